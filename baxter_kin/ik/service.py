"""The IK service, with the semantics of the service of the robot that it replaces.

A request is a pose, optionally a seed of the user's and the arm's current joint angles, and a seed
mode. `baxter_kin.ik.search.batch` solves requests, one or many together. A single request first
gets a quick attempt: the first searches of a batch, without its arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Sized
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import islice
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.display import OneLine
from baxter_kin.errors import ConfigurationError, RequestError
from baxter_kin.frames import PoseLike, checked_pose, pose_matrices
from baxter_kin.ik.result import IKFailure, IKResult
from baxter_kin.ik.search.batch import Batch, Solver
from baxter_kin.ik.search.search_function import SEED_TOLERANCE_RAD
from baxter_kin.ik.search.searcher import Backend
from baxter_kin.ik.seeds import SeedMode, SeedType
from baxter_kin.ik.self_motion.objectives import (
    Objective,
    Scope,
    SmallestStep,
    best_of,
    best_on,
    checked_scope,
)
from baxter_kin.ik.self_motion.pieces import all_pieces
from baxter_kin.ik.self_motion.tracing import trace_self_motion
from baxter_kin.ik.tolerance import EXACT, Tolerance
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray, expect, float_array, positive_scalar

SeedLike: TypeAlias = "Mapping[str, float] | ArrayLike"
"""A configuration by joint name or in joint order, rad."""

BLOCK = 4096
"""Number of poses of a large batch that are solved at a time."""

MAX_SOLVERS = 16
"""Number of tolerances whose solvers are kept."""

MAX_POSES = 10_000_000
"""Maximum size of a batch, whose results are all kept in memory; a stream has no limit."""

OBJECTIVE_STEP_RAD = 0.1
"""Step along a self-motion curve of which only the best point is wanted, which is found exactly."""


@dataclass(frozen=True, slots=True)
class Requests:
    """Poses, seeds and mode of a request, before they are checked."""

    poses: list[Any]
    seeds: list[Any] | None
    current: SeedLike | None
    mode: SeedMode
    first: int = 0  # index of the first pose, for error messages

    def blocks(self) -> Iterator[Requests]:
        """The same requests, `BLOCK` poses at a time."""
        for at in range(0, len(self.poses), BLOCK):
            part = slice(at, at + BLOCK)
            seeds = None if self.seeds is None else self.seeds[part]
            yield replace(self, poses=self.poses[part], seeds=seeds, first=self.first + at)

    def seed_table(self, arm: Arm) -> dict[SeedType, FloatArray]:
        """The seeds of each type, shape (n, 7), rad; NaN where there is none."""
        table = {}
        if self.seeds is not None:
            table[SeedType.USER] = self._user_seeds(arm, self.seeds)
        if self.current is not None:
            q = _checked_seed(arm, self.current, "current")
            table[SeedType.CURRENT] = np.tile(q, (len(self.poses), 1))
        return table

    def _user_seeds(self, arm: Arm, seeds: list[Any]) -> FloatArray:
        if all(type(seed) is np.ndarray and seed.shape == (7,) for seed in seeds):
            together = float_array(seeds, "seeds", ConfigurationError)
            limits, slack = arm.limits, SEED_TOLERANCE_RAD
            inside = (together >= limits.q_min - slack) & (together <= limits.q_max + slack)
            if inside.all():  # which NaN is not
                return together.clip(limits.q_min, limits.q_max)
        table = np.full((len(seeds), 7), np.nan)
        for i, seed in enumerate(seeds):
            if seed is not None:
                name = "seed" if len(seeds) == 1 else f"seeds[{self.first + i}]"
                table[i] = _checked_seed(arm, seed, name)
        return table


@dataclass(frozen=True, slots=True)
class Choice:
    """Which of all solutions of a pose is wanted.

    Attributes:
        objective: chooses the best; None for the nearest to the current joints.
        scope: the solutions among which it chooses.
        max_step_rad: the greatest allowed step to the nearest.
    """

    objective: Objective | None
    scope: Scope
    max_step_rad: float = np.inf

    @classmethod
    def checked(
        cls,
        objective: Objective | None,
        scope: str | Scope | None,
        max_step_rad: float | None,
        tolerance: Tolerance | None,
        current: SeedLike | None,
    ) -> Choice | None:
        """The choice that a request asks for; None for the first solution found."""
        chosen = checked_scope(objective, scope)
        if objective is None and max_step_rad is None:
            return None
        if objective is not None and max_step_rad is not None:
            raise RequestError(
                "max_step_rad asks for the nearest solution, an objective for the best one; give "
                "one of them"
            )
        if tolerance is not None:
            raise RequestError(
                "an objective and max_step_rad choose among the solutions of an exact pose; give "
                "either one of them or a tolerance"
            )
        if max_step_rad is None:
            return cls(objective, chosen)
        if current is None:
            raise RequestError("max_step_rad limits the step from the current joints: give current")
        return cls(None, chosen, positive_scalar(max_step_rad, "max_step_rad", RequestError))


def _checked_seed(arm: Arm, seed: SeedLike, what: str) -> FloatArray:
    return arm.limits.check(arm.configuration(seed, what), what, SEED_TOLERANCE_RAD)


def as_list(values: Iterable[Any], what: str) -> list[Any]:
    """Poses or seeds as a list, if their number is known."""
    if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
        raise RequestError(f"{what} must be a sequence, got {type(values).__name__}")
    if not isinstance(values, Sized):
        raise RequestError(
            f"{what} must be a sequence, whose length is known, got {type(values).__name__}; "
            "solve_stream takes any iterable, or make a list of it"
        )
    if len(values) > MAX_POSES:
        raise RequestError(
            f"got {len(values)} {what}; a batch takes up to {MAX_POSES}, solve_stream any number"
        )
    return list(values)


class IKService(OneLine):
    """Inverse kinematics for one arm.

    The same backend always gives the same result for the same request.

    Attributes:
        arm: the arm whose tip is placed.
        backend: where its searches run.
        search: the search for exact poses.
    """

    def __init__(self, arm: Arm, backend: str | Backend = Backend.AUTO) -> None:
        """Prepare the searches.

        With `AUTO` and a C compiler, they are compiled the first time, which takes some seconds and
        is logged at level INFO; later processes find them in the user's cache.
        """
        self._wanted = Backend.of(backend)
        self.arm = expect(arm, Arm, "arm", RequestError)
        self._exact = Solver(arm, self._wanted)
        self._within = lru_cache(MAX_SOLVERS)(partial(Solver, arm, self._wanted))
        self.search = self._exact.search
        self.backend = self.search.backend

    def __reduce__(self) -> tuple[type[IKService], tuple[Arm, Backend]]:
        return type(self), (self.arm, self._wanted)

    def solve(
        self,
        T_base_tip: PoseLike,
        seed: SeedLike | None = None,
        current: SeedLike | None = None,
        mode: SeedMode = SeedMode.AUTO,
        *,
        objective: Objective | None = None,
        scope: str | Scope | None = None,
        max_step_rad: float | None = None,
        tolerance: Tolerance | None = None,
    ) -> IKResult:
        """Joint angles that place the tip at a pose.

        Args:
            T_base_tip: the pose as SE3 or 4 x 4 matrix seen from base, or a `StampedPose`.
            seed: the user's seed, by joint name or shape (7,), rad.
            current: the arm's current joint angles, in the same forms.
            mode: which seeds to try.
            objective: chooses the best of all solutions, since a seventh joint leaves one degree of
                freedom. Takes tens of milliseconds. Without an objective, the result is the first
                solution found, near its start.
            scope: the solutions among which the objective chooses: `Scope.ALL`, "all", the default;
                or `Scope.CURVE`, "curve": those that the arm can reach from the first solution
                while the tip stays at the pose.
            max_step_rad: the greatest allowed difference of a single joint from `current`. The
                result is then the nearest of all solutions in this measure; if it is farther, an
                invalid result, whose failure says how far. Takes tens of milliseconds.
            tolerance: allowed deviations from the pose; the errors of the result are by how much it
                exceeds them.

        Returns:
            A result, which states the reason if no solution was found. A mode whose seed was not
            given also gives such a result.

        Raises:
            PoseError: when the pose is not a valid one.
            ConfigurationError: when a seed has another shape, is not finite, or lies outside the
                limits by more than `SEED_TOLERANCE_RAD`.
            UnknownNameError: when a seed names a joint of another arm, or there is no such mode
                or scope.
            RequestError: when two of objective, step and tolerance are given, one of them is of
                another class, a scope is given without an objective, or a step without `current`.
        """
        choice = Choice.checked(objective, scope, max_step_rad, tolerance, current)
        result = self._first(self._solver(tolerance), T_base_tip, seed, current, mode)
        return self._chosen(result, T_base_tip, choice, current)

    def _facts(self) -> tuple[str, ...]:
        return repr(self.arm), f"backend {self.backend.value}"

    def _first(
        self, solver: Solver, T_base_tip: PoseLike, seed: Any, current: Any, mode: SeedMode
    ) -> IKResult:
        """The first solution found, or a result with the reason why there is none."""
        result = None
        if mode is SeedMode.AUTO and isinstance(T_base_tip, pin.SE3):
            if current is None:
                result = solver.solve_one(T_base_tip, seed, SeedType.USER)
            elif seed is None:
                result = solver.solve_one(T_base_tip, current, SeedType.CURRENT)
        if result is not None:
            return result
        seeds = None if seed is None else [seed]
        return self._answers(solver, Requests([T_base_tip], seeds, current, mode))[0]

    def _solver(self, tolerance: Tolerance | None) -> Solver:
        if tolerance is None or expect(tolerance, Tolerance, "tolerance", RequestError) == EXACT:
            return self._exact
        return self._within(tolerance)

    def solve_batch(
        self,
        T_base_tips: Sequence[PoseLike],
        seeds: Sequence[SeedLike | None] | None = None,
        current: SeedLike | None = None,
        mode: SeedMode = SeedMode.AUTO,
        *,
        chain: bool = False,
        objective: Objective | None = None,
        scope: str | Scope | None = None,
        max_step_rad: float | None = None,
        tolerance: Tolerance | None = None,
        progress: Callable[[int], object] | None = None,
    ) -> list[IKResult]:
        """The results for many poses, in their order.

        Args:
            T_base_tips: poses, as for `solve`.
            seeds: one per pose, each a seed or None; or None for no seeds at all.
            current: the arm's current joint angles, for all poses.
            mode: which seeds to try.
            chain: whether each solution becomes the current joint angles of the next pose; a pose
                without a solution leaves them as they are. Otherwise the poses are independent, and
                large batches use all cores.
            objective: as for `solve`, for each pose on its own.
            scope: likewise.
            max_step_rad: likewise; with `chain`, the poses of a path are followed without jumps.
            tolerance: allowed deviations from the poses.
            progress: called with the number of poses solved since the last call, such as the
                `update` of a tqdm bar.

        Raises:
            RequestError: when poses or seeds are not sequences, are more than `MAX_POSES`, or
                differ in number, or when another argument is of another class.
            BaxterError: as `solve`, with the index of the pose or seed.
        """
        poses = as_list(T_base_tips, "poses")
        given = None if seeds is None else as_list(seeds, "seeds")
        expect(chain, bool, "chain", RequestError)
        if progress is not None and not callable(progress):
            raise RequestError(f"progress must be callable, got {type(progress).__name__}")
        if given is not None and len(given) != len(poses):
            raise RequestError(
                f"{len(poses)} poses came with {len(given)} seeds; give one seed per pose (None "
                "where a pose has none), or no seeds at all"
            )
        choice = Choice.checked(objective, scope, max_step_rad, tolerance, current)
        solver, requests = self._solver(tolerance), Requests(poses, given, current, mode)
        parts = (
            self._chained(solver, requests, choice)
            if chain
            else self._independent(solver, requests, choice)
        )
        results: list[IKResult] = []
        for part in parts:
            results += part
            if progress is not None:
                progress(len(part))
        return results

    def solve_stream(
        self,
        T_base_tips: Iterable[PoseLike],
        current: SeedLike | None = None,
        mode: SeedMode = SeedMode.AUTO,
        *,
        tolerance: Tolerance | None = None,
    ) -> Iterator[IKResult]:
        """The results for a stream of poses, in bounded memory.

        Wrap the result in tqdm to show its progress.

        Args:
            T_base_tips: poses, as for `solve`; they are read in blocks of `BLOCK`.
            current: the arm's current joint angles, for all poses.
            mode: which seeds to try.
            tolerance: allowed deviations from the poses.

        Raises:
            RequestError: immediately, when the poses are not iterable.
            BaxterError: as `solve`, when the pose is read.
        """
        if isinstance(T_base_tips, (str, bytes, Mapping)) or not isinstance(T_base_tips, Iterable):
            raise RequestError(f"poses must be an iterable, got {type(T_base_tips).__name__}")
        return self._streamed(iter(T_base_tips), current, mode, self._solver(tolerance))

    def _streamed(
        self, poses: Iterator[PoseLike], current: SeedLike | None, mode: SeedMode, solver: Solver
    ) -> Iterator[IKResult]:
        while block := list(islice(poses, BLOCK)):
            yield from self._answers(solver, Requests(block, None, current, mode))

    def _chosen(
        self, first: IKResult, T_base_tip: PoseLike, choice: Choice | None, current: Any
    ) -> IKResult:
        """The solution that is wanted of all, given the first one found."""
        if choice is None or not first.is_valid:
            return first
        pose = checked_pose(T_base_tip)
        if choice.objective is not None:
            return self._best(first, pose, choice.objective, choice.scope)
        here = self.arm.configuration(current, "current")  # also where it is outside the limits
        nearest = self._best(first, pose, SmallestStep(here), Scope.ALL)
        return _within_step(nearest, here, choice.max_step_rad)

    def _best(
        self, result: IKResult, T_base_tip: pin.SE3, objective: Objective, scope: Scope
    ) -> IKResult:
        arm, step_rad = self.arm, OBJECTIVE_STEP_RAD
        if scope is Scope.CURVE:
            curve = trace_self_motion(arm, result.q, T_base_tip=T_base_tip, step_rad=step_rad)
            q = best_on(curve, objective)
        else:
            q = best_of(all_pieces(arm, self.search, T_base_tip, step_rad, result.q), objective)
        q.setflags(write=False)
        errors = EXACT.excess(T_base_tip, arm.T_base_tip(q))
        return IKResult(arm.joint_names, q, result.seed_type, *errors)

    def _chained(
        self, solver: Solver, requests: Requests, choice: Choice | None
    ) -> Iterator[list[IKResult]]:
        current, seeds = requests.current, requests.seeds
        for i, pose in enumerate(requests.poses):
            seed = None if seeds is None else seeds[i]
            first = self._first(solver, pose, seed, current, requests.mode)
            result = self._chosen(first, pose, choice, current)
            current = result.q if result.is_valid else current
            yield [result]

    def _independent(
        self, solver: Solver, requests: Requests, choice: Choice | None
    ) -> Iterator[list[IKResult]]:
        for block in requests.blocks():
            firsts = self._answers(solver, block)
            if choice is None:
                yield firsts
                continue
            for first, pose in zip(firsts, block.poses, strict=True):
                yield [self._chosen(first, pose, choice, requests.current)]

    def _answers(self, solver: Solver, requests: Requests) -> list[IKResult]:
        Ts, table = pose_matrices(requests.poses, requests.first), requests.seed_table(self.arm)
        batch = Batch(Ts, table, SeedMode.of(requests.mode))
        batch.solve(solver)
        return list(batch.results(solver))


def _within_step(nearest: IKResult, q: FloatArray, max_step_rad: float) -> IKResult:
    """The nearest solution, or its refusal if it is farther from `q` than allowed."""
    steps = np.abs(nearest.q - q)
    farthest = int(steps.argmax())
    step_rad = float(steps[farthest])
    if step_rad <= max_step_rad:
        return nearest
    failure = IKFailure(
        f"no solution within {max_step_rad:.4g} rad of the current joints: the nearest one found "
        f"moves {nearest.joint_names[farthest]} by {step_rad:.4g} rad",
        nearest_step_rad=step_rad,
    )
    errors = nearest.position_error_m, nearest.orientation_error_rad
    return IKResult(nearest.joint_names, nearest.q, SeedType.INVALID, *errors, failure)
