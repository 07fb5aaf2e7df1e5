"""The IK service: requests in, results out, with the semantics of the service it replaces.

One request is a pose, an optional seed of the user's, the arm's current joint angles if known, and
a seed mode. A request that one search from its only seed answers takes a short cut; all others go
through `baxter_kin.ik.batch`, alone or many together.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.arrays import Vector, float_array
from baxter_kin.errors import ConfigurationError, RequestError, expect
from baxter_kin.frames import PoseLike, checked_pose, pose_matrices
from baxter_kin.ik.batch import COARSE_ROUNDS, Batch
from baxter_kin.ik.explanation import Explainer
from baxter_kin.ik.kernel import SEED_TOLERANCE_RAD
from baxter_kin.ik.objectives import Objective, best_on
from baxter_kin.ik.program import IpoptSearcher
from baxter_kin.ik.result import IKResult
from baxter_kin.ik.search import Backend, Search, Searcher
from baxter_kin.ik.seeds import NullSpaceMap, SeedMode, SeedType
from baxter_kin.ik.self_motion import trace_self_motion
from baxter_kin.model import Arm

SeedLike: TypeAlias = "Mapping[str, float] | ArrayLike"
"""A configuration by joint name or in joint order, rad."""

OBJECTIVE_STEP_RAD = 0.1
"""Steps along a self-motion curve when only its best point is wanted, which is found exactly."""

BLOCK = 4096
"""How many poses of a large batch are worked on together."""


class IKService:
    """Inverse kinematics for one arm.

    The same request always gets the same answer from the same backend.

    Attributes:
        arm: whose tip is placed.
        backend: where its searches run.
    """

    def __init__(self, arm: Arm, backend: str | Backend = Backend.AUTO) -> None:
        """Prepare the searches; with `AUTO` and a C compiler, the first time takes half a second.

        Raises:
            UnknownNameError: when there is no such backend.
        """
        wanted = Backend.of(backend)
        self.arm = expect(arm, Arm, "arm", RequestError)
        self._quick = None if wanted is Backend.IPOPT else Searcher.of(arm, wanted)
        self._search: Search = self._quick or IpoptSearcher(arm)
        self.backend = self._search.backend
        self._null_space_map = NullSpaceMap(arm)
        self._explainer = Explainer(arm, self._search, self._null_space_map)

    def solve(
        self,
        T_base_tip: PoseLike,
        seed: SeedLike | None = None,
        current: SeedLike | None = None,
        mode: SeedMode = SeedMode.AUTO,
        *,
        objective: Objective | None = None,
    ) -> IKResult:
        """Joint angles that place the tip at a pose.

        Args:
            T_base_tip: the pose as SE3 or 4 x 4 matrix seen from base, or a `StampedPose`.
            seed: the user's seed, by joint name or shape (7,), rad.
            current: the arm's present joint angles, in the same forms.
            mode: which seeds to try.
            objective: what to make of the freedom that a seventh joint leaves: the solution is then
                the best on the whole self-motion curve through the one that was found. Takes some
                milliseconds. Without one, it is the first that was found, near its start.

        Returns:
            A result; when no solution was found, one that says why. A mode whose seed was not given
            also yields such a result.

        Raises:
            PoseError: when the pose is none.
            ConfigurationError: when a seed has another shape, is not finite, or lies outside the
                limits by more than `SEED_TOLERANCE_RAD`.
            UnknownNameError: when a seed names a joint of another arm, or the mode is none.
        """
        result = self._first(T_base_tip, seed, current, mode)
        if objective is None or not result.is_valid:
            return result
        return self._best(result, checked_pose(T_base_tip), objective)

    def _first(
        self,
        T_base_tip: PoseLike,
        seed: SeedLike | None,
        current: SeedLike | None,
        mode: SeedMode,
    ) -> IKResult:
        """The first solution that is found, or why there is none."""
        if mode is SeedMode.AUTO and self._quick is not None and isinstance(T_base_tip, pin.SE3):
            result = None
            if current is None and seed is None:
                result = self._from_map(self._quick, checked_pose(T_base_tip))
            elif current is None and isinstance(seed, np.ndarray):
                result = self._short_cut(self._quick, T_base_tip, seed, SeedType.USER)
            elif seed is None and isinstance(current, np.ndarray):
                result = self._short_cut(self._quick, T_base_tip, current, SeedType.CURRENT)
            if result is not None:
                return result
        return self._answers([T_base_tip], None if seed is None else [seed], current, mode)[0]

    def solve_batch(
        self,
        T_base_tips: Sequence[PoseLike],
        seeds: Sequence[SeedLike | None] | None = None,
        current: SeedLike | None = None,
        mode: SeedMode = SeedMode.AUTO,
        *,
        chain: bool = False,
    ) -> list[IKResult]:
        """One result per pose, in order; no poses, no results.

        Args:
            T_base_tips: poses, as for `solve`.
            seeds: one per pose, each a seed or None; or None for no seeds at all.
            current: the arm's present joint angles, for all poses.
            mode: which seeds to try.
            chain: whether each solution is the current joint angles of the next pose. Otherwise
                every pose is answered on its own, and large batches use all cores.

        Raises:
            RequestError: when poses or seeds are not sequences, or differ in number.
            BaxterError: as `solve`, with the index of the pose or seed.
        """
        poses = _as_list(T_base_tips, "poses")
        given = None if seeds is None else _as_list(seeds, "seeds")
        if given is not None and len(given) != len(poses):
            raise RequestError(
                f"{len(poses)} poses came with {len(given)} seeds; give one seed per pose (None "
                "where a pose has none), or no seeds at all"
            )
        if chain:
            return list(self._chained(poses, given, current, mode))
        results: list[IKResult] = []
        for at in range(0, len(poses), BLOCK):
            part = None if given is None else given[at : at + BLOCK]
            results += self._answers(poses[at : at + BLOCK], part, current, mode, at)
        return results

    def solve_stream(
        self,
        T_base_tips: Iterable[PoseLike],
        current: SeedLike | None = None,
        mode: SeedMode = SeedMode.AUTO,
    ) -> Iterator[IKResult]:
        """Results for poses that come one by one, in bounded memory however many there are.

        Wrap the result in tqdm to see its progress.

        Args:
            T_base_tips: poses, as for `solve`; they are read in blocks of `BLOCK`.
            current: the arm's present joint angles, for all poses.
            mode: which seeds to try.

        Raises:
            BaxterError: as `solve`.
        """
        poses = iter(T_base_tips)
        while block := list(islice(poses, BLOCK)):
            yield from self._answers(block, None, current, mode)

    def _short_cut(
        self, searcher: Searcher, T_base_tip: pin.SE3, q_seed: Vector, seed_type: SeedType
    ) -> IKResult | None:
        """What a batch of this one request would answer, without its bookkeeping.

        None when that, or the input, needs a closer look.
        """
        if q_seed.shape != (7,) or q_seed.dtype != np.float64:
            return None
        q, report = searcher.search_one(q_seed, T_base_tip)
        is_solved, offset, angle, _, is_valid_input = report.tolist()
        if is_solved == 1.0:
            return IKResult.trusted(self.arm.joint_names, q.copy(), seed_type, (offset, angle))
        if is_valid_input != 1.0:
            return None
        return self._from_map(searcher, T_base_tip)

    def _from_map(self, searcher: Searcher, T_base_tip: pin.SE3) -> IKResult | None:
        """The same without a seed; the pose must be valid."""
        names, seed_type = self.arm.joint_names, SeedType.NS_MAP
        q, report = searcher.search_one_from_map(T_base_tip)
        is_solved, offset, angle, _, _ = report.tolist()
        if is_solved == 1.0:
            return IKResult.trusted(names, q.copy(), seed_type, (offset, angle))
        Ts = T_base_tip.homogeneous[None]
        if self._explainer.are_out_of_reach_at_a_glance(Ts).any():
            return None
        for q_start in self._null_space_map.coarse.starts(Ts, sum(COARSE_ROUNDS))[0]:
            q, report = searcher.search_one(q_start, T_base_tip)
            is_solved, offset, angle, _, _ = report.tolist()
            if is_solved == 1.0:
                return IKResult.trusted(names, q.copy(), seed_type, (offset, angle))
        return None

    def _best(self, result: IKResult, T_base_tip: pin.SE3, objective: Objective) -> IKResult:
        curve = trace_self_motion(
            self.arm, result.q, T_base_tip=T_base_tip, step_rad=OBJECTIVE_STEP_RAD
        )
        best = self._explainer.measured(T_base_tip.homogeneous, best_on(curve, objective).copy())
        errors = best.position_error_m, best.orientation_error_rad
        return IKResult.trusted(self.arm.joint_names, best.q, result.seed_type, errors)

    def _chained(
        self,
        poses: list[Any],
        seeds: list[Any] | None,
        current: SeedLike | None,
        mode: SeedMode,
    ) -> Iterator[IKResult]:
        for i, pose in enumerate(poses):
            result = self.solve(pose, None if seeds is None else seeds[i], current, mode)
            current = result.q if result.is_valid else current
            yield result

    def _answers(
        self,
        poses: list[Any],
        seeds: list[Any] | None,
        current: SeedLike | None,
        mode: SeedMode,
        first: int = 0,
    ) -> list[IKResult]:
        Ts, table = pose_matrices(poses), self._seed_table(len(poses), seeds, current, first)
        batch = Batch(Ts, table, SeedMode.of(mode))
        batch.solve(self.arm, self._search, self._null_space_map, self._explainer)
        return list(batch.results(self.arm, self._explainer))

    def _seed_table(
        self, count: int, seeds: list[Any] | None, current: SeedLike | None, first: int
    ) -> dict[SeedType, Vector]:
        """The seeds of each type, shape (count, 7), rad; NaN where there is none."""
        table = {}
        if seeds is not None:
            table[SeedType.USER] = self._user_seeds(seeds, first)
        if current is not None:
            q = self._checked_seed(current, "current")
            table[SeedType.CURRENT] = np.tile(q, (count, 1))
        return table

    def _user_seeds(self, seeds: list[Any], first: int) -> Vector:
        if all(isinstance(seed, np.ndarray) and seed.shape == (7,) for seed in seeds):
            together = float_array(seeds, "seeds", ConfigurationError)
            limits, slack = self.arm.limits, SEED_TOLERANCE_RAD
            inside = (together >= limits.q_min - slack) & (together <= limits.q_max + slack)
            if inside.all():  # which NaN is not
                return together
        table = np.full((len(seeds), 7), np.nan)
        for i, seed in enumerate(seeds):
            if seed is not None:
                name = "seed" if len(seeds) == 1 else f"seeds[{first + i}]"
                table[i] = self._checked_seed(seed, name)
        return table

    def _checked_seed(self, seed: SeedLike, what: str) -> Vector:
        q = self.arm.configuration(seed, what)
        return self.arm.limits.check(q, what, SEED_TOLERANCE_RAD)


def _as_list(values: Iterable[Any], what: str) -> list[Any]:
    if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
        raise RequestError(f"{what} must be a sequence, got {type(values).__name__}")
    return list(values)
