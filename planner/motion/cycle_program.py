"""The motions of a pick and place as one program, from a crude guess or from planned ones."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache

import numpy as np

from baxter_kin import Arm
from baxter_kin.arrays import Vector
from baxter_kin.frames import angle_between
from planner.choice import Choice
from planner.cycle import Cycle
from planner.lines import Lines
from planner.manipulator import Manipulator
from planner.motion.guess import Way, backwards, between, risen
from planner.motion.obstacles import LinearBounds, Obstacles
from planner.motion.phases import LineTolerance, MotionTask, Phase
from planner.motion.program import Clearances, MotionProgram, fraction
from planner.motion.splines import Sketch
from planner.straight_line import StraightLine
from planner.surroundings import Surroundings
from planner.trajectory import Trajectory

ENTRY, ACROSS = 20, 28
"""Intervals on the way to the first line, and between both lines."""

LEAST_ON_LINE, INTERVAL_M = 10, 0.011
"""Intervals on a line, and their greatest mean length, lest the tip leaves the line in between."""

MOST_ON_LINE, SHORTEST_LINE_M = 80, 1e-4
"""Longer and shorter lines are left to others."""

AT_KNOTS = LineTolerance(2e-5, 5e-5)
"""How far the tip may be off its line at the knots, along and about each axis: a fifth and a
seventh of what it may be off anywhere."""

PROMISED, LOOKS = LineTolerance(1e-4, math.radians(0.02)), 4
"""How far it may be off anywhere, and how often that is looked at in an interval; 0.9 of it counts,
for what is between two looks."""

BELOW_M = 1e-6
"""By so much the tip may sink, by rounding, where it shall not sink."""

RESTING = {
    "pick: approach": [0],
    "pick: descend": [-1],
    "pick: retract": [0],
    "place: approach": [],
    "place: descend": [-1],
    "place: retract": [0, -1],
}
"""Where the arm rests in each stage: at its first or its last knot."""

LED_CLEAR_M, SHORT_OF_M = 0.005, 0.002
"""What is kept of obstacles beside what is asked for, and by how much a motion that is tried may
fall short of it: distances are bounded at some times, and those of hulls."""

ROUNDS, TRUST_RAD, LESS_TRUST = 10, 0.4, 0.7
"""How often bounds are taken anew, how far a control may be led from where they were, and how much
less each time from half of the rounds on."""

BY_ROUND, MOST_FAILURES, SETTLED = 5, 1, 3e-3
"""A motion that is not clear after so many rounds, or had no solution more often than that, is
given up; one that is clear and whose duration changes by less than this share is good enough."""


class CycleProgram:
    """The program of one task, for any pair of solutions."""

    def __init__(
        self, manipulator: Manipulator, q_start: Vector, lines: Lines, *, fineness: int = 1
    ) -> None:
        """For an arm that stands somewhere.

        Args:
            manipulator: the arm and its hand.
            q_start: where it stands, shape (7,), rad.
            lines: where the cycle leads the tip.
            fineness: how many times as many intervals there are as usual.
        """
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
        usual = ENTRY, clear, clear, ACROSS, clear, hover
        shortest_m = min(line.length_m for line in self._task.lines)
        self._is_usual = max(usual) <= MOST_ON_LINE and shortest_m >= SHORTEST_LINE_M
        self._intervals = tuple(fineness * count for count in usual)

    def near(self, cycle: Cycle) -> Cycle | None:
        """The fastest cycle near one; None where none is found."""
        return self._solved(self._sketches_of(cycle)) if self._is_usual else None

    def of(self, choice: Choice) -> Cycle | None:
        """The fastest cycle near a pair of solutions; None where none is found."""
        sketches = self._sketched(choice) if self._is_usual else None
        return None if sketches is None else self._solved(sketches)

    def around(self, cycle: Cycle, situations: Mapping[str, Surroundings]) -> Iterator[Cycle]:
        """Cycles near one, clear or not, that are led around what is there; the last found first.

        Args:
            cycle: where to begin.
            situations: of each stage, by its label.

        Yields:
            Those that look clear where distances were bounded, each found from the one after it and
            mostly faster. Whether they are is for the caller to prove.
        """
        if not self._is_usual:
            return
        sketches, places = self._sketches_of(cycle), [situations[stage] for stage in RESTING]
        obstacles = [
            Obstacles(around, sketch.q[resting], around.margin_m + LED_CLEAR_M)
            for around, sketch, resting in zip(places, sketches, RESTING.values(), strict=True)
        ]
        found: list[Cycle] = []
        failures, trust_rad, bounds = 0, TRUST_RAD, _bounds(obstacles, sketches)
        for number in range(1, ROUNDS + 1):
            led = self._solved(sketches, Clearances.of(bounds, trust_rad))
            if led is None or number > ROUNDS // 2:
                trust_rad *= LESS_TRUST
            if led is None:
                failures += 1
            else:
                sketches = self._sketches_of(led)
                bounds = _bounds(obstacles, sketches)
                if min(each.excess_m for each in bounds) > -SHORT_OF_M:
                    found.append(led)
            is_hopeless = failures > MOST_FAILURES or (number >= BY_ROUND and not found)
            if is_hopeless or (led is not None and _is_settled(found)):
                break
        yield from reversed(found)

    def _sketches_of(self, cycle: Cycle) -> list[Sketch]:
        motions = cycle.by_stage.values()
        pairs = zip(motions, self._intervals, strict=True)
        return [Sketch.of(motion, count) for motion, count in pairs]

    def _solved(
        self, sketches: Sequence[Sketch], clearances: Clearances | None = None
    ) -> Cycle | None:
        arm, limits = self._manipulator.arm, self._manipulator.limits
        program = _program(self._intervals, keeps_clear=clearances is not None)
        found = program.solve(sketches, self._task, arm, limits, clearances)
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
        entry, at_pick, _, across, at_place, at_end = self._intervals
        ik, limits = self._manipulator.ik, self._manipulator.limits
        up_pick = risen(ik, limits, choice.q_pick, Way(pick, at_pick))
        up_place = risen(ik, limits, choice.q_place, Way(place, at_place))
        up_end = risen(ik, limits, choice.q_place, Way(end, at_end, ends_at_rest=True))
        if up_pick is None or up_place is None or up_end is None:
            return None
        down_pick, down_place = backwards(up_pick), backwards(up_place)
        standing = Sketch(self._task.q_start[None], np.zeros((2, 7)), 0.0)
        to_pick = between(standing, down_pick, limits, entry)
        to_place = between(up_pick, down_place, limits, across)
        return [to_pick, down_pick, up_pick, to_place, down_place, up_end]


def _intervals(length_m: float) -> int:
    """On a line; in steps, so that there are few programs."""
    needed = max(LEAST_ON_LINE, math.ceil(length_m / INTERVAL_M))
    return 2 * math.ceil(needed / 2) if needed <= 20 else 10 * math.ceil(needed / 10)


@lru_cache(maxsize=8)
def _program(intervals: tuple[int, ...], *, keeps_clear: bool = False) -> MotionProgram:
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
        keeps_clear=keeps_clear,
    )


def _bounds(obstacles: Sequence[Obstacles], sketches: Sequence[Sketch]) -> list[LinearBounds]:
    return [near.bounds(s.controls) for near, s in zip(obstacles, sketches, strict=True)]


def _is_settled(found: Sequence[Cycle]) -> bool:
    """Whether the last of several cycles is hardly faster than the one before."""
    if len(found) < 2:
        return False
    before_s, last_s = (cycle.duration_s for cycle in found[-2:])
    return abs(before_s - last_s) < SETTLED * last_s


def _is_straight(arm: Arm, line: StraightLine, motion: Trajectory) -> bool:
    """Whether the tip keeps to a line between the knots too."""
    looks = np.linspace(0.0, motion.duration, LOOKS * (len(motion.knots_s) - 1) + 1)
    off = np.array([_off(arm, line, q) for q in motion.sample(looks).q])
    return bool((off <= 0.9 * np.array(PROMISED)).all())


def _off(arm: Arm, line: StraightLine, q: Vector) -> tuple[float, float]:
    """How far the tip is from a line, m, and turned, rad."""
    T = arm.T_base_tip(q)
    there = line.at(fraction(line, T))
    distance_m = float(np.linalg.norm(T.translation - there.translation))
    return distance_m, angle_between(T.rotation, there.rotation)
