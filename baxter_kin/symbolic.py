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
from baxter_kin.errors import DescriptionError, RequestError, expect
from baxter_kin.model import Arm

_AXES: dict[str, tuple[float, float, float]] = {
    "JointModelRX": (1.0, 0.0, 0.0),
    "JointModelRY": (0.0, 1.0, 0.0),
    "JointModelRZ": (0.0, 0.0, 1.0),
}


@dataclass(frozen=True, slots=True)
class SymbolicChain:
    """The joints of an arm seen from one of its links, in closed form.

    Seen from a link along the chain the formulas are shorter than from base, for each joint depends
    only on those between.

    Attributes:
        q: the joint symbols, 7 x 1, rad.
        R_link_base: rotation of base, 3 x 3.
        p_link_base: position of base, 3 x 1, m.
        R_link_tip: rotation of the tip, 3 x 3.
        p_link_tip: position of the tip, 3 x 1, m.
        axes: the joints' axes of rotation, each 3 x 1.
        origins: the joints' origins, each 3 x 1, m.
    """

    q: ca.SX
    R_link_base: ca.SX
    p_link_base: ca.SX
    R_link_tip: ca.SX
    p_link_tip: ca.SX
    axes: tuple[ca.SX, ...]
    origins: tuple[ca.SX, ...]

    @classmethod
    def of(cls, arm: Arm, link: int = 0, *, rounding: float = 0.0) -> SymbolicChain:
        """The chain seen from a link.

        Args:
            arm: whose joints.
            link: 0 for base, else the link that follows that many joints and turns with the last.
            rounding: entries of the model's placements this close to 0, 1 or -1 are taken for these
                numbers, which shortens the formulas.

        Raises:
            RequestError: when `arm` is none.
        """
        model, q = expect(arm, Arm, "arm", RequestError).model, ca.SX.sym("q", arm.model.nq)
        joints = [_Joint.of(model, i, q[i], rounding) for i in range(model.nq)]
        R, p, axes, origins = ca.SX.eye(3), ca.SX.zeros(3), {}, {}
        for i in range(link, model.nq):
            R, p = R @ joints[i].R, p + R @ joints[i].p
            axes[i], origins[i] = R @ joints[i].axis, p
            R = R @ joints[i].turn
        tip = _Joint.placed(model.frames[model.getFrameId(arm.tip_frame)].placement, rounding)
        R_tip, p_tip = R @ tip[0], p + R @ tip[1]
        R, p = ca.SX.eye(3), ca.SX.zeros(3)
        for i in reversed(range(link)):
            axes[i], origins[i] = R @ joints[i].axis, p
            R = R @ joints[i].turn.T @ joints[i].R.T
            p = p - R @ joints[i].p
        ordered = [tuple(table[i] for i in range(model.nq)) for table in (axes, origins)]
        return cls(q, R, p, R_tip, p_tip, *ordered)


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
        chain = SymbolicChain.of(arm)
        p = chain.p_link_tip
        columns = [
            ca.vertcat(ca.cross(axis, p - origin), axis)
            for axis, origin in zip(chain.axes, chain.origins, strict=True)
        ]
        quat = _quaternion(arm, chain.q)
        return cls(chain.q, p, chain.R_link_tip, quat, ca.horzcat(*columns))

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


@dataclass(frozen=True, slots=True)
class _Joint:
    """A joint's placement, axis and turn: 3 x 3, 3 x 1 (m), 3 x 1, 3 x 3."""

    R: ca.SX
    p: ca.SX
    axis: ca.SX
    turn: ca.SX

    @classmethod
    def of(cls, model: pin.Model, i: int, angle: ca.SX, rounding: float) -> _Joint:
        R, p = cls.placed(model.jointPlacements[i + 1], rounding)
        axis = _axis(model.joints[i + 1].shortname())
        return cls(R, p, ca.sparsify(ca.SX(axis)), _rotation(axis, angle))

    @staticmethod
    def placed(T: pin.SE3, rounding: float) -> tuple[ca.SX, ca.SX]:
        return _rounded(T.rotation, rounding), _rounded(T.translation, rounding)


def _rounded(values: Vector, rounding: float) -> ca.SX:
    nearest = np.rint(values)
    is_close = (np.abs(values - nearest) <= rounding) & (np.abs(nearest) <= 1.0)
    return ca.sparsify(ca.SX(np.where(is_close, nearest, values)))


def _quaternion(arm: Arm, q: ca.SX) -> ca.SX:
    """The tip's rotation as a product of unit quaternions, one for each placement and joint."""
    model, quat = arm.model, ca.SX([0.0, 0.0, 0.0, 1.0])
    tip = model.frames[model.getFrameId(arm.tip_frame)].placement
    for i in range(model.nq):
        axis, half = ca.SX(_axis(model.joints[i + 1].shortname())), q[i] / 2
        turn = ca.vertcat(ca.sin(half) * axis, ca.cos(half))
        quat = quaternion_product(quat, _coefficients(model.jointPlacements[i + 1]))
        quat = quaternion_product(quat, turn)
    return quaternion_product(quat, _coefficients(tip))


def _coefficients(T: pin.SE3) -> ca.SX:
    xyzw: Vector = pin.Quaternion(T.rotation).coeffs()
    return ca.SX(xyzw)


def _rotation(axis: tuple[float, float, float], angle: ca.SX) -> ca.SX:
    """Rodrigues' formula: the rotation by `angle` about a unit axis."""
    along = np.outer(axis, axis)
    across = ca.sparsify(ca.SX(np.eye(3) - along))
    K = ca.sparsify(ca.skew(ca.SX(axis)))
    return ca.sparsify(ca.SX(along)) + ca.cos(angle) * across + ca.sin(angle) * K


def _axis(joint_type: str) -> tuple[float, float, float]:
    if joint_type not in _AXES:
        raise DescriptionError(
            f"the symbolic kinematics know revolute joints about x, y or z, not {joint_type}"
        )
    return _AXES[joint_type]
