"""Sparse matrices whose entries are sums of few computed numbers, each with a constant weight."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from baxter_kin.validation import FloatArray, Indices


class Rows(NamedTuple):
    """Some constraints, `low <= g(x) <= high`, with their derivatives.

    Attributes:
        g: n x 1.
        low: shape (n,).
        high: shape (n,).
        jacobian: of g, sparse.
        hessian: from multipliers, n x 1, to the second derivatives of `multipliers . g`, sparse,
            the upper triangle.
    """

    g: ca.MX
    low: FloatArray
    high: FloatArray
    jacobian: ca.MX
    hessian: Callable[[ca.MX], ca.MX]


class SparseSum:
    """A matrix made by `M[row, column] += weight * entry`, for entries computed elsewhere."""

    def __init__(self) -> None:
        self._parts: list[tuple[Indices, Indices, Indices, FloatArray]] = []

    def add(
        self, rows: Indices, columns: Indices, entries: Indices, weights: FloatArray | float = 1.0
    ) -> None:
        """Add entries by their numbers; all arguments have shapes that go together."""
        given = np.broadcast_arrays(rows, columns, entries)
        each = np.broadcast_to(np.asarray(weights, dtype=np.float64), given[0].shape)
        self._parts.append((*(numbers.ravel() for numbers in given), each.ravel()))  # type: ignore[arg-type]

    def matrix(self, entries: ca.MX, shape: tuple[int, int], *, is_upper: bool = False) -> ca.MX:
        """The sparse matrix, of what lies inside its shape.

        Args:
            entries: the numbers, n x 1.
            shape: rows and columns.
            is_upper: whether to leave out what is below the diagonal.
        """
        rows, columns, numbers, weights = (
            np.concatenate(part) for part in zip(*self._parts, strict=True)
        )
        inside: NDArray[np.bool_] = (rows < shape[0]) & (columns < shape[1])
        if is_upper:
            inside &= rows <= columns
        pattern, places = _pattern(rows[inside], columns[inside], shape)
        sums = (pattern.nnz(), entries.shape[0])
        return ca.MX(pattern, constant(places, numbers[inside], weights[inside], sums) @ entries)


def constant(rows: Indices, columns: Indices, weights: FloatArray, shape: tuple[int, int]) -> ca.DM:
    """A sparse matrix of constants; those at one place are added up."""
    pattern, places = _pattern(rows, columns, shape)
    return ca.DM(pattern, np.bincount(places, weights, pattern.nnz()))


def _pattern(
    rows: Indices, columns: Indices, shape: tuple[int, int]
) -> tuple[ca.Sparsity, Indices]:
    """Where entries are, and which of these each one is; CasADi counts column by column."""
    keys, places = np.unique(columns * shape[0] + rows, return_inverse=True)
    where = (keys % shape[0]).tolist(), (keys // shape[0]).tolist()
    return ca.Sparsity.triplet(*shape, *where), places
