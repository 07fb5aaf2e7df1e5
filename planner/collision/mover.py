"""Mover: the arms that move, as one list of joints and as one serial chain.

Rows of separation hold for a serial chain (`planner.certificate.rows`). Two arms on one base are
such a chain, too, along the walk from base to the left hand, back to base, and to the right hand:
it passes any two links one after the other, and all joints between them.

Let S_j be the pose of joint j of the left arm at position 0, seen from joint j - 1. Its frame is
F_j = F_(j-1) S_j Z(q_j), where Z is a rotation about z. On the way back, take for link j the frame
G_j = F_j S_(j+1), which is fixed to the link; S_8 = 1, and G_0 is fixed to base. Then

    G_j^-1 G_(j-1) = S_(j+1)^-1 F_j^-1 F_(j-1) S_j = S_(j+1)^-1 Z(-q_j),

a constant pose followed by a rotation about z by -q_j. A joint that is passed backwards is
therefore an ordinary joint with the same speed and acceleration, and at the right arm's first joint
the constant pose is G_0^-1 F_0 S_1 of that arm. All proofs for serial chains hold for the walk; the
bounds of `planner.certificate.motion.carried` need only speeds, accelerations, and the distances
from each joint to the next.
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
    """Arms that move together; the left arm's joints come before the right arm's.

    Attributes:
        arms: one arm, or the left and the right.
    """

    arms: tuple[Arm, ...]

    @classmethod
    def of(cls, *arms: Arm) -> Mover:
        """The mover of one arm, or of both in any order."""
        return cls(tuple(sorted(arms, key=lambda arm: LIMBS.index(arm.side))))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The names of all joints, J in number."""
        return tuple(name for arm in self.arms for name in arm.joint_names)

    @property
    def limits(self) -> JointLimits:
        """The limits of all joints, with the origins of the first arm's."""
        return JointLimits.side_by_side([arm.limits for arm in self.arms])


class Walk(NamedTuple):
    """The serial chain of a mover: along its arm, or along the left arm, back, and along the right.

    With two arms, it passes base and the links of the left arm twice: outbound and on the way back.

    Attributes:
        chain: the joints in order, n of them.
        joints: number of each joint in the mover, shape (n,).
        signs: 1, or -1 for a joint that is passed backwards, shape (n,).
        levels: numbers, counted from 1, of the joints of the chain that carry base and the links of
            the mover's J joints, outbound and, with two arms, on the way back, shape
            (1 or 2, J + 1); 0 for base, -1 for a link that is not passed.
        T_level_link: poses of base and of the frames of the mover's joints, seen from the joints of
            the chain that carry them, shape (1 or 2, J + 1, 4, 4).
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
        """Positions of the chain's joints, (..., n), from the mover's, (..., J), or derivatives."""
        found: FloatArray = self.signs * q[..., self.joints]
        return found

    def bounds_along(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds on the chain's joints from those on the mover's."""
        ends = self.along(low), self.along(high)
        return np.minimum(*ends), np.maximum(*ends)

    def of_mover(self, q: FloatArray) -> FloatArray:
        """Positions of the mover's joints from those of the chain's, the inverse of `along`."""
        found = np.empty(1 + int(self.joints.max()))
        found[self.joints] = self.signs * q
        return found

    @property
    def from_hand(self) -> Walk:
        """With two arms, the part from the left hand on, which passes each joint once."""
        if len(self.levels) == 1:
            return self
        chain, first = self.chain, int(self.levels[1].min())
        return Walk(
            Chain(chain.R[first:], chain.p[first:], chain.offsets[first:], first),
            self.joints[first:],
            self.signs[first:],
            self.levels[1:] - first,
            self.T_level_link[1:],
        )


def about_z(chain: JointChain) -> tuple[Chain, FloatArray]:
    """The same chain with frames turned such that each joint rotates about z.

    Returns:
        The chain, and the poses of base and the joints' old frames seen from the new ones, shape
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
    """Transforms, shape (n, 4, 4), of rotations, (n, 3, 3), and translations, (n, 3)."""
    T = np.tile(np.eye(4), (len(R), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = R, p
    return T
