"""Mover: the arms that move, as one list of joints and as one serial chain.

Rows of separation hold for a serial chain (`planner.certificate.rows`). Two arms on one base are
such a chain, too, if one walks from base along the left arm to its hand, back to base, and along
the right arm: any two links are met one after the other, with all joints between them on the way.

Let S_j be the pose of joint j of the left arm at position 0, seen from joint j - 1. Its frame is
F_j = F_(j-1) S_j Z(q_j), where Z is a rotation about z. On the way back, take for link j the frame
G_j = F_j S_(j+1), which is fixed to the link; S_8 = 1, and G_0 is fixed to base. Then

    G_j^-1 G_(j-1) = S_(j+1)^-1 F_j^-1 F_(j-1) S_j = S_(j+1)^-1 Z(-q_j),

a constant pose followed by a rotation about z by -q_j. A joint that is passed backwards is
therefore a joint like any other, with the same speed and acceleration, and at the right arm's first
joint the constant pose is G_0^-1 F_0 S_1 of that arm. All that is proven of serial chains holds for
the walk; the bounds of `planner.certificate.motion.carried` need only speeds, accelerations, and
the distances from each joint to the next.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baxter_kin import Arm, JointLimits
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.kinematics.joint_chain import JointChain
from baxter_kin.validation import FloatArray, Indices
from planner.prover.problem import Chain


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """Arms that move together. Their joints are in a row, the left arm's before the right arm's.

    Attributes:
        arms: in this order.
    """

    arms: tuple[Arm, ...]

    @classmethod
    def of(cls, *arms: Arm) -> Mover:
        """One arm, or both in any order."""
        return cls(tuple(sorted(arms, key=lambda arm: LIMBS.index(arm.side))))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The names of all joints, n in all."""
        return tuple(name for arm in self.arms for name in arm.joint_names)

    @property
    def limits(self) -> JointLimits:
        """The limits of all joints; their origins are those of the first arm."""
        each = [arm.limits for arm in self.arms]
        q_min, q_max, v_max, a_max, j_max = (
            np.concatenate([getattr(limits, name) for limits in each])
            for name in ("q_min", "q_max", "v_max", "a_max", "j_max")
        )
        origins = each[0].origins
        return JointLimits(self.joint_names, q_min, q_max, v_max, a_max, j_max, origins)


class Walk(NamedTuple):
    """The serial chain of a mover: along its arm, or along the left arm, back, and along the right.

    Base and the links of the left arm are met twice then: outbound and on the way back.

    Attributes:
        chain: the joints in order, n of them.
        joints: the joint of the mover that each of them is, shape (n,).
        signs: 1, or -1 for a joint that is passed backwards, shape (n,).
        levels: the joints of the chain that carry base and the links of the mover's J joints,
            outbound and, with two arms, on the way back, shape (1 or 2, J + 1); 0 for base, -1 for
            a link that is not met.
        T_level_link: poses of base and of these joints' frames as the mover has them, seen from
            the joints of the chain that carry them, shape (1 or 2, J + 1, 4, 4).
    """

    chain: Chain
    joints: Indices
    signs: FloatArray
    levels: Indices
    T_level_link: FloatArray

    @classmethod
    def of(cls, mover: Mover) -> Walk:
        """The walk of one arm or both."""
        chain, T = about_z(mover.arms[0].chain)
        count = len(T) - 1
        joints, levels = np.arange(count), np.arange(count + 1)
        if len(mover.arms) == 1:
            return cls(chain, joints, np.ones(count), levels[None], T[None])
        other, T_other = about_z(mover.arms[1].chain)
        links = np.arange(1, len(T_other))
        S = np.concatenate([homogeneous(chain.R, chain.p), np.eye(4)[None]])  # S_1 to S_8
        S_inverse, onward = np.linalg.inv(S), homogeneous(other.R, other.p)
        onward[0] = S_inverse[0] @ onward[0]
        return cls(
            Chain.of_poses(np.concatenate([S[:-1], S_inverse[:0:-1], onward])),
            np.concatenate([joints, joints[::-1], count + links - 1]),
            np.repeat([1.0, -1.0, 1.0], [count, count, len(links)]),
            np.array(
                [
                    np.append(levels, np.full(len(links), -1)),
                    np.append(2 * count - levels, 2 * count + links),
                ]
            ),
            np.array([[*T, *T_other[1:]], [*(S_inverse @ T), *T_other[1:]]]),
        )

    def along(self, q: FloatArray) -> FloatArray:
        """Positions of the chain's joints by those of the mover's, or derivatives, (..., n)."""
        found: FloatArray = self.signs * q[..., self.joints]
        return found


def about_z(chain: JointChain) -> tuple[Chain, FloatArray]:
    """The chain with frames that are turned so that each joint is about z.

    Returns:
        The chain, and poses of base and the joints' frames seen from the new ones, shape
        (n + 1, 4, 4).
    """
    z = chain.axes
    x = np.cross(z, np.eye(3)[np.abs(z).argmin(axis=1)])
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    turned = np.concatenate([np.eye(3)[None], np.stack([x, np.cross(z, x), z], axis=2)])
    T = chain.T_parent_joints
    R = turned[:-1].swapaxes(1, 2) @ T[:, :3, :3] @ turned[1:]
    p = (turned[:-1].swapaxes(1, 2) @ T[:, :3, 3:])[..., 0]
    return Chain.of_poses(homogeneous(R, p)), homogeneous(turned.swapaxes(1, 2))


def homogeneous(R: FloatArray, p: FloatArray | float = 0.0) -> FloatArray:
    """Transforms by rotations, shape (n, 3, 3), and translations, shape (n, 3), shape (n, 4, 4)."""
    T = np.tile(np.eye(4), (len(R), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = R, p
    return T
