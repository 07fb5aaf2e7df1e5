"""Cubic splines on [0, 1] whose first and last three coefficients fix their ends.

A cubic spline over n segments is a sum of n + 3 B-splines, of which four differ from zero on each
segment (de Boor, "A Practical Guide to Splines", 1978, ch. IX and X). With the end knots repeated
four times, value, slope and curvature at an end depend on the three outermost coefficients alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from baxter_kin.arrays import Vector

DEGREE = 3
ENDS = 3
"""How many coefficients at either end the value, slope and curvature there fix."""


@dataclass(frozen=True, slots=True, eq=False)
class ClampedSpline:
    """The space of cubic splines over some knots.

    Attributes:
        knots: shape (n + 1,), from 0 to 1, increasing; n is at least 4.
        slopes: shape (n, n + 3): coefficients -> those of the first derivative but the first and
            the last. On a segment the derivative is between the one of its own and its neighbours'.
        at_knots: three matrices of shape (n + 1, n + 3): coefficients -> values, first and second
            derivatives at the knots.
        third: shape (n, n + 3): coefficients -> third derivatives of the segments.
    """

    knots: Vector
    slopes: Vector
    at_knots: tuple[Vector, Vector, Vector]
    third: Vector

    @classmethod
    def over(cls, knots: Vector) -> ClampedSpline:
        """The splines over those knots."""
        t = np.concatenate([np.zeros(DEGREE), knots, np.ones(DEGREE)])
        first = _differences(t, 3)
        second = _differences(t[1:-1], 2) @ first
        third = _differences(t[2:-2], 1) @ second
        values = (_basis(t, 3, knots), _basis(t[1:-1], 2, knots), _basis(t[2:-2], 1, knots))
        return cls(knots, first[1:-1], (values[0], values[1] @ first, values[2] @ second), third)

    @property
    def segments(self) -> int:
        """How many there are."""
        return len(self.knots) - 1

    def ends(self, first: Vector, last: Vector) -> tuple[Vector, Vector]:
        """The outermost coefficients for a value, slope and curvature at either end.

        Args:
            first: at 0, shape (3,) or (3, m) for m splines.
            last: the same at 1.

        Returns:
            The first and the last three coefficients, each of the shape of `first`.
        """
        start = np.array([matrix[0, :ENDS] for matrix in self.at_knots])
        end = np.array([matrix[-1, -ENDS:] for matrix in self.at_knots])
        return np.linalg.solve(start, first), np.linalg.solve(end, last)

    def through(self, values: Vector, first: Vector, last: Vector) -> Vector:
        """The coefficients of the spline through values at the knots but the second from each end.

        These two are left out because the ends take two conditions more than there are knots.

        Args:
            values: at the knots, shape (n + 1,) or (n + 1, m).
            first: value, slope and curvature at 0, shape (3,) or (3, m).
            last: the same at 1.

        Returns:
            Shape (n + 3,) or (n + 3, m).
        """
        head, tail = self.ends(first, last)
        rows = self.at_knots[0][2:-2]
        known = rows[:, :ENDS] @ head + rows[:, -ENDS:] @ tail
        inner = np.linalg.solve(rows[:, ENDS:-ENDS], values[2:-2] - known)
        return np.concatenate([head, inner, tail])

    def columns(self, matrix: Vector) -> Vector:
        """Of each row k of a matrix (n, n + 3), the four entries from column k on, shape (n, 4)."""
        here = np.arange(self.segments)[:, None] + np.arange(DEGREE + 1)
        return np.take_along_axis(matrix, here, axis=1)


def _basis(t: Vector, degree: int, x: Vector) -> Vector:
    """All B-splines of a degree over the extended knots t, at x: de Boor's recurrence."""
    last = int(np.searchsorted(t, t[-1])) - 1
    B = np.zeros((len(x), len(t) - 1))
    B[np.arange(len(x)), np.minimum(np.searchsorted(t, x, side="right") - 1, last)] = 1.0
    for d in range(1, degree + 1):
        width = t[d:] - t[:-d]
        inverse = np.divide(1.0, width, out=np.zeros_like(width), where=width > 0.0)
        rising = (x[:, None] - t[:-d]) * inverse
        falling = np.where(width > 0.0, 1.0 - rising, 0.0)
        B = rising[:, :-1] * B[:, :-1] + falling[:, 1:] * B[:, 1:]
    return B


def _differences(t: Vector, degree: int) -> Vector:
    """Coefficients of a spline -> coefficients of its derivative."""
    n = len(t) - degree - 1
    slope = degree / (t[degree + 1 : degree + n] - t[1:n])
    D, row = np.zeros((n - 1, n)), np.arange(n - 1)
    D[row, row], D[row, row + 1] = -slope, slope
    return D
