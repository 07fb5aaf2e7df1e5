from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm
from baxter_kin.ik.self_motion.curve_kernel import (
    BLOCK,
    MAX_TURN_RAD,
    MIN_STEP_RAD,
    CurveKernel,
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
    """From nearby, Newton's steps of least norm end close to the result of the first step."""
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


def test_a_march_goes_on_from_attempt_to_attempt(any_arm: Arm) -> None:
    rng = np.random.default_rng(3)
    for _ in range(10):
        q = any_arm.random_configuration(rng)
        states = np.array(curve_functions()[3](state_of(any_arm, q, 0.4), 0.4, *shared(any_arm, q)))
        assert states.shape == (25, BLOCK)
        assert states[23].any()
        assert_each_follows(any_arm, state_of(any_arm, q, 0.4), states.T)


def assert_each_follows(arm: Arm, before: FloatArray, states: FloatArray) -> None:
    """Accepted states are a step ahead, refused ones unchanged."""
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


MEASURE_ROUNDING = 1e-9
"""Accuracy of null vectors and determinants, relative to the singular values that occur."""


@pytest.fixture(scope="module")
def interpreted(any_arm: Arm) -> CurveKernel:
    """The kernel of an arm in CasADi's virtual machine."""
    return CurveKernel(DHParameters.of(any_arm), curve_functions())


def pose(arm: Arm, q: FloatArray) -> FloatArray:
    T: FloatArray = arm.T_base_tip(q).homogeneous
    return T


@given(seed=st.integers(0, 10_000))
def test_measures_are_those_of_the_jacobian(seed: int, any_arm: Arm) -> None:
    rng = np.random.default_rng(seed)
    q, other = any_arm.random_configuration(rng), any_arm.random_configuration(rng)
    found, J = CurveKernel.of(any_arm).measured(q, pose(any_arm, other)), any_arm.jacobian(q)
    sigma = np.linalg.svd(J, compute_uv=False)[5]
    assert np.linalg.norm(found.tangent[0]) == pytest.approx(1.0, abs=1e-12)
    assert np.linalg.norm(J @ found.tangent[0]) < MEASURE_ROUNDING
    determinant = np.linalg.det(np.vstack([J, found.tangent[0]]))
    assert found.determinant[0] == pytest.approx(determinant, abs=MEASURE_ROUNDING)
    assert found.determinant[0] >= 0.0
    assert sigma / 3.0 <= found.rank[0] <= sigma * (1.0 + MEASURE_ROUNDING)


@given(seed=st.integers(0, 10_000))
def test_residual_is_the_pose_error(seed: int, any_arm: Arm) -> None:
    rng = np.random.default_rng(seed)
    q = any_arm.random_configuration(rng)
    T = any_arm.T_base_tip(q) * pin.exp6(1e-4 * rng.standard_normal(6))
    expected = np.linalg.norm(pin.log6(any_arm.T_base_tip(q).actInv(T)).vector)
    found = CurveKernel.of(any_arm).measured(q, T.homogeneous)
    assert found.residual[0] == pytest.approx(expected, rel=1e-3)


def test_corrected_is_on_the_pose_and_in_the_hyperplane(any_arm: Arm) -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        q = any_arm.random_configuration(rng)
        normal = np.linalg.svd(any_arm.jacobian(q))[2][6]
        off = 1e-3 * rng.standard_normal(7)
        found = CurveKernel.of(any_arm).corrected(q + off, normal, pose(any_arm, q))
        reached = any_arm.T_base_tip(found.q[0]).actInv(any_arm.T_base_tip(q))
        assert np.linalg.norm(pin.log6(reached).vector) < 1e-12
        assert abs(normal @ (found.q[0] - q - off)) < 1e-12


def test_a_tool_is_part_of_the_arm(left: Arm) -> None:
    tool = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.1])), np.array([0.05, -0.02, 0.1]))
    arm = left.with_tip(tool, "tool")
    found = CurveKernel.of(arm).measured(left.start, pose(arm, left.start))
    J = arm.jacobian(left.start)
    assert found.residual[0] < 1e-12
    determinant = np.linalg.det(np.vstack([J, found.tangent[0]]))
    assert found.determinant[0] == pytest.approx(determinant, abs=MEASURE_ROUNDING)


def test_many_are_corrected_like_one(left: Arm) -> None:
    kernel, rng = CurveKernel.of(left), np.random.default_rng(2)
    T, near = pose(left, left.start), left.start + 1e-3 * rng.standard_normal((77, 7))
    normal = rng.standard_normal((77, 7))
    many = kernel.corrected_many(near, normal, T)
    assert len(kernel.corrected_many(near[:0], normal[:0], T).q) == 0
    for q, n, row in zip(near, normal, many.q, strict=True):
        np.testing.assert_array_equal(kernel.corrected(q, n, T).q[0], row)


def test_steps_stay_on_the_curve_and_turn_little(left: Arm) -> None:
    kernel, T = CurveKernel.of(left), pose(left, left.start)
    at = kernel.measured(left.start, T)
    state = kernel.start_state(left.start, at.tangent[0], float(at.determinant[0]), 0.2)
    steps = kernel.march(state, T, 0.2)
    assert len(steps.q) > 5
    assert steps.residual.max() < 1e-12
    tangents = np.vstack([at.tangent, steps.tangent])
    assert (tangents[1:] * tangents[:-1]).sum(axis=1).min() > np.cos(MAX_TURN_RAD)
    assert np.linalg.norm(np.diff(steps.q, axis=0), axis=1).max() <= 0.2 * 1.05


def test_virtual_machine_does_the_same(any_arm: Arm, interpreted: CurveKernel) -> None:
    kernel, T = CurveKernel.of(any_arm), pose(any_arm, any_arm.start)
    at = kernel.measured(any_arm.start, T)
    state = kernel.start_state(any_arm.start, at.tangent[0], float(at.determinant[0]), 0.1)
    one, other = (k.march(state, T, 0.1) for k in (kernel, interpreted))
    np.testing.assert_allclose(one.q, other.q, atol=1e-9)
