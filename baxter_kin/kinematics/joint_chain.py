"""Chains of joints: poses of all joints at many configurations at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from baxter_kin.validation import FloatArray


class JointChain:
    """A chain of n revolute joints, or several parallel chains with n joints in total.

    Attributes:
        T_parent_joints: poses of the joints at zero, each seen from the one before, shape
            (n, 4, 4).
        axes: unit vectors along the joints' axes in their own frames, shape (n, 3).
    """

    def __init__(
        self, T_parent_joints: FloatArray, axes: FloatArray, first: Sequence[int] = (0,)
    ) -> None:
        """Store the joints.

        Args:
            T_parent_joints: as of the class.
            axes: as of the class.
            first: indices of the joints that begin a chain.
        """
        self.T_parent_joints, self.axes = T_parent_joints, axes
        self._followers = [joint for joint in range(len(axes)) if joint not in first]
        x, y, z = axes.T
        zero = np.zeros_like(x)
        self._K = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
        self._K_squared = self._K @ self._K

    @classmethod
    def of(cls, model: pin.Model) -> JointChain:
        """The joints of a Pinocchio model, which must be revolute and follow each other."""
        placements = [T.homogeneous for T in model.jointPlacements[1:]]
        axes = [np.ravel(joint.S)[3:] for joint in model.createData().joints[1:]]
        return cls(np.array(placements), np.array(axes))

    @classmethod
    def side_by_side(cls, chains: Sequence[JointChain]) -> JointChain:
        """Several simple chains as parallel chains on the same mount."""
        first = np.cumsum([0, *(len(chain.axes) for chain in chains[:-1])])
        placements, axes = ([getattr(c, x) for c in chains] for x in ("T_parent_joints", "axes"))
        return cls(np.concatenate(placements), np.concatenate(axes), first.tolist())

    def poses(self, qs: FloatArray) -> FloatArray:
        """Poses of the joints at configurations, shape (m, n), rad: shape (m, n, 4, 4).

        They are seen from the mount of each chain. Pinocchio computes the same for one
        configuration at a time; here, rotations follow from Rodrigues' formula.
        """
        sine, versine = np.sin(qs)[..., None, None], (1.0 - np.cos(qs))[..., None, None]
        turns = np.zeros((*qs.shape, 4, 4))
        turns[..., :3, :3] = np.eye(3) + sine * self._K + versine * self._K_squared
        turns[..., 3, 3] = 1.0
        poses: FloatArray = self.T_parent_joints @ turns
        for joint in self._followers:
            poses[:, joint] = poses[:, joint - 1] @ poses[:, joint]
        return poses
