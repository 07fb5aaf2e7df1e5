"""A self-motion curve between two neighbouring points: a cubic, then corrected to the pose."""

from __future__ import annotations

import math

import numpy as np

from baxter_kin.arrays import Vector
from baxter_kin.ik.fibre import CurvePoint, PoseFibre

_EXACT = 1e-13
"""Residual, m and rad together, of a corrected point: what rounding leaves after one step more."""


class Segment:
    """The curve from one point to the next, by Hermite's cubic through both and their tangents."""

    def __init__(self, fibre: PoseFibre, a: CurvePoint, b: CurvePoint) -> None:
        """Join `a` and `b`, in the direction of travel."""
        self._fibre = fibre
        self.a, self.b = a, b
        self._chord = b.q - a.q
        self.length_rad = float(arc_lengths(self._chord, a.tangent, b.tangent))

    def estimate(self, u: float) -> Vector:
        """The cubic at a share `u` of the way, in [0, 1], shape (7,), rad.

        Off the curve by the fourth power of the length.
        """
        h = self.length_rad
        ease = u * u * (3.0 - 2.0 * u)
        out, back = h * u * (1.0 - u) ** 2, h * u * u * (1.0 - u)
        q: Vector = self.a.q + ease * self._chord
        return q + out * self.a.tangent - back * self.b.tangent

    def direction(self, u: float) -> Vector:
        """The unit direction of the cubic at `u`, shape (7,)."""
        h = self.length_rad
        out, back = h * (1.0 - u) * (1.0 - 3.0 * u), h * u * (2.0 - 3.0 * u)
        slope = 6.0 * u * (1.0 - u) * self._chord + out * self.a.tangent - back * self.b.tangent
        unit: Vector = slope / math.sqrt(slope @ slope)
        return unit

    def exact(self, u: float) -> Vector:
        """The configuration of the curve at `u`, shape (7,), rad, a fresh array.

        Where the corrector fails, which takes a singularity: the nearer end.
        """
        if u in (0.0, 1.0):
            return np.array(self.b.q if u else self.a.q)
        found = self._fibre.corrected(self.estimate(u), self.direction(u), _EXACT)
        if found is None:
            return np.array(self.a.q if u < 0.5 else self.b.q)
        return found[0]

    def turns(self, joint: int) -> list[float]:
        """0, 1, and between them, in order, where that joint of the cubic turns back."""
        h, rise = self.length_rad, float(self._chord[joint])
        first, last = h * float(self.a.tangent[joint]), h * float(self.b.tangent[joint])
        slope = [3.0 * (first + last - 2.0 * rise), 6.0 * rise - 4.0 * first - 2.0 * last, first]
        inside = [u.real for u in np.roots(slope) if u.imag == 0.0 and 0.0 < u.real < 1.0]
        return [0.0, *sorted(map(float, inside)), 1.0]


def arc_lengths(chord: Vector, tangent_a: Vector, tangent_b: Vector) -> Vector:
    """The lengths of cubics between points whose unit tangents are known, shape (...), rad.

    Simpson's rule on the speed of the cubic; off by the fifth power of the length.

    Args:
        chord: from a to b, shape (..., 7), rad.
        tangent_a: shape (..., 7).
        tangent_b: shape (..., 7).
    """
    straight = np.sqrt(np.square(chord).sum(axis=-1))
    middle = 1.5 * chord - 0.25 * straight[..., None] * (tangent_a + tangent_b)
    lengths: Vector = (straight + 2.0 * np.sqrt(np.square(middle).sum(axis=-1))) / 3.0
    return lengths
