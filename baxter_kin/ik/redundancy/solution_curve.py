"""The configurations of an arm that reach one pose: the solution set of IK.

For seven joints the solution set is a curve wherever the Jacobian J (6 x 7) has full rank; its unit
tangent spans the null space of J. The cofactors of J are a null vector that is continuous in q,
which gives every curve one direction: the one in which `det [J; tangent']` is positive.

Where the rank drops to five, the null space is a plane and the set is no curve: two branches
cross, or the point stands alone. Second derivatives decide (Allgower and Georg, "Numerical
Continuation Methods", 1990, ch. 8): with w the left null vector of J and N a basis of the plane,
the branches leave along those N a for which the quadratic form `w' (dJ along N a) N a` vanishes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cached_property

import numpy as np
import pinocchio as pin

from baxter_kin.errors import ConfigurationError
from baxter_kin.ik.redundancy.curve_functions import RESIDUAL_TOLERANCE, SINGULAR
from baxter_kin.ik.redundancy.curve_kernel import Corrected, CurveKernel, Steps
from baxter_kin.ik.redundancy.curve_points import CurvePoint, CurvePoints, whole_turns_off
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray

TOUCHING_RAD = 1e-11
"""How far outside its limits a joint may be by rounding: of the pose, of limits, of what touches
several limits at once."""

POSE_MISMATCH = 1e-5
"""How far, in m and rad together, a configuration may miss the pose it is said to reach: ten times
the tolerance of the IK service."""

_CORRECTIONS, _MAX_CORRECTION_RAD = 2, 1.0
"""Calls of three Newton steps each, and how far all of them may lead."""

_REPEATS = 2
"""More such calls for what is far from the curve, as closed forms of an arm as drawn are from that
of a calibrated one."""

_DIFFERENCE_RAD = 1e-4
"""Step of the central difference of J: its error, the square, is far below `_FLAT`."""

_FLAT = 1e-6
"""Curvature, 1/rad, below which the quadratic form counts as zero."""


class SolutionCurve:
    """All configurations of an arm that reach one pose.

    Attributes:
        arm: whose joints reach it.
        T_base_tip: the pose of the tip, seen from base.
        kernel: computes along its curves.
        has_limits: whether curves end on joint limits.
        q_min: where curves end, shape (7,), rad: the arm's lower limits, or minus infinity.
        q_max: the same above.
    """

    def __init__(self, arm: Arm, T_base_tip: pin.SE3, *, has_limits: bool = True) -> None:
        self.arm = arm
        self.kernel = CurveKernel.of(arm)
        self.has_limits = has_limits
        unlimited = np.full(7, np.inf)
        self.q_min = arm.limits.q_min if has_limits else -unlimited
        self.q_max = arm.limits.q_max if has_limits else unlimited
        self._middle = 0.5 * (arm.limits.q_min + arm.limits.q_max)
        self.T_base_tip = _orthonormal(T_base_tip)
        self._base_from_tip = np.zeros((6, 6))
        self._base_from_tip[:3, :3] = self._base_from_tip[3:, 3:] = self.T_base_tip.rotation
        self._matrix = self.T_base_tip.homogeneous

    @cached_property
    def without_limits(self) -> SolutionCurve:
        """The same pose, whatever the limits."""
        return SolutionCurve(self.arm, self.T_base_tip, has_limits=False)

    def limited_by(self, joints: Iterable[int]) -> SolutionCurve:
        """The same pose, with the limits of these joints alone: for cutting curves that exist."""
        limited = SolutionCurve(self.arm, self.T_base_tip)
        is_limited = np.isin(np.arange(7), list(joints))
        limited.q_min = np.where(is_limited, self.q_min, -np.inf)
        limited.q_max = np.where(is_limited, self.q_max, np.inf)
        return limited

    def error(self, q: FloatArray) -> FloatArray:
        """The twist from the pose of `q` to the target, shape (6,), m and rad, linear first.

        Along the axes of base up to the square of the error; of the right size whatever it is.
        """
        twist = pin.log6(self.arm.T_base_tip(q).actInv(self.T_base_tip)).vector
        error: FloatArray = self._base_from_tip @ twist
        return error

    def corrected(
        self, q: FloatArray, normal: FloatArray, tolerance: float = RESIDUAL_TOLERANCE
    ) -> tuple[FloatArray, float] | None:
        """The configuration of the curve in a hyperplane through `q`, and its residual.

        Newton's method on `[J; normal'] dq = [error; 0]`.

        Args:
            q: a configuration near the curve, shape (7,), rad.
            normal: of the hyperplane, shape (7,).
            tolerance: the residual to reach, m and rad together.

        Returns:
            None when it does not converge nearby.
        """
        moved = q
        for _ in range(_CORRECTIONS):
            found = self.kernel.corrected(moved, normal, self._matrix)
            moved, residual = found.q[0], float(found.residual[0])
            if residual <= tolerance:
                is_near = np.square(moved - q).sum() <= _MAX_CORRECTION_RAD**2
                return (moved, residual) if is_near else None
        return None

    def onto(self, q: FloatArray) -> FloatArray:
        """The configuration next to `q` that reaches the pose inside the limits.

        Raises:
            ConfigurationError: when `q`, shape (7,), rad, misses the pose by more than
                `POSE_MISMATCH`, or there is no such configuration.
        """
        limits = self.arm.limits
        miss = float(np.linalg.norm(self.error(q)))
        if miss > POSE_MISMATCH:
            raise ConfigurationError(
                f"q misses the pose by {miss:.3g} (m and rad together); allowed is "
                f"{POSE_MISMATCH:g}"
            )
        found = self.corrected(q, np.linalg.svd(self.arm.jacobian(q))[2][6])
        for _ in range(len(q)):
            if found is None:
                break
            nearby = np.clip(found[0], limits.q_min, limits.q_max)
            excess = np.abs(found[0] - nearby)
            if not excess.any():
                return nearby
            held = np.eye(len(q))[int(np.argmax(excess))]
            found = self.corrected(nearby * held + found[0] * (1.0 - held), held)
        raise ConfigurationError(
            f"q misses the pose by {miss:.3g}, and no configuration next to it reaches the pose "
            "inside the limits"
        )

    def corrected_many(self, q: FloatArray, normal: FloatArray) -> Corrected:
        """The same for configurations, shape (n, 7), with their residuals, however large."""
        return self.kernel.corrected_many(q, normal, self._matrix)

    def nearest_many(self, q: FloatArray) -> Corrected:
        """Configurations, shape (n, 7), moved onto the curve by steps of least norm."""
        found = self.kernel.corrected_many(q, np.zeros_like(q), self._matrix)
        for _ in range(_REPEATS):
            off = np.flatnonzero(~(found.residual <= RESIDUAL_TOLERANCE))
            again = self.kernel.corrected_many(found.q[off], np.zeros((len(off), 7)), self._matrix)
            for values, better in zip(found, again, strict=True):
                values[off] = better
        return found

    def march(self, state: FloatArray, max_step_rad: float) -> tuple[CurvePoints, Steps]:
        """The points of one block of steps, and the steps; as `CurveKernel.march`."""
        steps = self.kernel.march(state, self._matrix, max_step_rad)
        clearance = self.clearance_rad(steps.q)
        return CurvePoints(np.column_stack([*steps[:4], clearance])), steps

    def point(self, q: FloatArray, ahead: FloatArray) -> CurvePoint:
        """The point of the curve at `q`, its tangent on the side of `ahead`.

        Args:
            q: shape (7,), rad; as good as on the curve.
            ahead: shape (7,).
        """
        return self.points(self.kernel.measured(q, self._matrix), ahead[None])[0]

    def points(self, found: Corrected, ahead: FloatArray) -> CurvePoints:
        """Points of the curve, their tangents on the sides of `ahead`, shape (n, 7)."""
        sign = np.where((found.tangent * ahead).sum(axis=1) < 0.0, -1.0, 1.0)
        determinant, clearance = sign * found.determinant, self.clearance_rad(found.q)
        columns = found.q, sign[:, None] * found.tangent, determinant, found.residual, clearance
        return CurvePoints(np.column_stack(columns))

    def into_range(self, points: CurvePoints) -> CurvePoints:
        """The points less whole turns: as near to the middle of the ranges as they come.

        Those outside a limit by no more than `TOUCHING_RAD` are put on it.
        """
        rows = np.array(points.rows)
        rows[:, :7] = self.turned(points.q)
        rows[:, 16] = self.clearance_rad(rows[:, :7])
        for i in np.flatnonzero((rows[:, 16] < 0.0) & (rows[:, 16] >= -TOUCHING_RAD)):
            rows[i] = CurvePoints.of([self.touching(rows[i, :7], rows[i, 7:14])]).rows
        return CurvePoints(rows)

    def touching(self, q: FloatArray, ahead: FloatArray) -> CurvePoint:
        """As `point`, moved onto the limits where `q` is outside by rounding."""
        return self.point(np.clip(q, self.q_min, self.q_max), ahead)

    def turned(self, q: FloatArray) -> FloatArray:
        """Configurations less whole turns, shape (n, 7), rad, likewise."""
        return self._middle + whole_turns_off(q - self._middle)

    def clearance_rad(self, q: FloatArray) -> FloatArray:
        """How far the joint nearest to a limit is inside it; below zero outside.

        Args:
            q: shape (..., 7), rad.

        Returns:
            Shape (...,), rad.
        """
        clearance: FloatArray = np.minimum(q - self.q_min, self.q_max - q).min(axis=-1)
        return clearance

    def start(self, q: FloatArray, towards: FloatArray | None = None) -> CurvePoint | None:
        """The point of the curve at `q`, travelled in the direction every curve has.

        Where two branches cross, the branch whose direction is nearest to `towards`, shape (7,), on
        its side; without `towards`, the first branch, on the side on which the joint that moves
        most grows. The determinant is zero there.

        Returns:
            None when the point stands alone.
        """
        J, residual = self.arm.jacobian(q), float(np.linalg.norm(self.error(q)))
        U, sigma, Vt = np.linalg.svd(J)
        tangent, determinant = Vt[6], 0.0
        if sigma[5] > SINGULAR:
            determinant = float(np.linalg.det(np.vstack([J, tangent])))
            tangent = math.copysign(1.0, determinant) * tangent
        else:
            directions = self._branches(q, U[:, 5], Vt[5:])
            if not directions:
                return None
            tangent = _nearest_direction(directions, towards)
        clearance = float(self.clearance_rad(q))
        return CurvePoint(q, tangent, abs(determinant), residual, clearance)

    def way(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """The joint motion between two configurations, shape (7,), rad.

        Without limits whole turns of a joint do not count. Inside limits there are none.
        """
        if self.has_limits:
            return end - start
        return whole_turns_off(end - start)

    def _branches(self, q: FloatArray, left_null: FloatArray, null: FloatArray) -> list[FloatArray]:
        form = np.array([self._second_derivative(q, n) @ left_null @ null.T for n in null])
        (low, high), axes = np.linalg.eigh(0.5 * (form + form.T))
        if low > _FLAT or high < -_FLAT:
            return []
        a, b = math.sqrt(max(high, 0.0)), math.sqrt(max(-low, 0.0))
        scale = math.hypot(a, b)
        if scale == 0.0:
            return []
        ways = (a * axes[:, 0] + sign * b * axes[:, 1] for sign in (1.0, -1.0))
        return [way / scale @ null for way in ways]

    def _second_derivative(self, q: FloatArray, direction: FloatArray) -> FloatArray:
        """Transposed change of J along `direction`, shape (7, 6), per rad."""
        ahead = self.arm.jacobian(q + _DIFFERENCE_RAD * direction)
        behind = self.arm.jacobian(q - _DIFFERENCE_RAD * direction)
        change: FloatArray = (ahead - behind).T / (2.0 * _DIFFERENCE_RAD)
        return change


def _orthonormal(T: pin.SE3) -> pin.SE3:
    """The pose with the rotation nearest to its own, which may be off by rounded digits.

    The orthogonal factor of the polar decomposition (Higham, 1986).
    """
    U, _, Vt = np.linalg.svd(T.rotation)
    return pin.SE3(U @ Vt, T.translation)


def _nearest_direction(directions: list[FloatArray], towards: FloatArray | None) -> FloatArray:
    if towards is None:
        first = directions[0]
        return first if first[np.argmax(np.abs(first))] > 0.0 else -first
    best = max(directions, key=lambda direction: abs(float(direction @ towards)))
    return best if best @ towards >= 0.0 else -best
