"""The motions of a pick and place: as one program, or with a stop at the ends of all lines."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import count, pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from baxter_kin.fields import FrozenMapping
from baxter_kin.validation import FloatArray
from planner.collision.context import CollisionContext
from planner.collision.obstacles import Obstacles
from planner.errors import MotionError
from planner.motion.paths.straight_line import intervals_of, is_on_line, knot_tolerance
from planner.motion.paths.straight_move import plan_straight_move
from planner.motion.program.guess import (
    MIN_STRIDE,
    LineFollowed,
    guess_along,
    guess_between,
    reversed_sketch,
)
from planner.motion.program.motion_program import EXTRA_MARGIN_M, MotionProgram, Motions, led_around
from planner.motion.program.rows import Clearances
from planner.motion.program.unknowns import MotionTask, Phase
from planner.motion.upright import KNOT_SHARES, Upright
from planner.pick_place.candidates import CandidatePair
from planner.pick_place.plan_builder import NoSolutionError, ProvenMotion, free_motion, proven
from planner.pick_place.task import (
    CARRYING,
    INWARD,
    LINES,
    PICK_LINES,
    SIDEWAYS,
    Leg,
    PickAndPlace,
    PlanRequest,
)
from planner.splines import Sketch
from planner.trajectory import Trajectory

FREE: Mapping[str, int] = FrozenMapping({"pick: approach": 14, "place: approach": 20})
"""Number of intervals on the way to the first line, and between the lines of pick and place."""

LED: Mapping[str, int] = FrozenMapping({"pick: approach": 20, "place: approach": 28})
"""These numbers for motions around obstacles, which have more turns."""

LED_ON_LINE = 1.5
"""Factor of the number of intervals on lines where the arm avoids a collision on one, or these are
not vertical: an elbow that swings aside moves the tip off the line between knots."""

GOOD_ENOUGH, LONG_STRIDE = 1.03, 0.01
"""Where lines are not vertical: maximum duration of a motion around obstacles that is fast enough,
as a multiple of the one through them; and the minimum step along a line, as a fraction of it, as
many solutions cannot follow lines of 30 cm."""

MAX_SOLVED = 2
"""Maximum number of times that a program is solved, with twice as many intervals on lines that the
tip leaves between knots."""

MIN_ON_LINE, MAX_ON_LINE, MIN_LINE_M = 10, 80, 1e-4
"""Bounds of the number of intervals on a line, and of its length. Other lines are planned one by
one."""

HEIGHT_TOLERANCE_M = 1e-6
"""Rounding allowed where the tip must not sink."""

TIMEOUT_S = 2.0
"""Maximum duration of the search for one path; a wall on the table takes a tenth of a second."""

LINES_FIRST = ("pick: retract", "pick: descend", "place: descend", "place: retract")
"""The order in which a stopping cycle plans its lines."""


def tip_upright(request: PlanRequest, task: PickAndPlace) -> Upright | None:
    """The axis of the body that stays upright, seen from the tip that holds it; None if none does.

    Fingers that close on the body shift it, and do not turn it.
    """
    if task.upright is None:
        return None
    R_base_body = request.scene[task.body].T_base_body.rotation
    return task.upright.seen_from_tip(task.T_base_pick.rotation.T @ R_base_body)


class CycleProgram:
    """The program of one task, for any pair of solutions.

    Attributes:
        is_vertical: whether all lines are.
    """

    def __init__(self, request: PlanRequest, task: PickAndPlace, *, fineness: int = 1) -> None:
        """State the task.

        Args:
            request: the arm, its initial configuration, and the tolerance of its lines.
            task: what goes where.
            fineness: multiplies the number of intervals.
        """
        self._manipulator, self._tolerance = request.manipulator, request.line_tolerance
        self._legs = legs = task.legs
        lines = tuple(line for leg in legs if (line := leg.line) is not None)
        is_vertical = all(leg.is_vertical for leg in legs if leg.ends is not None)
        self._task = MotionTask(
            request.q_start,
            lines,
            knot_tolerance(self._tolerance),
            self._heights_m(request) if is_vertical else (),
        )
        usual, led = (
            [
                free[leg.stage]
                if leg.line is None
                else intervals_of(leg.line, self._tolerance, MIN_ON_LINE)
                for leg in legs
            ]
            for free in (FREE, LED)
        )
        shortest_m = min(line.length_m for line in lines)
        self._is_usual = max(usual) <= MAX_ON_LINE and shortest_m >= MIN_LINE_M
        self._intervals, self._led = ([fineness * n for n in counts] for counts in (usual, led))
        self.is_vertical = is_vertical
        self._phases = _phases(
            legs, may_sink=not is_vertical, keeps_upright=task.upright is not None
        )
        self._upright = tip_upright(request, task)
        self._followed: dict[tuple[str, bytes], list[Sketch] | None] = {}

    def _heights_m(self, request: PlanRequest) -> tuple[float, float]:
        """Minimum heights of the tip on the way to the pick, and on that to the place."""
        start_m = request.manipulator.arm.T_base_tip(request.q_start).translation[2]
        pick_m, place_m = (
            leg.T_base_goal.translation[2] for leg in self._legs if leg.stage in SIDEWAYS
        )
        return min(start_m, pick_m) - HEIGHT_TOLERANCE_M, min(pick_m, place_m)

    def near(self, cycle: Cycle) -> Cycle | None:
        """The fastest cycle near another one; None where none is found."""
        if not self._is_usual:
            return None
        return self._solved(Sketch.of_each(cycle.motions, self._intervals))

    def of(self, pair: CandidatePair) -> Cycle | None:
        """The fastest cycle near a pair of solutions; None where none is found."""
        sketches = self._sketched(pair) if self._is_usual else None
        return None if sketches is None else self._solved(sketches)

    def can_follow(self, pair: CandidatePair) -> bool:
        """Whether the arm can follow all lines from a pair of solutions, by least-norm steps."""
        return not self._is_usual or self._lines(pair) is not None

    def promise(
        self, pair: CandidatePair, contexts: Mapping[str, CollisionContext]
    ) -> tuple[bool, float]:
        """Whether the guess of a pair collides on a line, and its duration.

        Infinite where the arm cannot follow a line.
        """
        sketches = self._sketched(pair)
        if sketches is None:
            return True, math.inf
        collides = any(
            not contexts[leg.label].is_free(q)
            for leg, sketch in zip(self._legs, sketches, strict=True)
            if leg.line is not None
            for q in sketch.q
        )
        return collides, sum(sketch.duration_s for sketch in sketches)

    def around(
        self, cycle: Cycle, contexts: Mapping[str, CollisionContext], *, on_lines: bool = False
    ) -> list[Cycle]:
        """Cycles near one that are led around obstacles; the last found first.

        The caller proves whether they are clear.

        Args:
            cycle: the initial guess, clear or not.
            contexts: of each leg, by its label.
            on_lines: whether it collides on a line.
        """
        led = self.led(cycle, contexts, on_lines=on_lines)
        if led is None:
            return []
        enough_s = 0.0 if self.is_vertical else GOOD_ENOUGH * cycle.duration_s
        found = led_around(self._led_motions, led.obstacles, led.sketches, enough_s=enough_s)
        return [Cycle(self._legs, motions) for motions in found]

    def led(
        self, cycle: Cycle, contexts: Mapping[str, CollisionContext], *, on_lines: bool = False
    ) -> LedCycle | None:
        """A cycle as a guess for motions around obstacles, and these; the arguments of `around`.

        None where a line is too short or too long for the program, or the cycle collides where the
        arm rests.
        """
        if not self._is_usual:
            return None
        finer = LED_ON_LINE if on_lines or not self.is_vertical else 1.0
        intervals = [
            n if leg.line is None else math.ceil(finer * n)
            for leg, n in zip(self._legs, self._led, strict=True)
        ]
        sketches = Sketch.of_each(cycle.motions, intervals)
        obstacles, was_resting = [], True
        for leg, sketch in zip(self._legs, sketches, strict=True):
            context = contexts[leg.label]
            resting = [0] * was_resting + [-1] * leg.rests
            free = [knot for knot in resting if context.is_free(sketch.q[knot])]
            if resting and not free:
                return None
            obstacles.append(context.obstacles(context.margin_m + EXTRA_MARGIN_M, sketch.q[free]))
            was_resting = leg.rests
        return LedCycle(tuple(sketches), tuple(obstacles))

    def problem(self, share: float = KNOT_SHARES[0]) -> tuple[tuple[Phase, ...], MotionTask]:
        """The phases, without their numbers of intervals, and the parameters of the task.

        Args:
            share: of the cone's sine that is allowed at knots, where an axis stays upright.
        """
        if self._upright is None:
            return self._phases, self._task
        return self._phases, replace(self._task, tilt=self._upright.at_knots(share))

    def strays(self, motions: Motions) -> list[bool]:
        """Whether each motion leaves its line, or the body leans too much in it."""
        off = zip(self._off_line(motions), self._leaning(motions), strict=True)
        return [leaves or leans for leaves, leans in off]

    def _solved(self, sketches: Sequence[Sketch]) -> Cycle | None:
        """The fastest cycle near sketches; lines that it leaves between knots get more of them."""
        for _ in range(MAX_SOLVED):
            motions = self._motions(sketches)
            if motions is None:
                return None
            off = self._off_line(motions)
            if not any(off):
                return Cycle(self._legs, motions)
            intervals = [
                s.intervals * (2 if is_off else 1) for s, is_off in zip(sketches, off, strict=True)
            ]
            sketches = Sketch.of_each(motions, intervals)
        return None

    def _led_motions(self, sketches: Sequence[Sketch], clearances: Clearances) -> Motions | None:
        motions = self._motions(sketches, clearances)
        return None if motions is None or any(self._off_line(motions)) else motions

    def _motions(
        self, sketches: Sequence[Sketch], clearances: Clearances | None = None
    ) -> Motions | None:
        arm, limits = self._manipulator.arm, self._manipulator.limits
        program = cycle_program(with_intervals(self._phases, sketches), len(limits.names))
        if self._upright is None:
            return program.solve(sketches, self._task, arm, limits, clearances)
        for share in KNOT_SHARES:
            _, task = self.problem(share)
            motions = program.solve(sketches, task, arm, limits, clearances)
            if motions is None or not any(self._leaning(motions)):
                return motions
        return None

    def _leaning(self, motions: Motions) -> list[bool]:
        """Whether each motion carries the body, and the axis that stays upright leaves its cone."""
        return [
            self._upright is not None
            and leg.stage in CARRYING
            and not self._upright.is_kept_by(self._manipulator.arm, motion)
            for leg, motion in zip(self._legs, motions, strict=True)
        ]

    def _off_line(self, motions: Motions) -> list[bool]:
        """Whether each motion leaves its line."""
        return [
            leg.line is not None
            and not is_on_line(self._manipulator.arm, leg.line, motion, self._tolerance)
            for leg, motion in zip(self._legs, motions, strict=True)
        ]

    def _sketched(self, pair: CandidatePair) -> list[Sketch] | None:
        """A guess: along the lines, and smoothly in between.

        None where the arm cannot follow a line from its solution.
        """
        lines = self._lines(pair)
        if lines is None:
            return None
        limits = self._manipulator.limits
        standing = Sketch(self._task.q_start[None], np.zeros((2, len(limits.names))), 0.0)
        sketches = [standing]
        for leg, n in zip(self._legs, self._intervals, strict=True):
            if leg.line is None:
                sketches.append(guess_between(sketches[-1], lines[0], limits, n))
            else:
                sketches.append(lines.pop(0))
        return sketches[1:]

    def _lines(self, pair: CandidatePair) -> list[Sketch] | None:
        """Guesses along all lines, in order; None where the arm cannot follow one."""
        sketches: list[Sketch] = []
        for stage in LINES:
            q = pair.q_pick if stage in PICK_LINES else pair.q_place
            key = stage, q.tobytes()
            if key not in self._followed:
                self._followed[key] = self._outwards(stage, q)
            lines = self._followed[key]
            if lines is None:
                return None
            sketches += map(reversed_sketch, reversed(lines)) if stage in INWARD else lines
        return sketches

    def _outwards(self, stage: str, q: FloatArray) -> list[Sketch] | None:
        """Guesses along the lines of a stage, away from the pick or place.

        The arm rests between them; it leaves the last one while accelerating, except at the end of
        the cycle.
        """
        arm, limits = self._manipulator.arm, self._manipulator.limits
        counted = [
            each for each in zip(self._legs, self._intervals, strict=True) if each[0].stage == stage
        ]
        if stage in INWARD:
            counted.reverse()
        sketches: list[Sketch] = []
        for k, (leg, n) in enumerate(counted, 1):
            if leg.line is None:
                continue
            ends_at_rest = k < len(counted) or leg is self._legs[-1]
            sketch = guess_along(
                *(arm, limits, q, leg.line, n),
                ends_at_rest=ends_at_rest,
                min_stride=MIN_STRIDE if self.is_vertical else LONG_STRIDE,
            )
            if isinstance(sketch, LineFollowed):
                return None
            sketches.append(sketch)
            q = sketch.q[-1]
        return sketches


def _phases(legs: Sequence[Leg], *, may_sink: bool, keeps_upright: bool) -> tuple[Phase, ...]:
    """The phases of a program, whose numbers of intervals are not known yet."""
    numbers = count()
    return tuple(
        Phase(
            0,
            rests=leg.rests,
            may_sink=may_sink,
            keeps_upright=keeps_upright and leg.stage in CARRYING,
        )
        if leg.line is None
        else Phase(
            0, next(numbers), (1.0, 0.0) if leg.stage in INWARD else (0.0, 1.0), rests=leg.rests
        )
        for leg in legs
    )


def with_intervals(phases: Sequence[Phase], sketches: Sequence[Sketch]) -> tuple[Phase, ...]:
    """Phases with the numbers of intervals of sketches."""
    return tuple(
        phase._replace(intervals=sketch.intervals)
        for phase, sketch in zip(phases, sketches, strict=True)
    )


@lru_cache(maxsize=8)
def cycle_program(phases: tuple[Phase, ...], joints: int) -> MotionProgram:
    """The program of some phases; the last ones that were built are kept."""
    return MotionProgram(phases, joints)


class LedCycle(NamedTuple):
    """The guess of a cycle around obstacles.

    Attributes:
        sketches: of each leg.
        obstacles: around each leg.
    """

    sketches: tuple[Sketch, ...]
    obstacles: tuple[Obstacles, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Cycle:
    """The motions of a cycle, at rest where the gripper acts.

    Attributes:
        legs: those of the task.
        motions: of each leg, in order.
    """

    legs: tuple[Leg, ...]
    motions: tuple[Trajectory, ...]

    @property
    def by_label(self) -> dict[str, Trajectory]:
        """The motions by the labels of their moves."""
        labels = (leg.label for leg in self.legs)
        return dict(zip(labels, self.motions, strict=True))

    @property
    def q_pick(self) -> FloatArray:
        """The configuration at the pick, shape (7,), rad."""
        return self.by_label["pick: descend"].q_goal

    @property
    def duration_s(self) -> float:
        """Total duration."""
        return sum(motion.duration for motion in self.motions)


class StoppingCycles:
    """Cycles that stop at the ends of all lines; these are planned once for each solution."""

    def __init__(
        self, request: PlanRequest, task: PickAndPlace, contexts: Mapping[str, CollisionContext]
    ) -> None:
        """Store a task, with the collision context of each leg by its label."""
        self._request, self._legs, self._contexts = request, task.legs, contexts
        self._upright = tip_upright(request, task)
        self._planned: dict[tuple[bytes, bytes], Trajectory | str] = {}

    def of(self, q_pick: FloatArray, q_place: FloatArray) -> tuple[Cycle, dict[str, ProvenMotion]]:
        """The motions for a pair of solutions, and those of them that are proven, by label.

        Between the lines the arm moves around obstacles.
        """
        contexts, legs = self._contexts, self._legs
        lines: dict[str, Trajectory] = {}
        for stage in LINES_FIRST:
            lines |= self._lines(stage, q_pick if stage in PICK_LINES else q_place)
        motions = {
            leg.label: proven(leg.stage, lines[leg.label], contexts[leg.label])
            for leg in legs
            if leg.line is not None and leg.stage != "pick: retract"
        }
        q = self._request.q_start
        for leg, following in pairwise(legs):
            if leg.line is None:
                ends = q, lines[following.label].q_start
                manipulator, context = self._request.manipulator, contexts[leg.label]
                upright = self._upright if leg.stage in CARRYING else None
                found = free_motion(
                    *(leg.stage, ends, manipulator, context, TIMEOUT_S), upright=upright
                )
                motions[leg.label], lines[leg.label] = found, found.trajectory
            q = lines[leg.label].q_goal
        return Cycle(legs, tuple(lines[leg.label] for leg in legs)), motions

    def _lines(self, stage: str, q: FloatArray) -> dict[str, Trajectory]:
        """The motions along the lines of a stage, by label, from a solution outwards."""
        motions: dict[str, Trajectory] = {}
        legs = [leg for leg in self._legs if leg.stage == stage]
        for leg in reversed(legs) if stage in INWARD else legs:
            if leg.ends is None:
                continue
            outwards = self._line(stage, q, leg.ends[1])
            motions[leg.label] = outwards.reversed() if stage in INWARD else outwards
            q = outwards.q_goal
        return motions

    def _line(self, stage: str, q: FloatArray, T_base_goal: pin.SE3) -> Trajectory:
        key = T_base_goal.homogeneous.tobytes(), q.tobytes()
        if key not in self._planned:
            arm, limits = self._request.manipulator.arm, self._request.manipulator.limits
            tolerance = self._request.line_tolerance
            try:
                self._planned[key] = plan_straight_move(
                    arm, q, T_base_goal, limits, line_tolerance=tolerance
                )
            except MotionError as cause:
                self._planned[key] = str(cause)
        motion = self._planned[key]
        if isinstance(motion, str):
            raise NoSolutionError.at(stage, motion)
        return motion
