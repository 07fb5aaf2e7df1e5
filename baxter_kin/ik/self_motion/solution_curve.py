"""The configurations of an arm that reach one pose: the solution set of IK.

For seven joints the solution set is a curve wherever the Jacobian J (6 x 7) has full rank; its unit
tangent spans the null space of J. The cofactors of J are a null vector that is continuous in q,
which defines one direction of every curve: the one in which `det [J; tangent']` is positive.

Where the rank drops to five, the null space is a plane and the set is not a curve: two branches
cross, or the point is isolated. Second derivatives decide (Allgower and Georg, "Numerical
Continuation Methods", 1990, ch. 8): with w the left null vector of J and N a basis of the plane,
the branches leave along those N a for which the quadratic form `w' (dJ along N a) N a` vanishes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin.errors import ConfigurationError
from baxter_kin.ik.self_motion.curve_kernel import (
    RESIDUAL_TOLERANCE,
    SINGULAR,
    Corrected,
    CurveKernel,
    Steps,
)
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray

TOUCHING_RAD = 1e-11
"""Excess of a joint over its limits that is attributed to rounding: of the pose, of limits, of
points on several limits at once."""

POSE_MISMATCH = 1e-5
"""Allowed error, in m and rad together, of a configuration that is given for a pose: ten times the
tolerance of the IK service."""

_CORRECTIONS, _MAX_CORRECTION_RAD = 2, 1.0
"""Number of calls of three Newton steps each, and the maximum distance of the result."""

_REPEATS = 2
"""Number of additional calls for configurations far from the curve, such as those of the closed
form for a calibrated arm."""

_DIFFERENCE_RAD = 1e-4
"""Step of the central difference of J: its error, the square, is far below `_FLAT`."""

_FLAT = 1e-6
"""Curvature, 1/rad, below which the quadratic form counts as zero."""


@dataclass(frozen=True, slots=True, eq=False)
class CurvePoint:
    """One point of the curve.

    Attributes:
        q: configuration, shape (7,), rad.
        tangent: unit direction of travel, shape (7,).
        determinant: of `[J; tangent']`; its size is Yoshikawa's manipulability.
        residual: norm of the pose error, m and rad together.
        clearance_rad: distance of the joint nearest to a limit from that limit; negative outside.
    """

    q: FloatArray
    tangent: FloatArray
    determinant: float
    residual: float
    clearance_rad: float

    @property
    def measures(self) -> tuple[float, float, float]:
        """Determinant, residual and clearance."""
        return self.determinant, self.residual, self.clearance_rad

    def reversed(self) -> CurvePoint:
        """The same point with the opposite direction of travel."""
        return replace(self, tangent=-self.tangent, determinant=-self.determinant)


@dataclass(frozen=True, slots=True, eq=False)
class CurvePoints:
    """n points of the curve in order, in one array that is quickly cut and joined.

    Attributes:
        rows: q, tangent, determinant, residual and clearance of each, as of `CurvePoint`; shape
            (n, 17).
    """

    rows: FloatArray

    @classmethod
    def of(cls, points: Iterable[CurvePoint]) -> CurvePoints:
        """The points as one array."""
        rows = [np.concatenate([p.q, p.tangent, p.measures]) for p in points]
        return cls(np.reshape(rows, (-1, 17)))

    @property
    def q(self) -> FloatArray:
        """Configurations, shape (n, 7), rad."""
        return self.rows[:, :7]

    @property
    def tangent(self) -> FloatArray:
        """Unit directions of travel, shape (n, 7)."""
        return self.rows[:, 7:14]

    @property
    def determinant(self) -> FloatArray:
        """Determinants of `[J; tangent']`, shape (n,)."""
        return self.rows[:, 14]

    @property
    def residual(self) -> FloatArray:
        """Norms of the pose error, shape (n,), m and rad together."""
        return self.rows[:, 15]

    @property
    def clearance_rad(self) -> FloatArray:
        """Distances of the joint nearest to a limit from it, shape (n,); negative outside."""
        return self.rows[:, 16]

    @property
    def chords_rad(self) -> FloatArray:
        """Distances between neighbours, up to whole turns of joints, shape (n - 1,), rad."""
        squares = np.square(whole_turns_off(np.diff(self.q, axis=0))).sum(axis=1)
        return np.asarray(np.sqrt(squares))

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, i: int) -> CurvePoint:
        row = self.rows[i]
        return CurvePoint(row[:7], row[7:14], *row[14:].tolist())

    def part(self, index: slice | NDArray[np.generic]) -> CurvePoints:
        """Some of the points."""
        return CurvePoints(self.rows[index])

    def reversed(self) -> CurvePoints:
        """The same points in the opposite direction of travel."""
        rows = np.array(self.rows[::-1])
        rows[:, 7:15] *= -1.0
        return CurvePoints(rows)

    def then(self, *others: CurvePoints) -> CurvePoints:
        """These points, followed by others."""
        return CurvePoints(np.concatenate([self.rows, *(other.rows for other in others)]))


def whole_turns_off(angles: FloatArray) -> FloatArray:
    """The same angles up to whole turns, in [-pi, pi]."""
    turns = np.round(angles / (2.0 * math.pi))
    return angles - 2.0 * math.pi * turns


class SolutionCurve:
    """All configurations of an arm that reach one pose.

    Attributes:
        arm: the arm.
        T_base_tip: the pose of the tip, seen from base.
        kernel: computes along the curves.
        has_limits: whether curves end on joint limits.
        q_min: lower limits at which curves end, shape (7,), rad; minus infinity without limits.
        q_max: upper limits, likewise.
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
        """The solution set of the same pose with the limits ignored."""
        return SolutionCurve(self.arm, self.T_base_tip, has_limits=False)

    def limited_by(self, joints: Iterable[int]) -> SolutionCurve:
        """The same pose with the limits of some joints alone, to cut existing curves."""
        limited = SolutionCurve(self.arm, self.T_base_tip)
        is_limited = np.isin(np.arange(7), list(joints))
        limited.q_min = np.where(is_limited, self.q_min, -np.inf)
        limited.q_max = np.where(is_limited, self.q_max, np.inf)
        return limited

    def error(self, q: FloatArray) -> FloatArray:
        """The twist from the pose of `q` to the target, shape (6,), m and rad, linear first.

        It is along the axes of base up to the square of the error; its norm is exact.
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
            None if it does not converge nearby.
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
        """The configuration next to `q` that reaches the pose inside the limits, or an error."""
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
        """The same for configurations, shape (n, 7), with residuals of any size."""
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
            q: shape (7,), rad; on the curve up to rounding.
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
        """The points as near to the middle of the joint ranges as whole turns allow.

        Those outside a limit by at most `TOUCHING_RAD` are moved onto it.
        """
        rows = np.array(points.rows)
        rows[:, :7] = self.turned(points.q)
        rows[:, 16] = self.clearance_rad(rows[:, :7])
        for i in np.flatnonzero((rows[:, 16] < 0.0) & (rows[:, 16] >= -TOUCHING_RAD)):
            rows[i] = CurvePoints.of([self.touching(rows[i, :7], rows[i, 7:14])]).rows
        return CurvePoints(rows)

    def touching(self, q: FloatArray, ahead: FloatArray) -> CurvePoint:
        """As `point`, moved onto the limits if `q` is outside by rounding."""
        return self.point(np.clip(q, self.q_min, self.q_max), ahead)

    def turned(self, q: FloatArray) -> FloatArray:
        """Configurations as near to the middle of the ranges, shape (n, 7), rad."""
        return self._middle + whole_turns_off(q - self._middle)

    def clearance_rad(self, q: FloatArray) -> FloatArray:
        """Distance of the joint nearest to a limit from that limit; negative outside.

        Args:
            q: shape (..., 7), rad.

        Returns:
            Shape (...,), rad.
        """
        clearance: FloatArray = np.minimum(q - self.q_min, self.q_max - q).min(axis=-1)
        return clearance

    def start(self, q: FloatArray, towards: FloatArray | None = None) -> CurvePoint | None:
        """The point of the curve at `q`, in the direction that every curve has.

        If two branches cross there, it is on the branch whose direction is nearest to `towards`,
        shape (7,), and on its side; without `towards`, on the first branch, in the direction in
        which the fastest joint increases. The determinant is zero there.

        Returns:
            None if the point is isolated.
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

        Without limits, whole turns of a joint are ignored. Inside limits there are none.
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
    """The pose with the nearest orthonormal rotation, since digits may have been rounded.

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
