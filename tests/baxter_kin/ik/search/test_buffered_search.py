from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from baxter_kin.ik.search.buffered_search import BATCH_SIZES, BatchedSearch, BufferedSearch, Found


@pytest.fixture(scope="module")
def function() -> ca.Function:
    """As a search: it ends at the start moved by the first column of the pose and a shared number.

    Its report: valid where the start is above zero, two errors, iterations, valid input.
    """
    q, T, shared = ca.MX.sym("q", 7), ca.MX.sym("T", 4, 4), ca.MX.sym("shared", 2)
    moved = q + shared[0] + 10 * T[0, 3] + 100 * T[3, 0]
    report = ca.vertcat(q[0] > 0, ca.fabs(q[1]), ca.fabs(q[2]), shared[1], 1)
    return ca.Function("search", [q, T, shared], [moved, report])


SHARED = np.array([0.5, 3.0])

ROUNDING = 1e-12
"""Of sums of numbers up to 1,000."""


def requests(count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(count)
    return rng.normal(size=(count, 7)), rng.normal(size=(count, 4, 4))


@pytest.fixture(scope="module")
def batched(function: ca.Function) -> BatchedSearch:
    return BatchedSearch(function, (np.zeros(7), np.eye(4)))


@pytest.mark.parametrize("count", sorted({1, 2, *BATCH_SIZES, 17, BATCH_SIZES[-1] * 2 + 3}))
def test_of_any_number_each_gets_its_own_answer(batched: BatchedSearch, count: int) -> None:
    q, T = requests(count)
    found = batched((q, T), (SHARED,))
    expected = q + (0.5 + 10.0 * T[:, 0, 3] + 100.0 * T[:, 3, 0])[:, None]
    np.testing.assert_allclose(found.q, expected, atol=ROUNDING)
    np.testing.assert_array_equal(found.is_valid, q[:, 0] > 0.0)
    np.testing.assert_array_equal(found.position_error_m, np.abs(q[:, 1]))
    np.testing.assert_array_equal(found.orientation_error_rad, np.abs(q[:, 2]))
    np.testing.assert_array_equal(found.iterations, np.full(count, 3.0))


def test_what_was_found_outlives_the_next_search(batched: BatchedSearch) -> None:
    q, T = requests(3)
    found = batched((q, T), (SHARED,))
    kept = found.q.copy()
    batched((q + 1.0, T), (SHARED,))
    np.testing.assert_array_equal(found.q, kept)


def test_one_alone_is_as_one_among_many(function: ca.Function, batched: BatchedSearch) -> None:
    (q, T), alone = requests(5), BufferedSearch(function, (SHARED,))
    together = batched((q, T), (SHARED,))
    for i in range(5):
        alone.request[0][:], alone.request[1][:] = q[i], T[i]
        alone.run()
        np.testing.assert_array_equal(alone.q, together.q[i])
        assert (alone.report[0] == 1.0) == together.is_valid[i]


def found_with(position_errors_m: list[float], *, q: float) -> Found:
    count = len(position_errors_m)
    errors = np.array(position_errors_m), np.zeros(count)
    return Found(np.full((count, 7), q), errors[0] == 0.0, *errors, np.full(count, q))


def test_only_what_is_better_is_improved_on() -> None:
    found = found_with([0.3, 0.2, 0.1], q=1.0)
    found.improve(np.array([0, 2]), found_with([0.0, 0.4], q=2.0))
    assert found.position_error_m.tolist() == [0.0, 0.2, 0.1]
    assert found.q[:, 0].tolist() == found.iterations.tolist() == [2.0, 1.0, 1.0]
    assert found.is_valid.tolist() == [True, False, False]


def test_no_requests_find_nothing(function: ca.Function) -> None:
    search = BatchedSearch(function, (np.zeros(7), np.eye(4)))
    found = search((np.empty((0, 7)), np.empty((0, 4, 4))), (SHARED,))
    assert found.q.shape == (0, 7)
    assert found.is_valid.shape == (0,)
