"""The configurations of an arm that reach one pose: its fibre under forward kinematics.

For seven joints the fibre is a curve wherever the Jacobian J (6 x 7) has full rank; its unit
tangent spans the null space of J. The cofactors of J are a null vector that is continuous in q,
which gives every curve one direction: the one in which `det [J; tangent']` is positive.

Where the rank drops to five, the null space is a plane and the fibre is no curve: two branches
cross, or the point stands alone. Second derivatives decide (Allgower and Georg, "Numerical
Continuation Methods", 1990, ch. 8): with w the left null vector of J and N a basis of the plane,
the branches leave along those N a for which the quadratic form `w' (dJ along N a) N a` vanishes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from baxter_kin.arrays import Vector
from baxter_kin.model import Arm

RESIDUAL_TOLERANCE = 1e-12
"""Of a corrected configuration: norm of the pose error, in m and rad together. Rounding leaves
1e-15; one Newton step from a predicted point leaves about this."""

SINGULAR = 1e-6
"""Smallest singular value of J, in m and rad, at which its rank counts as five.

It grows in proportion to the distance from the singularity, by 0.001 to 1 per rad. Two branches
that pass so closely reach poses that differ by about `RESIDUAL_TOLERANCE` to a thousand times as
much: they cannot be told apart safely."""

_SUSPECT_DETERMINANT = 1e-3
"""Manipulability above which J is surely regular: the product of the other five singular values, in
m and rad, was at most 1.2 at 20,000 random configurations of Baxter's arm."""

_NEWTON_ITERATIONS = 6
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
        clearance_rad: from the joint nearest to a limit to that limit; below zero outside.
    """

    q: Vector
    tangent: Vector
    determinant: float
    residual: float
    clearance_rad: float

    def reversed(self) -> CurvePoint:
        """The same point, travelled the other way."""
        return replace(self, tangent=-self.tangent, determinant=-self.determinant)


class PoseFibre:
    """All configurations of an arm that reach one pose.

    One thread at a time: it reuses its memory.

    Attributes:
        arm: whose joints reach it.
        T_base_tip: the pose of the tip, seen from base.
        q_min: where curves end, shape (7,), rad: the arm's lower limits, or minus infinity.
        q_max: the same above.
    """

    def __init__(self, arm: Arm, T_base_tip: pin.SE3, *, has_limits: bool = True) -> None:
        """State the pose, and whether curves end on the arm's joint limits."""
        self.arm = arm
        self._has_limits = has_limits
        unlimited = np.full(7, np.inf)
        self.q_min = arm.limits.q_min if has_limits else -unlimited
        self.q_max = arm.limits.q_max if has_limits else unlimited
        self.T_base_tip = _orthonormal(T_base_tip)
        self._base_from_tip = np.zeros((6, 6))
        self._base_from_tip[:3, :3] = self._base_from_tip[3:, 3:] = self.T_base_tip.rotation
        self._system = np.empty((7, 7))
        self._last_axis = np.eye(7)[6]

    def error(self, q: Vector) -> Vector:
        """The twist from the pose of `q` to the target, shape (6,), m and rad, linear first.

        Along the axes of base up to the square of the error; of the right size whatever it is.
        """
        twist = pin.log6(self.arm.T_base_tip(q).actInv(self.T_base_tip)).vector
        error: Vector = self._base_from_tip @ twist
        return error

    def corrected(
        self, q: Vector, normal: Vector, tolerance: float = RESIDUAL_TOLERANCE
    ) -> tuple[Vector, float] | None:
        """The configuration of the fibre in a hyperplane through `q`, and its residual.

        Newton's method on `[J; normal'] dq = [error; 0]`.

        Args:
            q: a configuration near the fibre, shape (7,), rad.
            normal: of the hyperplane, shape (7,).
            tolerance: the residual to reach, m and rad together.

        Returns:
            None when it does not converge nearby.
        """
        wanted = np.zeros(7)
        for _ in range(_NEWTON_ITERATIONS):
            wanted[:6] = self.error(q)
            residual = math.sqrt(wanted @ wanted)
            if residual <= tolerance:
                return q, residual
            step = self._solved(q, normal, wanted)
            if step is None or step @ step > 1.0:
                return None
            q = q + step
        return None

    def point(self, q: Vector, residual: float, ahead: Vector) -> CurvePoint | None:
        """The point of the curve at `q`, its tangent on the side of `ahead`, shape (7,).

        Returns:
            None when `[J; ahead']` is singular.
        """
        tangent = self._solved(q, ahead, self._last_axis)
        if tangent is None:
            return None
        length = math.sqrt(tangent @ tangent)
        determinant = float(np.linalg.det(self._system)) * length
        return CurvePoint(q, tangent / length, determinant, residual, self.clearance_rad(q))

    def clearance_rad(self, q: Vector) -> float:
        """How far the joint nearest to a limit is inside it; below zero outside."""
        return float(np.minimum(q - self.q_min, self.q_max - q).min())

    def start(self, q: Vector, towards: Vector | None = None) -> CurvePoint | None:
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
        return CurvePoint(q, tangent, abs(determinant), residual, self.clearance_rad(q))

    def way(self, start: Vector, end: Vector) -> Vector:
        """The joint motion between two configurations, shape (7,), rad.

        Without limits whole turns of a joint do not count. Inside limits there are none.
        """
        if self._has_limits:
            return end - start
        return whole_turns_off(end - start)

    def is_singular(self, point: CurvePoint) -> bool:
        """Whether the rank of J counts as five there."""
        if abs(point.determinant) > _SUSPECT_DETERMINANT:
            return False
        sigma = np.linalg.svd(self.arm.jacobian(point.q), compute_uv=False)
        return bool(sigma[5] <= SINGULAR)

    def _branches(self, q: Vector, left_null: Vector, null: Vector) -> list[Vector]:
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

    def _second_derivative(self, q: Vector, direction: Vector) -> Vector:
        """Transposed change of J along `direction`, shape (7, 6), per rad."""
        ahead = self.arm.jacobian(q + _DIFFERENCE_RAD * direction)
        behind = self.arm.jacobian(q - _DIFFERENCE_RAD * direction)
        change: Vector = (ahead - behind).T / (2.0 * _DIFFERENCE_RAD)
        return change

    def _solved(self, q: Vector, last_row: Vector, wanted: Vector) -> Vector | None:
        self._system[:6] = self.arm.jacobian(q)
        self._system[6] = last_row
        try:
            return np.asarray(np.linalg.solve(self._system, wanted), dtype=np.float64)
        except np.linalg.LinAlgError:
            return None


def whole_turns_off(angles: Vector) -> Vector:
    """The same angles but for whole turns, in [-pi, pi]."""
    turns = np.round(angles / (2.0 * math.pi))
    return angles - 2.0 * math.pi * turns


def _orthonormal(T: pin.SE3) -> pin.SE3:
    """The pose with the rotation nearest to its own, which may be off by rounded digits.

    The orthogonal factor of the polar decomposition (Higham, 1986).
    """
    U, _, Vt = np.linalg.svd(T.rotation)
    return pin.SE3(U @ Vt, T.translation)


def _nearest_direction(directions: list[Vector], towards: Vector | None) -> Vector:
    if towards is None:
        first = directions[0]
        return first if first[np.argmax(np.abs(first))] > 0.0 else -first
    best = max(directions, key=lambda direction: abs(float(direction @ towards)))
    return best if best @ towards >= 0.0 else -best
