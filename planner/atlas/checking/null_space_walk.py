"""Follows a self-motion by nothing that `baxter_kin` uses: Pinocchio's Jacobian, small fixed steps.

Each step goes along the null vector of the Jacobian and is corrected to the pose by damped least
squares; it ends where a joint leaves the URDF's limits. What adaptive continuation and cuts on
limits find, this finds again, slower. Its lengths are sums of chords: of the pieces that bend most
4e-4 rad short, with a fifth of the step 2e-5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter
from baxter_kin.validation import FloatArray

WALK_RAD = 0.005
"""Of a step."""

MOST_STEPS = 20_000
"""Of a walk in one direction: 100 rad; the longest pieces have 30."""

CORRECTIONS, DAMPING = 4, 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Walk:
    """What was found of a piece.

    Attributes:
        q: configurations inside the limits, `WALK_RAD` apart, shape (n, 7), rad.
        length_rad: up to the limits, which lie up to a step beyond the first and the last.
        manipulability: sqrt(det(J J')) at each, shape (n,).
        margin_rad: the greatest distance of the joint nearest to a limit.
    """

    q: FloatArray
    length_rad: float
    manipulability: FloatArray
    margin_rad: float


class NullSpaceWalker:
    """Walks with one arm of a robot."""

    def __init__(self, robot: Baxter, side: str) -> None:
        self._model, self._data = robot.model, robot.model.createData()
        self._frame = self._model.getFrameId(f"{side}_gripper")
        names = robot.arm(side).joint_names
        joints = [self._model.joints[self._model.getJointId(name)] for name in names]
        self._at_q, self._at_v = [j.idx_q for j in joints], [j.idx_v for j in joints]
        self._full = pin.neutral(self._model)
        self._low = self._model.lowerPositionLimit[self._at_q]
        self._high = self._model.upperPositionLimit[self._at_q]

    def walk(self, T_base_tip: pin.SE3, q: FloatArray) -> Walk:
        """The piece through a configuration that reaches a pose, shape (7,), rad."""
        q = self._corrected(T_base_tip, q)
        _, J = self._linearized(T_base_tip, q)
        tangent: FloatArray = np.linalg.svd(J)[2][6]
        ahead, beyond, is_closed = self._one_way(T_base_tip, q, tangent)
        behind: list[FloatArray] = []
        if not is_closed:
            behind, before, _ = self._one_way(T_base_tip, q, -tangent)
            beyond += before
        points = np.array([*behind[::-1], q, *ahead])
        length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()) + beyond
        margin = np.minimum(points - self._low, self._high - points).min(axis=1).max()
        worth = np.array([self._manipulability(T_base_tip, each) for each in points])
        return Walk(points, length, worth, float(margin))

    def _one_way(
        self, T: pin.SE3, start: FloatArray, tangent: FloatArray
    ) -> tuple[list[FloatArray], float, bool]:
        """Points after the first, what is left to a limit or the start, and whether it closed."""
        q, points = start, list[FloatArray]()
        for number in range(MOST_STEPS):
            tried = self._corrected(T, q + WALK_RAD * tangent)
            chord = tried - q
            if number > 2 and np.linalg.norm(tried - start) < WALK_RAD:
                points.append(tried)
                return points, float(np.linalg.norm(tried - start)), True
            over = np.maximum(self._low - tried, tried - self._high)
            if over.max() > 0.0:
                speed = np.abs(chord) / np.linalg.norm(chord)
                past = np.where(over > 0.0, over / speed.clip(min=1e-12), 0.0).max()
                return points, max(float(np.linalg.norm(chord)) - float(past), 0.0), False
            points.append(tried)
            null = np.linalg.svd(self._linearized(T, tried)[1])[2][6]
            tangent = null if null @ chord >= 0.0 else -null
            q = tried
        return points, 0.0, False

    def _corrected(self, T: pin.SE3, q: FloatArray) -> FloatArray:
        for _ in range(CORRECTIONS):
            error, J = self._linearized(T, q)
            if error @ error < 1e-24:
                break
            q = q + J.T @ np.linalg.solve(J @ J.T + DAMPING * np.eye(6), error)
        return q

    def _linearized(self, T: pin.SE3, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The error of the pose and the Jacobian of the tip, in the tip's axes."""
        self._full[self._at_q] = q
        pin.computeJointJacobians(self._model, self._data, self._full)
        reached = pin.updateFramePlacement(self._model, self._data, self._frame)
        J = pin.getFrameJacobian(self._model, self._data, self._frame, pin.LOCAL)
        return np.array(pin.log6(reached.actInv(T)).vector), J[:, self._at_v]

    def _manipulability(self, T: pin.SE3, q: FloatArray) -> float:
        J = self._linearized(T, q)[1]
        return float(np.sqrt(max(np.linalg.det(J @ J.T), 0.0)))
