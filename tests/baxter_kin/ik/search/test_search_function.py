from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm
from baxter_kin.frames import angle_between
from baxter_kin.ik.search.map_search import search_functions
from baxter_kin.ik.search.search_function import (
    INSET,
    ITERATIONS,
    SEED_TOLERANCE_RAD,
    ArmNumbers,
    solve_symmetric,
    task_coordinates,
)
from baxter_kin.ik.tolerance import EXACT, Task, Tolerance
from baxter_kin.kinematics.dh_parameters import DHParameters
from baxter_kin.kinematics.symbolic import Shape, dimensions_of

ROUNDING = 1e-12

URDF_ROUNDING = 1e-10
"""The search assumes that the URDF's right angles are exact, which moves the tip by 2e-11 m."""

CONVERGED = 1e-9


@pytest.fixture(scope="module")
def search(any_arm: Arm) -> ca.Function:
    return search_functions(ArmNumbers.of(any_arm).shape)[0]


def task_of(arm: Arm, tolerance: Tolerance = EXACT) -> np.ndarray:
    """The task as input of the search."""
    return Task.of(arm, tolerance).numbers(DHParameters.of(arm).T_last_tip)


def run_from(search: ca.Function, arm: Arm, q: np.ndarray, T: np.ndarray) -> tuple[np.ndarray, ...]:
    inputs = q, T, task_of(arm), ArmNumbers.of(arm).within()
    q_found, report = (np.array(x).ravel() for x in search(*inputs))
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
    for _ in range(100):
        T = any_arm.T_base_tip(any_arm.random_configuration(rng))
        q, report = run_from(search, any_arm, middle, T.homogeneous)
        if report[0] == 1.0:
            reached = any_arm.T_base_tip(q)
            assert np.linalg.norm(reached.translation - T.translation) < CONVERGED + URDF_ROUNDING
            assert angle_between(reached.rotation, T.rotation) < CONVERGED + URDF_ROUNDING
            assert not any_arm.limits.violations(q)
            solved += 1
    assert solved > 70


def test_errors_are_those_of_the_last_iterate(search: ca.Function, any_arm: Arm) -> None:
    rng = np.random.default_rng(2)
    for _ in range(100):
        T = any_arm.T_base_tip(any_arm.random_configuration(rng))
        q, report = run_from(search, any_arm, any_arm.random_configuration(rng), T.homogeneous)
        reached = any_arm.T_base_tip(q)
        offset = np.linalg.norm(reached.translation - T.translation)
        assert report[1] == pytest.approx(offset, abs=URDF_ROUNDING)
        angle = angle_between(reached.rotation, T.rotation)
        assert (
            2 * np.sin(angle / 2) == pytest.approx(report[2], abs=URDF_ROUNDING)
            or angle > np.pi / 2
        )


def test_start_at_the_solution_is_the_solution(search: ca.Function, any_arm: Arm) -> None:
    q, report = run_from(
        search, any_arm, any_arm.start, any_arm.T_base_tip(any_arm.start).homogeneous
    )
    np.testing.assert_array_equal(q, any_arm.start)
    assert report[3] == 1


def test_search_ends_after_its_iterations(search: ca.Function, any_arm: Arm) -> None:
    T = np.eye(4)
    T[0, 3] = 5.0
    _, report = run_from(search, any_arm, any_arm.start, T)
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
def test_invalid_poses_are_not_solved(search: ca.Function, any_arm: Arm, T: np.ndarray) -> None:
    _, report = run_from(search, any_arm, any_arm.start, T)
    assert report[0] == 0.0
    assert report[4] == 0.0


@pytest.mark.parametrize("bad", [np.nan, np.inf, 5.0])
def test_a_start_that_is_none_is_not_solved(search: ca.Function, any_arm: Arm, bad: float) -> None:
    T = any_arm.T_base_tip(any_arm.start).homogeneous
    _, report = run_from(search, any_arm, np.where(np.arange(7) == 3, bad, any_arm.start), T)
    assert report[0] == 0.0
    assert report[4] == 0.0


def test_a_start_slightly_outside_the_limits_is_clamped(search: ca.Function, any_arm: Arm) -> None:
    q = np.array(any_arm.limits.q_max) + 0.9 * SEED_TOLERANCE_RAD
    _, report = run_from(search, any_arm, q, any_arm.T_base_tip(any_arm.limits.q_max).homogeneous)
    assert report[4] == 1.0


def test_a_half_turn_away_is_not_mistaken_for_the_pose(search: ca.Function, any_arm: Arm) -> None:
    """The skew part of the rotation matrix vanishes there as well."""
    T = any_arm.T_base_tip(any_arm.start)
    for axis in np.eye(3):
        turned = T.homogeneous
        turned[:3, :3] = (2 * np.outer(axis, axis) - np.eye(3)) @ turned[:3, :3]
        q, report = run_from(search, any_arm, any_arm.start, turned)
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
                for x in search_functions(each.shape)[0](
                    left.start, T, task_of(left), each.within()
                )
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


AGREEMENT = 1e-12


@pytest.fixture(scope="module")
def coordinates() -> ca.Function:
    T, p, R = ca.SX.sym("T", 4, 4), ca.SX.sym("p", 3), ca.SX.sym("R", 3, 3)
    free = ca.SX.sym("free")
    return ca.Function("coordinates", [T, p, R, free], [task_coordinates(T, p, R, free)])


def pairs(arm: Arm, count: int) -> list[tuple[pin.SE3, pin.SE3]]:
    """Poses and others nearby, from a nanoradian to nearly half a turn away."""
    rng = np.random.default_rng(1)
    found = []
    for _ in range(count):
        T = arm.T_base_tip(arm.random_configuration(rng))
        axis, angle = rng.normal(size=3), min(10.0 ** rng.uniform(-9.0, 0.5), 3.1)
        R = pin.exp3(angle * axis / np.linalg.norm(axis))
        found.append((T, T * pin.SE3(R, rng.normal(size=3))))
    return found


def test_coordinates_are_displacement_and_rotation_vector(
    left: Arm, coordinates: ca.Function
) -> None:
    for target, reached in pairs(left, 150):
        D = target.actInv(reached)
        x = np.array(coordinates(target.homogeneous, reached.translation, reached.rotation, 0))
        expected = np.concatenate([D.translation, pin.log3(D.rotation)])
        np.testing.assert_allclose(x.ravel(), expected, atol=AGREEMENT)


def test_with_the_roll_free_the_rotation_is_the_tilt(left: Arm, coordinates: ca.Function) -> None:
    tolerance = Tolerance.about("z")
    for target, reached in pairs(left, 150):
        x = np.array(coordinates(target.homogeneous, reached.translation, reached.rotation, 1))
        _, tilt = tolerance.excess(target, reached)
        assert np.linalg.norm(x[3:]) == pytest.approx(tilt, abs=AGREEMENT)
        assert x[5] == 0.0


def test_a_task_as_good_as_exact_is_the_exact_search(any_arm: Arm) -> None:
    """Widths of zero have a step of their own; widths of nearly zero have the general one."""
    numbers = ArmNumbers.of(any_arm)
    search, rng, solved = search_functions(numbers.shape)[0], np.random.default_rng(2), 0
    nearly = Tolerance((1e-15,) * 3)
    for _ in range(40):
        T = any_arm.T_base_tip(any_arm.random_configuration(rng))
        both = [
            [
                np.array(x).ravel()
                for x in search(any_arm.neutral, T.homogeneous, task, numbers.within())
            ]
            for task in (task_of(any_arm), task_of(any_arm, nearly))
        ]
        for q, report in both:
            distance, angle = EXACT.excess(T, any_arm.T_base_tip(q))
            assert report[1] == pytest.approx(distance, abs=1e-10)
            assert report[2] == pytest.approx(2 * np.sin(angle / 2), abs=1e-10) or (
                report[2] == pytest.approx(angle, abs=1e-10) or angle > np.pi / 2
            )
        solved += int(both[0][1][0] == both[1][1][0] == 1.0)
    assert solved > 20


def test_an_exact_search_is_that_of_the_tool_as_well(any_arm: Arm) -> None:
    tool = any_arm.with_tip(
        pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.5])), np.array([0.1, 0.2, 0.3]))
    )
    search, rng, solved = (
        search_functions(ArmNumbers.of(tool).shape)[0],
        np.random.default_rng(3),
        0,
    )
    for _ in range(40):
        T = tool.T_base_tip(tool.random_configuration(rng))
        q, report = run_from(search, tool, tool.neutral, T.homogeneous)
        if report[0] == 1.0:
            assert max(EXACT.excess(T, tool.T_base_tip(q))) <= CONVERGED + 1e-9
            solved += 1
    assert solved > 20


@pytest.mark.parametrize("tilt_rad", [0.0, 0.3])
def test_the_error_of_the_search_is_the_excess_over_the_cone(any_arm: Arm, tilt_rad: float) -> None:
    """For a search that ends where it starts, with all joints locked."""
    numbers, tolerance = ArmNumbers.of(any_arm), Tolerance.about("z", tilt_rad=tilt_rad)
    search, task = search_functions(numbers.shape)[0], task_of(any_arm, tolerance)
    for target, reached in pairs(any_arm, 50):
        q = np.array(any_arm.start)
        T = any_arm.T_base_tip(q) * reached.actInv(target)
        _, report = search(q, T.homogeneous, task, numbers.within(np.concatenate([q, q])))
        expected = tolerance.excess(T, any_arm.T_base_tip(q))
        assert np.array(report).ravel()[1:3] == pytest.approx(expected, abs=3 * INSET)


def test_frames_lead_from_base_and_from_the_tip(any_arm: Arm) -> None:
    dh, task = DHParameters.of(any_arm), task_of(any_arm)
    frames = ArmNumbers.of(any_arm).frame, task[:12], task[12:24]
    expected = dh.T_base_first.inverse(), dh.T_last_tip, dh.T_last_tip.inverse()
    for numbers, T in zip(frames, expected, strict=True):
        np.testing.assert_array_equal(numbers[:9].reshape(3, 3).T, T.rotation)
        np.testing.assert_array_equal(numbers[9:], T.translation)


def test_bounds_replace_the_joint_limits(left: Arm) -> None:
    numbers, unlimited = ArmNumbers.of(left), np.repeat([-np.pi, np.pi], 7)
    usual, other = numbers.within(), numbers.within(unlimited)
    np.testing.assert_array_equal(usual[:14], [*left.limits.q_min, *left.limits.q_max])
    np.testing.assert_array_equal(other[:14], unlimited)
    np.testing.assert_array_equal(usual[14:], other[14:])
