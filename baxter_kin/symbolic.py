"""The arm's kinematics as CasADi expressions (CasADi enters here).

Built from the joint placements of the Pinocchio model, because the wheel of Pinocchio carries no
`pinocchio.casadi`. Both agree to rounding, which the tests check at random configurations.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pinocchio as pin

from baxter_kin.arrays import Vector
from baxter_kin.errors import DescriptionError
from baxter_kin.model import Arm

_AXES: dict[str, tuple[float, float, float]] = {
    "JointModelRX": (1.0, 0.0, 0.0),
    "JointModelRY": (0.0, 1.0, 0.0),
    "JointModelRZ": (0.0, 0.0, 1.0),
}


@dataclass(frozen=True, slots=True)
class SymbolicArm:
    """Forward kinematics and Jacobian of an arm's tip, in closed form.

    Attributes:
        q: the joint symbols, 7 x 1, rad.
        p_base_tip: position of the tip, 3 x 1, m.
        R_base_tip: rotation of the tip, 3 x 3.
        quat_xyzw: the same rotation as a unit quaternion, 4 x 1; smooth in `q`, of either sign.
        J: geometric Jacobian, 6 x 7, linear first, axes of base, at the tip.
    """

    q: ca.SX
    p_base_tip: ca.SX
    R_base_tip: ca.SX
    quat_xyzw: ca.SX
    J: ca.SX

    @classmethod
    def of(cls, arm: Arm) -> SymbolicArm:
        """Build the expressions for one arm."""
        model, q = arm.model, ca.SX.sym("q", arm.model.nq)
        R, p, quat = ca.SX.eye(3), ca.SX.zeros(3), ca.SX([0.0, 0.0, 0.0, 1.0])
        origins, axes = [], []
        for joint in range(1, model.njoints):
            R, p, quat = _moved(R, p, quat, model.jointPlacements[joint])
            axis = ca.SX(_axis(model.joints[joint].shortname()))
            origins.append(p)
            axes.append(R @ axis)
            angle = q[joint - 1]
            R = R @ _rotation(axis, angle)
            half = angle / 2
            quat = quaternion_product(quat, ca.vertcat(ca.sin(half) * axis, ca.cos(half)))
        tip = model.frames[model.getFrameId(arm.tip_frame)].placement
        R, p, quat = _moved(R, p, quat, tip)
        columns = [
            ca.vertcat(ca.cross(axis, p - origin), axis)
            for axis, origin in zip(axes, origins, strict=True)
        ]
        return cls(q=q, p_base_tip=p, R_base_tip=R, quat_xyzw=quat, J=ca.horzcat(*columns))

    def pose_function(self) -> ca.Function:
        """`q -> (p_base_tip, R_base_tip)` as a CasADi function."""
        return ca.Function(
            "pose",
            [self.q],
            [self.p_base_tip, self.R_base_tip],
            ["q"],
            ["p_base_tip", "R_base_tip"],
        )

    def jacobian_function(self) -> ca.Function:
        """`q -> J` as a CasADi function."""
        return ca.Function("jacobian", [self.q], [self.J], ["q"], ["J"])


def quaternion_product(a_xyzw: ca.SX, b_xyzw: ca.SX) -> ca.SX:
    """The Hamilton product of two quaternions, 4 x 1 each, in x, y, z, w order."""
    a, b = a_xyzw[:3], b_xyzw[:3]
    vector = a_xyzw[3] * b + b_xyzw[3] * a + ca.cross(a, b)
    return ca.vertcat(vector, a_xyzw[3] * b_xyzw[3] - ca.dot(a, b))


def _moved(R: ca.SX, p: ca.SX, quat: ca.SX, T: pin.SE3) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The frame (R, p, quat) moved on by a constant placement."""
    placed: Vector = pin.Quaternion(T.rotation).coeffs()
    return (
        R @ ca.SX(T.rotation),
        p + R @ ca.SX(T.translation),
        quaternion_product(quat, ca.SX(placed)),
    )


def _rotation(axis: ca.SX, angle: ca.SX) -> ca.SX:
    """Rodrigues' formula: the rotation by `angle` about a unit axis."""
    K = ca.skew(axis)
    return ca.SX(np.eye(3)) + ca.sin(angle) * K + (1 - ca.cos(angle)) * (K @ K)


def _axis(joint_type: str) -> tuple[float, float, float]:
    if joint_type not in _AXES:
        raise DescriptionError(
            f"the symbolic kinematics know revolute joints about x, y or z, not {joint_type}"
        )
    return _AXES[joint_type]
