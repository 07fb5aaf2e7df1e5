"""Checks of a plan on an arm that follows its set-points late.

Where its joints may be is found by code of its own (`response_tube`), and so is what keeps clear
there (`box_distances`), of the shapes, the pairs and the story that all other checks are of. What
may touch on purpose is left out, as the hand is off its path; how far is checked, of the tip.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np

from baxter_kin.description import RobotDescription
from baxter_kin.validation import FloatArray, Indices
from planner.certificate.timeline import PRESS_M
from planner.motion.response import Response
from planner.plan import Move, Plan
from planner.verification.body.distances import SolidDistances, SolidPair
from planner.verification.body.robot_body import robot_body
from planner.verification.body.stretch import IN_HAND, Section
from planner.verification.body.stretches import TRAVELS_M, Stretches
from planner.verification.certificate import Check, Worst, greatest, least
from planner.verification.fingers import Fingers
from planner.verification.motion.cubics import Cubics
from planner.verification.story import Run, Stage, Story
from planner.verification.tracking.box_distances import BoxDistances
from planner.verification.tracking.response_tube import STEP_S, ResponseTube, response_tube
from planner.verification.urdf_robot import UrdfRobot

AngleRange: TypeAlias = tuple[FloatArray, FloatArray]
"""Lowest and highest positions, each of shape (7,), rad."""

NO_MOVES = "no moves"

OFF_PATH_M = 0.05
"""How far the tip of an arm that follows late may be off its path where it touches something on
purpose, and off its goal when it is settled. The planner allows 40 mm; the bound here counts as
well what the arm lags along its path."""

START_RAD, SETTLED_RAD = 0.02, 0.0087
"""How far joints are measured from a plan's start at most, and how far from their last set-points
where they are settled."""

REST_RAD_S = 1e-6
"""A move that ends slower than this ends at rest."""

FAR_M = 0.2
"""Clearances are not told apart beyond."""

FIRST_BOXES, HALVED = 16, 24
"""How many boxes a move is cut into at first, and how many are halved in a round."""

LEAST_ROUNDS, MOST_ROUNDS = 2, 16
"""How often they are halved to make bounds tighter, and where some are not enough."""

PATH_S, TIP_S = 2e-3, 5e-3
"""Of plan time: between two points of a path, and how long a box is where the tip is looked at."""


@dataclass(frozen=True, slots=True)
class _TrackedMove:
    """What was found of one move.

    Attributes:
        clearance: the least distance wherever the joints may be.
        off_path: how far the tip may be off its path; None where nothing is touched on purpose.
        off_goal: how far it may be off its goal when all joints are settled; None where it does not
            rest.
    """

    clearance: Worst
    off_path: Worst | None
    off_goal: Worst | None


def lag_checks(
    plan: Plan, description: RobotDescription, straight: Collection[str], response: Response
) -> Iterator[Check]:
    """Checks of a plan on an arm that follows late.

    Raises:
        DescriptionError: when the meshes of the robot cannot be read.
    """
    robot = UrdfRobot(description, plan.limb)
    standing = robot.standing(plan.start.joints)
    solids = robot_body(description).solids
    story = Story(plan, plan.start, robot, Fingers(robot, solids))
    stretches = Stretches(robot, solids, standing, story.elsewhere, straight)
    follower = Follower(robot, standing, stretches, response)
    yield from tracking_checks(list(tracked(story.stages, follower)))


def tracking_checks(found: Sequence[_TrackedMove]) -> Iterator[Check]:
    """Clearance, and where the tip may be."""
    clearance = least((move.clearance for move in found), NO_MOVES)
    yield clearance.above(0.0, "tracking: clearance", "m")
    off = greatest(
        (move.off_path for move in found if move.off_path), "nothing is touched on purpose"
    )
    yield off.at_most(OFF_PATH_M, "tracking: tip off its path", "m")
    rests = greatest((move.off_goal for move in found if move.off_goal), NO_MOVES)
    yield rests.at_most(OFF_PATH_M, "tracking: tip off its goal", "m")


class Follower(NamedTuple):
    """An arm that follows late, in its surroundings.

    Attributes:
        robot: whose arm moves.
        standing: a full configuration, which says where all other joints stand.
        stretches: of the robot.
        response: how the arm follows.
    """

    robot: UrdfRobot
    standing: FloatArray
    stretches: Stretches
    response: Response


def tracked(stages: Iterable[Stage], follower: Follower) -> Iterator[_TrackedMove]:
    """Follow an arm along the moves of a plan.

    Args:
        stages: of the plan's story.
        follower: the arm.
    """
    start: AngleRange | None = None
    response, error = follower.response, follower.response.settled_error_rad
    for stage in stages:
        if not isinstance(stage, Run) or not stage.moves:
            continue
        if start is None:
            off_rad = START_RAD + error  # what is measured has errors
            start = stage.q_start - off_rad, stage.q_start + off_rad
        survey = _TrackedRun(stage, follower)
        for moves in _between_rests(stage.moves):
            tube = response_tube(moves, response, start, SETTLED_RAD)
            yield from survey.moves(moves, tube)
            start = tube.next_start(SETTLED_RAD, error)


def _between_rests(moves: Sequence[Move]) -> Iterator[tuple[Move, ...]]:
    pending: list[Move] = []
    for move in moves:
        pending.append(move)
        if float(np.abs(move.trajectory.v[-1]).max()) < REST_RAD_S:
            yield tuple(pending)
            pending = []
    if pending:
        yield tuple(pending)


@dataclass(frozen=True, slots=True, eq=False)
class _Box:
    """Angles of the arm's joints between the ends of two steps of a tube, and pairs."""

    first: int
    last: int
    low: FloatArray
    high: FloatArray
    pairs: Indices


class _TrackedRun:
    """Moves between two actions of the fingers."""

    def __init__(self, run: Run, follower: Follower) -> None:
        self._error = follower.response.settled_error_rad
        self._robot, self._standing = follower.robot, follower.standing
        self._stretch = follower.stretches.of_run(run, TRAVELS_M[0])
        self._pairs = follower.stretches.pairs_of_run(run, self._stretch)
        self._planned = SolidDistances(self._robot, self._stretch, self._pairs)
        self._boxes = BoxDistances(self._robot, self._pairs, self._standing, run.finger_m)
        self._sections = {id(section.step): section for section in self._stretch.sections}

    def moves(self, moves: Sequence[Move], tube: ResponseTube) -> Iterator[_TrackedMove]:
        """What is found of moves that only the last of ends at rest."""
        path = self._path(moves)
        for number, move in enumerate(moves):
            span = tube.steps_of(number)
            touched = self._touched(self._sections[id(move)])
            counted = np.setdiff1d(np.arange(len(self._pairs)), touched)
            off_path = off_goal = None
            if len(touched):
                off_path = self._off(move, tube, span, path)
            if number == len(moves) - 1:
                low, high = tube.next_start(SETTLED_RAD, self._error)
                settled = low - self._error, high + self._error
                off_goal = self._off_goal(move, settled, path[-1:])
            yield _TrackedMove(self._clearance(move, tube, span, counted), off_path, off_goal)

    def _touched(self, section: Section) -> Indices:
        """The pairs that may touch on purpose, and the palm with what its fingers may touch."""
        numbers = [
            number
            for number, pair in enumerate(self._pairs)
            if self._may_touch(section, pair, number)
        ]
        return np.array(numbers, dtype=np.intp)

    def _may_touch(self, section: Section, pair: SolidPair, number: int) -> bool:
        if pair.body is None:
            return not pair.is_stated and pair.second.name in section.touched
        if pair.first.joint != IN_HAND:
            return pair.body in section.touched
        near_m = PRESS_M
        ends = [section.first] * section.is_taken + [section.last] * section.is_put_down
        return any(self._planned.shapes_apart(number, end, 2 * near_m) <= near_m for end in ends)

    def _clearance(
        self, move: Move, tube: ResponseTube, span: tuple[int, int], pairs: Indices
    ) -> Worst:
        """The least bound, once boxes in which it is least have been halved some times."""
        cuts = np.unique(np.linspace(*span, FIRST_BOXES + 1).astype(np.intp)).tolist()
        new = [_Box(a, b, *tube.hull(a, b), pairs) for a, b in pairwise(cuts)]
        known: list[tuple[float, int, _Box]] = []
        for number in range(MOST_ROUNDS):
            known += self._bounded(new)
            known.sort(key=lambda each: each[0])
            least_m = known[0][0]
            if number >= LEAST_ROUNDS and least_m > 0.0:
                break
            if number < MOST_ROUNDS - 1:
                parted, known = known[:HALVED], known[HALVED:]
                new = [half for *_, box in parted for half in self._halves(tube, box)]
        least_m, pair, box = known[0]
        if pair < 0:
            return Worst(least_m, f"{move.label}, nothing within {FAR_M:g} m")
        when_s = tube.step_s * (box.first + box.last) / 2
        where = f"{move.label}, {when_s:.2f} s after it last rested, {self._pairs[pair]}"
        return Worst(least_m, where)

    def _bounded(self, boxes: Sequence[_Box]) -> Iterator[tuple[float, int, _Box]]:
        """Boxes with their least bound and its pair, if any; those far apart count no more."""
        lows, highs = (np.array([getattr(box, name) for box in boxes]) for name in ("low", "high"))
        found = self._boxes.least(lows, highs, [box.pairs for box in boxes], FAR_M)
        for box, bounds in zip(boxes, found, strict=True):
            near = bounds < FAR_M
            if near.any():
                pair = int(box.pairs[bounds.argmin()])
                yield float(bounds.min()), pair, replace(box, pairs=box.pairs[near])
            else:
                yield FAR_M, -1, replace(box, pairs=box.pairs[near])

    def _halves(self, tube: ResponseTube, box: _Box) -> Iterator[_Box]:
        """In time, where that makes them smaller; else across the joint that reaches farthest."""
        reach = (box.high - box.low) * self._robot.tip_reach_m
        middle = (box.first + box.last) // 2
        at_once = (tube.high[middle] - tube.low[middle]) * self._robot.tip_reach_m
        if box.last - box.first > 1 and float(np.maximum(reach - at_once, 0.0).sum()) > reach.max():
            for first, last in ((box.first, middle), (middle, box.last)):
                low, high = tube.hull(first, last)
                low, high = np.maximum(low, box.low), np.minimum(high, box.high)
                if (low <= high).all():
                    yield _Box(first, last, low, high, box.pairs)
            return
        joint = int(reach.argmax())
        low, high = np.array(box.low), np.array(box.high)
        low[joint] = high[joint] = (box.low[joint] + box.high[joint]) / 2
        yield replace(box, high=high)
        yield replace(box, low=low)

    def _off(
        self, move: Move, tube: ResponseTube, span: tuple[int, int], path: FloatArray
    ) -> Worst:
        """How far the tip may be off the path."""
        steps = max(1, round(TIP_S / STEP_S))
        starts = list(range(*span, steps))
        boxes = [tube.hull(first, min(first + steps, span[1])) for first in starts]
        lows, highs = (np.array(corners) for corners in zip(*boxes, strict=True))
        off_m = self._boxes.tips_off(lows, highs, path)
        worst = int(off_m.argmax())
        when_s = tube.step_s * starts[worst]
        where = f"{move.label}, {when_s:.2f} s after it last rested"
        return Worst(float(off_m[worst]), where)

    def _off_goal(self, move: Move, start: AngleRange, goal: FloatArray) -> Worst:
        """How far it may be off its goal when the next step begins."""
        off_m = self._boxes.tips_off(start[0][None], start[1][None], goal)
        return Worst(float(off_m[0]), move.label)

    def _path(self, moves: Sequence[Move]) -> FloatArray:
        """Points of the tip on the way, close together, shape (k, 3), m."""
        points = []
        for cubics in (Cubics(move.trajectory) for move in moves):
            count = 2 + int(cubics.duration_s / PATH_S)
            qs = cubics.positions(np.linspace(0.0, cubics.duration_s, count))
            points += [self._robot.T_base_tip(self._standing, q).translation for q in qs]
        return np.array(points)
