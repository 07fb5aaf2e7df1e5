"""The arm's kinematics as CasADi expressions (CasADi enters here).

They are built from Denavit-Hartenberg parameters (`baxter_kin.kinematics.dh_parameters`), because
the wheel of Pinocchio has no `pinocchio.casadi`. The parameters are numbers, or symbols for the
numbers of any arm. Both agree with Pinocchio up to rounding, which the tests check at random
configurations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import casadi as ca
import numpy as np
import pinocchio as pin

from baxter_kin.kinematics.arm import Arm
from baxter_kin.kinematics.dh_parameters import DHParameters
from baxter_kin.validation import FloatArray, Indices

RIGHT_ANGLE = 1e-10
"""Tolerance of right angles and intersecting axes, in rad and m: URDFs write angles with eleven
digits, which moves the tip by 2e-11 m."""

QUARTERS = (-1, -2, -2, -2, -2)
"""The angles between the normals of a Baxter's links at q = 0, in quarter turns."""

_A, _COS, _SIN, _D, _THETA, _TIP = (
    0,
    6,
    12,
    18,
    23,
    28,
)  # indices among 31 numbers
_COUNT = 31
_NOMINAL = np.zeros(_COUNT)
_NOMINAL[_SIN:_D] = 1.0
_NOMINAL.setflags(write=False)


class Shape(Enum):
    """The dimensions of an arm that may differ from nominal ones."""

    SQUARE = (_A, _A + 2, _A + 4, _D + 1, _D + 3, _TIP + 2)
    """Right angles between axes, as Baxter is drawn: only lengths along them, and the tip's."""
    GENERAL = tuple(range(_COUNT))
    """All dimensions, as of a calibrated arm."""

    @classmethod
    def of(cls, dimensions: FloatArray) -> Shape:
        """The simplest shape of an arm with some dimensions."""
        off = np.abs(dimensions - _NOMINAL)
        off[list(cls.SQUARE.value)] = 0.0
        return cls.SQUARE if off.max() <= RIGHT_ANGLE else cls.GENERAL

    @property
    def free(self) -> Indices:
        """The indices of the dimensions that the shape leaves open."""
        return np.array(self.value)


def dimensions_of(dh: DHParameters) -> FloatArray:
    """The dimensions of the chain between first and last axis, shape (31,), m and rad.

    `a` (6), cosines and sines of `alpha` (6 and 6), `d` (5), `theta` less `QUARTERS` (5), and the
    tip's position seen from the last axis (3).
    """
    theta = dh.theta_rad - 0.5 * np.pi * np.array(QUARTERS)
    alpha, tip = dh.alpha_rad, dh.T_last_tip.translation
    return np.concatenate([dh.a_m, np.cos(alpha), np.sin(alpha), dh.d_m, theta, tip])


@dataclass(frozen=True, slots=True)
class SymbolicChain:
    """The joints of an arm seen from one of its links, in closed form.

    From a link within the chain the formulas are shorter than from the first axis, since each joint
    depends only on those in between. Link 0 is the first axis, which does not move; link i turns
    with joint i, its z along that joint's axis.

    Attributes:
        q: the joint symbols, 7 x 1, rad.
        dimensions: the symbols among `dimensions_of`, n x 1.
        R_link_first: rotation of the first axis (`DHParameters.T_base_first`), 3 x 3.
        p_link_first: position of the first axis, 3 x 1, m.
        R_link_last: rotation of the last axis (as in `DHParameters.T_last_tip`), 3 x 3.
        p_link_last: position of the last axis, at the end of the last normal, 3 x 1, m.
        p_last_tip: the tip seen from the last axis, 3 x 1, m.
        axes: the joints' axes of rotation, each 3 x 1.
        origins: points on these axes, each 3 x 1, m.
    """

    q: ca.SX
    dimensions: ca.SX
    R_link_first: ca.SX
    p_link_first: ca.SX
    R_link_last: ca.SX
    p_link_last: ca.SX
    p_last_tip: ca.SX
    axes: tuple[ca.SX, ...]
    origins: tuple[ca.SX, ...]

    @classmethod
    def of_shape(cls, shape: Shape, link: int = 0) -> SymbolicChain:
        """The chain of any arm of a shape, with symbols as dimensions.

        Args:
            shape: determines the dimensions.
            link: 0 for the first axis, else the link after that many joints, which turns with the
                last of them.
        """
        symbols = ca.SX.sym("dimensions", len(shape.value))
        values = [ca.SX(number) for number in _NOMINAL.tolist()]
        for at, symbol in zip(shape.value, ca.vertsplit(symbols), strict=True):
            values[at] = symbol
        return cls._of(values, symbols, link)

    @classmethod
    def of(cls, dh: DHParameters) -> SymbolicChain:
        """The chain of one arm seen from its first axis."""
        values = [ca.SX(number) for number in dimensions_of(dh).tolist()]
        return cls._of(values, ca.SX(0, 1), 0)

    @classmethod
    def _of(cls, values: Sequence[ca.SX], symbols: ca.SX, link: int) -> SymbolicChain:
        q = ca.SX.sym("q", 7)
        joints = [_Joint.of(values, i, q[i]) for i in range(7)]
        axes: dict[int, ca.SX] = {}
        origins: dict[int, ca.SX] = {}
        R, p = ca.SX.eye(3), ca.SX(3, 1)
        for i in range(link, 7):
            R, p = joints[i].along_link(R, p)
            axes[i], origins[i] = R[:, 2], p
            R, p = joints[i].turned(R, p)
        last = R, p
        R, p = ca.SX.eye(3), ca.SX(3, 1)
        for i in reversed(range(link)):
            R, p = joints[i].turned_back(R, p)
            axes[i], origins[i] = R[:, 2], p
            R, p = joints[i].back_along_link(R, p)
        tip = ca.sparsify(ca.vertcat(*values[_TIP:]))
        ordered = [tuple(table[i] for i in range(7)) for table in (axes, origins)]
        return cls(q, symbols, R, p, *last, tip, *ordered)


@dataclass(frozen=True, slots=True)
class SymbolicArm:
    """Forward kinematics of an arm's tip, in closed form.

    Attributes:
        q: the joint symbols, 7 x 1, rad.
        p_base_tip: position of the tip, 3 x 1, m.
        R_base_tip: rotation of the tip, 3 x 3.
        quat_xyzw: the same rotation as a unit quaternion, 4 x 1; smooth in `q`, of either sign.
    """

    q: ca.SX
    p_base_tip: ca.SX
    R_base_tip: ca.SX
    quat_xyzw: ca.SX

    @classmethod
    def of(cls, arm: Arm) -> SymbolicArm:
        """The expressions for one arm."""
        dh = DHParameters.of(arm)
        chain, base = SymbolicChain.of(dh), dh.T_base_first
        R_base = ca.SX(base.rotation)
        p = chain.p_link_last + chain.R_link_last @ chain.p_last_tip
        return cls(
            q=chain.q,
            p_base_tip=R_base @ p + ca.SX(base.translation),
            R_base_tip=R_base @ chain.R_link_last @ ca.SX(dh.T_last_tip.rotation),
            quat_xyzw=_quaternion(dh, chain.q),
        )


def quaternion_product(a_xyzw: ca.SX, b_xyzw: ca.SX) -> ca.SX:
    """The Hamilton product of two quaternions, 4 x 1 each, in x, y, z, w order."""
    a, b = a_xyzw[:3], b_xyzw[:3]
    vector = a_xyzw[3] * b + b_xyzw[3] * a + ca.cross(a, b)
    return ca.vertcat(vector, a_xyzw[3] * b_xyzw[3] - ca.dot(a, b))


@dataclass(frozen=True, slots=True)
class _Joint:
    """A joint: its turn `Rz(q + theta) Tz(d)` after the link `Tx(a) Rx(alpha)` before it."""

    a: ca.SX
    twist: ca.SX
    d: ca.SX
    turn: ca.SX

    @classmethod
    def of(cls, values: Sequence[ca.SX], i: int, angle: ca.SX) -> _Joint:
        """The joint with an index from 0; the first has no link, the first and last no `d`."""
        a, twist, d, quarters = ca.SX(1, 1), ca.SX.eye(3), ca.SX(1, 1), 0
        if i > 0:
            a = ca.sparsify(values[_A + i - 1])
            twist = _about_x(values[_COS + i - 1], values[_SIN + i - 1])
        if 0 < i < 6:
            d, quarters = ca.sparsify(values[_D + i - 1]), QUARTERS[i - 1]
            angle = angle + values[_THETA + i - 1]
        return cls(a, twist, d, _about_z(angle, quarters))

    def along_link(self, R: ca.SX, p: ca.SX) -> tuple[ca.SX, ca.SX]:
        return R @ self.twist, p + R[:, 0] * self.a

    def turned(self, R: ca.SX, p: ca.SX) -> tuple[ca.SX, ca.SX]:
        return R @ self.turn, p + R[:, 2] * self.d

    def turned_back(self, R: ca.SX, p: ca.SX) -> tuple[ca.SX, ca.SX]:
        return R @ self.turn.T, p - R[:, 2] * self.d

    def back_along_link(self, R: ca.SX, p: ca.SX) -> tuple[ca.SX, ca.SX]:
        R = R @ self.twist.T
        return R, p - R[:, 0] * self.a


def _about_x(cosine: ca.SX, sine: ca.SX) -> ca.SX:
    rows = ca.horzcat(1, 0, 0), ca.horzcat(0, cosine, -sine), ca.horzcat(0, sine, cosine)
    return ca.sparsify(ca.vertcat(*rows))


def _about_z(angle: ca.SX, quarters: int) -> ca.SX:
    """The rotation about z by an angle and some quarter turns."""
    c, s = ca.cos(angle), ca.sin(angle)
    c, s = ((c, s), (-s, c), (-c, -s), (s, -c))[quarters % 4]
    return ca.sparsify(ca.vertcat(ca.horzcat(c, -s, 0), ca.horzcat(s, c, 0), ca.horzcat(0, 0, 1)))


def _quaternion(dh: DHParameters, q: ca.SX) -> ca.SX:
    """The tip's rotation as a product of unit quaternions, one for each link and joint."""
    quat = _coefficients(dh.T_base_first.rotation)
    theta = [0.0, *dh.theta_rad.tolist(), 0.0]
    for i in range(7):
        half = (q[i] + theta[i]) / 2
        quat = quaternion_product(quat, ca.vertcat(0, 0, ca.sin(half), ca.cos(half)))
        if i < 6:
            half_twist = 0.5 * float(dh.alpha_rad[i])
            link = ca.SX([math.sin(half_twist), 0.0, 0.0, math.cos(half_twist)])
            quat = quaternion_product(quat, link)
    return quaternion_product(quat, _coefficients(dh.T_last_tip.rotation))


def _coefficients(R: FloatArray) -> ca.SX:
    xyzw: FloatArray = pin.Quaternion(R).coeffs()
    return ca.SX(xyzw)
