"""Checks of a plan on an arm that lags behind its set-points.

The positions that its joints may have are bounded by independent code (`response_tube`). Clearance
there is proven by rows over boxes of joint angles: the prover finds them, and
`planner.certificate.boxes` checks them, for the clusters and pairs of the plan's own certificate.
Intended contacts are excluded, because a lagging hand is off its path; instead, the deviation of
its tip is bounded by the same lemma.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from baxter_kin.validation import FloatArray
from planner.certificate.boxes import Tube
from planner.certificate.robot import Robot
from planner.certificate.rows import Step
from planner.certificate.timeline import Timeline
from planner.motion.response import Response
from planner.plan import Move, Plan
from planner.verification.certificate import Check, Worst, greatest, least
from planner.verification.lag.response_tube import STEP_S, ResponseTube, response_tube
from planner.verification.lag.tubes import TubeDistances, path_of, tips_off

CLEARANCE, OFF_PATH, OFF_GOAL = (
    "tracking: clearance",
    "tracking: tip off its path",
    "tracking: tip off its goal",
)
"""Names of the checks."""

NO_MOVES = "no moves"

MAX_OFF_PATH_M = 0.05
"""Maximum distance of the tip from its path in moves with an intended contact, and from its goal
when all joints are settled. The planner allows 40 mm; the bound here includes the lag along the
path."""

START_RAD, SETTLED_RAD = 0.02, 0.0087
"""Maximum measured distance of the joints from a plan's start, and from their last set-points where
they count as settled."""

REST_RAD_S = 1e-6
"""A move whose final speed is below this ends at rest."""

TIP_S = 5e-3
"""Plan time covered by each box in which the tip is checked, s."""

SINCE_REST = "after it last rested"


def lag_checks(plan: Plan, timeline: Timeline | None, response: Response) -> Iterator[Check]:
    """Check clearance, and the deviation of the tip.

    Args:
        plan: the plan.
        timeline: of the same plan; None where the checker refuses to follow it, so that nothing is
            measured.
        response: how the arm follows its set-points, and how these are sent.
    """
    if timeline is None:
        yield Worst(np.nan, "the plan cannot be followed").above(0.0, CLEARANCE, "m")
        return
    yield from checks_of(list(_tracked(plan, timeline, response)))


def checks_of(found: Sequence[TrackedMove]) -> Iterator[Check]:
    """The checks of an arm whose moves have these worst values."""
    clearance = least((move.clearance for move in found), NO_MOVES)
    yield clearance.above(0.0, CLEARANCE, "m")
    off = greatest((move.off_path for move in found if move.off_path), "no intended contacts")
    yield off.at_most(MAX_OFF_PATH_M, OFF_PATH, "m")
    rests = greatest((move.off_goal for move in found if move.off_goal), NO_MOVES)
    yield rests.at_most(MAX_OFF_PATH_M, OFF_GOAL, "m")


@dataclass(frozen=True, slots=True)
class TrackedMove:
    """Worst values of one move.

    Attributes:
        clearance: the smallest distance at any position that the joints may have.
        off_path: maximum distance of the tip from its path; None without intended contacts.
        off_goal: maximum distance of the tip from its goal when all joints are settled; None where
            the arm does not rest.
    """

    clearance: Worst
    off_path: Worst | None
    off_goal: Worst | None


def _tracked(plan: Plan, timeline: Timeline, response: Response) -> Iterator[TrackedMove]:
    """The moves of a plan, with the arm somewhere in its tube."""
    error = response.settled_error_rad
    off_rad = START_RAD + error  # measurements have errors
    start = plan.q_start - off_rad, plan.q_start + off_rad
    clearances = Clearances(timeline)
    numbers = (number for number, step in enumerate(plan.steps) if isinstance(step, Move))
    for moves in _between_rests(plan.moves):
        motions = [move.trajectory for move in moves]
        tube = response_tube(motions, response, start, SETTLED_RAD)
        start = tube.next_start(SETTLED_RAD, error)
        path = np.concatenate([path_of(timeline.robot, motion) for motion in motions])
        for k, move in enumerate(moves):
            step = clearances.step_of(next(numbers))
            first, last = tube.steps_of(k)
            clearance, off_path, off_goal = Worst(np.inf, f"{move.label} takes no time"), None, None
            if step is not None:
                clearance = clearances.found(step, tube, (first, last), SINCE_REST)
                if any(pair.least_m < 0.0 for pair in step.pairs):
                    off_path = off_path_of(
                        timeline.robot, move.label, tube, (first, last), path, since=SINCE_REST
                    )
            if k == len(moves) - 1:
                settled = np.array([start[0] - error, start[1] + error])
                off_m = float(tips_off(timeline.robot, settled[None], path[-1:])[0])
                off_goal = Worst(off_m, move.label)
            yield TrackedMove(clearance, off_path, off_goal)


def _between_rests(moves: Sequence[Move]) -> Iterator[tuple[Move, ...]]:
    pending: list[Move] = []
    for move in moves:
        pending.append(move)
        if float(np.abs(move.trajectory.v[-1]).max()) < REST_RAD_S:
            yield tuple(pending)
            pending = []
    if pending:
        yield tuple(pending)


class Clearances:
    """Clearances in the moves of a plan, proven by rows."""

    def __init__(self, timeline: Timeline) -> None:
        self._distances = TubeDistances(timeline.robot, timeline.clusters)
        both = zip(timeline.steps, timeline.numbers, strict=True)
        self._steps = {number: step for step, number in both if step.motion is not None}

    def step_of(self, number: int) -> Step | None:
        """The pairs of a step of the plan that is a move; None if it takes no time."""
        return self._steps.get(number)

    def found(self, step: Step, tube: ResponseTube, span: tuple[int, int], since: str) -> Worst:
        """The smallest distance of a step's pairs in a span of a tube, or why none is proven."""
        pairs = [pair for pair in step.pairs if pair.is_counted]
        if not pairs:
            return Worst(np.inf, f"{step.label}, nothing to keep apart")
        some = slice(span[0], span[1] + 1)
        near = self._distances.least(pairs, Tube(tube.low[some], tube.high[some]))
        if near is None:
            return Worst(0.0, f"{step.label}, not shown, as it needs too many rows")
        when_s = tube.step_s * (span[0] + near.time_s)
        names = f"{pairs[near.pair].first.name} with {pairs[near.pair].second.name}"
        return Worst(near.distance_m, f"{step.label}, {when_s:.2f} s {since}, {names}")


def off_path_of(
    robot: Robot,
    label: str,
    tube: ResponseTube,
    span: tuple[int, int],
    path: FloatArray,
    *,
    since: str,
) -> Worst:
    """Maximum distance of the tip from the path between two ends of steps of a tube."""
    steps = max(1, round(TIP_S / STEP_S))
    starts = list(range(*span, steps))
    boxes = np.array([tube.hull(first, min(first + steps, span[1])) for first in starts])
    off_m = tips_off(robot, boxes, path)
    worst = int(off_m.argmax())
    when_s = tube.step_s * starts[worst]
    return Worst(float(off_m[worst]), f"{label}, {when_s:.2f} s {since}")
