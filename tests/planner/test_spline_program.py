"""The interior-point method, against HiGHS on the same linear programs."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from planner.spline_program import SplineProgram

SEGMENTS = 8
ROWS = 5
AGREEMENT = 1e-5
"""Both solvers stop within about 1e-7 of the optimum."""

Vector = NDArray[np.float64]


def random_program(seed: int, shift: float = 0.0) -> SplineProgram:
    """Feasible at zero when the bounds are not shifted, and bounded below by t >= -1."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(SEGMENTS, ROWS, 4))
    b, r = rng.normal(size=(2, SEGMENTS, ROWS))
    low, high = r - rng.uniform(0.1, 1.0, r.shape), r + rng.uniform(0.1, 1.0, r.shape)
    A[0, 0], b[0, 0], r[0, 0], low[0, 0], high[0, 0] = 0.0, 1.0, 0.0, -1.0, 10.0
    return SplineProgram(A, b, r, low + shift, high + shift)


def dense(program: SplineProgram) -> tuple[Vector, Vector, Vector]:
    """All rows over (inner coefficients, t), and their bounds."""
    rows = np.zeros((SEGMENTS, ROWS, SEGMENTS + 4))
    for k in range(SEGMENTS):
        rows[k, :, k : k + 4] = program.A[k]
        rows[k, :, -1] = program.b[k]
    free = [*range(3, SEGMENTS), SEGMENTS + 3]
    bounds = (program.low - program.r, program.high - program.r)
    return rows.reshape(-1, SEGMENTS + 4)[:, free], bounds[0].ravel(), bounds[1].ravel()


def least_by_highs(program: SplineProgram) -> float:
    rows, low, high = dense(program)
    A = ca.DM(rows)
    cost = np.zeros(rows.shape[1])
    cost[-1] = 1.0
    shapes = {"h": ca.Sparsity(len(cost), len(cost)), "a": A.sparsity()}
    solver = ca.conic("least", "highs", shapes, {"highs": {"output_flag": False}})
    return float(solver(a=A, g=cost, lba=low, uba=high)["cost"])


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_the_least_value_is_that_of_another_solver(seed: int) -> None:
    program = random_program(seed)
    solution = program.solved()
    assert solution is not None
    assert solution[1] == pytest.approx(least_by_highs(program), abs=AGREEMENT)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_the_solution_keeps_every_bound(seed: int) -> None:
    program = random_program(seed)
    solution = program.solved()
    assert solution is not None
    rows, low, high = dense(program)
    values = rows @ np.append(solution[0][3:-3], solution[1])
    assert (values >= low - AGREEMENT).all()
    assert (values <= high + AGREEMENT).all()


def test_the_outermost_coefficients_stay() -> None:
    solution = random_program(1).solved()
    assert solution is not None
    assert not solution[0][:3].any()
    assert not solution[0][-3:].any()


def test_contradictory_bounds_have_no_solution() -> None:
    program = random_program(2)
    A, b = np.array(program.A), np.array(program.b)
    A[1, 0], b[1, 0] = 0.0, 1.0  # t between 2 and 3, against t at most 1
    r, low, high = (np.array(x) for x in (program.r, program.low, program.high))
    high[0, 0] = 1.0
    r[1, 0], low[1, 0], high[1, 0] = 0.0, 2.0, 3.0
    assert SplineProgram(A, b, r, low, high).solved() is None
