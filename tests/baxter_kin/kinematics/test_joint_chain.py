from __future__ import annotations

import numpy as np
import pinocchio as pin
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm
from baxter_kin.kinematics.joint_chain import JointChain

ROUNDING = 1e-14
"""Rounding of a product of seven transforms, in m and of the rotation matrix."""


@given(st.integers(0, 2**32 - 1))
def test_joints_are_where_pinocchio_has_them(any_arm: Arm, seed: int) -> None:
    qs = np.random.default_rng(seed).uniform(-7.0, 7.0, (4, 7))
    poses, data = any_arm.chain.poses(qs), any_arm.model.createData()
    assert poses.shape == (4, 7, 4, 4)
    for q, joints in zip(qs, poses, strict=True):
        pin.forwardKinematics(any_arm.model, data, q)
        expected = np.array([T.homogeneous for T in data.oMi[1:]])
        assert np.abs(joints - expected).max() < ROUNDING


@given(st.integers(0, 2**32 - 1))
def test_axes_may_have_any_direction(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model, axes = pin.Model(), rng.normal(size=(3, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    for i, axis in enumerate(axes):
        placement = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        model.addJoint(i, pin.JointModelRevoluteUnaligned(axis), placement, f"j{i}")
    placements = np.array([T.homogeneous for T in model.jointPlacements[1:]])
    (q,) = qs = rng.uniform(-3.0, 3.0, (1, 3))
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    expected = np.array([T.homogeneous for T in data.oMi[1:]])
    for chain in (JointChain(placements, axes), JointChain.of(model)):
        np.testing.assert_allclose(chain.axes, axes, atol=ROUNDING)
        assert np.abs(chain.poses(qs)[0] - expected).max() < 10.0 * ROUNDING


def test_at_zero_each_joint_is_where_it_is_mounted(left: Arm) -> None:
    poses = left.chain.poses(np.zeros((1, 7)))[0]
    seen = np.eye(4)
    for pose, T_parent_joint in zip(poses, left.model.jointPlacements[1:], strict=True):
        seen = seen @ T_parent_joint.homogeneous
        assert np.abs(pose - seen).max() < ROUNDING


def test_no_configurations_have_no_poses(left: Arm) -> None:
    assert left.chain.poses(np.zeros((0, 7))).shape == (0, 7, 4, 4)
