from __future__ import annotations

import math

import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.ik.redundancy.curve_functions import (
    BLOCK,
    LANES,
    MAX_TURN_RAD,
    MIN_STEP_RAD,
    curve_functions,
)
from baxter_kin.kinematics.dh_parameters import DHParameters
from baxter_kin.kinematics.symbolic import dimensions_of
from baxter_kin.validation import FloatArray

ROUNDING = 1e-10


def shared(arm: Arm, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The last two inputs, for the pose that `q` reaches."""
    dh = DHParameters.of(arm)
    T_first_last = dh.T_base_first.inverse() * arm.T_base_tip(q) * dh.T_last_tip.inverse()
    return T_first_last.homogeneous, dimensions_of(dh)


def state_of(arm: Arm, q: FloatArray, step_rad: float) -> FloatArray:
    J = arm.jacobian(q)
    tangent = np.linalg.svd(J)[2][6]
    determinant = np.linalg.det(np.vstack([J, tangent]))
    return np.concatenate([q, tangent, np.zeros(7), [step_rad, determinant, 1.0, 0.0]])


def test_a_correction_is_that_of_the_pseudo_inverse(any_arm: Arm) -> None:
    """From nearby, Newton's steps of least norm end next to where the first one leads."""
    _, correct, *_ = curve_functions()
    rng, size = np.random.default_rng(1), 1e-4
    for _ in range(10):
        q = any_arm.random_configuration(rng)
        sigma, null = np.linalg.svd(any_arm.jacobian(q))[1:]
        if sigma[5] < 0.05:
            continue
        off = q + size * rng.normal(size=7)
        found = np.array(correct(off, np.zeros(7), *shared(any_arm, q))).ravel()
        assert found[15] < 1e-13  # the residual
        second_order = 100.0 * size**2 / sigma[5]
        assert np.linalg.norm(found[:7] - q - (null[6] @ (off - q)) * null[6]) < second_order


def test_many_lanes_are_each_as_one(any_arm: Arm) -> None:
    _, correct, many, _ = curve_functions()
    q, rng = any_arm.start, np.random.default_rng(2)
    starts, normals = q + 0.01 * rng.normal(size=(LANES, 7)), rng.normal(size=(LANES, 7))
    together = np.array(many(starts.T, normals.T, *shared(any_arm, q))).T
    for start, normal, found in zip(starts, normals, together, strict=True):
        alone = np.array(correct(start, normal, *shared(any_arm, q))).ravel()
        np.testing.assert_array_equal(found, alone)


def test_a_march_goes_on_from_attempt_to_attempt(any_arm: Arm) -> None:
    rng = np.random.default_rng(3)
    for _ in range(10):
        q = any_arm.random_configuration(rng)
        states = np.array(curve_functions()[3](state_of(any_arm, q, 0.4), 0.4, *shared(any_arm, q)))
        assert states.shape == (25, BLOCK)
        assert states[23].any()
        assert_each_follows(any_arm, state_of(any_arm, q, 0.4), states.T)


def assert_each_follows(arm: Arm, before: FloatArray, states: FloatArray) -> None:
    """Accepted ones a step ahead, refused ones where they were."""
    for state in states:
        if state[23] == 1.0:
            turn = math.acos(min(1.0, state[7:14] @ before[7:14]))
            assert turn <= MAX_TURN_RAD
            assert np.linalg.norm(state[:7] - before[:7]) <= 1.25 * before[21]
            assert state[22] * before[22] > 0.0
            J = arm.jacobian(state[:7])
            assert np.linalg.norm(J @ state[7:14]) < ROUNDING
        else:
            np.testing.assert_array_equal(state[:7], before[:7])
            assert state[21] == 0.5 * before[21]
        before = state


def test_a_step_that_turns_too_much_is_refused_and_halved(left: Arm) -> None:
    march, q = curve_functions()[3], left.start
    states = np.array(march(state_of(left, q, 3.0), 3.0, *shared(left, q))).T
    assert states[0, 23] == 0.0
    assert states[0, 21] == 1.5
    np.testing.assert_array_equal(states[0, :7], q)


@pytest.mark.parametrize("step_rad", [0.5 * MIN_STEP_RAD, 2.0 * MIN_STEP_RAD])
def test_steps_below_the_least_are_refused(left: Arm, step_rad: float) -> None:
    march, q = curve_functions()[3], left.start
    states = np.array(march(state_of(left, q, step_rad), 0.1, *shared(left, q))).T
    assert (states[0, 23] == 1.0) == (step_rad > MIN_STEP_RAD)
