from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm
from baxter_kin.errors import RequestError
from baxter_kin.frames import angle_between
from baxter_kin.ik import Program
from baxter_kin.kinematics.symbolic import SymbolicArm

AGREEMENT = 1e-12
"""Asked for at any configuration; what is seen is 9e-16, of the quaternion 3e-15."""


def test_pose_and_jacobian_agree_with_pinocchio_anywhere(any_arm: Arm) -> None:
    symbolic = SymbolicArm.of(any_arm)
    pose, jacobian = symbolic.pose_function(), symbolic.jacobian_function()
    rng = np.random.default_rng(4)
    for _ in range(500):
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
    for _ in range(100):
        q = any_arm.random_configuration(rng)
        x, y, z, w = np.array(quat(q)).ravel()
        R = pin.Quaternion(w, x, y, z).toRotationMatrix()
        assert angle_between(any_arm.T_base_tip(q).rotation, R) < AGREEMENT


def test_geometric_jacobian_is_the_derivative_of_the_expression(left: Arm) -> None:
    symbolic = SymbolicArm.of(left)
    derivative = ca.Function("d", [symbolic.q], [ca.jacobian(symbolic.p_base_tip, symbolic.q)])
    linear = np.array(derivative(left.start))
    np.testing.assert_allclose(left.jacobian(left.start)[:3], linear, atol=AGREEMENT)


@pytest.mark.parametrize("state", [SymbolicArm.of, Program.of])
@pytest.mark.parametrize("arm", [None, 5, "left"], ids=str)
def test_what_is_no_arm_has_no_expressions(state: Any, arm: Any) -> None:
    with pytest.raises(RequestError, match="arm must be of class Arm"):
        state(arm)
