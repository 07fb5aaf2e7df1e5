from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm
from baxter_kin.ik.search.arm_numbers import ArmNumbers
from baxter_kin.ik.search.task_search import INSET, task_coordinates, task_search_function
from baxter_kin.ik.tolerance import Tolerance

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
    for target, reached in pairs(left, 500):
        D = target.actInv(reached)
        x = np.array(coordinates(target.homogeneous, reached.translation, reached.rotation, 0))
        expected = np.concatenate([D.translation, pin.log3(D.rotation)])
        np.testing.assert_allclose(x.ravel(), expected, atol=AGREEMENT)


def test_with_the_roll_free_the_rotation_is_the_tilt(left: Arm, coordinates: ca.Function) -> None:
    tolerance = Tolerance.about("z")
    for target, reached in pairs(left, 500):
        x = np.array(coordinates(target.homogeneous, reached.translation, reached.rotation, 1))
        _, tilt = tolerance.excess(target, reached)
        assert np.linalg.norm(x[3:]) == pytest.approx(tilt, abs=AGREEMENT)
        assert x[5] == 0.0


def prepared(arm: Arm) -> tuple[ca.Function, ArmNumbers, np.ndarray]:
    """The search for an arm, its numbers, and its tip seen from the last axis."""
    numbers = ArmNumbers.of(arm)
    return task_search_function(numbers.shape), numbers, numbers.T_last_tip.homogeneous


def test_an_exact_task_is_the_exact_search(any_arm: Arm) -> None:
    search, numbers, tool = prepared(any_arm)
    rng = np.random.default_rng(2)
    solved = 0
    for _ in range(60):
        T = any_arm.T_base_tip(any_arm.random_configuration(rng))
        given = (T.homogeneous, tool, np.zeros(7), 0.0, numbers.within())
        q, report = (np.array(x).ravel() for x in search(any_arm.neutral, *given))
        distance, angle = Tolerance().excess(T, any_arm.T_base_tip(q))
        assert report[1] == pytest.approx(distance, abs=1e-10)
        assert report[2] == pytest.approx(angle, abs=1e-10) or angle > 3.0
        solved += int(report[0])
    assert solved > 30


@pytest.mark.parametrize("tilt_rad", [0.0, 0.3])
def test_the_error_of_the_search_is_the_excess_over_the_cone(any_arm: Arm, tilt_rad: float) -> None:
    """Of a search that ends where it starts, with all joints locked."""
    (search, numbers, tool), tolerance = prepared(any_arm), Tolerance.about("z", tilt_rad=tilt_rad)
    widths = np.array([0.0] * 5 + [np.inf, tilt_rad])
    for target, reached in pairs(any_arm, 50):
        q = np.array(any_arm.start)
        T = any_arm.T_base_tip(q) * reached.actInv(target)
        given = (T.homogeneous, tool, widths, 1.0, numbers.within(np.concatenate([q, q])))
        _, report = search(q, *given)
        expected = tolerance.excess(T, any_arm.T_base_tip(q))
        assert np.array(report).ravel()[1:3] == pytest.approx(expected, abs=3 * INSET)


def test_invalid_input_is_reported(any_arm: Arm) -> None:
    (search, numbers, tool), T = prepared(any_arm), np.diag([1.0, 1.0, -1.0, 1.0])
    _, report = search(any_arm.neutral, T, tool, np.zeros(7), 0.0, numbers.within())
    assert np.array(report).ravel()[[0, 4]].tolist() == [0.0, 0.0]
