"""The IK service: requests in, results out, with the semantics of the service it replaces.

One request is a pose, an optional seed of the user's, the arm's current joint angles if known, and
a seed mode. Every solution is checked by Pinocchio, which is not what found it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.arrays import Vector
from baxter_kin.errors import RequestError
from baxter_kin.frames import PoseLike, angle_between, checked_pose
from baxter_kin.ik.program import IpoptSolver, Solver
from baxter_kin.ik.reach import ReachBound
from baxter_kin.ik.result import IKFailure, IKResult, reaches_pose
from baxter_kin.ik.seeds import NullSpaceMap, SeedMode, SeedType, Start, starts_around
from baxter_kin.model import Arm

SEED_TOLERANCE_RAD = 0.02
"""Seeds this far outside the limits are clamped: arms at rest report a little more than their
limits. Farther out they are refused."""

AT_LIMIT_RAD = 1e-6

SeedLike = Mapping[str, float] | ArrayLike
"""A configuration by joint name or in joint order, rad."""


@dataclass(frozen=True, slots=True, eq=False)
class _Request:
    T_base_tip: pin.SE3
    seeds: Mapping[SeedType, Vector]
    mode: SeedMode


@dataclass(frozen=True, slots=True, eq=False)
class _Attempt:
    seed_type: SeedType
    q: Vector
    position_error_m: float
    orientation_error_rad: float

    @property
    def residual(self) -> float:
        return self.position_error_m + self.orientation_error_rad


class IKService:
    """Inverse kinematics for one arm.

    The same request always gets the same answer.
    """

    def __init__(self, arm: Arm, solver: Solver | None = None) -> None:
        """Prepare the solver.

        Args:
            arm: whose tip to place.
            solver: another one than IPOPT on the nonlinear program.
        """
        self.arm = arm
        self._solver = solver or IpoptSolver(arm)
        self._null_space_map = NullSpaceMap(arm)
        self._reach = ReachBound(arm)

    def solve(
        self,
        T_base_tip: PoseLike,
        seed: SeedLike | None = None,
        current: SeedLike | None = None,
        mode: SeedMode = SeedMode.AUTO,
    ) -> IKResult:
        """Joint angles that place the tip at a pose.

        Args:
            T_base_tip: the pose as SE3 or 4 x 4 matrix seen from base, or a `StampedPose`.
            seed: the user's seed, by joint name or shape (7,), rad.
            current: the arm's present joint angles, in the same forms.
            mode: which seeds to try.

        Returns:
            A result; when no solution was found, one that says why. A mode whose seed was not given
            also yields such a result.

        Raises:
            PoseError: when the pose is none.
            ConfigurationError: when a seed has another shape, is not finite, or lies outside the
                limits by more than `SEED_TOLERANCE_RAD`.
            UnknownNameError: when a seed names a joint of another arm, or the mode is none.
        """
        return self._answer(self._request(T_base_tip, seed, current, mode, "seed"))

    def solve_batch(
        self,
        T_base_tips: Sequence[PoseLike],
        seeds: Sequence[SeedLike | None] | None = None,
        current: SeedLike | None = None,
        mode: SeedMode = SeedMode.AUTO,
    ) -> list[IKResult]:
        """One result per pose, each answered on its own; no poses, no results.

        Args:
            T_base_tips: poses, as for `solve`.
            seeds: one per pose, each a seed or None; or None for no seeds at all.
            current: the arm's present joint angles, for all poses.
            mode: which seeds to try.

        Raises:
            RequestError: when poses or seeds are not sequences, or differ in number.
            BaxterError: as `solve`, with the index of the pose or seed. Nothing is solved then.
        """
        poses = _as_list(T_base_tips, "poses")
        given: list[Any] = [None] * len(poses) if seeds is None else _as_list(seeds, "seeds")
        if len(given) != len(poses):
            raise RequestError(
                f"{len(poses)} poses came with {len(given)} seeds; give one seed per pose (None "
                "where a pose has none), or no seeds at all"
            )
        requests = [
            self._request(pose, seed, current, mode, f"seeds[{i}]")
            for i, (pose, seed) in enumerate(zip(poses, given, strict=True))
        ]
        return [self._answer(request) for request in requests]

    def _request(
        self,
        pose: PoseLike,
        seed: SeedLike | None,
        current: SeedLike | None,
        mode: SeedMode,
        seed_name: str,
    ) -> _Request:
        seeds = {}
        if seed is not None:
            seeds[SeedType.USER] = self._checked_seed(seed, seed_name)
        if current is not None:
            seeds[SeedType.CURRENT] = self._checked_seed(current, "current")
        return _Request(checked_pose(pose), seeds, SeedMode.of(mode))

    def _checked_seed(self, seed: SeedLike, what: str) -> Vector:
        q = self.arm.configuration(seed, what)
        return self.arm.limits.check(q, what, SEED_TOLERANCE_RAD)

    def _answer(self, request: _Request) -> IKResult:
        T = request.T_base_tip
        attempts = []
        if self._reach.excess_m(T) == 0.0:
            for start in self._starts(request):
                attempt = self._attempt(T, start)
                if reaches_pose(attempt.position_error_m, attempt.orientation_error_rad):
                    return self._result(attempt, None)
                attempts.append(attempt)
        return self._failed(request, attempts)

    def _starts(self, request: _Request) -> Iterator[Start]:
        seed_types = [SeedType.USER, SeedType.CURRENT, SeedType.NS_MAP]
        if request.mode is not SeedMode.AUTO:
            seed_types = [SeedType(request.mode)]
        return chain.from_iterable(self._starts_of(request, seed_type) for seed_type in seed_types)

    def _starts_of(self, request: _Request, seed_type: SeedType) -> Iterator[Start]:
        if seed_type is SeedType.NS_MAP:
            return self._null_space_map.starts(request.T_base_tip)
        if seed_type not in request.seeds:
            return iter(())
        return starts_around(self.arm, seed_type, request.seeds[seed_type])

    def _attempt(self, T_base_tip: pin.SE3, start: Start) -> _Attempt:
        return self._measured(T_base_tip, start.seed_type, self._solver.attempt(T_base_tip, start))

    def _measured(self, T_base_tip: pin.SE3, seed_type: SeedType, q: Vector) -> _Attempt:
        reached = self.arm.T_base_tip(q)
        offset = reached.translation - T_base_tip.translation
        angle = angle_between(T_base_tip.rotation, reached.rotation)
        return _Attempt(seed_type, q, float(np.linalg.norm(offset)), angle)

    def _failed(self, request: _Request, attempts: list[_Attempt]) -> IKResult:
        if attempts:
            best = min(attempts, key=lambda attempt: attempt.residual)
        else:
            q = next(iter(request.seeds.values()), self.arm.neutral)
            best = self._measured(request.T_base_tip, SeedType.INVALID, q)
        return self._result(best, self._why(request, attempts, best))

    def _why(self, request: _Request, attempts: list[_Attempt], best: _Attempt) -> IKFailure:
        excess_m = self._reach.excess_m(request.T_base_tip)
        x, y, z = request.T_base_tip.translation
        pose = f"the pose at ({x:.3f}, {y:.3f}, {z:.3f}) m in base"
        if excess_m > 0.0:
            return IKFailure(
                f"{pose} is out of reach: {1e3 * excess_m:.0f} mm beyond the "
                f"{self._reach.radius_m:.3f} m that the {self.arm.side} arm spans from "
                f"{self._reach.joint_name}",
                beyond_reach_m=excess_m,
            )
        if not attempts:
            name = request.mode.name
            return IKFailure(f"seed mode {name} was asked for, but no {name} seed was given")
        return self._not_found(pose, attempts, best)

    def _not_found(self, pose: str, attempts: list[_Attempt], best: _Attempt) -> IKFailure:
        starts = Counter(attempt.seed_type for attempt in attempts)
        counts = ", ".join(f"{count} {seed_type.name}" for seed_type, count in starts.items())
        at_limit = self._joints_at_limit(best.q)
        limited = f", with {', '.join(at_limit)} at a limit" if at_limit else ""
        return IKFailure(
            f"no solution found for {pose} in {len(attempts)} starts ({counts}); the best attempt "
            f"ends {1e3 * best.position_error_m:.3g} mm and {best.orientation_error_rad:.3g} rad "
            f"away{limited}",
            starts=starts,
            joints_at_limit=at_limit,
        )

    def _joints_at_limit(self, q: Vector) -> tuple[str, ...]:
        limits = self.arm.limits
        near = np.minimum(q - limits.q_min, limits.q_max - q) <= AT_LIMIT_RAD
        return tuple(limits.names[i] for i in np.flatnonzero(near))

    def _result(self, attempt: _Attempt, failure: IKFailure | None) -> IKResult:
        return IKResult(
            joint_names=self.arm.joint_names,
            q=attempt.q,
            seed_type=SeedType.INVALID if failure else attempt.seed_type,
            position_error_m=attempt.position_error_m,
            orientation_error_rad=attempt.orientation_error_rad,
            failure=failure,
        )


def _as_list(values: Iterable[Any], what: str) -> list[Any]:
    if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
        raise RequestError(f"{what} must be a sequence, got {type(values).__name__}")
    return list(values)
