"""From a configuration near a pose to one at it: the page's own iteration, here for many at once.

The first joint stays, and Newton's method turns the other six, so that of the self-motion the same
point is found again from which the configuration was rounded. The steps are damped least squares
(Wampler 1986) with a damping that only singular arms feel. `pages/atlas/kinematics.js` has the same
in JavaScript, and takes its numbers from `SETTINGS`.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray

SETTINGS = MappingProxyType({"iterations": 10, "damping": 1e-12, "longest_rad": 0.1})
"""The most iterations, what is added to the diagonal, and how far a joint may turn in one."""

MET = 1e-8
"""Metres and rad at which it ends: a hundredth of what a witness may be off."""

PIECE = 8192
"""Configurations worked on together, which bounds the memory."""


@dataclass(frozen=True, slots=True, eq=False)
class TipChain:
    """An arm as the page has it.

    Attributes:
        arm: the arm.
        T_last_tip: the tip seen from the last joint, shape (4, 4).
    """

    arm: Arm
    T_last_tip: FloatArray

    @classmethod
    def of(cls, arm: Arm) -> TipChain:
        """That of an arm."""
        last = arm.chain.poses(arm.neutral[None])[0, -1]
        return cls(arm, np.linalg.solve(last, arm.T_base_tip(arm.neutral).homogeneous))

    def errors(self, q: FloatArray, Ts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How far the tip is from poses, shape (m, 6), and Jacobians (m, 6, 7), linear first."""
        joints = self.arm.chain.poses(q)
        tips = joints[:, -1] @ self.T_last_tip
        axes = (joints[:, :, :3, :3] @ self.arm.chain.axes[:, :, None])[..., 0]
        arms = tips[:, None, :3, 3] - joints[:, :, :3, 3]
        jacobians = np.concatenate([np.cross(axes, arms), axes], axis=2).swapaxes(1, 2)
        turned = _rotation_vectors(Ts[:, :3, :3] @ tips[:, :3, :3].swapaxes(1, 2))
        return np.concatenate([Ts[:, :3, 3] - tips[:, :3, 3], turned], axis=1), jacobians

    def polished(self, q: FloatArray, Ts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Configurations at poses, from near ones, and what is left of the error.

        Args:
            q: shape (m, 7), rad.
            Ts: of the tip seen from base, shape (m, 4, 4).
        """
        parts = [slice(at, at + PIECE) for at in range(0, len(q), PIECE)]
        both = [self._polished(q[part], Ts[part]) for part in parts]
        found = [each[0] for each in both], [each[1] for each in both]
        return np.concatenate([q[:0], *found[0]]), np.concatenate([np.zeros(0), *found[1]])

    def _polished(self, q: FloatArray, Ts: FloatArray) -> tuple[FloatArray, FloatArray]:
        q, left = q.copy(), np.zeros(len(q))
        moving = np.arange(len(q))
        for iteration in range(int(SETTINGS["iterations"]) + 1):
            error, jacobians = self.errors(q[moving], Ts[moving])
            left[moving] = np.abs(error).max(axis=1)
            far = left[moving] > MET
            moving = moving[far]
            if iteration == SETTINGS["iterations"] or not moving.size:
                break
            q[moving, 1:] += _step(error[far], jacobians[far, :, 1:])
        return q, left


def _step(error: FloatArray, J: FloatArray) -> FloatArray:
    """Of the six joints, no longer than allowed."""
    normal = J @ J.swapaxes(1, 2) + SETTINGS["damping"] * np.eye(6)
    step = (J.swapaxes(1, 2) @ np.linalg.solve(normal, error[..., None]))[..., 0]
    longest = np.abs(step).max(axis=1, keepdims=True)
    shortened: FloatArray = step * np.minimum(1.0, SETTINGS["longest_rad"] / (longest + 1e-300))
    return shortened


def _rotation_vectors(Rs: FloatArray) -> FloatArray:
    """Axis times angle of rotations below half a turn, shape (m, 3), rad."""
    off = np.stack([Rs[:, 2, 1], Rs[:, 0, 2], Rs[:, 1, 0]], axis=1)
    off = (off - np.stack([Rs[:, 1, 2], Rs[:, 2, 0], Rs[:, 0, 1]], axis=1)) / 2.0
    sine = np.linalg.norm(off, axis=1, keepdims=True)
    cosine = (np.trace(Rs, axis1=1, axis2=2)[:, None] - 1.0) / 2.0
    vectors: FloatArray = off * (np.arctan2(sine, cosine) / np.maximum(sine, 1e-300))
    return vectors
