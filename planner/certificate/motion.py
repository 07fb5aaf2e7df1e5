"""A motion of the arm: polynomials of time between knots, and bounds on their values.

Everything here and in `rows` rests on one lemma. Let phi be continuous on a cell of length h and,
except at some kinks, continuously differentiable with |phi''| <= M almost everywhere; and let S be
the sum of the jumps of its slope at the kinks inside the cell. Then phi is at least
min(phi(start), phi(end)) - M h^2 / 8 - S h / 4 throughout: it is its chord minus the integral of
phi'' and of the jumps with Green's function min(t, s) (h - max(t, s)) / h, which is at most h / 4
and has an integral of at most h^2 / 8.

Files may have jumps of up to `MAX_JUMP` at knots, due to rounding. With jumps of at most d in phi
and at most s in its slope at k knots, phi is a function without jumps plus one that changes by at
most k (d + s T) over a time T, so twice that is added to the bound.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import comb, factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.certificate.errors import NotCertifiedError, require
from planner.certificate.intervals import UNDERFLOW, UNIT, Array, Interval, above
from planner.certificate.robot import ARM_JOINTS, Robot

MAX_JUMP = 1e-8
"""Maximum jump of position, velocity and acceleration at a knot due to rounding, rad, rad/s,
rad/s^2. A knot with a larger jump of velocity is a kink."""

MAX_DEGREE = 5

MAX_PIECES = 50_000

LIMIT_RATIO = 1e-9
"""Maximum relative excess over a limit due to rounding."""

MAX_HALVINGS = 30

QUANTITIES = ("position", "velocity", "acceleration", "jerk")

Indices = np.ndarray[Any, np.dtype[np.intp]]


def carried(
    v: Array, a: Array, rho: Array, offsets: Array, between: NDArray[np.bool_] | None = None
) -> tuple[Array, Array]:
    """Bounds on the velocity and acceleration of points that some joints carry.

    From the last joint to the first: w += 2 V u + sqrt(V^4 + A^2) rho, u += V rho, and rho grows by
    the offset to the next joint. The terms of w are the Coriolis acceleration, and the centripetal
    and Euler accelerations together, which are perpendicular.

    Args:
        v: maximum speed of each joint, shape (k, n), rad/s.
        a: maximum acceleration of each joint, shape (k, n), rad/s^2.
        rho: maximum distance of the points from the frame that carries them, shape (k,), m.
        offsets: lengths between successive joints, shape (n,), m.
        between: which joints count, shape (k, n); all when not given.
    """
    u, w = np.zeros_like(rho), np.zeros_like(rho)
    for i in range(len(offsets) - 1, -1, -1):
        counts = True if between is None else between[:, i]
        fast, hard = v[:, i], a[:, i]
        w = np.where(counts, w + 2.0 * fast * u + np.sqrt(fast**4 + hard**2) * rho, w)
        u = np.where(counts, u + fast * rho, u)
        rho = np.where(counts, rho + offsets[i], rho)
    return u * (1.0 + 1e-9), w * (1.0 + 1e-9)


class Polynomials:
    """A piecewise polynomial motion of some joints, seven of them in plans.

    Attributes:
        t: times of the n + 1 knots, from 0, s.
        derivatives: position, velocity, acceleration, jerk and so on at the start of each piece,
            shape (n, 4 to 6, joints); higher ones are 0.
        start, end: positions, velocities and accelerations at both ends, shape (3, joints).
        duration_s: the time of the last knot.
        v_peak, a_peak: upper bounds on |v| and |a| in each piece, shape (n, joints).
        jumps: upper bounds on the jumps of position, velocity and acceleration at any knot.
        kinks_s: times of the kinks, shape (k,), s.
        kinks: upper bounds on the jumps of velocity there, shape (k, joints), rad/s.
    """

    def __init__(self, t: Array, derivatives: Array, label: str, stated: Array) -> None:
        """Check a motion.

        Args:
            t: times of the knots.
            derivatives: at the start of each piece, shape (n, k, joints).
            label: its name in messages.
            stated: positions, velocities and accelerations at the knots, shape (m, 3, joints), with
                m = n + 1 where those of the last knot are stated, else n.

        Raises:
            NotCertifiedError: when it is malformed, or its position jumps.
        """
        self.label, self.t, self.derivatives = label, t, derivatives
        n = len(derivatives)
        require(n <= MAX_PIECES, f"{label}: more than {MAX_PIECES} pieces")
        require(t.shape == (n + 1,), f"{label}: knots do not fit the pieces")
        finite = [np.isfinite(x).all() for x in (t, derivatives, stated)]
        require(finite, f"{label}: a number is not finite")
        require(t[0] == 0.0, f"{label}: the first knot is not at 0")
        require(np.diff(t) > 0.0, f"{label}: the times of the knots do not increase")
        self.duration_s = float(t[-1])
        self._length = (Interval(t[1:]) - Interval(t[:-1])).reshaped(n, 1)
        after, jumps = stated[1:], []
        ends = [self._values(order, np.arange(n), self._length) for order in range(3)]
        for order, reached in enumerate(ends):
            jumps.append((reached[: len(after)] - after[:, order]).magnitude)
        is_kink = (jumps[1][: n - 1] > MAX_JUMP).any(axis=1) if n else np.zeros(0, np.bool_)
        self.kinks_s, self.kinks = t[1:-1][is_kink], jumps[1][: n - 1][is_kink]
        self.jumps = tuple(float(each.max(initial=0.0)) for each in jumps)
        self._rounding = float(
            np.delete(jumps[1], np.flatnonzero(is_kink), axis=0).max(initial=0.0)
        )
        require(self.jumps[0] <= MAX_JUMP, f"{label}: it jumps at a knot")
        last = [0.5 * (end.low[-1:] + end.high[-1:]) for end in ends]
        self.start = stated[0]
        self.end: Array = stated[-1] if len(stated) > n else np.concatenate(last)
        self.v_peak, self.a_peak = self._peaks(1), self._peaks(2)

    @classmethod
    def of_plan(cls, data: Mapping[str, Any], label: str) -> Polynomials:
        """Read a trajectory of a plan file: `knots_s`, `q`, `v` and `a` there, `j` between.

        Raises:
            NotCertifiedError: when it is malformed, or jumps at a knot.
        """
        try:
            t = np.array(data["knots_s"], np.float64)
            q, v, a, j = (np.array(data[key], np.float64).reshape(-1, ARM_JOINTS) for key in "qvaj")
        except (KeyError, TypeError, ValueError) as cause:
            raise NotCertifiedError(f"{label}: the trajectory is malformed: {cause!r}") from cause
        return cls.of_knots(t, (q, v, a), j, label)

    @classmethod
    def of_knots(cls, t: Array, qva: Sequence[Array], j: Array, label: str) -> Polynomials:
        """A motion of constant jerks, by its state at knots.

        Args:
            t: times of the knots, shape (n + 1,), s.
            qva: positions, velocities and accelerations there, each of shape (n + 1, joints).
            j: jerks between them, shape (n, joints).
            label: its name in messages.

        Raises:
            NotCertifiedError: when shapes do not match, or the motion jumps at a knot.
        """
        require([len(x) == len(j) + 1 for x in qva], f"{label}: knots do not fit the jerks")
        stated = np.stack(qva, axis=1)
        found = cls(t, np.concatenate([stated[:-1], j[:, None]], axis=1), label, stated)
        require(np.array(found.jumps) <= MAX_JUMP, f"{label}: it jumps at a knot")
        return found

    @classmethod
    def of_pieces(cls, data: Mapping[str, Any], label: str) -> Polynomials:
        """Read a motion of polynomials: `knots_s`, and `derivatives` at the start of each piece.

        Raises:
            NotCertifiedError: when it is malformed, of a degree above `MAX_DEGREE`, or its position
                jumps at a knot.
        """
        try:
            t = np.array(data["knots_s"], np.float64)
            given = np.array(data["derivatives"], np.float64)
            n, orders, joints = given.shape
        except (KeyError, TypeError, ValueError) as cause:
            raise NotCertifiedError(f"{label}: the motion is malformed: {cause!r}") from cause
        require(n > 0 and orders > 0 and joints == ARM_JOINTS, f"{label}: the motion is malformed")
        require(orders <= MAX_DEGREE + 1, f"{label}: of a degree above {MAX_DEGREE}")
        derivatives = np.zeros((n, max(orders, 4), ARM_JOINTS))
        derivatives[:, :orders] = given
        return cls(t, derivatives, label, derivatives[:, :3])

    def at(self, times_s: Array) -> Interval:
        """Positions at exact times, shape (k, joints)."""
        if not len(self.derivatives):
            return Interval(np.repeat(self.start[:1], len(times_s), axis=0))
        i = self._pieces(times_s, "right")
        return self._values(0, i, (Interval(times_s) - Interval(self.t[i])).reshaped(len(i), 1))

    def peaks(self, starts_s: Array, ends_s: Array) -> tuple[Array, Array, Array]:
        """Upper bounds on |v| and |a| of each joint in cells, and on the sum of the jumps of v.

        Each of shape (k, joints); only jumps at kinks inside a cell count.
        """
        if not len(self.derivatives):
            still = np.zeros((len(starts_s), self.start.shape[1]))
            return still, still, still
        cells, back = np.unique(starts_s + 1j * ends_s, return_inverse=True)  # many are equal
        starts_s, ends_s = cells.real, cells.imag
        first = self._pieces(starts_s, "right")
        last = np.maximum(self._pieces(ends_s, "left"), first)
        v, a = (_each(np.maximum, peak, first, last + 1) for peak in (self.v_peak, self.a_peak))
        first, last = self._inside(starts_s, ends_s)
        jumps = np.zeros_like(v)
        has_kink = np.flatnonzero(last > first)
        if len(has_kink):
            total = _each(np.add, self.kinks, first[has_kink], last[has_kink])
            jumps[has_kink] = total * (1.0 + 2.0 * len(self.kinks) * UNIT)
        return v[back], a[back], jumps[back]

    def cuts_s(self, starts_s: Array, ends_s: Array) -> Array:
        """Where cells are cut: at the kink inside that is nearest to the middle, or there."""
        middle = 0.5 * (starts_s + ends_s)
        if not len(self.kinks_s):
            return middle
        first, last = self._inside(starts_s, ends_s)
        middle_at = np.searchsorted(self.kinks_s, middle)
        second = np.clip(middle_at, first, np.maximum(last - 1, first))
        numbers = (np.maximum(second - 1, first), second)
        before, after = (self.kinks_s[np.minimum(k, len(self.kinks_s) - 1)] for k in numbers)
        nearest = np.where(middle - before <= after - middle, before, after)
        return np.where(last > first, nearest, middle)

    def slack_m(self, reach_m: float) -> float:
        """What is added to every bound on a gap because positions and velocities jump at knots, m.

        Each joint turns points that are at most `reach_m` away, so a jump of all n joints by d
        moves them by n d `reach_m`. Their velocities change by n s `reach_m`, and by
        n^2 d V `reach_m` as the joints before turn too. `peaks` counts jumps of velocity at kinks.
        """
        return self._slack_m(reach_m, len(self.derivatives), self.duration_s)

    def slack_in_cells_m(self, reach_m: float, starts_s: Array, ends_s: Array) -> float:
        """The same for bounds in cells, in each of which only its own knots count."""
        first, last = (np.searchsorted(self.t, each, side="right") for each in (starts_s, ends_s))
        knots, longest_s = (last - first).max(initial=0), (ends_s - starts_s).max(initial=0.0)
        return self._slack_m(reach_m, int(knots), float(longest_s))

    def _slack_m(self, reach_m: float, knots: int, time_s: float) -> float:
        if not len(self.derivatives):
            return 0.0
        d, s = self.jumps[0], self._rounding
        fastest = float(self.v_peak.max())
        joints = float(self.derivatives.shape[2])
        slope = joints * s + joints**2 * fastest * d
        return 2.1 * knots * reach_m * (joints * d + time_s * slope)

    def require_limits(self, *bounds: tuple[Array, Array] | None) -> None:
        """Refuse a motion that exceeds a limit.

        Args:
            bounds: minimum and maximum positions, velocities, accelerations and jerks, in this
                order, each of shape (7,); None for a quantity that is not judged.
        """
        for order, (bound, what) in enumerate(zip(bounds, QUANTITIES, strict=False)):
            if bound is None:
                continue
            for jump, before in zip(self.jumps[:order], QUANTITIES, strict=False):
                reason = f"{self.label}: the {before} jumps at a knot, so there is no {what}"
                require(jump <= MAX_JUMP, reason)
            self._require_within(order, bound, what)

    def _require_within(self, order: int, bounds: tuple[Array, Array], what: str) -> None:
        """Halve cells until the values at their ends, and the sag between, are within bounds."""
        low, high = bounds
        bends, n = self._peaks(order + 2), len(self.derivatives)
        i, start, end = np.arange(n), np.zeros(n), self._length.high[:, 0]
        is_there = (self.start[order : order + 1] >= low) & (self.start[order : order + 1] <= high)
        require(n > 0 or is_there, f"{self.label}: {what} beyond its limit")
        for _ in range(MAX_HALVINGS):
            ends = [self._values(order, i, Interval(t).reshaped(len(i), 1)) for t in (start, end)]
            for x, since in zip(ends, (start, end), strict=True):
                self._require_at(~((x.low >= low) & (x.high <= high)), self.t[i] + since, what)
            sag = above(bends[i] * ((end - start) ** 2)[:, None] / 8.0 * (1.0 + 16.0 * UNIT))
            lowest = np.minimum(ends[0].low, ends[1].low) - sag
            highest = np.maximum(ends[0].high, ends[1].high) + sag
            outside = ~((lowest >= low) & (highest <= high))
            is_open = outside.any(axis=1)
            i, start, end = i[is_open], start[is_open], end[is_open]
            if not len(i):
                return
            middle = 0.5 * (start + end)
            i = np.concatenate([i, i])
            start, end = np.concatenate([start, middle]), np.concatenate([middle, end])
        self._require_at(outside[is_open], self.t[i[: len(i) // 2]] + start[: len(i) // 2], what)

    def _require_at(self, outside: NDArray[np.bool_], times_s: Array, what: str) -> None:
        rows, joints = np.nonzero(outside)
        if len(rows):
            first = int(np.argmin(times_s[rows]))
            raise NotCertifiedError(
                f"{self.label}: {what} beyond its limit, joint {joints[first] + 1} at "
                f"{times_s[rows[first]]:.4f} s"
            )

    def _pieces(self, times_s: Array, side: Any) -> Indices:
        found: Indices = np.searchsorted(self.t, times_s, side=side) - 1
        return np.clip(found, 0, len(self.derivatives) - 1)

    def _inside(self, starts_s: Array, ends_s: Array) -> tuple[Indices, Indices]:
        """The first kink inside each cell, and the first after it."""
        first: Indices = np.searchsorted(self.kinks_s, starts_s, side="right")
        last: Indices = np.searchsorted(self.kinks_s, ends_s, side="left")
        return first, last

    def _values(self, order: int, i: Indices, since: Interval) -> Interval:
        """A derivative of pieces at times since their starts, by Horner's rule, (k, joints)."""
        *others, last = range(order, self.derivatives.shape[1])
        value = Interval(self.derivatives[i, last])
        for k in reversed(others):
            term = since * value
            value = Interval(self.derivatives[i, k]) + (
                term.over(k - order + 1.0) if k > order else term
            )
        return value

    def _peaks(self, order: int) -> Array:
        """Upper bounds on the absolute values of a derivative in each piece, shape (n, joints).

        They are the largest of the coefficients in Bernstein's basis of the two halves of the
        piece: a polynomial is a convex combination of its coefficients. These are computed in
        doubles. Each is a sum of shares of the coefficients of powers, so with fewer than 60
        roundings its error is below 64 units of the sum of their absolute values.
        """
        n, orders, joints = self.derivatives.shape
        if order >= orders:
            return np.zeros((n, joints))
        degree, length = orders - 1 - order, np.diff(self.t)[:, None]
        terms = np.array(
            [self.derivatives[:, order + k] * length**k / factorial(k) for k in range(degree + 1)]
        )
        points = np.tensordot(_BERNSTEIN[degree], terms, 1)
        peak = np.maximum(np.abs(points[0]), np.abs(points[-1]))
        while (
            len(points) > 1
        ):  # de Casteljau's rule at the middle: ends of rows belong to the halves
            points = 0.5 * (points[:-1] + points[1:])
            peak = np.maximum(peak, np.maximum(np.abs(points[0]), np.abs(points[-1])))
        error = 64.0 * UNIT * np.abs(terms).sum(axis=0) + UNDERFLOW
        return above(peak + error)


_BERNSTEIN = [
    np.array([[comb(i, k) / comb(degree, k) for k in range(degree + 1)] for i in range(degree + 1)])
    for degree in range(MAX_DEGREE + 1)
]
"""From coefficients of powers to coefficients in Bernstein's basis, by degree."""


def _each(of: np.ufunc, values: Array, first: Indices, last: Indices) -> Array:
    """The maximum or the sum of successive rows, from each `first` to before each `last`."""
    pairs = np.column_stack([first, last]).ravel()
    found: Array = of.reduceat(np.concatenate([values, values[-1:]]), pairs, axis=0)[::2]
    return found


def stated_limits(
    robot: Robot, stated: Mapping[str, Any], a_max: Array, j_max: Array, label: str
) -> tuple[tuple[Array, Array], ...]:
    """Bounds on positions, velocities, accelerations and jerks: the stricter of two each.

    Args:
        robot: the robot, with limits of position and velocity.
        stated: limits that the plan itself states.
        a_max: maximum accelerations, shape (7,), rad/s^2.
        j_max: maximum jerks, shape (7,), rad/s^3.
        label: name of the motion in messages.
    """
    try:
        low, high, v, a, j = (
            np.array(stated[key], np.float64).reshape(ARM_JOINTS)
            for key in ("q_min", "q_max", "v_max", "a_max", "j_max")
        )
    except (KeyError, TypeError, ValueError) as cause:
        raise NotCertifiedError(f"{label}: limits are malformed: {cause!r}") from cause
    greatest = (
        np.minimum(own, given) * (1.0 + LIMIT_RATIO)
        for own, given in ((v, robot.v_max), (a, a_max), (j, j_max))
    )
    q_min = np.maximum(low, robot.q_min) - MAX_JUMP
    q_max = np.minimum(high, robot.q_max) + MAX_JUMP
    return (q_min, q_max), *((-x, x) for x in greatest)
