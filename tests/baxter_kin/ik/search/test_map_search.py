from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.ik.search.map_search import PATIENCE, search_functions
from baxter_kin.ik.search.search_function import (
    ITERATIONS,
    ROTATION_WEIGHT_M,
    ArmNumbers,
    search_function,
)
from baxter_kin.ik.seeds import MAP_STARTS, NullSpaceMap
from baxter_kin.kinematics.arm import LIMBS
from tests.baxter_kin.ik.search.test_search_function import task_of


@pytest.fixture(scope="module")
def searches(any_arm: Arm) -> tuple[ca.Function, ca.Function]:
    """The search from a start, with the patience of the map's, and the search from the map."""
    shape = ArmNumbers.of(any_arm).shape
    from_map = search_functions(shape)[1 + LIMBS.index(any_arm.side)]
    return search_function(shape, PATIENCE), from_map


def run(function: ca.Function, *inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    q, report = (np.array(x).ravel() for x in function(*inputs))
    return q, report


def from_map(arm: Arm, T: np.ndarray) -> tuple[np.ndarray, ...]:
    """The inputs of the search from the map for a pose of the gripper."""
    return T, T, task_of(arm), ArmNumbers.of(arm).within()


def one_by_one(search: ca.Function, arm: Arm, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The result of searches from the nearest setpoints, with the map in NumPy."""
    map_ = NullSpaceMap(arm)
    best_q, best, iterations, starts = np.zeros(7), np.full(2, np.inf), 0, 0
    for index in map_.nearest(T[None])[0]:
        q, report = run(search, map_.setpoints[index], T, task_of(arm), ArmNumbers.of(arm).within())
        iterations, starts = iterations + int(report[3]), starts + 1
        if report[1] + report[2] < best.sum():
            best_q, best = q, report[1:3]
        if report[0] == 1.0:
            break
    return best_q, np.array([report[0], *best, iterations, 1.0, starts])


@pytest.mark.slow
def test_it_is_the_search_from_one_setpoint_after_the_other(
    any_arm: Arm, searches: tuple[ca.Function, ca.Function]
) -> None:
    rng, (search, map_search) = np.random.default_rng(1), searches
    starts = set()
    for _ in range(80):
        T = any_arm.T_base_tip(any_arm.random_configuration(rng)).homogeneous
        q, report = run(map_search, *from_map(any_arm, T))
        expected_q, expected = one_by_one(search, any_arm, T)
        np.testing.assert_array_equal(q, expected_q)
        np.testing.assert_array_equal(report, expected)
        starts.add(int(report[5]))
    assert {1, 2} <= starts


def test_when_all_fail_the_nearest_iterate_is_kept(
    any_arm: Arm, searches: tuple[ca.Function, ca.Function]
) -> None:
    T, (search, map_search) = np.eye(4), searches
    T[:3, 3] = 1.6, 0.0, 0.5
    q, report = run(map_search, *from_map(any_arm, T))
    expected_q, expected = one_by_one(search, any_arm, T)
    np.testing.assert_array_equal(q, expected_q)
    np.testing.assert_array_equal(report, expected)
    assert report[0] == 0.0
    assert report[5] == MAP_STARTS
    assert report[3] == MAP_STARTS * min(PATIENCE)


@pytest.mark.slow
def test_searches_end_where_patience_does(any_arm: Arm) -> None:
    """A search that is slow then ends; any other has the same result as with endless patience."""
    numbers, rng = ArmNumbers.of(any_arm), np.random.default_rng(3)
    one, other = (search_function(numbers.shape, patience) for patience in (PATIENCE, {}))
    ends = set()
    for _ in range(200):
        T = any_arm.T_base_tip(any_arm.random_configuration(rng)).homogeneous
        start = any_arm.random_configuration(rng)
        (q, report), (q_other, other_report) = (
            run(search, start, T, task_of(any_arm), numbers.within()) for search in (one, other)
        )
        error, count = report[1] + ROTATION_WEIGHT_M * report[2], int(report[3])
        if report[0] == 0.0 and count <= ITERATIONS:
            assert error > PATIENCE[count]
            ends.add(count)
        else:
            np.testing.assert_array_equal(q, q_other)
            np.testing.assert_array_equal(report, other_report)
    assert ends == set(PATIENCE)


@pytest.mark.parametrize(
    "T", [np.diag([1.0, 1.0, -1.0, 1.0]), np.full((4, 4), np.nan), np.diag([1.0, 1.0, 1.0, 2.0])]
)
def test_an_invalid_pose_is_reported_from_the_map_too(any_arm: Arm, T: np.ndarray) -> None:
    functions = search_functions(ArmNumbers.of(any_arm).shape)
    _, report = run(functions[1 + LIMBS.index(any_arm.side)], *from_map(any_arm, T))
    assert report[[0, 4]].tolist() == [0.0, 0.0]
