"""The motions of a pick and place as one program, from a crude guess or from planned ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from baxter_kin import Arm
from baxter_kin.arrays import Vector
from baxter_kin.frames import angle_between
from planner.choice import Choice
from planner.cycle import Cycle
from planner.lines import Lines
from planner.manipulator import Manipulator
from planner.motion.phases import LineTolerance, MotionTask, Phase
from planner.motion.program import MotionProgram
from planner.motion.splines import Sketch
from planner.rest_time import rest_to_rest_s
from planner.straight_line import StraightLine
from planner.trajectory import Trajectory

ENTRY, ACROSS = 20, 28
"""Intervals on the way to the first line, and between both lines."""

LEAST_ON_LINE, INTERVAL_M = 10, 0.011
"""Intervals on a line, and how long one may be, lest the tip leaves the line in between."""

MOST_ON_LINE = 80
"""Longer lines are left to others."""

AT_KNOTS = LineTolerance(2e-5, 5e-5)
"""How far the tip may be off its line at the knots: a fifth of what it may in between."""

PROMISED, LOOKS = LineTolerance(1e-4, math.radians(0.02)), 4
"""How far it may be off anywhere, and how often that is looked at in an interval; 0.9 of it counts,
for what is between two looks."""

BELOW_M = 1e-6
"""By so much the tip may sink, by rounding, where it shall not sink."""

STRIDE_RAD = 0.5
"""A joint that is farther from knot to knot of a line has jumped."""

SPEEDING, SPARE, REACTION = 0.75, 1.1, 0.3
"""How long guesses take: on lines that are left at speed, and between lines, times the fastest
motion from rest to rest; and between lines, times the durations of both, to turn round."""


class CycleProgram:
    """The program of one task, for any pair of solutions."""

    def __init__(self, manipulator: Manipulator, q_start: Vector, lines: Lines) -> None:
        """For an arm that stands somewhere."""
        self._manipulator = manipulator
        pick, place, end = lines.T_base_pick, lines.T_base_place, lines.T_base_end
        above_pick, above_place = lines.T_base_above_pick, lines.T_base_above_place
        pick_m, place_m = above_pick.translation[2], above_place.translation[2]
        start_m = manipulator.arm.T_base_tip(q_start).translation[2]
        ways = (pick, above_pick), (place, above_place), (place, end)
        self._task = MotionTask(
            q_start,
            tuple(StraightLine(*way) for way in ways),
            AT_KNOTS,
            (min(start_m, pick_m) - BELOW_M, min(pick_m, place_m)),
        )
        clear, hover = (_intervals(line.length_m) for line in self._task.lines[1:])
        self._intervals = ENTRY, clear, clear, ACROSS, clear, hover

    def near(self, cycle: Cycle) -> Cycle | None:
        """The fastest cycle near one; None where none is found."""
        motions = cycle.by_stage.values()
        pairs = zip(motions, self._intervals, strict=True)
        return self._solved([Sketch.of(motion, count) for motion, count in pairs])

    def of(self, choice: Choice) -> Cycle | None:
        """The fastest cycle near a pair of solutions; None where none is found."""
        sketches = self._sketched(choice)
        return None if sketches is None else self._solved(sketches)

    def _solved(self, sketches: Sequence[Sketch]) -> Cycle | None:
        if max(self._intervals) > MOST_ON_LINE:
            return None
        arm, limits = self._manipulator.arm, self._manipulator.limits
        found = _program(self._intervals).solve(sketches, self._task, arm, limits)
        if found is None:
            return None
        pick, place, end = self._task.lines
        to_pick, down_pick, up_pick, to_place, down_place, up_end = found
        straight = (pick, down_pick), (pick, up_pick), (place, down_place), (end, up_end)
        if not all(_is_straight(arm, line, motion) for line, motion in straight):
            return None
        return Cycle(to_pick, down_pick, up_pick, to_place, down_place, up_end)

    def _sketched(self, choice: Choice) -> list[Sketch] | None:
        """A guess: up the lines faster and faster, down as up, and smoothly from one to the next.

        None where the arm cannot be led along a line from its solution.
        """
        pick, place, end = self._task.lines
        up_pick = self._risen(choice.q_pick, pick, ends_at_rest=False)
        up_place = self._risen(choice.q_place, place, ends_at_rest=False)
        up_end = self._risen(choice.q_place, end, ends_at_rest=True)
        if up_pick is None or up_place is None or up_end is None:
            return None
        down_pick, down_place = _back(up_pick), _back(up_place)
        standing = Sketch(self._task.q_start[None], np.zeros((2, 7)), 0.0)
        to_pick = self._between(standing, down_pick, ENTRY)
        to_place = self._between(up_pick, down_place, ACROSS)
        return [to_pick, down_pick, up_pick, to_place, down_place, up_end]

    def _risen(self, q: Vector, line: StraightLine, *, ends_at_rest: bool) -> Sketch | None:
        """Along a line, from rest at a configuration; None where the arm cannot follow."""
        t = np.linspace(0.0, 1.0, 1 + _intervals(line.length_m))
        passed = t**3 * (10.0 - 15.0 * t + 6.0 * t**2) if ends_at_rest else t**2
        search, qs = self._manipulator.ik.search, [q]
        for s in passed[1:].tolist():
            found = search.search(qs[-1][None], line.at(s).homogeneous[None])
            if not found.is_valid[0] or np.abs(found.q[0] - qs[-1]).max() > STRIDE_RAD:
                return None
            qs.append(found.q[0])
        way, v_ends = np.array(qs), np.zeros((2, 7))
        duration_s = float(rest_to_rest_s(way[-1] - q, self._manipulator.limits))
        if not ends_at_rest:
            duration_s *= SPEEDING
            v_ends[1] = 2.0 * (way[-1] - way[-2]) / (passed[-1] - passed[-2]) / duration_s
        return Sketch(way, v_ends, duration_s)

    def _between(self, before: Sketch, after: Sketch, intervals: int) -> Sketch:
        """From the end of one motion to the start of another, by cubics."""
        q0, q1 = before.q[-1], after.q[0]
        v_ends = np.array([before.v_ends[1], after.v_ends[0]])
        duration_s = SPARE * float(rest_to_rest_s(q1 - q0, self._manipulator.limits))
        duration_s += REACTION * (before.duration_s + after.duration_s)
        t = np.linspace(0.0, 1.0, intervals + 1)[:, None]
        v0, v1 = v_ends * duration_s
        q = q0 + t * v0 + t**2 * (3.0 * (q1 - q0) - 2.0 * v0 - v1)
        return Sketch(q + t**3 * (v0 + v1 - 2.0 * (q1 - q0)), v_ends, duration_s)


def _back(sketch: Sketch) -> Sketch:
    return Sketch(sketch.q[::-1], -sketch.v_ends[::-1], sketch.duration_s)


def _intervals(length_m: float) -> int:
    """On a line; in steps, so that there are few programs."""
    needed = max(LEAST_ON_LINE, math.ceil(length_m / INTERVAL_M))
    return 2 * math.ceil(needed / 2) if needed <= 20 else 10 * math.ceil(needed / 10)


@lru_cache(maxsize=8)
def _program(intervals: tuple[int, ...]) -> MotionProgram:
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
        )
    )


def _is_straight(arm: Arm, line: StraightLine, motion: Trajectory) -> bool:
    """Whether the tip keeps to a line between the knots too."""
    looks = np.linspace(0.0, motion.duration, LOOKS * (len(motion.knots_s) - 1) + 1)
    off = np.array([_off(arm, line, q) for q in motion.sample(looks).q])
    return bool((off <= 0.9 * np.array(PROMISED)).all())


def _off(arm: Arm, line: StraightLine, q: Vector) -> tuple[float, float]:
    """How far the tip is from a line, m, and turned, rad."""
    T, way = arm.T_base_tip(q), line.twist[:3]
    s = float(way @ (T.translation - line.T_base_start.translation) / (way @ way))
    there = line.at(s)
    distance_m = float(np.linalg.norm(T.translation - there.translation))
    return distance_m, angle_between(T.rotation, there.rotation)
