from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.ik.search.arm_numbers import ArmNumbers
from baxter_kin.ik.search.exact_search import (
    ITERATIONS,
    ROTATION_WEIGHT_M,
    iterations_of,
    search_function,
    step_function,
)
from baxter_kin.ik.search.map_search import PATIENCE
from baxter_kin.ik.search.searcher import exact_functions
from baxter_kin.ik.seeds import MAP_STARTS, NullSpaceMap
from baxter_kin.kinematics.arm import LIMBS


@pytest.fixture(scope="module")
def searches(any_arm: Arm) -> tuple[ca.Function, ca.Function]:
    """From a start, giving up as the map's searches do, and from the map."""
    shape = ArmNumbers.of(any_arm).shape
    iterations = iterations_of(step_function(shape), PATIENCE)
    from_map = exact_functions(shape)[1 + LIMBS.index(any_arm.side)]
    return search_function(shape, iterations), from_map


def run(function: ca.Function, *inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    q, report = (np.array(x).ravel() for x in function(*inputs))
    return q, report


def one_by_one(search: ca.Function, arm: Arm, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What the search finds from the nearest setpoints, with the map in NumPy."""
    map_ = NullSpaceMap(arm)
    best_q, best, iterations, starts = np.zeros(7), np.full(2, np.inf), 0, 0
    for index in map_.nearest(T[None])[0]:
        q, report = run(search, map_.setpoints[index], T, ArmNumbers.of(arm).within())
        iterations, starts = iterations + int(report[3]), starts + 1
        if report[1] + report[2] < best.sum():
            best_q, best = q, report[1:3]
        if report[0] == 1.0:
            break
    return best_q, np.array([report[0], *best, iterations, starts])


def test_it_is_the_search_from_one_setpoint_after_the_other(
    any_arm: Arm, searches: tuple[ca.Function, ca.Function]
) -> None:
    rng, (search, map_search) = np.random.default_rng(1), searches
    starts = set()
    for _ in range(150):
        T = any_arm.T_base_tip(any_arm.random_configuration(rng)).homogeneous
        q, report = run(map_search, T, ArmNumbers.of(any_arm).within())
        expected_q, expected = one_by_one(search, any_arm, T)
        np.testing.assert_array_equal(q, expected_q)
        np.testing.assert_array_equal(report, expected)
        starts.add(int(report[4]))
    assert {1, 2, 3} <= starts


def test_when_all_fail_the_nearest_iterate_is_kept(
    any_arm: Arm, searches: tuple[ca.Function, ca.Function]
) -> None:
    T, (search, map_search) = np.eye(4), searches
    T[:3, 3] = 1.6, 0.0, 0.5
    q, report = run(map_search, T, ArmNumbers.of(any_arm).within())
    expected_q, expected = one_by_one(search, any_arm, T)
    np.testing.assert_array_equal(q, expected_q)
    np.testing.assert_array_equal(report, expected)
    assert report[0] == 0.0
    assert report[4] == MAP_STARTS
    assert report[3] == MAP_STARTS * min(PATIENCE)


def test_searches_end_where_patience_does(any_arm: Arm) -> None:
    """A search that is still slow then ends; one that is not, as if patience were endless."""
    numbers, rng = ArmNumbers.of(any_arm), np.random.default_rng(3)
    step = step_function(numbers.shape)
    one, other = (search_function(numbers.shape, iterations_of(step, p)) for p in (PATIENCE, {}))
    ends = set()
    for _ in range(200):
        T = any_arm.T_base_tip(any_arm.random_configuration(rng)).homogeneous
        start = any_arm.random_configuration(rng)
        (q, report), (q_other, other_report) = (
            run(search, start, T, numbers.within()) for search in (one, other)
        )
        error, count = report[1] + ROTATION_WEIGHT_M * report[2], int(report[3])
        if report[0] == 0.0 and count <= ITERATIONS:
            assert error > PATIENCE[count]
            ends.add(count)
        else:
            np.testing.assert_array_equal(q, q_other)
            np.testing.assert_array_equal(report, other_report)
    assert ends == set(PATIENCE)
