"""From corners in joint space to one smooth motion inside the limits.

The motion that stops at every corner is made of time-optimal straight legs. It is then cut short:
between two of its moments, position, velocity and acceleration are known, and the fastest motion
that joins these two states under the limits replaces what was between them, if it takes less time
and looks clear (Hauser and Ng-Thow-Hing 2010, here with jerk limits). Every piece comes from the
same exact planner as a joint move, so limits hold at all times, and a corner is stopped at only
where no shortcut across it was found.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin import JointLimits
from baxter_kin.arrays import Vector, float_array
from baxter_kin.errors import expect
from planner.errors import MotionError, TrajectoryError, expect_all
from planner.screening import IsFree, looks_clear
from planner.splicing import joined, nearest_cut, section
from planner.timing import least_duration_s, plan_joint_move
from planner.trajectory import JointState, Trajectory

SHORTCUT_TRIES = 80
"""Shortcuts tried on one motion; half as many more save another 2 % of its time."""

SCREENING_STEP_RAD = 0.03
"""Farthest that a joint moves between two looks at a shortcut."""

LEAST_GAIN_S = 0.01
"""A shortcut that saves less is not worth its collision checks."""

LEAST_GAIN = 0.02
"""The same, as a share of what it replaces."""


def stopping_at(corners: ArrayLike, limits: JointLimits) -> Trajectory:
    """The fastest motion along straight lines from corner to corner, at rest in each.

    Args:
        corners: shape (m, n), rad, inside the limits; at least two.
        limits: of those n joints.

    Raises:
        MotionError: when there are fewer than two, or no motion joins two of them.
        ConfigurationError: when one is not finite or outside the limits.
    """
    return joined(_legs(corners, limits))


def smoothed(
    corners: ArrayLike,
    limits: JointLimits,
    is_free: IsFree,
    rng: np.random.Generator,
    *,
    tries: int = SHORTCUT_TRIES,
    step_rad: float = SCREENING_STEP_RAD,
) -> Trajectory:
    """A fast motion from the first corner to the last, at rest in both, that looks clear.

    Its shortcuts are looked at in samples, the legs between corners are taken for clear: that it is
    clear everywhere remains to be proven.

    Args:
        corners: shape (m, n), rad, inside the limits; at least two, the lines between them clear.
        limits: of those n joints.
        is_free: whether a configuration is free.
        rng: chooses the shortcuts; the same numbers make the same motion.
        tries: how many to try.
        step_rad: farthest that a joint moves between two looks.

    Raises:
        MotionError: when there are fewer than two corners, no motion joins two of them, or `rng` is
            no NumPy generator.
        ConfigurationError: when a corner is not finite or outside the limits.
    """
    return blended(_legs(corners, limits), is_free, rng, tries=tries, step_rad=step_rad)


def blended(
    pieces: Iterable[Trajectory],
    is_free: IsFree,
    rng: np.random.Generator,
    *,
    tries: int = SHORTCUT_TRIES,
    step_rad: float = SCREENING_STEP_RAD,
) -> Trajectory:
    """Motions one after another, cut short where they meet, so that none of them need stop there.

    It begins in the state where the first piece begins, and ends in that where the last one ends.
    As in `smoothed`, shortcuts are looked at in samples and the pieces are taken for clear.

    Args:
        pieces: each begins in the state where the one before ends.
        is_free: whether a configuration is free.
        rng: chooses the shortcuts; the same numbers make the same motion.
        tries: how many to try.
        step_rad: farthest that a joint moves between two looks.

    Raises:
        TrajectoryError: when there is no piece, or q, v or a jump from one to the next.
        MotionError: when `rng` is no NumPy generator.
    """
    expect(rng, np.random.Generator, "rng", MotionError)
    motion = _Stitched.of(pieces)
    for _ in range(tries):
        if not motion.seams_s.size:
            break  # one time-optimal piece; nothing is shorter
        motion = motion.cut_short(*motion.window(rng), is_free, step_rad)
    return motion.trajectory


def _legs(corners: ArrayLike, limits: JointLimits) -> list[Trajectory]:
    array = float_array(corners, "corners", MotionError)
    if array.ndim != 2 or len(array) < 2:
        raise MotionError(f"corners have shape {array.shape}; give at least two, shape (m, n)")
    return [plan_joint_move(q, q_next, limits) for q, q_next in pairwise(array)]


@dataclass(frozen=True, slots=True, eq=False)
class _Stitched:
    """A motion and its seams: the times where two time-optimal pieces meet.

    A window between two seams cannot be crossed faster, so every shortcut spans a seam.
    """

    trajectory: Trajectory
    seams_s: Vector

    @classmethod
    def of(cls, pieces: Iterable[Trajectory]) -> _Stitched:
        checked = expect_all(pieces, Trajectory, "the pieces", TrajectoryError)
        ends = np.cumsum([piece.duration for piece in checked])
        inner = (ends > 0.0) & (ends < ends[-1:])
        return cls(joined(checked), np.unique(ends[inner]))

    def window(self, rng: np.random.Generator) -> tuple[float, float]:
        """A random time on either side of a random seam."""
        seam = self.seams_s[rng.integers(self.seams_s.size)]
        start, end = rng.uniform(0.0, seam), rng.uniform(seam, self.trajectory.duration)
        return nearest_cut(self.trajectory, start), nearest_cut(self.trajectory, end)

    def cut_short(
        self, start_s: float, end_s: float, is_free: IsFree, step_rad: float
    ) -> _Stitched:
        """With a shortcut between two times, or as it is if there is none worth having."""
        shortcut = self._shortcut(start_s, end_s)
        if shortcut is None or not looks_clear(shortcut, is_free, step_rad):
            return self
        before = section(self.trajectory, 0.0, start_s)
        after = section(self.trajectory, end_s, self.trajectory.duration)
        arrival_s = start_s + shortcut.duration
        seams = [
            *self.seams_s[self.seams_s < start_s],
            *(t for t, part in ((start_s, before), (arrival_s, after)) if part.duration > 0.0),
            *(self.seams_s[self.seams_s > end_s] - (end_s - arrival_s)),
        ]
        return _Stitched(joined([before, shortcut, after]), np.array(seams))

    def _shortcut(self, start_s: float, end_s: float) -> Trajectory | None:
        """The fastest motion between the states at two times, unless it gains too little."""
        limits, window_s = self.trajectory.limits, end_s - start_s
        start, end = _states(self.trajectory, start_s, end_s)
        longest_s = window_s - max(LEAST_GAIN_S, LEAST_GAIN * window_s)
        try:
            if least_duration_s(start, end, limits) > longest_s:
                return None
            return plan_joint_move(
                start.q,
                end.q,
                limits,
                v_start=start.v,
                a_start=start.a,
                v_goal=end.v,
                a_goal=end.a,
            )
        except MotionError:  # it would overshoot a limit
            return None


def _states(trajectory: Trajectory, *times: float) -> list[JointState]:
    """States at some times; what is over a limit by rounding is put at the limit."""
    limits = trajectory.limits
    q, v, a = trajectory.sample(times)
    q = np.clip(q, limits.q_min, limits.q_max)
    v = np.clip(v, -limits.v_max, limits.v_max)
    a = np.clip(a, -limits.a_max, limits.a_max)
    return [JointState(*row) for row in zip(q, v, a, strict=True)]
