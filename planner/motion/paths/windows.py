"""The motion along a path, planned in windows that overlap, so that its cost is linear.

Each piece of the path is a phase of a motion program, with a duration of its own. Where two pieces
meet, the tip is within the tolerance of both, so that the program rounds corners itself. A window
begins in the state in which the part of the last one that is kept ended, and ends at rest. Its
guess is the rest of the last window, and then motions from rest to rest between the configurations
of a chain (`planner.motion.paths.chain`).

Between its knots the tip may leave the path. Samples show where it does; there the piece gets more
intervals.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from baxter_kin import JointLimits
from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import Arm
from planner.collision.context import SCREENING_STEP_RAD, CollisionContext, looks_clear
from planner.motion.joint_move import rest_to_rest_s
from planner.motion.paths.chain import Chain
from planner.motion.paths.deviation import deviations
from planner.motion.paths.path import corners_of
from planner.motion.paths.pieces import Piece
from planner.motion.paths.straight_line import (
    SAMPLED_SHARE,
    SAMPLES_PER_INTERVAL,
    LineTolerance,
    Turn,
    knot_tolerance,
)
from planner.motion.program.motion_program import EXTRA_MARGIN_M, MotionProgram, Motions, led_around
from planner.motion.program.rows import Clearances
from planner.motion.program.unknowns import MotionTask, Phase
from planner.splines import Sketch, trajectory_of
from planner.trajectory import Trajectory

WINDOW, KEPT, AHEAD, SHORTER = 8, 4, 2, 2
"""Number of pieces in a window, how many of them are kept, how many after those must be near the
path as well, and by how many at a time a window is shortened that has no solution. The state in
which a window is left must allow a motion with the intervals that the next pieces need."""

FEW, MANY, MANY_M, MAX_INTERVALS = 6, 12, 0.03, 48
"""Initial number of intervals of a piece; that of a longer one with corners at both ends, which is
too short for ramps; and the maximum number."""

SMOOTHING = 100.0
"""Weight of squared third differences of the controls where the tip has a set speed. Without it,
the arm uses what freedom it has in ways that change from interval to interval."""

MAX_SPEED, DIFFERENCE_S = 1.01, 1e-5
"""Maximum speed of the tip at samples, relative to the set speed; and the time over which it is
measured."""

OPTIONS = {
    "ipopt.slack_bound_push": 1e-2,
    "ipopt.slack_bound_frac": 1e-2,
    "ipopt.bound_mult_init_val": 1.0,
}
"""Options of the solver: its defaults, with which fewer windows fail than with those of cycles."""


class PathTask(NamedTuple):
    """What is asked of a motion along a path.

    Attributes:
        pieces: of the path.
        tolerance: maximum deviation of the tip.
        stops: whether the arm rests at corners.
        speed_m_s: maximum speed of the tip; None for the limits of the joints alone.
        context: the surroundings; None without obstacles.
    """

    pieces: tuple[Piece, ...]
    tolerance: LineTolerance
    stops: bool = False
    speed_m_s: float | None = None
    context: CollisionContext | None = None


class Windows:
    """The windows of one path."""

    def __init__(self, arm: Arm, limits: JointLimits, task: PathTask, chain: Chain) -> None:
        self._arm, self._limits, self._task, self._chain = arm, limits, task, chain
        self._knots = knot_tolerance(task.tolerance)
        corners = corners_of(task.pieces)
        self._rests = [*(task.stops and corner for corner in corners[1:-1]), True]
        self._intervals = [
            MANY if piece.length_m > MANY_M and all(ends) else FEW
            for piece, ends in zip(task.pieces, pairwise(corners), strict=True)
        ]

    def motions(self) -> list[Trajectory]:
        """The motions along the pieces, as far as any are found."""
        found: list[Trajectory] = []
        ahead: Motions = ()  # the rest of the last window, which ends at rest
        while len(found) < len(self._task.pieces):
            window = self._solved(found, ahead)
            if window is not None:
                is_last = len(found) + len(window) == len(self._task.pieces)
                kept = len(window) if is_last else self._kept(len(window))
                found += window[:kept]
                ahead = window[kept:]
            elif ahead:
                found += ahead
                ahead = ()
            else:
                break
        return [*found[:1], *(_continuing(*pair) for pair in pairwise(found))]

    def _kept(self, count: int) -> int:
        """How many pieces of a window are kept that is not the last one."""
        return min(KEPT, max(1, count - 1))

    def _solved(self, found: Sequence[Trajectory], ahead: Sequence[Trajectory]) -> Motions | None:
        """The motions of a window, which is shortened where it has no solution."""
        sketches = self._sketches(found, ahead)
        for count in range(len(sketches), max(0, len(sketches) - KEPT - 1), -SHORTER):
            window = self._refined(found, sketches[:count])
            if window is not None:
                return window
        return None

    def _refined(self, found: Sequence[Trajectory], sketches: Sequence[Sketch]) -> Motions | None:
        """The motions of a window, with enough intervals that the tip stays on the path."""
        first = len(found)
        is_last = first + len(sketches) == len(self._task.pieces)
        judged = len(sketches) if is_last else self._kept(len(sketches)) + AHEAD
        while True:
            window = self._clear(found, sketches)
            if window is None:
                return None
            off = [
                first + k
                for k, motion in enumerate(window[:judged])
                if self._intervals[first + k] < MAX_INTERVALS
                and not self._is_near(first + k, motion)
            ]
            if not off:
                return window
            for number in off:
                self._intervals[number] *= 2
            sketches = Sketch.of_each(window, self._intervals[first : first + len(window)])

    def _clear(self, found: Sequence[Trajectory], sketches: Sequence[Sketch]) -> Motions | None:
        """The motions of a window, led around obstacles where they are too near."""
        window, context = self._program_solved(found, sketches), self._task.context
        if context is None or (window is not None and self._is_clear(context, window)):
            return window
        if window is not None:
            sketches = Sketch.of_each(window, (sketch.intervals for sketch in sketches))
        start = sketches[0].q[:1] if not found else np.zeros((0, len(self._limits.names)))
        near = context.obstacles(context.margin_m + EXTRA_MARGIN_M, start)
        led = led_around(
            lambda guess, clearances: self._program_solved(found, guess, clearances),
            [near] * len(sketches),
            sketches,
        )
        return next((motions for motions in led if self._is_clear(context, motions)), None)

    def _is_clear(self, context: CollisionContext, motions: Sequence[Trajectory]) -> bool:
        return all(looks_clear(motion, context.is_free, SCREENING_STEP_RAD) for motion in motions)

    def _program_solved(
        self,
        found: Sequence[Trajectory],
        sketches: Sequence[Sketch],
        clearances: Clearances | None = None,
    ) -> Motions | None:
        """The fastest motions near some sketches, from the state in which the found ones end."""
        first, end = len(found), len(found) + len(sketches)
        is_moving = bool(found) and not self._rests[first - 1]
        phases = tuple(
            Phase(
                sketch.intervals,
                k,
                rests=self._rests[first + k] or first + k == end - 1,
                is_moving=is_moving and k == 0,
            )
            for k, sketch in enumerate(sketches)
        )
        tolerance, speed_m_s = self._task.tolerance, self._task.speed_m_s
        task = MotionTask(
            found[-1].q_goal if found else sketches[0].q[0],
            self._task.pieces[first:end],
            self._knots,
            start_rates=(found[-1].v[-1], found[-1].a[-1]) if is_moving else None,
            speed_m_s=1.0 if speed_m_s is None else speed_m_s,
            axis=tolerance.free_about if tolerance.turn is Turn.ABOUT_AXIS else "z",
        )
        program = _program(
            phases, len(self._limits.names), tolerance.turn, has_speed=speed_m_s is not None
        )
        return program.solve(sketches, task, self._arm, self._limits, clearances)

    def _sketches(self, found: Sequence[Trajectory], ahead: Sequence[Trajectory]) -> list[Sketch]:
        """Guesses: the rest of the last window, then from rest to rest along the chain."""
        first, limits = len(found), self._limits
        sketches = Sketch.of_each(ahead, self._intervals[first : first + len(ahead)])
        q = found[-1].q_goal if found else self._chain.qs[0]
        for number in range(first + len(ahead), min(first + WINDOW, len(self._task.pieces))):
            q = sketches[-1].q[-1] if sketches else q
            t = np.linspace(0.0, 1.0, self._intervals[number] + 1)
            eased = t**3 * (10.0 - 15.0 * t + 6.0 * t**2)
            qs = self._chain.along(number, q, eased)
            still = np.zeros((2, len(q)))
            peaks = trajectory_of(Sketch(qs, still, 1.0).controls, 1.0, limits).peak_ratios()
            quickest_s = float(rest_to_rest_s(qs[-1] - q, limits))
            duration_s = max(
                quickest_s, peaks.velocity, peaks.acceleration**0.5, peaks.jerk ** (1.0 / 3.0)
            )
            if self._task.speed_m_s is not None:
                length_m = self._task.pieces[number].length_m
                duration_s = max(duration_s, length_m / self._task.speed_m_s)
            sketches.append(Sketch(qs, still, duration_s))
        return sketches

    def _is_near(self, number: int, motion: Trajectory) -> bool:
        """Whether the tip stays near its path and below its speed, at samples between the knots."""
        count = SAMPLES_PER_INTERVAL * (len(motion.knots_s) - 1) + 1
        times_s = np.linspace(0.0, motion.duration, count)
        tips = self._arm.T_base_tips(motion.sample(times_s).q)
        at = np.full(count, number)
        found = deviations(self._task.pieces, self._task.tolerance, tips, at)
        is_near = bool((found.share <= SAMPLED_SHARE).all())
        if self._task.speed_m_s is None or not is_near:
            return is_near
        pair_s = np.add.outer([0.0, DIFFERENCE_S], times_s).clip(max=motion.duration)
        before, after = (self._arm.T_base_tips(motion.sample(t).q)[:, :3, 3] for t in pair_s)
        speeds = np.linalg.norm(after - before, axis=1) / DIFFERENCE_S
        return bool((speeds <= MAX_SPEED * self._task.speed_m_s).all())


def _continuing(before: Trajectory, motion: Trajectory) -> Trajectory:
    """A motion that begins with the acceleration in which another one ends.

    The solver meets it to some 1e-8, and a trajectory may jump by at most that. The velocity after
    the first interval is then off by half of the difference times its length.
    """
    a, j = motion.a.copy(), motion.j.copy()
    a[0] = before.a[-1]
    j[0] = (a[1] - a[0]) / motion.knots_s[1]
    return evolve(motion, a=a, j=j)


@lru_cache(maxsize=64)
def _program(
    phases: tuple[Phase, ...], joints: int, turn: Turn, *, has_speed: bool
) -> MotionProgram:
    smoothing = SMOOTHING if has_speed else 0.0
    return MotionProgram(
        phases, joints, turn=turn, bounds_speed=has_speed, smoothing=smoothing, options=OPTIONS
    )
