"""The motions of a pick and place: as one program, or with a stop above pick and place."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from baxter_kin.validation import FloatArray
from planner.collision.context import CollisionContext
from planner.errors import MotionError
from planner.motion.program.guess import LineFollowed, guess_along, guess_between, reversed_sketch
from planner.motion.program.motion_program import EXTRA_MARGIN_M, MotionProgram, Motions, led_around
from planner.motion.program.rows import Clearances
from planner.motion.program.unknowns import MotionTask, Phase
from planner.motion.straight_line import StraightLine, intervals_of, is_on_line, knot_tolerance
from planner.motion.straight_move import plan_straight_move
from planner.pick_place.candidates import CandidatePair
from planner.pick_place.plan_builder import NoSolutionError, ProvenMotion, free_motion, proven
from planner.pick_place.task import MOVES, SIDEWAYS, PickAndPlace, PlanRequest
from planner.splines import Sketch
from planner.trajectory import Trajectory

ENTRY, ACROSS = 14, 20
"""Number of intervals on the way to the first line, and between both lines."""

LED_ENTRY, LED_ACROSS = 20, 28
"""These numbers for motions around obstacles, which have more turns."""

LED_ON_LINE = 1.5
"""Factor of the number of intervals on lines where the arm avoids a collision on one: an elbow that
swings aside moves the tip off the line between knots."""

MIN_ON_LINE, MAX_ON_LINE, MIN_LINE_M = 10, 80, 1e-4
"""Bounds of the number of intervals on a line, and of its length. Other lines are planned one by
one."""

HEIGHT_TOLERANCE_M = 1e-6
"""Rounding allowed where the tip must not sink."""

TIMEOUT_S = 2.0
"""Maximum duration of the search for one path; a wall on the table takes a tenth of a second."""

RESTING_KNOTS: tuple[list[int], ...] = ([0], [-1], [0], [], [-1], [0, -1])
"""The knots, first or last, at which the arm rests in each motion."""


class CycleProgram:
    """The program of one task, for any pair of solutions."""

    def __init__(self, request: PlanRequest, task: PickAndPlace, *, fineness: int = 1) -> None:
        """State the task.

        Args:
            request: the arm, its initial configuration, and the tolerance of its lines.
            task: what goes where.
            fineness: multiplies the number of intervals.
        """
        self._manipulator, self._tolerance = request.manipulator, request.line_tolerance
        pick, place, end = task.T_base_pick, task.T_base_place, task.T_base_end
        above_pick, above_place = task.T_base_above_pick, task.T_base_above_place
        pick_m, place_m = above_pick.translation[2], above_place.translation[2]
        start_m = self._manipulator.arm.T_base_tip(request.q_start).translation[2]
        ways = (pick, above_pick), (place, above_place), (place, end)
        self._task = MotionTask(
            request.q_start,
            tuple(StraightLine(*way) for way in ways),
            knot_tolerance(self._tolerance),
            (min(start_m, pick_m) - HEIGHT_TOLERANCE_M, min(pick_m, place_m)),
        )
        clear, hover = (
            intervals_of(line, self._tolerance, MIN_ON_LINE) for line in self._task.pieces[1:]
        )
        usual = ENTRY, clear, clear, ACROSS, clear, hover
        led = LED_ENTRY, clear, clear, LED_ACROSS, clear, hover
        shortest_m = min(line.length_m for line in self._task.pieces)
        self._is_usual = max(usual) <= MAX_ON_LINE and shortest_m >= MIN_LINE_M
        self._intervals, self._led = ([fineness * n for n in counts] for counts in (usual, led))

    def near(self, cycle: Cycle) -> Cycle | None:
        """The fastest cycle near another one; None where none is found."""
        if not self._is_usual:
            return None
        return self._solved(Sketch.of_each(cycle, self._intervals))

    def of(self, pair: CandidatePair) -> Cycle | None:
        """The fastest cycle near a pair of solutions; None where none is found."""
        sketches = self._sketched(pair) if self._is_usual else None
        return None if sketches is None else self._solved(sketches)

    def around(
        self, cycle: Cycle, contexts: Mapping[str, CollisionContext], *, on_lines: bool = False
    ) -> list[Cycle]:
        """Cycles near one that are led around obstacles; the last found first.

        The caller proves whether they are clear.

        Args:
            cycle: the initial guess, clear or not.
            contexts: of each stage, by its label.
            on_lines: whether it collides on a line.
        """
        if not self._is_usual:
            return []
        finer = LED_ON_LINE if on_lines else 1.0
        intervals = [
            n if stage in SIDEWAYS else math.ceil(finer * n)
            for stage, n in zip(MOVES, self._led, strict=True)
        ]
        sketches = Sketch.of_each(cycle, intervals)
        obstacles = []
        for stage, sketch, resting in zip(MOVES, sketches, RESTING_KNOTS, strict=True):
            context = contexts[stage]
            free = [knot for knot in resting if context.is_free(sketch.q[knot])]
            if resting and not free:
                return []
            obstacles.append(context.obstacles(context.margin_m + EXTRA_MARGIN_M, sketch.q[free]))
        return [Cycle(*motions) for motions in led_around(self._motions, obstacles, sketches)]

    def _solved(self, sketches: Sequence[Sketch]) -> Cycle | None:
        motions = self._motions(sketches)
        return None if motions is None else Cycle(*motions)

    def _motions(
        self, sketches: Sequence[Sketch], clearances: Clearances | None = None
    ) -> Motions | None:
        arm, limits = self._manipulator.arm, self._manipulator.limits
        intervals = tuple(sketch.intervals for sketch in sketches)
        program = _program(intervals, len(limits.names))
        motions = program.solve(sketches, self._task, arm, limits, clearances)
        if motions is None:
            return None
        pick, place, end = self._task.pieces
        _, down_pick, up_pick, _, down_place, up_end = motions
        straight = (pick, down_pick), (pick, up_pick), (place, down_place), (end, up_end)
        is_straight = all(is_on_line(arm, *each, self._tolerance) for each in straight)
        return motions if is_straight else None

    def _sketched(self, pair: CandidatePair) -> list[Sketch] | None:
        """A guess: up the lines while accelerating, down in reverse, and smoothly in between.

        None where the arm cannot follow a line from its solution.
        """
        pick, place, end = self._task.pieces
        entry, at_pick, _, across, at_place, at_end = self._intervals
        arm, limits = self._manipulator.arm, self._manipulator.limits
        up_pick = guess_along(arm, limits, pair.q_pick, pick, at_pick)
        up_place = guess_along(arm, limits, pair.q_place, place, at_place)
        up_end = guess_along(arm, limits, pair.q_place, end, at_end, ends_at_rest=True)
        if isinstance(up_pick, LineFollowed) or isinstance(up_place, LineFollowed):
            return None
        if isinstance(up_end, LineFollowed):
            return None
        down_pick, down_place = reversed_sketch(up_pick), reversed_sketch(up_place)
        standing = Sketch(self._task.q_start[None], np.zeros((2, len(limits.names))), 0.0)
        to_pick = guess_between(standing, down_pick, limits, entry)
        to_place = guess_between(up_pick, down_place, limits, across)
        return [to_pick, down_pick, up_pick, to_place, down_place, up_end]


@lru_cache(maxsize=8)
def _program(intervals: tuple[int, ...], joints: int) -> MotionProgram:
    entry, down_pick, up_pick, across, down_place, up_end = intervals
    down, up = (1.0, 0.0), (0.0, 1.0)
    return MotionProgram(
        (
            Phase(entry),
            Phase(down_pick, 0, down, rests=True),
            Phase(up_pick, 0, up),
            Phase(across),
            Phase(down_place, 1, down, rests=True),
            Phase(up_end, 2, up, rests=True),
        ),
        joints,
    )


class Cycle(NamedTuple):
    """The motions in the order of `MOVES`, from rest to rest where the gripper acts.

    Attributes:
        to_pick: to the line above the pick.
        down_to_pick: down that line, to rest.
        up_from_pick: up again.
        to_place: to the line above the place.
        down_to_place: down that line, to rest.
        up_from_place: up to the end of the cycle.
    """

    to_pick: Trajectory
    down_to_pick: Trajectory
    up_from_pick: Trajectory
    to_place: Trajectory
    down_to_place: Trajectory
    up_from_place: Trajectory

    @property
    def by_stage(self) -> dict[str, Trajectory]:
        """The motions by the labels of their moves."""
        return dict(zip(MOVES, self, strict=True))

    @property
    def q_pick(self) -> FloatArray:
        """The configuration at the pick, shape (7,), rad."""
        return self.down_to_pick.q_goal

    @property
    def q_place(self) -> FloatArray:
        """The configuration at the place, shape (7,), rad."""
        return self.down_to_place.q_goal

    @property
    def duration_s(self) -> float:
        """Total duration."""
        return sum(motion.duration for motion in self)


class StoppingCycles:
    """Cycles that stop above pick and place; lines are planned once for each solution."""

    def __init__(
        self, request: PlanRequest, task: PickAndPlace, contexts: Mapping[str, CollisionContext]
    ) -> None:
        """Store a task, with the collision context of each stage by its label."""
        self._request, self._task, self._contexts = request, task, contexts
        self._planned: dict[tuple[str, bytes], Trajectory | NoSolutionError] = {}

    def of(self, q_pick: FloatArray, q_place: FloatArray) -> tuple[Cycle, dict[str, ProvenMotion]]:
        """The motions for a pair of solutions, and those of them that are proven, by stage.

        Between the lines the arm moves around obstacles.
        """
        task, contexts, q_start = self._task, self._contexts, self._request.q_start
        up_pick = self._line("pick: retract", q_pick, task.T_base_above_pick)
        up_place = self._line("place: descend", q_place, task.T_base_above_place)
        up_end = self._line("place: retract", q_place, task.T_base_end)
        down_pick, down_place = up_pick.reversed(), up_place.reversed()
        motions = {
            stage: proven(stage, motion, contexts[stage])
            for stage, motion in (
                ("pick: descend", down_pick),
                ("place: descend", down_place),
                ("place: retract", up_end),
            )
        }
        for stage, ends in (
            ("pick: approach", (q_start, down_pick.q_start)),
            ("place: approach", (up_pick.q_goal, down_place.q_start)),
        ):
            manipulator, context = self._request.manipulator, contexts[stage]
            motions[stage] = free_motion(stage, ends, manipulator, context, TIMEOUT_S)
        to_pick, to_place = (motions[stage].trajectory for stage in SIDEWAYS)
        return Cycle(to_pick, down_pick, up_pick, to_place, down_place, up_end), motions

    def _line(self, stage: str, q: FloatArray, T_base_top: pin.SE3) -> Trajectory:
        key = stage, q.tobytes()
        if key not in self._planned:
            arm, limits = self._request.manipulator.arm, self._request.manipulator.limits
            tolerance = self._request.line_tolerance
            try:
                self._planned[key] = plan_straight_move(
                    arm, q, T_base_top, limits, line_tolerance=tolerance
                )
            except MotionError as cause:
                self._planned[key] = NoSolutionError.at(stage, str(cause))
        motion = self._planned[key]
        if isinstance(motion, NoSolutionError):
            raise motion
        return motion
