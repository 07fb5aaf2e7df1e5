"""Cubics between the points of a self-motion curve, and their distances from configurations.

Between neighbours with known unit tangents runs Hermite's cubic. Its distance from the curve is of
the fourth power of the length.
"""

from __future__ import annotations

import math

import numpy as np

from baxter_kin.ik.self_motion.solution_curve import CurvePoint, SolutionCurve, whole_turns_off
from baxter_kin.validation import FloatArray, Indices

_EXACT = 1e-13
"""Residual, m and rad together, of a corrected point: that of rounding, after one more step."""

_PROJECTIONS = 3

_RIVALS = 4
"""Number of segments examined, those with the nearest chords: parts of a curve may be close."""


class Segment:
    """The curve from one point to the next, by Hermite's cubic through both and their tangents."""

    def __init__(self, solution_curve: SolutionCurve, a: CurvePoint, b: CurvePoint) -> None:
        self._curve = solution_curve
        self.a, self.b = a, b
        self._chord = b.q - a.q
        self.length_rad = float(arc_lengths(self._chord, a.tangent, b.tangent))

    def estimate(self, u: float) -> FloatArray:
        """The cubic at a share `u` of the way, in [0, 1], shape (7,), rad.

        Its distance from the curve is of the fourth power of the length.
        """
        return self._cubic(u)[0]

    def direction(self, u: float) -> FloatArray:
        """The unit direction of the cubic at `u`, shape (7,)."""
        slope = self._cubic(u)[1]
        unit: FloatArray = slope / math.sqrt(slope @ slope)
        return unit

    def exact(self, u: float) -> FloatArray:
        """The configuration of the curve at `u`, shape (7,), rad, in a new array.

        The nearer end if the corrector fails, which happens only at a singularity.
        """
        if u in (0.0, 1.0):
            return np.array(self.b.q if u else self.a.q)
        found = self._curve.corrected(*self._cubic(u), _EXACT)
        if found is None:
            return np.array(self.a.q if u < 0.5 else self.b.q)
        return found[0]

    def _cubic(self, u: float) -> tuple[FloatArray, FloatArray]:
        weights = _weights(u, self.length_rad)
        position, slope = weights @ np.array([self._chord, self.a.tangent, self.b.tangent])
        return self.a.q + position, slope

    def coefficients(self, joint: int) -> tuple[float, float, float, float]:
        """Coefficients of a joint of the cubic, for powers of `u` from 0 to 3, rad."""
        h, rise = self.length_rad, float(self._chord[joint])
        first, last = h * float(self.a.tangent[joint]), h * float(self.b.tangent[joint])
        return (
            float(self.a.q[joint]),
            first,
            3.0 * rise - 2.0 * first - last,
            first + last - 2 * rise,
        )

    def turns(self, joint: int) -> list[float]:
        """0, 1, and between them, in order, the shares at which a joint of the cubic turns back."""
        _, c1, c2, c3 = self.coefficients(joint)
        return [
            0.0,
            *sorted(u for u in _quadratic_roots(3.0 * c3, 2.0 * c2, c1) if 0.0 < u < 1.0),
            1.0,
        ]


def cubics(
    q: FloatArray, tangent: FloatArray, segment: Indices, u: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Points and slopes of the cubics between the points of a curve.

    Args:
        q: the points, shape (n, 7), rad; whole turns between neighbours are ignored.
        tangent: unit directions there, shape (n, 7).
        segment: indices of the cubics, 0 to n - 2, shape (k,).
        u: shares of the cubics, in [0, 1], shape (k,).

    Returns:
        Configurations, rad, and derivatives of the cubics by the share, rad; shape (k, 7) each.
    """
    chord = whole_turns_off(np.diff(q, axis=0))
    length = arc_lengths(chord, tangent[:-1], tangent[1:])[segment]
    ends = np.array([chord[segment], tangent[segment], tangent[segment + 1]])
    position, slope = np.einsum("ijk,jkl->ikl", _weights(u, length), ends)
    return q[segment] + position, slope


def feet(
    q: FloatArray, tangent: FloatArray, near: FloatArray, breaks: Indices | None = None
) -> tuple[FloatArray, FloatArray]:
    """Distances of configurations from the cubics through points, and the directions there.

    Whole turns of a joint are ignored. Exact for configurations closer than the bends of the curve.

    Args:
        q: points of one or more successive curves, two or more of each; shape (n, 7), rad.
        tangent: unit directions there, shape (n, 7).
        near: the configurations, shape (k, 7), rad.
        breaks: indices of the first points of all curves except the first.

    Returns:
        Distances, shape (k,), rad, and unit directions of the cubics, shape (k, 7).
    """
    squares = _chord_distances(_on_circles(q), _on_circles(near))
    if breaks is not None:
        squares[:, breaks - 1] = np.inf
    count = min(_RIVALS, squares.shape[1])
    segment = np.argpartition(squares, count - 1, axis=1)[:, :count].ravel()
    each = np.repeat(near, count, axis=0)
    distance, direction = _cubic_feet(q, tangent, each, segment)
    distance = distance.reshape(len(near), count)
    best = np.argmin(distance, axis=1) + count * np.arange(len(near))
    return distance.ravel()[best], direction[best]


def _chord_distances(points: FloatArray, near: FloatArray) -> FloatArray:
    """Squares of the distances from points, (k, m), to chords of a polygon, (n, m): (k, n - 1)."""
    start, chord = points[:-1], np.diff(points, axis=0)
    length = np.square(chord).sum(axis=1).clip(min=np.finfo(float).tiny)
    along = (near @ chord.T - (start * chord).sum(axis=1)) / length
    share = along.clip(0.0, 1.0)
    offset = np.square(near).sum(axis=1)[:, None] - 2.0 * near @ start.T
    offset += np.square(start).sum(axis=1)
    squares: FloatArray = offset + length * share * (share - 2.0 * along)
    return squares


def _cubic_feet(
    q: FloatArray, tangent: FloatArray, near: FloatArray, segment: Indices
) -> tuple[FloatArray, FloatArray]:
    """`feet` on one segment each, by Newton's method for the share of the segment."""
    start, chord = q[segment], whole_turns_off(q[segment + 1] - q[segment])
    ends = np.array([chord, tangent[segment], tangent[segment + 1]])
    length = arc_lengths(*ends)
    miss = offset = whole_turns_off(near - start)
    slope, u = chord, np.zeros(len(near))
    for _ in range(_PROJECTIONS):
        step = (miss * slope).sum(axis=1) / np.square(slope).sum(axis=1)
        u = (u + step).clip(0.0, 1.0)
        position, slope = np.einsum("ijk,jkl->ikl", _weights(u, length), ends)
        miss = offset - position
    distance: FloatArray = np.sqrt(np.square(miss).sum(axis=1))
    return distance, slope / np.sqrt(np.square(slope).sum(axis=1))[:, None]


def _on_circles(q: FloatArray) -> FloatArray:
    """Each angle as a point on the unit circle, shape (n, 14), so that whole turns are ignored."""
    return np.concatenate([np.cos(q), np.sin(q)], axis=1)


def _weights(u: float | FloatArray, h: float | FloatArray) -> FloatArray:
    """Weights of chord and both tangents in Hermite's cubic and in its slope: shape (2, 3, ...).

    Args:
        u: shares of the segment, shape (...).
        h: lengths, shape (...), rad.
    """
    back = 1.0 - u
    position = u * u * (3.0 - 2.0 * u), h * u * back * back, -h * u * u * back
    slope = 6.0 * u * back, h * back * (1.0 - 3.0 * u), -h * u * (2.0 - 3.0 * u)
    return np.array([position, slope])


def _quadratic_roots(a: float, b: float, c: float) -> list[float]:
    """The real roots of `a u^2 + b u + c`, without cancellation (Press et al., 1992, 5.6)."""
    square = b * b - 4.0 * a * c
    if square < 0.0:
        return []
    t = -0.5 * (b + math.copysign(math.sqrt(square), b))
    return [over / under for over, under in ((t, a), (c, t)) if under != 0.0]


def arc_lengths(chord: FloatArray, tangent_a: FloatArray, tangent_b: FloatArray) -> FloatArray:
    """The lengths of cubics between points with unit tangents, shape (...), rad.

    Simpson's rule for the speed of the cubic; the error is of the fifth power of the length.

    Args:
        chord: from a to b, shape (..., 7), rad.
        tangent_a: shape (..., 7).
        tangent_b: shape (..., 7).
    """
    straight = np.sqrt(np.square(chord).sum(axis=-1))
    middle = 1.5 * chord - 0.25 * straight[..., None] * (tangent_a + tangent_b)
    lengths: FloatArray = (straight + 2.0 * np.sqrt(np.square(middle).sum(axis=-1))) / 3.0
    return lengths
