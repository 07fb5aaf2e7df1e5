from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.frames import angle_between
from baxter_kin.ik.kernel import (
    ITERATIONS,
    SEED_TOLERANCE_RAD,
    bounds_of,
    search_function,
    solve_symmetric,
)

ROUNDING = 1e-12

URDF_ROUNDING = 1e-10
"""The search takes the URDF's right angles for exact, which moves the tip by 2e-11 m."""

CONVERGED = 1e-9


@pytest.fixture(scope="module")
def search(left: Arm) -> ca.Function:
    return search_function(left)


def run(search: ca.Function, arm: Arm, q: np.ndarray, T: np.ndarray) -> tuple[np.ndarray, ...]:
    q_found, report = (np.array(x).ravel() for x in search(q, T, bounds_of(arm)))
    return q_found, report


def test_symmetric_systems_are_solved_as_numpy_solves_them() -> None:
    rng = np.random.default_rng(0)
    A, b = ca.SX.sym("A", 6, 6), ca.SX.sym("b", 6)
    solve = ca.Function("solve", [A, b], [solve_symmetric(A, b)])
    for _ in range(50):
        root, rhs = rng.normal(size=(6, 6)), rng.normal(size=6)
        matrix = root @ root.T + np.eye(6)
        np.testing.assert_allclose(
            np.array(solve(matrix, rhs)).ravel(), np.linalg.solve(matrix, rhs), atol=ROUNDING
        )


def test_solution_reaches_the_pose_by_pinocchio(search: ca.Function, left: Arm) -> None:
    rng, middle = np.random.default_rng(1), bounds_of(left).reshape(2, 7).mean(axis=0)
    solved = 0
    for _ in range(300):
        T = left.T_base_tip(left.random_configuration(rng))
        q, report = run(search, left, middle, T.homogeneous)
        if report[0] == 1.0:
            reached = left.T_base_tip(q)
            assert np.linalg.norm(reached.translation - T.translation) < CONVERGED + URDF_ROUNDING
            assert angle_between(reached.rotation, T.rotation) < CONVERGED + URDF_ROUNDING
            assert not left.limits.violations(q)
            solved += 1
    assert solved > 200


def test_errors_are_those_of_the_last_iterate_whether_it_converged_or_not(
    search: ca.Function, left: Arm
) -> None:
    rng = np.random.default_rng(2)
    for _ in range(100):
        T = left.T_base_tip(left.random_configuration(rng))
        q, report = run(search, left, left.random_configuration(rng), T.homogeneous)
        reached = left.T_base_tip(q)
        offset = np.linalg.norm(reached.translation - T.translation)
        assert report[1] == pytest.approx(offset, abs=URDF_ROUNDING)
        angle = angle_between(reached.rotation, T.rotation)
        assert (
            2 * np.sin(angle / 2) == pytest.approx(report[2], abs=URDF_ROUNDING)
            or angle > np.pi / 2
        )


def test_start_at_the_solution_is_the_solution(search: ca.Function, left: Arm) -> None:
    q, report = run(search, left, left.start, left.T_base_tip(left.start).homogeneous)
    np.testing.assert_array_equal(q, left.start)
    assert report[3] == 1


def test_search_ends_after_its_iterations(search: ca.Function, left: Arm) -> None:
    T = np.eye(4)
    T[0, 3] = 5.0
    _, report = run(search, left, left.start, T)
    assert report[0] == 0.0
    assert report[3] == ITERATIONS + 1


@pytest.mark.parametrize(
    "T",
    [
        np.diag([1.0, 1.0, -1.0, 1.0]),
        np.diag([1.0, 1.001, 1.0, 1.0]),
        np.full((4, 4), np.nan),
        np.diag([1.0, 1.0, 1.0, 2.0]),
    ],
)
def test_what_is_no_pose_is_not_solved(search: ca.Function, left: Arm, T: np.ndarray) -> None:
    _, report = run(search, left, left.start, T)
    assert report[0] == 0.0
    assert report[4] == 0.0


@pytest.mark.parametrize("bad", [np.nan, np.inf, 5.0])
def test_a_start_that_is_none_is_not_solved(search: ca.Function, left: Arm, bad: float) -> None:
    T = left.T_base_tip(left.start).homogeneous
    _, report = run(search, left, np.where(np.arange(7) == 3, bad, left.start), T)
    assert report[0] == 0.0
    assert report[4] == 0.0


def test_a_start_slightly_outside_the_limits_is_clamped(search: ca.Function, left: Arm) -> None:
    q = np.array(left.limits.q_max) + 0.9 * SEED_TOLERANCE_RAD
    _, report = run(search, left, q, left.T_base_tip(left.limits.q_max).homogeneous)
    assert report[4] == 1.0


def test_a_half_turn_away_is_not_mistaken_for_the_pose(search: ca.Function, left: Arm) -> None:
    """There the skew part of the rotation matrix vanishes as well."""
    T = left.T_base_tip(left.start)
    for axis in np.eye(3):
        turned = T.homogeneous
        turned[:3, :3] = (2 * np.outer(axis, axis) - np.eye(3)) @ turned[:3, :3]
        q, report = run(search, left, left.start, turned)
        reached = left.T_base_tip(q)
        if report[0] == 1.0:
            assert angle_between(reached.rotation, turned[:3, :3]) < 1e-6
