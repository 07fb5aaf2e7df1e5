"""Task: a tolerance and the tip it is for, and what follows from them.

Where one axis is free, tip and requested frame are turned alike so that it becomes z, which is the
one the search knows (`baxter_kin.ik.task_kernel`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pinocchio as pin

from baxter_kin.arrays import Vector
from baxter_kin.ik.tolerance import Tolerance

ROLLS = 16
"""Rotations about a free axis that starts are computed for."""

_CYCLES = ((1, 2, 0), (2, 0, 1), (0, 1, 2))  # the order of axes that makes x, y or z the last


@dataclass(frozen=True)
class Task:
    """What a tip has to do, but for the pose.

    Attributes:
        tolerance: how exactly.
        T_gripper_tip: the tip seen from the gripper.
    """

    tolerance: Tolerance = field(default_factory=Tolerance)
    T_gripper_tip: pin.SE3 = field(default_factory=pin.SE3.Identity)

    @property
    def roll_is_free(self) -> bool:
        """Whether the rotation about one axis is free."""
        return self.tolerance.free_axis is not None

    @cached_property
    def order(self) -> tuple[int, int, int]:
        """Which axes x, y and z of the turned frames are."""
        axis = self.tolerance.free_axis
        return _CYCLES[2 if axis is None else axis]

    @cached_property
    def widths(self) -> Vector:
        """What is allowed along and about the turned axes, shape (6,), m and rad."""
        order = list(self.order)
        allowed = np.array([self.tolerance.position_m, self.tolerance.rotation_rad])
        widths: Vector = allowed[:, order].ravel()
        return widths

    @cached_property
    def tool(self) -> Vector:
        """The turned tip seen from the gripper, shape (4, 4)."""
        return self.turned(self.T_gripper_tip.homogeneous)

    def turned(self, Ts: Vector) -> Vector:
        """Frames, shape (..., 4, 4), with the free axis as z."""
        turned: Vector = Ts[..., [*self.order, 3]]
        return turned

    @cached_property
    def variants(self) -> Vector:
        """Tip frames seen from the requested one that would do, shape (n, 4, 4): a sample."""
        if self.tolerance.is_position_only:
            rotations = _quarter_turns()
        elif self.tolerance.free_axis is not None:
            axis = np.eye(3)[self.tolerance.free_axis]
            rotations = [pin.exp3(2 * np.pi / ROLLS * i * axis) for i in range(ROLLS)]
        else:
            rotations = [np.eye(3)]
        return np.array([pin.SE3(R, np.zeros(3)).homogeneous for R in rotations])

    def gripper_poses(self, Ts: Vector) -> Vector:
        """Gripper poses that would do for tip poses, shape (m, 4, 4): shape (m, n, 4, 4)."""
        poses: Vector = Ts[:, None] @ self.variants @ self.T_gripper_tip.inverse().homogeneous
        return poses


def _quarter_turns() -> list[Vector]:
    """The 24 rotations of a cube."""
    turns = [pin.exp3(np.pi / 2 * axis) for axis in np.eye(3)]
    found = [np.eye(3)]
    for R in found:  # grows while it is gone through
        for turn in turns:
            if not any(np.allclose(R @ turn, other) for other in found):
                found.append(R @ turn)
    return found
