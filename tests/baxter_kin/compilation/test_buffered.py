from __future__ import annotations

import threading

import casadi as ca
import numpy as np
import pytest

from baxter_kin.compilation.buffered import BufferedFunction


@pytest.fixture
def product() -> ca.Function:
    """A matrix (2 x 3) times a vector, and the matrix doubled."""
    A, x = ca.SX.sym("A", 2, 3), ca.SX.sym("x", 3)
    return ca.Function("product", [A, x], [A @ x, 2 * A])


A = np.arange(6.0).reshape(2, 3)
X = np.array([1.0, -2.0, 0.5])


def test_columns_go_in_and_out_as_rows(product: ca.Function) -> None:
    Ax, doubled = BufferedFunction(product)(A.T, X[None])
    np.testing.assert_array_equal(Ax, [A @ X])
    np.testing.assert_array_equal(doubled, 2.0 * A.T)


def test_outputs_are_read_without_a_copy(product: ca.Function) -> None:
    buffered = BufferedFunction(product)
    memory = buffered.outputs[0]
    buffered.inputs[0][:], buffered.inputs[1][:] = A.T, X
    buffered.run()
    np.testing.assert_array_equal(memory, [A @ X])


def test_results_of_a_call_outlive_the_next_one(product: ca.Function) -> None:
    buffered = BufferedFunction(product)
    first = buffered(A.T, X[None])[0]
    buffered(A.T, 2.0 * X[None])
    np.testing.assert_array_equal(first, [A @ X])


def test_columns_that_are_not_given_stay_as_they_were(product: ca.Function) -> None:
    buffered = BufferedFunction(product)
    buffered(A.T, X[None])
    doubled = buffered(np.zeros((1, 2)), X[None])[1]
    np.testing.assert_array_equal(doubled, [[0.0, 0.0], *(2.0 * A.T[1:])])


def test_each_thread_has_memory_of_its_own(product: ca.Function) -> None:
    buffered, found = BufferedFunction(product), dict[float, np.ndarray]()
    barrier = threading.Barrier(2)

    def work(scale: float) -> None:
        buffered.inputs[0][:], buffered.inputs[1][:] = A.T, scale * X
        barrier.wait(10)  # both have written before either runs
        buffered.run()
        barrier.wait(10)
        found[scale] = buffered.outputs[0].copy()

    threads = [threading.Thread(target=work, args=(scale,)) for scale in (1.0, 2.0)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for scale in (1.0, 2.0):
        np.testing.assert_array_equal(found[scale], [A @ (scale * X)])
