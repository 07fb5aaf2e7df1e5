"""Trajectory: exact piecewise-cubic joint motion.

Between two knots every joint moves with constant jerk, so position, velocity and acceleration are
polynomials and their extrema are known in closed form; nothing here is sampled to be checked.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin import JointLimits
from baxter_kin.display import count, line, quoted, seconds, side_of
from baxter_kin.fields import array, frozen, shown
from baxter_kin.validation import (
    FloatArray,
    Indices,
    expect,
    expect_all,
    finite_array,
    finite_scalar,
    float_array,
)
from planner.errors import TrajectoryError

CONTINUITY_TOLERANCE = 1e-8
"""Maximum jump of q, v or a at a knot, in rad, rad/s, rad/s^2, due to rounding."""


SAME_KNOT_S = 1e-11
"""Maximum difference of two knots of different motions that are at the same time, due to rounding.
In this time, an acceleration changes by less than `CONTINUITY_TOLERANCE`."""


class JointState(NamedTuple):
    """Position, velocity and acceleration, each of shape (n,) or (m, n); rad and s."""

    q: FloatArray
    v: FloatArray
    a: FloatArray

    def __repr__(self) -> str:
        if type(self.v) is not np.ndarray or self.v.dtype.kind != "f":
            return line("JointState", map(shown, self))  # a named tuple takes anything
        speed = f"up to {np.abs(self.v).max(initial=0.0):.3g} rad/s"
        return line("JointState", (f"q={shown(self.q)} rad", speed))


class PeakRatios(NamedTuple):
    """Maximum share of a limit that any joint uses at any time; 1 is the limit."""

    velocity: float
    acceleration: float
    jerk: float


@frozen(error=TrajectoryError)
class Trajectory:
    """A motion of n joints over m segments of constant jerk.

    Attributes:
        limits: the limits it was made for.
        knots_s: times where jerk changes, shape (m + 1,), from 0, increasing. One knot and no
            segment is a motion that stays where it is.
        q: positions at the knots, shape (m + 1, n), rad.
        v: velocities at the knots, shape (m + 1, n), rad/s.
        a: accelerations at the knots, shape (m + 1, n), rad/s^2.
        j: jerks of the segments, shape (m, n), rad/s^3.

    Raises:
        TrajectoryError: when shapes do not match, a number is not finite, the knots do not increase
            from zero, or q, v or a jump by more than `CONTINUITY_TOLERANCE`.
    """

    limits: JointLimits
    knots_s: FloatArray = array(None)
    q: FloatArray = array(None, None)
    v: FloatArray = array(None, None)
    a: FloatArray = array(None, None)
    j: FloatArray = array(None, None)

    def __attrs_post_init__(self) -> None:
        knots, joints = len(self.knots_s), len(self.limits.names)
        for name in "qvaj":
            shape, expected = getattr(self, name).shape, (knots - (name == "j"), joints)
            if knots and shape != expected:
                raise TrajectoryError(f"{name} has shape {shape}; it must have shape {expected}")
        self._check_knots()
        self._check_continuity()

    @classmethod
    def stay(cls, q: ArrayLike, limits: JointLimits, duration_s: float = 0.0) -> Trajectory:
        """The rest at `q`, shape (n,), rad, for a duration, which may be zero.

        Raises:
            TrajectoryError: when `q` has another shape or is not finite, or the duration is not a
                number, or negative.
        """
        joints = len(expect(limits, JointLimits, "limits", TrajectoryError).names)
        at = finite_array(q, (joints,), "q", TrajectoryError)
        time_s = finite_scalar(duration_s, "duration_s", TrajectoryError, least=0.0)
        knots = np.unique([0.0, time_s])
        still = np.zeros((len(knots), joints))
        return cls(limits, knots, still + at, still, still, still[1:])

    @property
    def duration(self) -> float:
        """Seconds from first to last knot."""
        return float(self.knots_s[-1])

    @property
    def q_start(self) -> FloatArray:
        """Initial position, shape (n,), rad."""
        first: FloatArray = self.q[0]
        return first

    @property
    def q_goal(self) -> FloatArray:
        """Final position, shape (n,), rad."""
        last: FloatArray = self.q[-1]
        return last

    def sample(self, t: ArrayLike) -> JointState:
        """The state at one time or at many.

        Args:
            t: one time, or shape (m,); seconds, not negative. A motion that ends at rest stays at
                its goal after its end.

        Returns:
            Arrays of shape (n,) for one time, (m, n) for many.

        Raises:
            TrajectoryError: when a time is not a number, negative, or after the end of a motion
                that does not end at rest.
        """
        times = self._checked_times(t)
        inside = np.minimum(times, self.duration)
        i = np.searchsorted(self.knots_s, inside, side="right") - 1
        state = self._advanced(i, (inside - self.knots_s[i])[..., None])
        over = (times > self.duration)[..., None]
        return JointState(
            *(np.where(over, last, x) for last, x in zip(self._rest(), state, strict=True))
        )

    def jerks_at(self, times_s: FloatArray) -> FloatArray:
        """Jerks at times inside segments, shape (m,): (m, n), rad/s^3; zero after the end."""
        jerks = np.concatenate([self.j, np.zeros((1, self.j.shape[1]))])
        found: FloatArray = jerks[np.searchsorted(self.knots_s, times_s, side="right") - 1]
        return found

    def reversed(self) -> Trajectory:
        """The same path in reverse, within the same limits."""
        knots = self.duration - self.knots_s[::-1]
        backwards = self.q[::-1], -self.v[::-1], self.a[::-1], -self.j[::-1]
        return Trajectory(self.limits, knots, *backwards)

    def position_extrema(self) -> tuple[FloatArray, FloatArray]:
        """Exact minimum and maximum position of each joint; two arrays of shape (n,), rad."""
        segments = np.arange(len(self.j))
        candidates = np.concatenate([self.q, *(self._advanced(segments, t).q for t in self._turns)])
        return candidates.min(axis=0), candidates.max(axis=0)

    def peak_ratios(self, limits: JointLimits | None = None) -> PeakRatios:
        """Exact maxima of velocity, acceleration and jerk, relative to their limits.

        Args:
            limits: to compare with instead of the trajectory's own; of as many joints.
        """
        bounds = self._comparable(self.limits if limits is None else limits)
        v = np.abs(np.concatenate([self.v, self.turning_velocities])) / bounds.v_max
        a, j = np.abs(self.a) / bounds.a_max, np.abs(self.j) / bounds.j_max
        return PeakRatios(*(float(np.max(ratio, initial=0.0)) for ratio in (v, a, j)))

    def _facts(self) -> tuple[str, ...]:
        return side_of(self.limits.names), seconds(self.duration), count(len(self.knots_s), "knot")

    def _advanced(self, i: Indices, dt: FloatArray) -> JointState:
        """The state a time `dt` after knot `i`."""
        jerks = np.concatenate([self.j, np.zeros((1, self.j.shape[1]))])
        q, v, a, j = self.q[i], self.v[i], self.a[i], jerks[i]
        return JointState(
            q + dt * (v + dt * (a / 2 + dt * j / 6)),
            v + dt * (a + dt * j / 2),
            a + dt * j,
        )

    @property
    def _turns(self) -> FloatArray:
        """Time from a knot to each reversal of a joint, (2, m, n), s; 0 where there is none.

        The two roots of v + a t + j t^2 / 2, in the form without cancellation.
        """
        v, a, j = self.v[:-1], self.a[:-1], self.j
        root = np.sqrt(np.maximum(a * a - 2 * j * v, 0.0))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            large = -(a + np.where(a >= 0, root, -root))
            return self._inside(np.array([large / j, 2 * v / large]))

    @property
    def turning_velocities(self) -> FloatArray:
        """Velocities where acceleration is zero inside a segment, else at its start, (m, n)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            t = -self.a[:-1] / self.j
        return self._advanced(np.arange(len(self.j)), self._inside(t)).v

    def _inside(self, t: FloatArray) -> FloatArray:
        """Times within their segment; zero, the knot itself, for all others."""
        length = np.diff(self.knots_s)[:, None]
        return np.where((t > 0.0) & (t < length), t, 0.0)

    def _rest(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return self.q[-1], np.zeros_like(self.v[-1]), np.zeros_like(self.a[-1])

    def _checked_times(self, t: ArrayLike) -> FloatArray:
        times = float_array(t, "times", TrajectoryError)
        if times.ndim > 1:
            raise TrajectoryError(f"times have shape {times.shape}; give one time or shape (m,)")
        if not np.isfinite(times).all():
            raise TrajectoryError(f"times must be finite, got {quoted(times.tolist())}")
        if (times < 0.0).any():
            raise TrajectoryError(f"times start at 0, got {times.min():g} s")
        self._check_end(float(times.max(initial=0.0)))
        return times

    def _check_end(self, latest_s: float) -> None:
        speed, push = (float(np.abs(last).max()) for last in (self.v[-1], self.a[-1]))
        if latest_s > self.duration and max(speed, push) > CONTINUITY_TOLERANCE:
            raise TrajectoryError(
                f"{latest_s:g} s is after the end at {self.duration:g} s, where the motion still "
                f"has {speed:g} rad/s and {push:g} rad/s^2: nothing is known beyond"
            )

    def _comparable(self, limits: JointLimits) -> JointLimits:
        expect(limits, JointLimits, "limits", TrajectoryError)
        if len(limits.names) != len(self.limits.names):
            raise TrajectoryError(
                f"the limits are for {len(limits.names)} joints, the motion has "
                f"{len(self.limits.names)}"
            )
        return limits

    def _check_knots(self) -> None:
        if self.knots_s.size == 0 or self.knots_s[0] != 0.0:
            raise TrajectoryError(f"knots must start at 0, got {self.knots_s.tolist()[:3]}")
        if not (np.diff(self.knots_s) > 0.0).all():
            raise TrajectoryError("knots must increase from one to the next")

    def _check_continuity(self) -> None:
        segments = np.arange(len(self.j))
        reached = self._advanced(segments, np.diff(self.knots_s)[:, None])
        for name, end in zip("qva", reached, strict=True):
            jump = np.abs(end - getattr(self, name)[1:]).max(initial=0.0)
            if jump > CONTINUITY_TOLERANCE:
                raise TrajectoryError(
                    f"{name} jumps by {jump:.3g} at a knot; at most {CONTINUITY_TOLERANCE:g} is "
                    "rounding"
                )


def joined(trajectories: Iterable[Trajectory]) -> Trajectory:
    """Concatenate motions, each starting in the state in which the previous one ends.

    Args:
        trajectories: at least one; those of zero duration are skipped.
    """
    given = expect_all(trajectories, Trajectory, "the motions to join", TrajectoryError)
    if not given:
        raise TrajectoryError("nothing to join; give at least one motion")
    parts = [part for part in given if part.duration > 0.0] or list(given[:1])
    starts = np.cumsum([0.0, *(part.duration for part in parts)])
    knots = [part.knots_s[:-1] + start for part, start in zip(parts, starts[:-1], strict=True)]
    q, v, a = (
        np.concatenate(
            [*(getattr(part, name)[:-1] for part in parts), getattr(parts[-1], name)[-1:]]
        )
        for name in "qva"
    )
    j = np.concatenate([part.j for part in parts])
    return Trajectory(parts[0].limits, np.concatenate([*knots, starts[-1:]]), q, v, a, j)


def side_by_side(trajectories: Sequence[Trajectory]) -> Trajectory:
    """Motions of different joints that begin together, as one motion of all joints.

    Args:
        trajectories: at least one; each ends at rest, and stays there until the last one ends.
    """
    end_s = max(each.duration for each in trajectories)
    knots = np.unique(np.concatenate([each.knots_s for each in trajectories]))
    is_new = np.append(np.diff(knots) > SAME_KNOT_S, True)
    knots = knots[is_new] if end_s > 0.0 else knots[-1:]
    knots[0] = 0.0
    states = [each.sample(knots) for each in trajectories]
    jerks = [each.jerks_at((knots[:-1] + knots[1:]) / 2) for each in trajectories]
    q, v, a = (np.concatenate([state[i] for state in states], axis=1) for i in range(3))
    limits = JointLimits.side_by_side([each.limits for each in trajectories])
    return Trajectory(limits, knots, q, v, a, np.concatenate(jerks, axis=1))


def between(trajectory: Trajectory, begin_s: float, end_s: float) -> Trajectory:
    """The part of a motion between two times, the first one before the second."""
    knots = trajectory.knots_s
    inner = knots[(knots > begin_s + SAME_KNOT_S) & (knots < end_s - SAME_KNOT_S)]
    times = np.concatenate([[begin_s], inner, [end_s]])
    jerks = trajectory.jerks_at((times[:-1] + times[1:]) / 2)
    return Trajectory(trajectory.limits, times - begin_s, *trajectory.sample(times), jerks)
