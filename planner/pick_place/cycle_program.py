"""The motions of a pick and place as one program, from a crude guess or from planned ones."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np

from planner.collision.context import CollisionContext
from planner.motion.avoidance import LED_CLEAR_M, Motions, led_around
from planner.motion.guess import Followed, Way, along, backwards, between
from planner.motion.line_knots import at_knots, intervals_on, is_on_line
from planner.motion.program.clearance_rows import Clearances
from planner.motion.program.motion_program import MotionProgram
from planner.motion.program.phases import MotionTask, Phase
from planner.motion.straight_line import StraightLine
from planner.pick_place.candidates import CandidatePair
from planner.pick_place.cycle import MOVES, SIDEWAYS, Cycle
from planner.pick_place.task import PickAndPlace, PlanRequest
from planner.splines import Sketch

ENTRY, ACROSS = 14, 20
"""Intervals on the way to the first line, and between both lines."""

LED_ENTRY, LED_ACROSS = 20, 28
"""The same where the motion is led around obstacles, which takes more turns."""

LED_ON_LINE = 1.5
"""How many times as many intervals lines have where the arm is led around what it meets on one: an
elbow that swings aside takes the tip off the line between knots."""

LEAST_ON_LINE, MOST_ON_LINE, SHORTEST_LINE_M = 10, 80, 1e-4
"""Intervals on a line. Longer and shorter lines are left to others."""

BELOW_M = 1e-6
"""By so much the tip may sink, by rounding, where it shall not sink."""

RESTING: tuple[list[int], ...] = ([0], [-1], [0], [], [-1], [0, -1])
"""Where the arm rests in each motion: at its first or its last knot."""


class CycleProgram:
    """The program of one task, for any pair of solutions."""

    def __init__(self, request: PlanRequest, task: PickAndPlace, *, fineness: int = 1) -> None:
        """For an arm that stands somewhere.

        Args:
            request: the arm, where it stands, and how far its tip may be off its lines.
            task: what goes where.
            fineness: how many times as many intervals there are as usual.
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
            at_knots(self._tolerance),
            (min(start_m, pick_m) - BELOW_M, min(pick_m, place_m)),
        )
        clear, hover = (
            intervals_on(line, self._tolerance, LEAST_ON_LINE) for line in self._task.lines[1:]
        )
        usual = ENTRY, clear, clear, ACROSS, clear, hover
        led = LED_ENTRY, clear, clear, LED_ACROSS, clear, hover
        shortest_m = min(line.length_m for line in self._task.lines)
        self._is_usual = max(usual) <= MOST_ON_LINE and shortest_m >= SHORTEST_LINE_M
        self._intervals, self._led = ([fineness * n for n in counts] for counts in (usual, led))

    def near(self, cycle: Cycle) -> Cycle | None:
        """The fastest cycle near one; None where none is found."""
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
        """Cycles near one, clear or not, that are led around what is there; the last found first.

        Whether they are clear is for the caller to prove.

        Args:
            cycle: where to begin.
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
        for stage, sketch, resting in zip(MOVES, sketches, RESTING, strict=True):
            context = contexts[stage]
            free = [knot for knot in resting if context.is_free(sketch.q[knot])]
            if resting and not free:
                return []
            obstacles.append(context.obstacles(context.margin_m + LED_CLEAR_M, sketch.q[free]))
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
        found = program.solve(sketches, self._task, arm, limits, clearances)
        if found is None:
            return None
        pick, place, end = self._task.lines
        _, down_pick, up_pick, _, down_place, up_end = found
        straight = (pick, down_pick), (pick, up_pick), (place, down_place), (end, up_end)
        is_straight = all(is_on_line(arm, *each, self._tolerance) for each in straight)
        return found if is_straight else None

    def _sketched(self, pair: CandidatePair) -> list[Sketch] | None:
        """A guess: up the lines faster and faster, down as up, and smoothly from one to the next.

        None where the arm cannot be led along a line from its solution.
        """
        pick, place, end = self._task.lines
        entry, at_pick, _, across, at_place, at_end = self._intervals
        arm, limits = self._manipulator.arm, self._manipulator.limits
        up_pick = along(arm, limits, pair.q_pick, Way(pick, at_pick))
        up_place = along(arm, limits, pair.q_place, Way(place, at_place))
        up_end = along(arm, limits, pair.q_place, Way(end, at_end, ends_at_rest=True))
        if isinstance(up_pick, Followed) or isinstance(up_place, Followed):
            return None
        if isinstance(up_end, Followed):
            return None
        down_pick, down_place = backwards(up_pick), backwards(up_place)
        standing = Sketch(self._task.q_start[None], np.zeros((2, len(limits.names))), 0.0)
        to_pick = between(standing, down_pick, limits, entry)
        to_place = between(up_pick, down_place, limits, across)
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
