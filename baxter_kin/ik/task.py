"""Task: a tolerance and the tip it is for, and what follows from them.

Where one axis is free, tip and requested frame are turned alike so that it becomes z, which is the
one the search knows (`baxter_kin.ik.search.task_search`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pinocchio as pin

from baxter_kin.ik.tolerance import EXACT, Tolerance
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray

ROLLS = 16
"""Rotations about a free axis that starts are computed for."""

LEAN = 0.9
"""How far every second of them leans, as a share of the cone. With none, 17 of 500 poses that only
a lean of 0.1 rad makes reachable are left to IPOPT; with all, 4 of 4,000 with a cone of 1.5 rad."""

_DIRECTION_STEP = 5  # in steps of the rotation, so that the leaning ones go all around

_CYCLES = ((1, 2, 0), (2, 0, 1), (0, 1, 2))  # the order of axes that makes x, y or z the last


@dataclass(frozen=True)
class Task:
    """What a tip has to do, but for the pose.

    Attributes:
        tolerance: how exactly.
        T_gripper_tip: the tip seen from the gripper.
    """

    tolerance: Tolerance = EXACT
    T_gripper_tip: pin.SE3 = field(default_factory=pin.SE3.Identity)

    @classmethod
    def of(cls, arm: Arm, tolerance: Tolerance) -> Task:
        """What a tolerance asks of an arm's tip."""
        return cls(tolerance, arm.T_gripper_tip)

    @property
    def is_exact(self) -> bool:
        """Whether the gripper itself is the tip and meets its pose in every respect."""
        return self.tolerance == EXACT and self.T_gripper_tip == pin.SE3.Identity()

    @property
    def roll_is_free(self) -> bool:
        """Whether the rotation about one axis is free."""
        return self.tolerance.free_axis is not None

    @cached_property
    def order(self) -> tuple[int, int, int]:
        """Which axes x, y and z of the turned frames are."""
        axis = self.tolerance.free_axis
        return _CYCLES[2 if axis is None else axis]

    @property
    def columns(self) -> list[int]:
        """Those of a frame that make up the turned one."""
        return [*self.order, 3]

    @cached_property
    def widths(self) -> FloatArray:
        """What is allowed along and about the turned axes, and of tilt, shape (7,), m and rad."""
        order = list(self.order)
        allowed = np.array([self.tolerance.position_m, self.tolerance.rotation_rad])
        return np.append(allowed[:, order].ravel(), self.tolerance.tilt_rad)

    def numbers(self, T_last_gripper: pin.SE3) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What the search function takes of it (`baxter_kin.ik.search.task_search`).

        The turned tip seen from the last axis, `widths`, and 1 where the roll is free.
        """
        tip = T_last_gripper.homogeneous @ self.turned(self.T_gripper_tip.homogeneous)
        return tip, self.widths, np.array([float(self.roll_is_free)])

    def turned(self, Ts: FloatArray) -> FloatArray:
        """Frames, shape (..., 4, 4), with the free axis as z."""
        turned: FloatArray = Ts if self.tolerance.free_axis in {None, 2} else Ts[..., self.columns]
        return turned

    @cached_property
    def variants(self) -> FloatArray:
        """Tip frames seen from the requested one that would do, shape (n, 4, 4): a sample."""
        if self.tolerance.is_position_only:
            rotations = _quarter_turns()
        elif self.tolerance.free_axis is not None:
            rotations = _rolls(self.tolerance.free_axis, LEAN * self.tolerance.tilt_rad)
        else:
            rotations = [np.eye(3)]
        return np.array([pin.SE3(R, np.zeros(3)).homogeneous for R in rotations])

    def gripper_poses(self, Ts: FloatArray) -> FloatArray:
        """Gripper poses that would do for tip poses, shape (m, 4, 4): shape (m, n, 4, 4)."""
        poses: FloatArray = Ts[:, None] @ self.variants @ self.T_gripper_tip.inverse().homogeneous
        return poses


def _rolls(free_axis: int, lean_rad: float) -> list[FloatArray]:
    """Rotations about an axis, in equal steps, every second one followed by a lean of that axis."""
    axis, across = np.eye(3)[free_axis], np.eye(3)[free_axis - 1]
    rolls = [pin.exp3(2 * np.pi / ROLLS * i * axis) for i in range(ROLLS)]
    leans = [pin.exp3(lean_rad * (R @ across)) for R in rolls]
    return [leans[_DIRECTION_STEP * i % ROLLS] @ R if i % 2 else R for i, R in enumerate(rolls)]


def _quarter_turns() -> list[FloatArray]:
    """The 24 rotations of a cube."""
    turns = [pin.exp3(np.pi / 2 * axis) for axis in np.eye(3)]
    found = [np.eye(3)]
    for R in found:  # grows while it is gone through
        for turn in turns:
            if not any(np.allclose(R @ turn, other) for other in found):
                found.append(R @ turn)
    return found
