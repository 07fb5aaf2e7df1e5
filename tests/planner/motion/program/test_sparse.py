"""Sparse sums against dense ones."""

from __future__ import annotations

import casadi as ca
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.validation import FloatArray
from planner.motion.program.sparse import SparseSum, constant

ROUNDING = 1e-12

seeds = st.integers(0, 2**32 - 1)


def added(
    seed: int, shape: tuple[int, int], beyond: int = 0
) -> tuple[SparseSum, FloatArray, ca.DM]:
    """A sum of random parts, the same made densely, and the entries that both are made of."""
    rng, entries = np.random.default_rng(seed), np.random.default_rng(seed + 1).normal(size=12)
    found, dense = SparseSum(), np.zeros((shape[0] + beyond, shape[1] + beyond))
    for _ in range(3):
        rows = rng.integers(0, shape[0] + beyond, (4, 1))
        columns = rng.integers(0, shape[1] + beyond, (4, 2))
        numbers, weights = rng.integers(0, 12, (4, 2)), rng.normal(size=(4, 2))
        found.add(rows, columns, numbers, weights)
        np.add.at(dense, (np.broadcast_to(rows, (4, 2)), columns), weights * entries[numbers])
    return found, dense[: shape[0], : shape[1]], ca.DM(entries)


def evaluated(found: SparseSum, entries: ca.DM, shape: tuple[int, int], **options: bool) -> ca.DM:
    symbols = ca.MX.sym("entries", 12)
    matrix = found.matrix(symbols, shape, **options)
    return ca.Function("matrix", [symbols], [matrix])(entries)


@given(seeds)
def test_entries_at_one_place_are_added_up_with_their_weights(seed: int) -> None:
    found, dense, entries = added(seed, (4, 3))
    np.testing.assert_allclose(evaluated(found, entries, (4, 3)).full(), dense, atol=ROUNDING)


@given(seeds)
def test_what_lies_outside_of_the_shape_is_left_out(seed: int) -> None:
    found, dense, entries = added(seed, (3, 3), beyond=2)
    np.testing.assert_allclose(evaluated(found, entries, (3, 3)).full(), dense, atol=ROUNDING)


@given(seeds)
def test_of_an_upper_triangle_nothing_is_below_the_diagonal(seed: int) -> None:
    found, dense, entries = added(seed, (4, 4))
    upper = evaluated(found, entries, (4, 4), is_upper=True)
    np.testing.assert_allclose(upper.full(), np.triu(dense), atol=ROUNDING)
    assert upper.sparsity().is_triu()


def test_places_without_entries_are_not_stored() -> None:
    found = SparseSum()
    found.add(np.array([0, 2]), np.array([1, 1]), np.array([3, 4]))
    matrix = found.matrix(ca.MX.sym("entries", 12), (3, 3))
    assert matrix.sparsity().get_triplet() == ([0, 2], [1, 1])


def test_a_weight_that_is_not_given_is_one() -> None:
    found, entries = SparseSum(), np.arange(12.0)
    found.add(np.array([0, 0]), np.array([0, 1]), np.array([5, 7]))
    assert evaluated(found, ca.DM(entries), (1, 2)).full().tolist() == [[5.0, 7.0]]


@given(seeds)
def test_constants_at_one_place_are_added_up(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, columns, weights = rng.integers(0, 4, 9), rng.integers(0, 3, 9), rng.normal(size=9)
    dense = np.zeros((4, 3))
    np.add.at(dense, (rows, columns), weights)
    found = constant(rows, columns, weights, (4, 3))
    np.testing.assert_allclose(found.full(), dense, atol=ROUNDING)
