from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, Baxter
from baxter_kin.errors import DescriptionError
from baxter_kin.kinematics.dh_parameters import DHParameters

ROUNDING = 1e-13
"""Rounding of a product of 21 transforms, in m and of the rotation matrix."""

URDF_ROUNDING = 1e-5
"""Right angles of the URDF are written with five digits or more."""


def about_z(angle: float) -> pin.SE3:
    return pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, angle), np.zeros(3))


def link(a_m: float, alpha_rad: float) -> pin.SE3:
    """Tx(a) Rx(alpha)."""
    return pin.SE3(pin.rpy.rpyToMatrix(alpha_rad, 0.0, 0.0), np.array([a_m, 0.0, 0.0]))


def by_denavit_and_hartenberg(dh: DHParameters, q: np.ndarray) -> pin.SE3:
    """The formula of the module's docstring, written out."""
    T = dh.T_base_first * about_z(q[0]) * link(dh.a_m[0], dh.alpha_rad[0])
    for i in range(5):
        along = pin.SE3(np.eye(3), np.array([0.0, 0.0, dh.d_m[i]]))
        T = T * about_z(q[i + 1] + dh.theta_rad[i]) * along
        T = T * link(dh.a_m[i + 1], dh.alpha_rad[i + 1])
    return T * about_z(q[6]) * dh.T_last_tip


def test_their_product_is_the_tip_as_pinocchio_has_it(any_arm: Arm) -> None:
    dh, rng = DHParameters.of(any_arm), np.random.default_rng(1)
    for _ in range(50):
        q = any_arm.random_configuration(rng)
        difference = (
            by_denavit_and_hartenberg(dh, q).homogeneous - any_arm.T_base_tip(q).homogeneous
        )
        assert np.abs(difference).max() < ROUNDING


def test_a_tool_changes_the_last_transform_alone(left: Arm) -> None:
    T_gripper_tip = pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.3])), np.array([0.0, 0.02, 0.1]))
    own, tooled = DHParameters.of(left), DHParameters.of(left.with_tip(T_gripper_tip))
    for name in ("a_m", "alpha_rad", "d_m", "theta_rad"):
        np.testing.assert_array_equal(getattr(own, name), getattr(tooled, name))
    expected = (own.T_last_tip * T_gripper_tip).homogeneous
    assert np.abs(tooled.T_last_tip.homogeneous - expected).max() < ROUNDING


def test_lengths_are_those_that_williams_published(arm: Arm) -> None:
    """R. L. Williams II, "Baxter Humanoid Robot Kinematics", Ohio University, 2017, section 3."""
    dh = DHParameters.of(arm)
    rounded_m = 1e-3  # he gives millimetres and tenths
    np.testing.assert_allclose(np.abs(dh.a_m[[0, 2, 4]]), [0.069, 0.069, 0.010], atol=rounded_m)
    np.testing.assert_allclose(np.abs(dh.d_m[[1, 3]]), [0.36435, 0.37429], atol=rounded_m)
    np.testing.assert_allclose(dh.a_m[[1, 3, 5]], 0.0, atol=URDF_ROUNDING)


def test_both_arms_as_drawn_have_the_same(robot: Baxter) -> None:
    left, right = (DHParameters.of(robot.arm(side)) for side in ("left", "right"))
    for name in ("a_m", "alpha_rad", "d_m", "theta_rad"):
        one, other = getattr(left, name), getattr(right, name)
        np.testing.assert_allclose(one, other, atol=URDF_ROUNDING)


def test_neighbouring_axes_are_a_quarter_turn_apart(any_arm: Arm) -> None:
    alpha, calibrated_rad = DHParameters.of(any_arm).alpha_rad, 0.025
    assert np.abs(alpha - np.pi / 2).max() < calibrated_rad


def test_axes_that_are_nearly_parallel_are_refused_by_joint_and_angle(robot: Baxter) -> None:
    arm = Arm("left", robot.model)
    T = arm.model.jointPlacements[2]
    arm.model.jointPlacements[2] = T * pin.SE3(pin.exp3(np.array([1.4, 0.0, 0.0])), np.zeros(3))
    with pytest.raises(DescriptionError, match="axis of left_s1 is 10 degrees from parallel"):
        DHParameters.of(arm)
