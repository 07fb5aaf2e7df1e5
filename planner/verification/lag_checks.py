"""Checks of a plan on an arm that lags behind its set-points.

The positions that its joints may have are bounded by independent code (`response_tube`). Clearance
there is proven by rows over boxes of joint angles: the prover finds them, and
`planner.certificate.boxes` checks them, for the clusters and pairs of the plan's own certificate.
Intended contacts are excluded, as the hand is off its path; the deviation of its tip is bounded by
the same lemma.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from planner.certificate.boxes import Tube, box_gaps_m, box_rows
from planner.certificate.intervals import norm_bound
from planner.certificate.robot import ARM_JOINTS, Robot
from planner.certificate.rows import Pair, Step
from planner.certificate.timeline import Timeline
from planner.motion.response import Response
from planner.plan import Move, Plan
from planner.prover.kernel import Trees, rows_kernel
from planner.prover.numpy_boxes import search_tube
from planner.prover.problem import SHARES, BoxesFound, Chain, Outcome
from planner.verification.certificate import Check, Worst, greatest, least
from planner.verification.response_tube import (
    STEP_S,
    ResponseTube,
    positions,
    response_tube,
)

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

PATH_S, TIP_S = 2e-3, 5e-3
"""Plan time between two points of a path, and of a box in which the tip is checked."""


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
    found = list(_tracked(plan, timeline, response))
    clearance = least((move.clearance for move in found), NO_MOVES)
    yield clearance.above(0.0, CLEARANCE, "m")
    off = greatest((move.off_path for move in found if move.off_path), "no intended contacts")
    yield off.at_most(MAX_OFF_PATH_M, OFF_PATH, "m")
    rests = greatest((move.off_goal for move in found if move.off_goal), NO_MOVES)
    yield rests.at_most(MAX_OFF_PATH_M, OFF_GOAL, "m")


@dataclass(frozen=True, slots=True)
class _TrackedMove:
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


def _tracked(plan: Plan, timeline: Timeline, response: Response) -> Iterator[_TrackedMove]:
    """The moves of a plan, with the arm somewhere in its tube."""
    error = response.settled_error_rad
    off_rad = START_RAD + error  # measurements have errors
    start = plan.q_start - off_rad, plan.q_start + off_rad
    clearances = _Clearances(timeline)
    numbers = (number for number, step in enumerate(plan.steps) if isinstance(step, Move))
    for moves in _between_rests(plan.moves):
        tube = response_tube(moves, response, start, SETTLED_RAD)
        start = tube.next_start(SETTLED_RAD, error)
        path = np.concatenate([_path(timeline.robot, move) for move in moves])
        for k, move in enumerate(moves):
            step = clearances.step_of(next(numbers))
            first, last = tube.steps_of(k)
            clearance, off_path, off_goal = Worst(np.inf, f"{move.label} takes no time"), None, None
            if step is not None:
                clearance = clearances.found(step, tube, (first, last))
                if any(pair.least_m < 0.0 for pair in step.pairs):
                    off_path = _off_path(timeline.robot, move, tube, (first, last), path)
            if k == len(moves) - 1:
                settled = np.array([start[0] - error, start[1] + error])
                off_m = float(_tips_off(timeline.robot, settled[None], path[-1:])[0])
                off_goal = Worst(off_m, move.label)
            yield _TrackedMove(clearance, off_path, off_goal)


def _between_rests(moves: Sequence[Move]) -> Iterator[tuple[Move, ...]]:
    pending: list[Move] = []
    for move in moves:
        pending.append(move)
        if float(np.abs(move.trajectory.v[-1]).max()) < REST_RAD_S:
            yield tuple(pending)
            pending = []
    if pending:
        yield tuple(pending)


class _Clearances:
    """Clearances in the moves of a plan, proven by rows."""

    def __init__(self, timeline: Timeline) -> None:
        self._robot, self._clusters = timeline.robot, timeline.clusters
        self._chain = Chain.of(timeline.robot)
        kernel = rows_kernel()
        self._trees = None if kernel is None else Trees.of(kernel, timeline.clusters)
        both = zip(timeline.steps, timeline.numbers, strict=True)
        self._steps = {number: step for step, number in both if step.motion is not None}

    def step_of(self, number: int) -> Step | None:
        """The pairs of a step of the plan that is a move; None if it takes no time."""
        return self._steps.get(number)

    def found(self, step: Step, tube: ResponseTube, span: tuple[int, int]) -> Worst:
        """The smallest distance between two ends of steps of a tube, or why none is shown."""
        pairs = [pair for pair in step.pairs if pair.is_counted]
        if not pairs:
            return Worst(np.inf, f"{step.label}, nothing to keep apart")
        some = slice(span[0], span[1] + 1)
        box = Tube(tube.low[some], tube.high[some])

        def worst(value_m: float, pair: int, instant: float) -> Worst:
            when_s = tube.step_s * (span[0] + instant)
            names = f"{pairs[pair].first.name} with {pairs[pair].second.name}"
            return Worst(value_m, f"{step.label}, {when_s:.2f} s after it last rested, {names}")

        found = self._sought(step, pairs, box)
        if found.outcome == Outcome.TOO_MUCH:
            return Worst(0.0, f"{step.label}, not shown, as it needs too many rows")
        if found.outcome != Outcome.PROVEN:
            pair, distance_m, instant = found.stopped
            return worst(min(distance_m, 0.0), pair, instant)
        rows, n = box_rows(self._clusters, pairs, box, found.trace)
        gaps_m = box_gaps_m(self._robot, self._clusters, pairs, rows, n)
        least = int(gaps_m.argmin())
        middle = 0.5 * float(rows.start[least] + rows.end[least])
        return worst(float(gaps_m[least]), int(rows.pair[least]), middle)

    def _sought(self, step: Step, pairs: Sequence[Pair], tube: Tube) -> BoxesFound:
        kernel = rows_kernel()
        if kernel is None or self._trees is None:
            return search_tube(self._robot, self._clusters, pairs, tube)
        there = self._trees, self._trees.pairs(evolve(step, pairs=pairs)), tube
        for share in SHARES:
            found = kernel.search_tube(self._chain, *there, share=share)
            if found.outcome in (Outcome.PROVEN, Outcome.TOO_NEAR):
                break
        return found


def _path(robot: Robot, move: Move) -> FloatArray:
    """Positions of the tip along a move, closely spaced, shape (k, 3), m."""
    end_s = float(move.trajectory.knots_s[-1])
    times_s = np.linspace(0.0, end_s, 2 + int(end_s / PATH_S))
    return _tips(robot, positions(move.trajectory, times_s)[0][:, None])[:, 0]


def _off_path(
    robot: Robot, move: Move, tube: ResponseTube, span: tuple[int, int], path: FloatArray
) -> Worst:
    """Maximum distance of the tip from the path between two ends of steps of a tube."""
    steps = max(1, round(TIP_S / STEP_S))
    starts = list(range(*span, steps))
    boxes = np.array([tube.hull(first, min(first + steps, span[1])) for first in starts])
    off_m = _tips_off(robot, boxes, path)
    worst = int(off_m.argmax())
    when_s = tube.step_s * starts[worst]
    return Worst(float(off_m[worst]), f"{move.label}, {when_s:.2f} s after it last rested")


def _tips_off(robot: Robot, boxes: FloatArray, path: FloatArray) -> FloatArray:
    """Maximum distance of the tip from the nearest point of a path, in each box, shape (m,), m.

    Along any unit vector the tip's position is c + A cos q + B sin q as a function of any one joint
    q, so its distance is at most the greatest at the corners plus the sag of the lemma.

    Args:
        robot: the robot.
        boxes: lowest and highest angles of the joints, shape (m, 2, 7), rad.
        path: points, shape (k, 3), m.
    """
    tips = _tips(robot, boxes)
    middles = tips.mean(axis=1)
    nearest = np.array([path[np.linalg.norm(path - x, axis=1).argmin()] for x in middles])
    off_m: FloatArray = np.linalg.norm(tips - nearest[:, None], axis=2).max(axis=1)
    rho = float(norm_bound(robot.tip.p.magnitude)) + np.append(
        np.cumsum(robot.offsets[:0:-1])[::-1], 0
    )
    off_m += (np.ptp(boxes, axis=1) ** 2 @ rho) / 8.0
    return off_m


def _tips(robot: Robot, choices: FloatArray) -> FloatArray:
    """Positions of the tip for all combinations of c angles of each joint.

    Args:
        robot: the robot.
        choices: the angles, shape (m, c, 7), rad.

    Returns:
        Shape (m, c^7, 3), m.
    """
    points = np.broadcast_to(robot.tip.p.centred()[0], (len(choices), 1, 3))
    for joint in range(ARM_JOINTS - 1, -1, -1):
        span, q = robot.spans[joint], choices[:, :, joint, None]
        x, y, z = (points[:, None, :, i] for i in range(3))
        c, s = np.cos(q), np.sin(q)
        turned = np.stack(
            [c * x - s * y, s * x + c * y, np.broadcast_to(z, (c * x).shape)], axis=-1
        )
        points = turned.reshape(len(choices), -1, 3) @ span.R.centred()[0].T + span.p.centred()[0]
    return points
