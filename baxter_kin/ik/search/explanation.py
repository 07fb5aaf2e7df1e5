"""Reasons why a pose has no solution: proven out of reach, beyond joint limits, or not found."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin.display import millimetres_hint
from baxter_kin.frames import read_with_w_first
from baxter_kin.ik.reach.bound import ReachBound
from baxter_kin.ik.reach.linkage import FAR_M
from baxter_kin.ik.result import ORIENTATION_TOLERANCE_RAD, IKFailure
from baxter_kin.ik.search.searcher import Search
from baxter_kin.ik.seeds import NullSpaceMap, SeedType
from baxter_kin.ik.tolerance import EXACT, Tolerance
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray

AT_LIMIT_RAD = 1e-6

NEAR_ENOUGH_M = 1e-3
"""No thorough proof is tried for a pose to which the arm comes closer than this."""

STRAIGHT_DOWN_RAD = 0.1
"""A tool that leans by less counts as pointing straight down, as in most picks."""


@dataclass(frozen=True, slots=True, eq=False)
class BestAttempt:
    """The best attempt at a pose without a solution.

    Attributes:
        T: the pose as a matrix seen from base, shape (4, 4).
        q: the configuration, shape (7,), rad.
        position_error_m: distance of its tip from the pose.
        orientation_error_rad: angle between its tip and the pose.
        starts: number of searches by seed type; empty if the mode's seed was not given.
    """

    T: FloatArray
    q: FloatArray
    position_error_m: float
    orientation_error_rad: float
    starts: Mapping[SeedType, int]


class Explainer:
    """Finds reasons for one arm and tolerance.

    Attributes:
        reach: proofs that poses are out of reach.
    """

    def __init__(
        self, arm: Arm, search: Search, starts: NullSpaceMap, tolerance: Tolerance
    ) -> None:
        self._arm = arm
        self._search = search
        self._starts = starts
        self.reach = ReachBound(arm, tolerance)
        self._tolerance = tolerance
        self._tool_hint = _tool_hint(arm)
        self._unlimited = np.repeat([-np.pi, np.pi], 7)

    def errors_in_neutral(self, Ts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Errors of the neutral arm's tip for poses, shape (m, 4, 4): (m,), m, and (m,), rad."""
        T_neutral = self._arm.T_base_tip(self._arm.neutral)
        if self._tolerance != EXACT:
            rows = [self._tolerance.excess(_se3(T), T_neutral) for T in Ts]
            offsets, angles = np.reshape(rows, (-1, 2)).T
            return offsets, angles
        across = Ts[:, :3, 3] - T_neutral.translation
        cosines = 0.5 * (np.einsum("nij,ij->n", Ts[:, :3, :3], T_neutral.rotation) - 1.0)
        x, y, z = across.clip(-FAR_M, FAR_M).T
        return np.hypot(np.hypot(x, y), z), np.arccos(cosines.clip(-1.0, 1.0))

    def measured(self, T: FloatArray, q: FloatArray) -> BestAttempt:
        """A configuration as an attempt without searches, with its errors."""
        offset, angle = self._tolerance.excess(_se3(T), self._arm.T_base_tip(q))
        return BestAttempt(T, q, offset, angle, {})

    def why(self, attempt: BestAttempt, mode_name: str) -> IKFailure:
        """The reason why a pose has no solution."""
        x, y, z = attempt.T[:3, 3]
        what = "position" if self._tolerance.is_position_only else "pose at"
        pose = f"the {what} ({x:.3f}, {y:.3f}, {z:.3f}) m in base"
        proof = self.reach.proof(_se3(attempt.T))
        nearest_m = self._nearest_m(attempt)
        if proof is None and not attempt.starts:
            return IKFailure(
                f"seed mode {mode_name} was requested, but no {mode_name} seed was given"
            )
        if proof is None and nearest_m is not None and nearest_m > NEAR_ENOUGH_M:
            proof = self.reach.proof(_se3(attempt.T), is_thorough=True)
        if proof is None:
            return self._not_found(pose, attempt, nearest_m)
        reason = f"{pose} is proven out of reach: {proof.text}{self._hint(attempt.T)}"
        return IKFailure(reason, attempt.starts, beyond_reach_m=proof.excess_m, nearest_m=nearest_m)

    def _not_found(self, pose: str, attempt: BestAttempt, nearest_m: float | None) -> IKFailure:
        counts = ", ".join(f"{count} {type_.name}" for type_, count in attempt.starts.items())
        at_limit = self._joints_at_limit(attempt.q)
        limited = f", with {', '.join(at_limit)} at a limit" if at_limit else ""
        beyond = self._beyond_limits(attempt.T)
        only = f"; without joint limits, {'; '.join(beyond)} would reach it" if beyond else ""
        offset_mm, angle = 1e3 * attempt.position_error_m, attempt.orientation_error_rad
        ends = f"the best attempt ends {offset_mm:.3g} mm and {angle:.3g} rad away"
        if nearest_m is not None:
            ends = f"the nearest position found in this orientation is {offset_mm:.3g} mm away"
        return IKFailure(
            f"no solution found for {pose} in {sum(attempt.starts.values())} starts ({counts}); "
            f"{ends}{limited}{only}{self._hint(attempt.T)}",
            starts=attempt.starts,
            nearest_m=nearest_m,
            joints_at_limit=at_limit,
            limits_violated=beyond,
        )

    def _nearest_m(self, attempt: BestAttempt) -> float | None:
        """Distance from the pose of an attempt in its orientation; None in another orientation."""
        is_turned = attempt.orientation_error_rad > ORIENTATION_TOLERANCE_RAD
        is_exact = self._tolerance == EXACT and bool(attempt.starts)
        return attempt.position_error_m if is_exact and not is_turned else None

    def _hint(self, T: FloatArray) -> str:
        """A guess at what was meant, as the end of a sentence; empty without one."""
        return millimetres_hint(*T[:3, 3].tolist()) or self._tool_hint or self._order_hint(T)

    def _order_hint(self, T: FloatArray) -> str:
        """A hint for a quaternion with w first, of a tool that was to point straight down.

        With w first, the component of the tool's z axis along z is R[0, 0]: both are 1 minus twice
        the sum of the squares of the second and third number of the quaternion.
        """
        down = -math.cos(STRAIGHT_DOWN_RAD)
        if T[0, 0] > down or T[2, 2] <= down:
            return ""
        meant = T.copy()
        meant[:3, :3] = read_with_w_first(T[:3, :3])
        if self.reach.are_proven(meant[None])[0]:
            return ""
        return (
            "; did its quaternion come with w first? It is read as x, y, z, w; with w first the "
            "tool would point straight down"
        )

    def _joints_at_limit(self, q: FloatArray) -> tuple[str, ...]:
        limits = self._arm.limits
        near = np.minimum(q - limits.q_min, limits.q_max - q) <= AT_LIMIT_RAD
        return tuple(limits.names[i] for i in np.flatnonzero(near))

    def _beyond_limits(self, T: FloatArray) -> tuple[str, ...]:
        """A phrase for each joint limit that a solution without limits violates.

        Of a few such solutions, that with the smallest total excess is taken; empty without any.
        """
        Ts = T[None]
        starts = self._starts.setpoints[self._starts.nearest(Ts)[0]]
        found = self._search.search(starts, np.tile(Ts, (len(starts), 1, 1)), self._unlimited)
        limits = self._arm.limits
        solutions = found.q[found.is_valid]
        excess = np.maximum(limits.q_min - solutions, solutions - limits.q_max).clip(min=0.0)
        if not len(solutions):
            return ()
        return limits.violations(solutions[excess.sum(axis=1).argmin()])


def _tool_hint(arm: Arm) -> str:
    tool_m = arm.T_gripper_tip.translation
    hint = millimetres_hint(*tool_m.tolist())
    return f"; the tool is {np.linalg.norm(tool_m):.6g} m long{hint}" if hint else ""


def _se3(T: FloatArray) -> pin.SE3:
    return pin.SE3(T[:3, :3], T[:3, 3])
