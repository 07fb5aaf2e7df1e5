"""Points of the curve of configurations that reach one pose."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from baxter_kin.validation import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class CurvePoint:
    """One point of the curve.

    Attributes:
        q: configuration, shape (7,), rad.
        tangent: unit direction of travel, shape (7,).
        determinant: of `[J; tangent']`; its size is Yoshikawa's manipulability.
        residual: norm of the pose error, m and rad together.
        clearance_rad: from the joint nearest to a limit to that limit; below zero outside.
    """

    q: FloatArray
    tangent: FloatArray
    determinant: float
    residual: float
    clearance_rad: float

    @property
    def measures(self) -> tuple[float, float, float]:
        """Determinant, residual and clearance."""
        return self.determinant, self.residual, self.clearance_rad

    def reversed(self) -> CurvePoint:
        """The same point, travelled the other way."""
        return replace(self, tangent=-self.tangent, determinant=-self.determinant)


@dataclass(frozen=True, slots=True, eq=False)
class CurvePoints:
    """Points of the curve in order, n of them, in one array that is quickly cut and joined.

    Attributes:
        rows: q, tangent, determinant, residual and clearance of each, as of `CurvePoint`; shape
            (n, 17).
    """

    rows: FloatArray

    @classmethod
    def of(cls, points: Iterable[CurvePoint]) -> CurvePoints:
        """Those points."""
        rows = [np.concatenate([p.q, p.tangent, p.measures]) for p in points]
        return cls(np.reshape(rows, (-1, 17)))

    @property
    def q(self) -> FloatArray:
        """Configurations, shape (n, 7), rad."""
        return self.rows[:, :7]

    @property
    def tangent(self) -> FloatArray:
        """Unit directions of travel, shape (n, 7)."""
        return self.rows[:, 7:14]

    @property
    def determinant(self) -> FloatArray:
        """Of `[J; tangent']`, shape (n,)."""
        return self.rows[:, 14]

    @property
    def residual(self) -> FloatArray:
        """Norms of the pose error, shape (n,), m and rad together."""
        return self.rows[:, 15]

    @property
    def clearance_rad(self) -> FloatArray:
        """From the joint nearest to a limit to that limit, shape (n,); below zero outside."""
        return self.rows[:, 16]

    @property
    def chords_rad(self) -> FloatArray:
        """Distances between neighbours, whole turns of joints apart, shape (n - 1,), rad."""
        squares = np.square(whole_turns_off(np.diff(self.q, axis=0))).sum(axis=1)
        return np.asarray(np.sqrt(squares))

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, i: int) -> CurvePoint:
        row = self.rows[i]
        return CurvePoint(row[:7], row[7:14], *row[14:].tolist())

    def part(self, index: slice | NDArray[np.generic]) -> CurvePoints:
        """Some of them."""
        return CurvePoints(self.rows[index])

    def reversed(self) -> CurvePoints:
        """The same points, travelled the other way."""
        rows = np.array(self.rows[::-1])
        rows[:, 7:15] *= -1.0
        return CurvePoints(rows)

    def then(self, *others: CurvePoints) -> CurvePoints:
        """These points, then others."""
        return CurvePoints(np.concatenate([self.rows, *(other.rows for other in others)]))


def whole_turns_off(angles: FloatArray) -> FloatArray:
    """The same angles but for whole turns, in [-pi, pi]."""
    turns = np.round(angles / (2.0 * math.pi))
    return angles - 2.0 * math.pi * turns
