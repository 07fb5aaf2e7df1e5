"""Interval arithmetic on arrays: every result encloses the exact one.

Each bound is computed in doubles, which IEEE 754 rounds to nearest, and then moved outwards by one
unit in the last place. Sines and cosines are Taylor polynomials in intervals, so that nothing
depends on the accuracy of a mathematics library.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

UNIT = 2.0**-53
"""Half a unit in the last place of 1: the relative error of one rounded operation."""

UNDERFLOW = 1e-150
"""Above the square root of the error of squares that underflow."""

MAX_ANGLE = 4.0
"""Maximum angle of `cos_sin`, rad; no joint of the robot turns farther."""

TERMS = 21
"""Number of terms of the Taylor polynomials. At 4 rad the remainder is below 4^42 / 42! = 2e-26."""


def above(x: ArrayLike) -> Array:
    """The next larger double."""
    found: Array = np.nextafter(x, np.inf)
    return found


def below(x: ArrayLike) -> Array:
    """The next smaller double."""
    found: Array = np.nextafter(x, -np.inf)
    return found


class Interval:
    """Arrays of intervals.

    Attributes:
        low: lower bounds, of any shape.
        high: upper bounds, of the same shape.
    """

    __array_ufunc__ = None  # arrays on the left of an operator defer to this class

    def __init__(self, low: ArrayLike, high: ArrayLike | None = None) -> None:
        """Enclose exact values.

        Args:
            low: lower bounds, or the values themselves.
            high: upper bounds; `low` when not given.
        """
        self.low: Array = np.asarray(low, np.float64)
        self.high: Array = self.low if high is None else np.asarray(high, np.float64)

    @classmethod
    def stacked(cls, rows: Sequence[Interval], axis: int) -> Interval:
        """Join intervals of one shape along a new axis."""
        return cls(
            np.stack([row.low for row in rows], axis), np.stack([row.high for row in rows], axis)
        )

    @property
    def magnitude(self) -> Array:
        """Upper bounds on the absolute values."""
        return np.maximum(np.abs(self.low), np.abs(self.high))

    def centred(self) -> tuple[Array, float]:
        """Middles of the intervals, and the maximum distance of any value from its middle."""
        middle: Array = 0.5 * (self.low + self.high)
        radius = np.maximum(above(self.high - middle), above(middle - self.low))
        return middle, float(radius.max(initial=0.0))

    def over(self, divisor: float | Array) -> Interval:
        """Divide by exact positive numbers."""
        return Interval(below(self.low / divisor), above(self.high / divisor))

    def reshaped(self, *shape: int) -> Interval:
        """The same intervals in another shape."""
        return Interval(self.low.reshape(shape), self.high.reshape(shape))

    def transposed(self) -> Interval:
        """Exchange the last two axes."""
        return Interval(np.swapaxes(self.low, -1, -2), np.swapaxes(self.high, -1, -2))

    def __getitem__(self, index: Any) -> Interval:
        return Interval(self.low[index], self.high[index])

    def __neg__(self) -> Interval:
        return Interval(-self.high, -self.low)

    def __add__(self, other: Interval | ArrayLike) -> Interval:
        term = _interval(other)
        return Interval(below(self.low + term.low), above(self.high + term.high))

    def __sub__(self, other: Interval | ArrayLike) -> Interval:
        return self + -_interval(other)

    def __mul__(self, other: Interval | ArrayLike) -> Interval:
        least, greatest = _products(self, _interval(other))
        return Interval(below(least), above(greatest))

    __radd__, __rmul__ = __add__, __mul__


class Pose:
    """Rigid transforms as intervals: x in one frame is R x + p in the other.

    Attributes:
        R: rotation matrices, shape (..., 3, 3).
        p: translations, shape (..., 3), m.
    """

    def __init__(self, R: Interval, p: Interval) -> None:
        self.R, self.p = R, p

    @classmethod
    def identity(cls) -> Pose:
        """The identity."""
        return cls(Interval(np.eye(3)), Interval(np.zeros(3)))

    @classmethod
    def of_urdf(cls, xyz: ArrayLike, rpy: ArrayLike) -> Pose:
        """An `<origin>` of a URDF: translation in m, then roll, pitch and yaw about fixed axes."""
        cosines, sines = cos_sin(Interval(rpy))
        roll, pitch, yaw = (turn(axis, cosines[axis], sines[axis]) for axis in range(3))
        return cls(product(product(yaw, pitch), roll), Interval(xyz))

    def __mul__(self, other: Pose) -> Pose:
        moved = product(self.R, other.p.reshaped(*other.p.low.shape, 1))
        return Pose(product(self.R, other.R), moved[..., 0] + self.p)

    def inverse(self) -> Pose:
        """The inverse; the rotation is assumed to be orthonormal."""
        turned = self.R.transposed()
        return Pose(turned, -product(turned, self.p.reshaped(*self.p.low.shape, 1))[..., 0])


def product(first: Interval, second: Interval) -> Interval:
    """Matrix products, shapes (..., 3, 3) and (..., 3, k)."""
    least, greatest = _products(first[..., :, :, None], second[..., None, :, :])
    low, high = below(least), above(greatest)
    return Interval(
        below(below(low[..., 0, :] + low[..., 1, :]) + low[..., 2, :]),
        above(above(high[..., 0, :] + high[..., 1, :]) + high[..., 2, :]),
    )


def cos_sin(angle: Interval) -> tuple[Interval, Interval]:
    """Cosine and sine of angles up to `MAX_ANGLE`, rad.

    With y = x^2, cos x = 1 - y/(1 2) (1 - y/(3 4) (1 - ...)), and sin x / x likewise with
    1/(2 3), 1/(4 5), ... The innermost bracket is 1 - z for some 0 <= z < 1, within [0, 2].

    Raises:
        ValueError: when an angle is larger.
    """
    if not (angle.magnitude <= MAX_ANGLE).all():
        raise ValueError(f"an angle is beyond {MAX_ANGLE:g} rad")
    y, odd = angle * angle, np.arange(2.0).reshape(2, *[1] * angle.low.ndim)
    both = Interval(np.zeros((2, *angle.low.shape)), np.full((2, *angle.low.shape), 2.0))
    for i in range(TERMS, 0, -1):
        both = Interval(1.0) - (y * both).over((2 * i - 1 + odd) * (2 * i + odd))
    return both[0], both[1] * angle


def rotation(axis: int, angle: Interval) -> Interval:
    """Rotation matrices about x, y or z (0, 1, 2), shape (..., 3, 3), of angles of shape (...)."""
    return turn(axis, *cos_sin(angle))


def turn(axis: int, c: Interval, s: Interval) -> Interval:
    """Rotation matrices about x, y or z, of angles given by their cosines and sines."""
    zero, one = Interval(np.zeros_like(c.low)), Interval(np.ones_like(c.low))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rows = [[zero] * 3 for _ in range(3)]
    rows[axis][axis], rows[i][i], rows[j][j], rows[j][i], rows[i][j] = one, c, c, s, -s
    return Interval.stacked([Interval.stacked(row, -1) for row in rows], -2)


def turns_about(axis: Array, angle: Interval) -> Interval:
    """Rotations about a unit vector by n angles, shape (n, 3, 3), by Rodrigues' formula."""
    x, y, z = axis
    K = Interval(np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]))
    c, s = (part.reshaped(-1, 1, 1) for part in cos_sin(angle))
    return Interval(np.eye(3)) + s * K + (Interval(1.0) - c) * product(K, K)


def axis_angle(R: Array) -> tuple[Array, float]:
    """Axis and angle of a rotation matrix, in doubles, without a bound on the error.

    From the quaternion (w, x, y, z): of the matrix of all products of two components, given by
    traces and off-diagonal sums, the row of the largest component is the most accurate.
    """
    (a, b, c), (d, e, f), (g, h, i) = R
    products = np.array(
        [
            [1.0 + a + e + i, h - f, c - g, d - b],
            [h - f, 1.0 + a - e - i, b + d, c + g],
            [c - g, b + d, 1.0 - a + e - i, f + h],
            [d - b, c + g, f + h, 1.0 - a - e + i],
        ]
    )
    best = products[int(np.argmax(np.diag(products)))]
    q = best / np.linalg.norm(best) * (1.0 if best[0] >= 0.0 else -1.0)
    sine = float(np.linalg.norm(q[1:]))
    axis = q[1:] / sine if sine > 0.0 else np.array([0.0, 0.0, 1.0])
    return axis, 2.0 * float(np.arctan2(sine, q[0]))


def norm_bound(vectors: Array) -> Array:
    """Upper bounds on the lengths of vectors along the last axis.

    The rounded sum of n squares and its root have an error of less than n + 2 units.
    """
    length = np.sqrt((vectors**2).sum(axis=-1))
    bound: Array = length * (1.0 + (vectors.shape[-1] + 6) * UNIT) + UNDERFLOW
    return bound


def _products(first: Interval, second: Interval) -> tuple[Array, Array]:
    """The least and the greatest products of two intervals' ends, each rounded to nearest."""
    lows = (first.low,) if first.low is first.high else (first.low, first.high)
    highs = (second.low,) if second.low is second.high else (second.low, second.high)
    products = [x * y for x in lows for y in highs]
    least = greatest = products[0]
    for other in products[1:]:
        least, greatest = np.minimum(least, other), np.maximum(greatest, other)
    return least, greatest


def _interval(value: Interval | ArrayLike) -> Interval:
    return value if isinstance(value, Interval) else Interval(value)
