from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin

from baxter_kin import Arm
from baxter_kin.frames import angle_between
from baxter_kin.kinematics.dh_parameters import DHParameters
from baxter_kin.kinematics.symbolic import SymbolicArm, SymbolicChain

AGREEMENT = 1e-12
"""Required at any configuration; observed are 9e-16, for the quaternion 3e-15."""


def test_pose_and_axes_agree_with_pinocchio_anywhere(any_arm: Arm) -> None:
    """Axes and origins are tested by their geometric Jacobian."""
    symbolic, dh = SymbolicArm.of(any_arm), DHParameters.of(any_arm)
    pose = ca.Function("pose", [symbolic.q], [symbolic.p_base_tip, symbolic.R_base_tip])
    chain = SymbolicChain.of(dh)
    p_first_tip = chain.p_link_last + chain.R_link_last @ chain.p_last_tip
    columns = [
        dh.T_base_first.rotation @ ca.horzcat(ca.cross(axis, p_first_tip - origin), axis)
        for axis, origin in zip(chain.axes, chain.origins, strict=True)
    ]
    jacobian = ca.Function("jacobian", [chain.q], [ca.horzcat(*map(ca.vec, columns))])
    rng = np.random.default_rng(4)
    for _ in range(100):
        q = rng.uniform(-2 * np.pi, 2 * np.pi, 7)  # outside the limits as well
        p, R = (np.array(value) for value in pose(q))
        T = any_arm.T_base_tip(q)
        assert np.abs(p.ravel() - T.translation).max() < AGREEMENT
        assert np.abs(R - T.rotation).max() < AGREEMENT
        assert np.abs(np.array(jacobian(q)) - any_arm.jacobian(q)).max() < AGREEMENT


def test_quaternion_is_the_rotation(any_arm: Arm) -> None:
    symbolic = SymbolicArm.of(any_arm)
    quat = ca.Function("quat", [symbolic.q], [symbolic.quat_xyzw])
    rng = np.random.default_rng(5)
    for _ in range(50):
        q = any_arm.random_configuration(rng)
        x, y, z, w = np.array(quat(q)).ravel()
        R = pin.Quaternion(w, x, y, z).toRotationMatrix()
        assert angle_between(any_arm.T_base_tip(q).rotation, R) < AGREEMENT


def test_geometric_jacobian_is_the_derivative_of_the_expression(left: Arm) -> None:
    symbolic = SymbolicArm.of(left)
    derivative = ca.Function("d", [symbolic.q], [ca.jacobian(symbolic.p_base_tip, symbolic.q)])
    linear = np.array(derivative(left.start))
    np.testing.assert_allclose(left.jacobian(left.start)[:3], linear, atol=AGREEMENT)
