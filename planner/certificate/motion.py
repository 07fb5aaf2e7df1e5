"""A move of the arm as its file states it: cubics between knots, and bounds on what they do.

One lemma carries everything here and in `rows`: let phi be continuously differentiable on a cell of
length h with |phi''| <= M almost everywhere. Then phi is at least min(phi(start), phi(end)) minus
M h^2 / 8 throughout (the chord minus the greatest sag of a parabola below it).

Files may have jumps of up to `MAX_JUMP` at knots, from rounding. With jumps of at most d in phi and
of at most s in its slope at k knots, phi is a function without jumps plus one that changes by at
most k (d + s T) over a time T, so twice that is added to the bound.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.certificate.errors import NotCertifiedError, require
from planner.certificate.intervals import UNIT, Array, Interval, above
from planner.certificate.robot import ARM_JOINTS, Robot

MAX_JUMP = 1e-8
"""How far position, velocity and acceleration may jump at a knot, rad, rad/s and rad/s^2."""

LIMIT_RATIO = 1e-9
"""By how much, relatively, a limit may be exceeded by rounding."""

MAX_HALVINGS = 30

Indices = np.ndarray[Any, np.dtype[np.intp]]


def carried(
    v: Array, a: Array, rho: Array, offsets: Array, between: NDArray[np.bool_] | None = None
) -> tuple[Array, Array]:
    """Bounds on the velocity and acceleration of points that some joints carry.

    From the last joint to the first: w += 2 V u + sqrt(V^4 + A^2) rho, u += V rho, and rho grows by
    the offset to the next joint. The terms of w are Coriolis, and centripetal and Euler together,
    which are perpendicular.

    Args:
        v: greatest speed of each joint, shape (k, 7), rad/s.
        a: greatest acceleration of each joint, shape (k, 7), rad/s^2.
        rho: greatest distance of the points from the frame that carries them, shape (k,), m.
        offsets: lengths between successive joints, shape (7,), m.
        between: which joints count, shape (k, 7); all when not given.
    """
    u, w = np.zeros_like(rho), np.zeros_like(rho)
    for i in range(ARM_JOINTS - 1, -1, -1):
        counts = True if between is None else between[:, i]
        fast, hard = v[:, i], a[:, i]
        w = np.where(counts, w + 2.0 * fast * u + np.sqrt(fast**4 + hard**2) * rho, w)
        u = np.where(counts, u + fast * rho, u)
        rho = np.where(counts, rho + offsets[i], rho)
    return u * (1.0 + 1e-9), w * (1.0 + 1e-9)


class Cubics:
    """A piecewise cubic motion of seven joints.

    Attributes:
        t: times of the n + 1 knots, from 0, s.
        q, v, a: positions, velocities and accelerations at the knots, shape (n + 1, 7).
        j: jerks between them, shape (n, 7).
        duration_s: the time of the last knot.
        v_peak, a_peak: upper bounds on |v| and |a| in each piece, shape (n, 7).
        jumps: upper bounds on the jumps of position and velocity at any knot.
    """

    def __init__(self, data: Mapping[str, Any], label: str) -> None:
        """Read a trajectory of a plan file.

        Raises:
            NotCertifiedError: when it is malformed, or jumps at a knot.
        """
        self.label = label
        try:
            self.t = np.array(data["knots_s"], np.float64)
            self.q, self.v, self.a, self.j = (
                np.array(data[key], np.float64).reshape(-1, ARM_JOINTS) for key in "qvaj"
            )
        except (KeyError, TypeError, ValueError) as cause:
            raise NotCertifiedError(f"{label}: the trajectory is malformed: {cause!r}") from cause
        n = len(self.j)
        require(self.t.shape == (n + 1,), f"{label}: knots do not fit the jerks")
        require([len(x) == n + 1 for x in (self.q, self.v, self.a)], f"{label}: knots do not fit")
        finite = [np.isfinite(x).all() for x in (self.t, self.q, self.v, self.a, self.j)]
        require(finite, f"{label}: a number is not finite")
        require(self.t[0] == 0.0, f"{label}: the first knot is not at 0")
        require(np.diff(self.t) > 0.0, f"{label}: the times of the knots do not increase")
        self.duration_s = float(self.t[-1])
        self._length = (Interval(self.t[1:]) - Interval(self.t[:-1])).reshaped(n, 1)
        ends = self._states(np.arange(n), self._length)
        knots = (self.q, self.v, self.a)
        jumps = [(e - x[1:]).magnitude.max(initial=0.0) for e, x in zip(ends, knots, strict=True)]
        require([jump <= MAX_JUMP for jump in jumps], f"{label}: it jumps at a knot")
        self.jumps = float(jumps[0]), float(jumps[1])
        self.a_peak: Array = np.maximum(np.abs(self.a[:-1]), ends[2].magnitude)  # linear between
        ends_v = np.maximum(np.abs(self.v[:-1]), ends[1].magnitude)
        sag = np.abs(self.j) * self._length.magnitude**2 / 8.0  # the second derivative is the jerk
        self.v_peak: Array = (ends_v + sag) * (1.0 + 16.0 * UNIT)

    def at(self, times_s: Array) -> Interval:
        """Positions at exact times, shape (k, 7)."""
        if not len(self.j):
            return Interval(np.repeat(self.q, len(times_s), axis=0))
        i = self._pieces(times_s, "right")
        since = (Interval(times_s) - Interval(self.t[i])).reshaped(len(i), 1)
        return self._states(i, since)[0]

    def peaks(self, starts_s: Array, ends_s: Array) -> tuple[Array, Array]:
        """Upper bounds on |v| and |a| of each joint in cells, shapes (k, 7)."""
        if not len(self.j):
            still = np.zeros((len(starts_s), ARM_JOINTS))
            return still, still
        first = self._pieces(starts_s, "right")
        last = np.maximum(self._pieces(ends_s, "left"), first)
        pairs = np.column_stack([first, last + 1]).ravel()
        found = [
            np.maximum.reduceat(np.concatenate([peak, peak[-1:]]), pairs, axis=0)[::2]
            for peak in (self.v_peak, self.a_peak)
        ]
        return found[0], found[1]

    def slack_m(self, reach_m: float) -> float:
        """What is added to every bound on a gap because positions and velocities jump at knots.

        Each joint turns points that are at most `reach_m` away, so a jump of all seven by d moves
        them by 7 d `reach_m`; their velocities change by 7 s `reach_m`, and by 49 d V `reach_m` as
        the joints before turn too.
        """
        if not len(self.j):
            return 0.0
        d, s = self.jumps
        fastest = float(self.v_peak.max())
        slope = 7.0 * s + 49.0 * fastest * d
        return 2.1 * len(self.j) * reach_m * (7.0 * d + self.duration_s * slope)

    def require_limits(
        self, robot: Robot, stated: Mapping[str, Any], a_max: Array, j_max: Array
    ) -> None:
        """Refuse a motion that exceeds the robot's limits, or those that it states itself."""
        try:
            low, high, v, a, j = (
                np.array(stated[key], np.float64).reshape(ARM_JOINTS)
                for key in ("q_min", "q_max", "v_max", "a_max", "j_max")
            )
        except (KeyError, TypeError, ValueError) as cause:
            raise NotCertifiedError(f"{self.label}: limits are malformed: {cause!r}") from cause
        v, a, j = (
            np.minimum(own, given) * (1.0 + LIMIT_RATIO)
            for own, given in ((v, robot.v_max), (a, a_max), (j, j_max))
        )
        low, high = (
            np.maximum(low, robot.q_min) - MAX_JUMP,
            np.minimum(high, robot.q_max) + MAX_JUMP,
        )
        require(self.a_peak <= a, f"{self.label}: acceleration beyond its limit")
        require(np.abs(self.j) <= j, f"{self.label}: jerk beyond its limit")
        require((self.q >= low) & (self.q <= high), f"{self.label}: position beyond its limit")
        self._require_within(0, self.a_peak, (low, high), f"{self.label}: position")
        self._require_within(1, np.abs(self.j), (-v, v), f"{self.label}: velocity")

    def _require_within(
        self, derivative: int, bends: Array, bounds: tuple[Array, Array], what: str
    ) -> None:
        """Halve cells until the values at their ends, less the sag between, are within bounds."""
        low, high = bounds
        i, start, end = np.arange(len(self.j)), np.zeros(len(self.j)), self._length.high[:, 0]
        for _ in range(MAX_HALVINGS):
            ends = [
                self._states(i, Interval(t).reshaped(len(i), 1))[derivative] for t in (start, end)
            ]
            is_inside = [(x.low >= low) & (x.high <= high) for x in ends]
            require(is_inside, f"{what} beyond its limit")
            sag = above(bends[i] * ((end - start) ** 2)[:, None] / 8.0 * (1.0 + 16.0 * UNIT))
            lowest = np.minimum(ends[0].low, ends[1].low) - sag
            highest = np.maximum(ends[0].high, ends[1].high) + sag
            is_open = ((lowest < low) | (highest > high)).any(axis=1)
            i, start, end = i[is_open], start[is_open], end[is_open]
            if not len(i):
                return
            middle = 0.5 * (start + end)
            i = np.concatenate([i, i])
            start, end = np.concatenate([start, middle]), np.concatenate([middle, end])
        raise NotCertifiedError(f"{what} beyond its limit")

    def _pieces(self, times_s: Array, side: Any) -> Indices:
        found: Indices = np.searchsorted(self.t, times_s, side=side) - 1
        return np.clip(found, 0, len(self.j) - 1)

    def _states(self, i: Indices, since: Interval) -> tuple[Interval, Interval, Interval]:
        """Position, velocity and acceleration at times since the knots `i`."""
        q, v, a, j = (Interval(x[i]) for x in (self.q, self.v, self.a, self.j))
        return (
            q + since * (v + since * (a.over(2.0) + (since * j).over(6.0))),
            v + since * (a + (since * j).over(2.0)),
            a + since * j,
        )
