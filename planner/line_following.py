"""LineFollower: one configuration after another along a straight line of the tip.

Of all joint velocities that move the tip along the line, those of least norm are taken,
`dq/ds = J'(J J')^-1 twist` (Whitney, "Resolved motion rate control", 1969), in Runge-Kutta steps of
fourth order; after each, Newton's method puts the tip back on the line.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from baxter_kin import Arm, JointLimits
from baxter_kin.arrays import Vector
from planner.straight_line import StraightLine
from planner.timing import POSITION_TOLERANCE_RAD

LEAST_SINGULAR_VALUE = 1e-3
"""Smallest singular value of J, in m and rad, that counts as regular: the joints then move up to a
thousand times as fast as the tip. It is 0.05 to 0.3 in ordinary poses of Baxter's arm."""

STEP_RAD = 0.05
"""Longest step in joint space: the error of a Runge-Kutta step is its fifth power, 3e-7, over some
hundred."""

RESIDUAL_TOLERANCE = 1e-12
"""How far a corrected tip may be off the line, in m and rad together; rounding leaves 1e-15."""

_NEWTON_ITERATIONS = 6
_LONGEST_CORRECTION_RAD = 0.1 * STEP_RAD
_SEARCH_STEP = 1.0 / 128.0
_LEAST_SEARCH_STEP = 1e-7


class LineEnd(NamedTuple):
    """Where following a line stopped, and why."""

    fraction: float
    reason: str


class LineFollower:
    """Follows one line with one arm."""

    def __init__(self, arm: Arm, line: StraightLine) -> None:
        """Say whose tip goes where."""
        self._arm = arm
        self._line = line

    def through(self, q_start: Vector, fractions: Vector) -> Vector | None:
        """The configurations at fractions of the way, the first of them where `q_start` is.

        Args:
            q_start: shape (7,), rad; its tip is at the first fraction.
            fractions: shape (m,), increasing.

        Returns:
            Shape (m, 7), rad; None when the arm cannot follow.
        """
        found = [q_start]
        for s, end in pairwise(fractions.tolist()):
            q = self.advanced(found[-1], s, end)
            if q is None:
                return None
            found.append(q)
        return np.array(found)

    def advanced(self, q: Vector, s: float, end: float) -> Vector | None:
        """The configuration at the fraction `end`, from `q` at `s`; None when there is no way."""
        try:
            steps = 1 + int((end - s) * np.linalg.norm(self._rate(q)) / STEP_RAD)
            ds = (end - s) / steps
            for i in range(steps):
                ahead = self._corrected(self._runge_kutta(q, ds), s + (i + 1) * ds)
                if ahead is None or np.linalg.norm(ahead - q) > 3.0 * STEP_RAD:
                    return None
                q = ahead
        except np.linalg.LinAlgError:
            return None
        return q if self.least_singular_value(q) >= LEAST_SINGULAR_VALUE else None

    def least_singular_value(self, q: Vector) -> float:
        """Of the Jacobian at `q`, in m and rad."""
        return float(np.linalg.svd(self._arm.jacobian(q), compute_uv=False)[-1])

    def nearest_to_singular(self, q_start: Vector) -> LineEnd:
        """Where on a line that can be followed the arm is closest to a singularity."""
        fractions = np.arange(0.0, 1.0 + _SEARCH_STEP, _SEARCH_STEP)
        q = self.through(q_start, fractions)
        values = [0.0] if q is None else [self.least_singular_value(x) for x in q]
        i = int(np.argmin(values))
        return LineEnd(
            float(fractions[i]),
            "the arm passes a singularity so closely that its joints turn too sharply: the "
            f"smallest singular value of its Jacobian falls to {values[i]:.2g}",
        )

    def end(self, q_start: Vector, limits: JointLimits) -> LineEnd | None:
        """Where the way from `q_start` at 0 leaves the position limits or ends; None: nowhere."""
        s, q, ds = 0.0, q_start, _SEARCH_STEP
        while s < 1.0:
            ahead = self.advanced(q, s, min(s + ds, 1.0))
            if ahead is not None and not limits.violations(ahead, POSITION_TOLERANCE_RAD):
                s, q = min(s + ds, 1.0), ahead
            elif ds > _LEAST_SEARCH_STEP:
                ds /= 2.0
            elif ahead is not None:
                return LineEnd(s, limit_reached(ahead, limits))
            else:
                return LineEnd(s, self._singularity(q))
        return None

    def _singularity(self, q: Vector) -> str:
        return (
            "the arm is at a singularity, where no configuration leads on: the smallest singular "
            f"value of its Jacobian is {self.least_singular_value(q):.2g}; "
            f"{LEAST_SINGULAR_VALUE:g} is the least allowed"
        )

    def _rate(self, q: Vector) -> Vector:
        return _least_norm(self._arm.jacobian(q), self._line.twist)

    def _runge_kutta(self, q: Vector, ds: float) -> Vector:
        k1 = self._rate(q)
        k2 = self._rate(q + 0.5 * ds * k1)
        k3 = self._rate(q + 0.5 * ds * k2)
        k4 = self._rate(q + ds * k3)
        return q + ds / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)

    def _corrected(self, q: Vector, s: float) -> Vector | None:
        predicted = q
        for _ in range(_NEWTON_ITERATIONS):
            error = self._line.error(s, self._arm.T_base_tip(q))
            if np.linalg.norm(error) <= RESIDUAL_TOLERANCE:
                return q
            q = q + _least_norm(self._arm.jacobian(q), error)
            if np.linalg.norm(q - predicted) > _LONGEST_CORRECTION_RAD:
                return None
        return None


def limit_reached(q: Vector, limits: JointLimits) -> str:
    """Which joint is beyond which limit at `q`, as a reason to go no further."""
    i = int(np.argmax(np.maximum(limits.q_min - q, q - limits.q_max)))
    which, bound = ("lower", limits.q_min[i])
    if q[i] > limits.q_max[i]:
        which, bound = ("upper", limits.q_max[i])
    return (
        f"{limits.names[i]} runs into its {which} limit of {bound:.6g} rad; start from another "
        "configuration of the arm"
    )


def _least_norm(J: Vector, twist: Vector) -> Vector:
    step: Vector = J.T @ np.linalg.solve(J @ J.T, twist)
    return step
