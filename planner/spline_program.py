"""A linear program over the coefficients of a cubic spline, solved by an interior-point method.

The unknowns are the inner coefficients of a spline over n segments and one number more, which is
minimised. Every row touches the four coefficients of one segment, so an iteration costs some array
operations of size n and the solution of one system of n equations.

The method is Mehrotra's ("On the implementation of a primal-dual interior point method", SIAM J.
Optim. 2(4), 1992), with bounds on both sides of every row: su and sl are the distances from the
upper and the lower ones, lu and ll their multipliers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baxter_kin.arrays import Indices, Vector
from planner.clamped_spline import DEGREE, ENDS

TOLERANCE = 1e-7
"""Sum of the complementarity products, and greatest residual, of a solution."""

FREE = 1e3
"""A bound that is never met, for rows with one side only; rows are of order one."""

_ITERATIONS = 60
_TO_THE_BOUNDARY = 0.99
_LEAST_SLACK = 0.1
_REGULARISATION = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class SplineProgram:
    """Minimise t subject to `low <= r + A x + b t <= high` on every segment; m rows on each of n.

    The first and the last three coefficients are fixed: their x is zero.

    Attributes:
        A: shape (n, m, 4): effect of the coefficients k to k + 3 on the rows of segment k.
        b: shape (n, m): effect of t.
        r: shape (n, m): values at x = 0, t = 0.
        low: lower bounds, shape (n, m).
        high: upper bounds, shape (n, m).
    """

    A: Vector
    b: Vector
    r: Vector
    low: Vector
    high: Vector

    def solved(self) -> tuple[Vector, float] | None:
        """The coefficients x, shape (n + 3,), and t; None when there is no solution."""
        rows, upper, lower = _Rows.of(self.A, self.b), self.high - self.r, self.low - self.r
        point = _start(rows, upper, lower)
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            for _ in range(_ITERATIONS):
                residual = _residual(point, rows, upper, lower)
                if residual.size <= TOLERANCE:
                    return np.pad(point.y[:-1], ENDS), float(point.y[-1])
                step = _Newton.at(point, residual, rows)
                if step is None:
                    return None
                point = _improved(point, step)
        return None


class _Rows(NamedTuple):
    """The rows as a linear map of y: the free coefficients, then t."""

    A: Vector
    At: Vector
    columns: Indices
    pairs: Indices
    size: int

    @classmethod
    def of(cls, A: Vector, b: Vector) -> _Rows:
        n, size = len(A), len(A) + DEGREE + 1 - 2 * ENDS
        place = np.arange(n)[:, None] + np.arange(DEGREE + 1) - ENDS
        is_free = (place >= 0) & (place < size - 1)
        # fixed coefficients have no effect, wherever their zeros are added
        place = np.concatenate([np.where(is_free, place, 0), np.full((n, 1), size - 1)], axis=1)
        A = np.concatenate([A * is_free[:, None], b[:, :, None]], axis=2)
        pairs = (place[:, :, None] * size + place[:, None]).ravel()
        return cls(A, np.ascontiguousarray(A.transpose(0, 2, 1)), place, pairs, size)

    def times(self, y: Vector) -> Vector:
        product: Vector = np.matmul(self.A, y[self.columns][:, :, None])[:, :, 0]
        return product

    def transposed_times(self, w: Vector) -> Vector:
        parts = np.matmul(self.At, w[:, :, None])
        return _summed(self.columns.ravel(), parts.ravel(), self.size)

    def normal_inverse(self, weights: Vector) -> Vector | None:
        """The inverse of A' W A."""
        blocks = np.matmul(self.At * weights[:, None], self.A)
        normal = _summed(self.pairs, blocks.ravel(), self.size**2)
        normal[:: self.size + 1] += _REGULARISATION
        if not np.isfinite(normal).all():
            return None
        try:
            return np.asarray(np.linalg.inv(normal.reshape(self.size, -1)), dtype=np.float64)
        except np.linalg.LinAlgError:
            return None


def _summed(places: Indices, parts: Vector, size: int) -> Vector:
    """The sum of the parts that belong to each place."""
    return np.asarray(np.bincount(places, parts, size), dtype=np.float64)


class _Point(NamedTuple):
    """Unknowns, row values, and slacks and multipliers of the upper and lower bounds."""

    y: Vector
    rows: Vector
    su: Vector
    sl: Vector
    lu: Vector
    ll: Vector

    def moved(self, by: _Point, primal: float, dual: float) -> _Point:
        steps = (primal, primal, primal, primal, dual, dual)
        return _Point(*(x + step * dx for x, dx, step in zip(self, by, steps, strict=True)))

    def gap(self) -> float:
        """The sum of the complementarity products."""
        return float(np.vdot(self.su, self.lu) + np.vdot(self.sl, self.ll))

    def longest(self, by: _Point, share: float = 1.0) -> tuple[float, float]:
        """That share of the way to where a slack, and a multiplier, is zero; one at most."""
        primal = max(np.max(-by.su / self.su), np.max(-by.sl / self.sl))
        dual = max(np.max(-by.lu / self.lu), np.max(-by.ll / self.ll))
        return 1.0 / max(1.0, float(primal) / share), 1.0 / max(1.0, float(dual) / share)


class _Residual(NamedTuple):
    """By how much the conditions of an optimum are missed."""

    dual: Vector
    upper: Vector
    lower: Vector
    size: float


def _start(rows: _Rows, upper: Vector, lower: Vector) -> _Point:
    su, sl = np.maximum(upper, _LEAST_SLACK), np.maximum(-lower, _LEAST_SLACK)
    share = 1.0 / (su.size + sl.size)
    return _Point(np.zeros(rows.size), np.zeros_like(su), su, sl, share / su, share / sl)


def _residual(point: _Point, rows: _Rows, upper: Vector, lower: Vector) -> _Residual:
    dual = rows.transposed_times(point.lu - point.ll)
    dual[-1] += 1.0  # the gradient of what is minimised
    above, below = point.su + point.rows - upper, point.sl - point.rows + lower
    parts = (dual, above, below)
    size = max(point.gap(), *(float(np.abs(part).max()) for part in parts))
    return _Residual(dual, above, below, size)


class _Newton(NamedTuple):
    """Steps towards wanted complementarity products, all with one factorised matrix."""

    point: _Point
    residual: _Residual
    rows: _Rows
    inverse: Vector

    @classmethod
    def at(cls, point: _Point, residual: _Residual, rows: _Rows) -> _Newton | None:
        inverse = rows.normal_inverse(point.lu / point.su + point.ll / point.sl)
        return None if inverse is None else cls(point, residual, rows, inverse)

    def step(self, excess_u: Vector, excess_l: Vector) -> _Point:
        """The step that takes those amounts off the products su lu and sl ll, to first order."""
        (_, _, su, sl, lu, ll), residual = self.point, self.residual
        push = (lu * residual.upper - excess_u) / su - (ll * residual.lower - excess_l) / sl
        dy = self.inverse @ -(residual.dual + self.rows.transposed_times(push))
        rows = self.rows.times(dy)
        dsu, dsl = -residual.upper - rows, -residual.lower + rows
        return _Point(dy, rows, dsu, dsl, -(excess_u + lu * dsu) / su, -(excess_l + ll * dsl) / sl)


def _improved(point: _Point, newton: _Newton) -> _Point:
    """The next point: Mehrotra's predictor, then his centred corrector."""
    (_, _, su, sl, lu, ll), count = point, 2 * point.su.size
    ahead = newton.step(su * lu, sl * ll)
    gap = point.gap()
    centring = (point.moved(ahead, *point.longest(ahead)).gap() / gap) ** 3 * gap / count
    by = newton.step(
        su * lu + ahead.su * ahead.lu - centring, sl * ll + ahead.sl * ahead.ll - centring
    )
    return point.moved(by, *point.longest(by, _TO_THE_BOUNDARY))
