"""Searches for a configuration that reaches a pose, without code of the solvers of `baxter_kin`.

The model is read from the text of the URDF by Pinocchio, and so are the joints and their limits.
Bounded least squares by Levenberg and Marquardt's damping, with joints held at limits that they are
pushed against (projected Newton; Bertsekas 1982), from many starts at a time: those nearest to the
pose of many random configurations, then random ones. Whether a configuration counts is decided by
Pinocchio on the model of the whole robot. Finding none is not a proof; the share of reachable poses
for which it finds one, its power, has to be measured.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter
from baxter_kin.errors import DescriptionError
from baxter_kin.validation import FloatArray

TOLERANCE = 1e-6
"""How near a configuration must come to a pose to reach it, m and rad."""

NEAREST, RANDOM = 16, 64
"""Number of near starts, and of random ones that follow if these find nothing."""

LIBRARY = 20_000
"""Random configurations that the nearest are chosen from."""

STEPS, STALLED_STEPS, GAIN = 60, 8, 0.02
"""Maximum number of steps, and of steps in a row with less than this gain."""

ROTATION_M = 0.3
"""Weight of a radian, in metres, in distances of poses."""

_MIN_SINE = 1e-12


class PoseFinder:
    """The solver for one arm of a robot."""

    def __init__(self, robot: Baxter, side: str, *, seed: int = 0) -> None:
        """Prepare it.

        Args:
            robot: whose arm; of it the description alone is used.
            side: of the arm.
            seed: of the configurations to start from.
        """
        self._model, tip = pin.buildModelFromXML(robot.description.text), f"{side}_gripper"
        if not self._model.existFrame(tip):
            raise DescriptionError(f"the URDF is not Baxter's: it lacks the link {tip}")
        self._frame = self._model.getFrameId(tip)
        self._data, self._full = self._model.createData(), pin.neutral(self._model)
        wrist = self._model.frames[self._frame].parentJoint
        ids = [int(joint) for joint in self._model.supports[wrist]][1:]
        self._at_q = [self._model.joints[i].idx_q for i in ids]
        self._low = self._model.lowerPositionLimit[self._at_q]
        self._high = self._model.upperPositionLimit[self._at_q]
        placements = [self._model.jointPlacements[i] for i in ids]
        T_last_tip = self._model.frames[self._frame].placement
        self._spans = [(T.rotation.copy(), T.translation.copy()) for T in (*placements, T_last_tip)]
        self._T_base_mount = self._mount(ids[0])
        self._seed = seed
        self._library = self._random(LIBRARY, np.random.default_rng(seed))
        self._library_p, self._library_R, _ = self._tips(self._library)

    def margin_rad(self, q: FloatArray) -> float:
        """How far a configuration, shape (7,), is inside the limits."""
        return float(np.minimum(q - self._low, self._high - q).min())

    def holds(self, T_base_tip: pin.SE3, q: FloatArray) -> bool:
        """Whether a configuration is inside the limits and reaches a pose.

        Args:
            T_base_tip: the pose.
            q: shape (7,), rad.
        """
        if self.margin_rad(q) < 0.0:
            return False
        self._full[self._at_q] = q
        pin.forwardKinematics(self._model, self._data, self._full)
        T = pin.updateFramePlacement(self._model, self._data, self._frame)
        turned = pin.log3(T.rotation.T @ T_base_tip.rotation)
        off = np.linalg.norm(T.translation - T_base_tip.translation), np.linalg.norm(turned)
        return bool(max(off) <= TOLERANCE)

    def find(self, T_base_tip: pin.SE3) -> FloatArray | None:
        """A configuration inside the limits that reaches a pose, shape (7,); None if none is found.

        The same pose has the same answer, whatever was asked before.

        Args:
            T_base_tip: the pose.
        """
        pose = np.frombuffer(T_base_tip.homogeneous.tobytes(), np.uint32)
        rng = np.random.default_rng([self._seed, *pose])
        away = np.linalg.norm(self._library_p - T_base_tip.translation, axis=1)
        cosine = (np.einsum("nij,ij->n", self._library_R, T_base_tip.rotation) - 1.0) / 2.0
        away += ROTATION_M * np.arccos(cosine.clip(-1.0, 1.0))
        nearest = self._library[np.argpartition(away, NEAREST)[:NEAREST]]
        for starts in (nearest, self._random(RANDOM, rng)):
            q = self._search(starts, T_base_tip)
            if self.holds(T_base_tip, q):
                return q
        return None

    def _search(self, q: FloatArray, T_base_tip: pin.SE3) -> FloatArray:
        """The best that searches from configurations, shape (n, 7), come to."""
        damping, stalled = np.full(len(q), 1e-2), np.zeros(len(q), int)
        error, J = self._linearized(q, T_base_tip)
        cost = (error**2).sum(axis=1)
        best: FloatArray = q[cost.argmin()]
        least = cost.min()
        for _ in range(STEPS):
            tried = self._stepped(q, error, J, damping)
            new_error, new_J = self._linearized(tried, T_base_tip)
            new_cost = (new_error**2).sum(axis=1)
            stalled = np.where(new_cost < (1.0 - GAIN) * cost, 0, stalled + 1)
            is_better = new_cost < cost
            damping = np.where(is_better, damping / 5.0, damping * 4.0).clip(1e-12, 1e6)
            for old, new in ((q, tried), (error, new_error), (J, new_J), (cost, new_cost)):
                old[is_better] = new[is_better]
            if cost.min() < least:
                best, least = q[cost.argmin()].copy(), cost.min()
            goes_on = stalled < STALLED_STEPS
            if least < (TOLERANCE / 10.0) ** 2 or not goes_on.any():
                break
            q, error, J, cost = q[goes_on], error[goes_on], J[goes_on], cost[goes_on]
            damping, stalled = damping[goes_on], stalled[goes_on]
        return best

    def _stepped(
        self, q: FloatArray, error: FloatArray, J: FloatArray, damping: FloatArray
    ) -> FloatArray:
        """Damped steps inside the limits: joints that would leave them stay where they are."""
        descent = (error[:, None] @ J)[:, 0]
        held = ((q <= self._low) & (descent < 0.0)) | ((q >= self._high) & (descent > 0.0))
        free = J * ~held[:, None, :]
        transposed = free.swapaxes(1, 2)
        normal = free @ transposed + damping[:, None, None] * np.eye(6)
        steps = (transposed @ np.linalg.solve(normal, error[:, :, None]))[:, :, 0]
        stepped: FloatArray = (q + steps).clip(self._low, self._high)
        return stepped

    def _linearized(self, q: FloatArray, T_base_tip: pin.SE3) -> tuple[FloatArray, FloatArray]:
        """Errors (n, 6) and Jacobians (n, 6, 7) of the tip, linear first, in axes of base."""
        p, R, J = self._tips(q)
        W = T_base_tip.rotation @ R.swapaxes(1, 2)
        sine = np.stack(
            [W[:, 2, 1] - W[:, 1, 2], W[:, 0, 2] - W[:, 2, 0], W[:, 1, 0] - W[:, 0, 1]], axis=1
        )
        size = np.linalg.norm(sine, axis=1)
        angle = np.arctan2(size, np.trace(W, axis1=1, axis2=2) - 1.0)
        turned = sine * (angle / np.maximum(size, _MIN_SINE))[:, None]
        return np.concatenate([T_base_tip.translation - p, turned], axis=1), J

    def _tips(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions, rotations and Jacobians of the tip; joints turn about their z axes."""
        R = np.broadcast_to(self._T_base_mount.rotation, (len(q), 3, 3))
        p = np.broadcast_to(self._T_base_mount.translation, (len(q), 3))
        cosine, sine = np.cos(q), np.sin(q)
        axes, points = np.empty((2, len(q), 7, 3))
        for i, (R_span, p_span) in enumerate(self._spans):
            p = p + R @ p_span
            R = R @ R_span
            if i < 7:
                axes[:, i], points[:, i] = R[:, :, 2], p
                c, s = cosine[:, i, None], sine[:, i, None]
                x, y = R[:, :, 0], R[:, :, 1]
                R = np.stack([c * x + s * y, c * y - s * x, R[:, :, 2]], axis=2)
        linear = np.cross(axes, p[:, None] - points)
        return p, R, np.concatenate([linear, axes], axis=2).swapaxes(1, 2)

    def _mount(self, joint: int) -> pin.SE3:
        """What carries the arm, seen from base."""
        pin.forwardKinematics(self._model, self._data, self._full)
        carried: pin.SE3 = self._data.oMi[self._model.parents[joint]].copy()
        return carried

    def _random(self, number: int, rng: np.random.Generator) -> FloatArray:
        return rng.uniform(self._low, self._high, (number, 7))
