"""What an answer is worth: measured by Pinocchio on the whole robot's URDF, trusting no solver."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin.kinematics.arm import Arm
from baxter_kin.model import Baxter
from baxter_kin.validation import FloatArray

TOLERANCE = 1e-6
"""Distance in m and angle in rad within which a pose counts as solved."""

LIMIT_ROUNDING_RAD = 1e-9
"""Overshoot of a joint limit that counts as rounding."""

LOOSE_TOLERANCE = 1e-5
"""Error along (m) and about (rad) each axis of the tip; what TRAC-IK, and those who compare
themselves with it, call solved. Its authors: Beeson and Ames, Humanoids 2015."""

LOOSE_LIMIT_RAD = 1e-6
"""Overshoot of a joint limit allowed with it; some solvers keep limits in single precision."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """How far an answer is from the pose; infinitely far when there is none.

    Attributes:
        position_error_m: distance between requested and reached tip.
        orientation_error_rad: angle between requested and reached tip.
        axis_error: greatest error along or about one axis of the requested tip, m or rad.
        limit_excess_rad: how far the joint farthest outside its limits is outside; 0 inside.
        is_claimed: whether the solver says that it found an answer.
    """

    position_error_m: float = math.inf
    orientation_error_rad: float = math.inf
    axis_error: float = math.inf
    limit_excess_rad: float = math.inf
    is_claimed: bool = False

    @property
    def is_solved(self) -> bool:
        """Within 1e-6 m and 1e-6 rad, inside the limits."""
        return (
            self.position_error_m <= TOLERANCE
            and self.orientation_error_rad <= TOLERANCE
            and self.limit_excess_rad <= LIMIT_ROUNDING_RAD
        )

    @property
    def is_solved_loosely(self) -> bool:
        """Within 1e-5 per axis, and inside the limits within 1e-6 rad."""
        return self.axis_error <= LOOSE_TOLERANCE and self.limit_excess_rad <= LOOSE_LIMIT_RAD


class Verifier:
    """Measures answers for one arm on the model of the whole robot."""

    def __init__(self, robot: Baxter, arm: Arm) -> None:
        self._model = robot.model
        self._data = robot.model.createData()
        self._neutral = pin.neutral(robot.model)
        joint_ids = [robot.model.getJointId(name) for name in arm.joint_names]
        self._indices = [robot.model.joints[joint_id].idx_q for joint_id in joint_ids]
        self._tip_id = robot.model.getFrameId(arm.tip_frame)

    def T_base_tip(self, q: FloatArray) -> pin.SE3:
        """Forward kinematics of joint values of shape (7,), rad."""
        whole = self._neutral.copy()
        whole[self._indices] = q
        pin.forwardKinematics(self._model, self._data, whole)
        return pin.SE3(pin.updateFramePlacement(self._model, self._data, self._tip_id))

    def verdict(self, T_base_tip: pin.SE3, q: object) -> Verdict:
        """Measure an answer of any kind; None, or no seven finite numbers, is none."""
        values = _seven_numbers(q)
        if values is None:
            return Verdict(is_claimed=q is not None)
        T_tip_reached = T_base_tip.actInv(self.T_base_tip(values))
        offset, rotation = T_tip_reached.translation, pin.log3(T_tip_reached.rotation)
        return Verdict(
            position_error_m=float(np.linalg.norm(offset)),
            orientation_error_rad=float(np.linalg.norm(rotation)),
            axis_error=float(max(np.abs(offset).max(), np.abs(rotation).max())),
            limit_excess_rad=self._limit_excess(values),
            is_claimed=True,
        )

    def _limit_excess(self, q: FloatArray) -> float:
        below = self._model.lowerPositionLimit[self._indices] - q
        above = q - self._model.upperPositionLimit[self._indices]
        return max(0.0, float(below.max()), float(above.max()))


def _seven_numbers(q: object) -> FloatArray | None:
    try:
        values = np.array(q, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    return values if values.shape == (7,) and np.isfinite(values).all() else None
