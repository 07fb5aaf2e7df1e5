from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.frames import angle_between
from baxter_kin.ik.search.arm_numbers import ArmNumbers
from baxter_kin.ik.search.exact_search import ITERATIONS, SEED_TOLERANCE_RAD, solve_symmetric
from baxter_kin.ik.search.searcher import exact_functions
from baxter_kin.kinematics.dh_parameters import DHParameters
from baxter_kin.kinematics.symbolic import Shape, dimensions_of

ROUNDING = 1e-12

URDF_ROUNDING = 1e-10
"""The search takes the URDF's right angles for exact, which moves the tip by 2e-11 m."""

CONVERGED = 1e-9


@pytest.fixture(scope="module")
def search(any_arm: Arm) -> ca.Function:
    return exact_functions(ArmNumbers.of(any_arm).shape)[0]


def run(search: ca.Function, arm: Arm, q: np.ndarray, T: np.ndarray) -> tuple[np.ndarray, ...]:
    q_found, report = (np.array(x).ravel() for x in search(q, T, ArmNumbers.of(arm).within()))
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


def test_solution_reaches_the_pose_by_pinocchio(search: ca.Function, any_arm: Arm) -> None:
    rng, limits = np.random.default_rng(1), any_arm.limits
    middle = 0.5 * (limits.q_min + limits.q_max)
    solved = 0
    for _ in range(300):
        T = any_arm.T_base_tip(any_arm.random_configuration(rng))
        q, report = run(search, any_arm, middle, T.homogeneous)
        if report[0] == 1.0:
            reached = any_arm.T_base_tip(q)
            assert np.linalg.norm(reached.translation - T.translation) < CONVERGED + URDF_ROUNDING
            assert angle_between(reached.rotation, T.rotation) < CONVERGED + URDF_ROUNDING
            assert not any_arm.limits.violations(q)
            solved += 1
    assert solved > 200


def test_errors_are_those_of_the_last_iterate_whether_it_converged_or_not(
    search: ca.Function, any_arm: Arm
) -> None:
    rng = np.random.default_rng(2)
    for _ in range(100):
        T = any_arm.T_base_tip(any_arm.random_configuration(rng))
        q, report = run(search, any_arm, any_arm.random_configuration(rng), T.homogeneous)
        reached = any_arm.T_base_tip(q)
        offset = np.linalg.norm(reached.translation - T.translation)
        assert report[1] == pytest.approx(offset, abs=URDF_ROUNDING)
        angle = angle_between(reached.rotation, T.rotation)
        assert (
            2 * np.sin(angle / 2) == pytest.approx(report[2], abs=URDF_ROUNDING)
            or angle > np.pi / 2
        )


def test_start_at_the_solution_is_the_solution(search: ca.Function, any_arm: Arm) -> None:
    q, report = run(search, any_arm, any_arm.start, any_arm.T_base_tip(any_arm.start).homogeneous)
    np.testing.assert_array_equal(q, any_arm.start)
    assert report[3] == 1


def test_search_ends_after_its_iterations(search: ca.Function, any_arm: Arm) -> None:
    T = np.eye(4)
    T[0, 3] = 5.0
    _, report = run(search, any_arm, any_arm.start, T)
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
def test_what_is_no_pose_is_not_solved(search: ca.Function, any_arm: Arm, T: np.ndarray) -> None:
    _, report = run(search, any_arm, any_arm.start, T)
    assert report[0] == 0.0
    assert report[4] == 0.0


@pytest.mark.parametrize("bad", [np.nan, np.inf, 5.0])
def test_a_start_that_is_none_is_not_solved(search: ca.Function, any_arm: Arm, bad: float) -> None:
    T = any_arm.T_base_tip(any_arm.start).homogeneous
    _, report = run(search, any_arm, np.where(np.arange(7) == 3, bad, any_arm.start), T)
    assert report[0] == 0.0
    assert report[4] == 0.0


def test_a_start_slightly_outside_the_limits_is_clamped(search: ca.Function, any_arm: Arm) -> None:
    q = np.array(any_arm.limits.q_max) + 0.9 * SEED_TOLERANCE_RAD
    _, report = run(search, any_arm, q, any_arm.T_base_tip(any_arm.limits.q_max).homogeneous)
    assert report[4] == 1.0


def test_a_half_turn_away_is_not_mistaken_for_the_pose(search: ca.Function, any_arm: Arm) -> None:
    """There the skew part of the rotation matrix vanishes as well."""
    T = any_arm.T_base_tip(any_arm.start)
    for axis in np.eye(3):
        turned = T.homogeneous
        turned[:3, :3] = (2 * np.outer(axis, axis) - np.eye(3)) @ turned[:3, :3]
        q, report = run(search, any_arm, any_arm.start, turned)
        reached = any_arm.T_base_tip(q)
        if report[0] == 1.0:
            assert angle_between(reached.rotation, turned[:3, :3]) < 1e-6


def test_right_angles_are_the_general_case_with_nominal_dimensions(left: Arm) -> None:
    numbers, rng = ArmNumbers.of(left), np.random.default_rng(5)
    assert numbers.shape is Shape.SQUARE
    exact = dimensions_of(DHParameters.of(left))
    general = replace(numbers, shape=Shape.GENERAL, dimensions=exact)
    for _ in range(50):
        T = left.T_base_tip(left.random_configuration(rng)).homogeneous
        found = [
            [
                np.array(x).ravel()
                for x in exact_functions(each.shape)[0](left.start, T, each.within())
            ]
            for each in (numbers, general)
        ]
        if found[0][1][0] == found[1][1][0] == 1.0:
            np.testing.assert_allclose(found[0][0], found[1][0], atol=1e-6)


@pytest.mark.parametrize("at", [0, 6, 12, 22, 23, 28])
def test_any_dimension_off_makes_an_arm_general(left: Arm, at: int) -> None:
    dimensions = dimensions_of(DHParameters.of(left))
    dimensions[at] += 1e-3
    is_free = at in Shape.SQUARE.value
    assert Shape.of(dimensions) is (Shape.SQUARE if is_free else Shape.GENERAL)
