"""Solver and batch: the order of the searches for a pose, until it is solved or given up.

The poses of a batch are solved together, round by round. A round is one start, or a few, for every
pose that is still open. The rounds of a seed type follow each other; the types follow in the order
of the seed mode. So the treatment of a pose does not depend on the others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property, partial
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin.frames import checked_pose
from baxter_kin.ik.result import (
    ORIENTATION_TOLERANCE_RAD,
    POSITION_TOLERANCE_M,
    IKFailure,
    IKResult,
    pending_failure,
)
from baxter_kin.ik.search.explanation import BestAttempt, Explainer
from baxter_kin.ik.search.ipopt import IpoptSearcher
from baxter_kin.ik.search.searcher import Backend, Found, Search, Searcher
from baxter_kin.ik.seeds import (
    MAP_STARTS,
    SEED_STARTS,
    NullSpaceMap,
    SeedMode,
    SeedType,
    Starts,
    starts_around,
)
from baxter_kin.ik.tolerance import EXACT, Tolerance
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray, Indices

COARSE_ROUNDS = (1, 1, 2, 4)
"""Numbers of computed starts in successive rounds; the first that leads to a solution counts."""

POLISH_ROUNDS = 20
"""Further searches from the best attempt, of up to 15 iterations each, if all starts failed."""

SCATTERED_POLISH_ROUNDS, SCATTERED_POLISHED = 6, 64
"""The same for starts from all over the joint ranges, and the number of attempts continued."""

NEAR_M, NEAR_RAD = 0.02, 0.05
"""Attempts that end farther away are stuck in a local minimum, not slow."""

_SEED_TYPES = tuple(SeedType)


class Solver:
    """Solves the requests of one tolerance for one arm.

    Attributes:
        arm: the arm whose tip is placed.
        fast: the fast search; None with the backend IPOPT.
        search: the search that is used: the fast one, or IPOPT.
        starts: the starts of searches without a seed.
        explainer: finds the reason why there is no solution.
    """

    def __init__(self, arm: Arm, backend: Backend, tolerance: Tolerance = EXACT) -> None:
        self.arm, self._tolerance = arm, tolerance
        self.starts = NullSpaceMap(arm, tolerance)
        is_fast = backend is not Backend.IPOPT
        self.fast = Searcher(arm, backend, tolerance) if is_fast else None
        self.search: Search = self.fast or self._ipopt
        self.explainer = Explainer(arm, self.search, self.starts, tolerance)

    @cached_property
    def last_resort(self) -> Search | None:
        """Another search for poses that the fast one did not solve from any start.

        For exact poses, it searches for the nearest position.
        """
        if self.fast is None:
            return None
        return (
            self._ipopt
            if self._tolerance != EXACT
            else IpoptSearcher(self.arm, self.starts, is_nearest=True)
        )

    @cached_property
    def _ipopt(self) -> IpoptSearcher:
        return IpoptSearcher(self.arm, self.starts, self._tolerance)

    def solve_one(self, T_base_tip: pin.SE3, q_seed: Any, seed_type: SeedType) -> IKResult | None:
        """The result of the first searches of a `Batch` of one pose, in a tenth of its time.

        A batch that maps this method takes a third longer for 10,000 poses on two cores. It also
        accepts searches that end within the tolerances of a result without converging, so that for
        one pose in a thousand it gives another solution than this method.

        Args:
            T_base_tip: the pose.
            q_seed: the only seed, or None.
            seed_type: its type.

        Returns:
            None if these searches fail, or if the seed must be converted or checked first.
        """
        fast = self.fast
        if fast is None:
            return None
        if q_seed is not None:
            if type(q_seed) is not np.ndarray or q_seed.shape != (7,) or q_seed.dtype != np.float64:
                return None
            q, report = fast.search_one(q_seed, T_base_tip)
            is_solved, offset, angle, _, is_valid_input = report.tolist()
            if is_solved == 1.0:
                return self._result(q, seed_type, offset, angle)
            if is_valid_input != 1.0:
                return None
        for q, report in self._from_map(fast, T_base_tip):
            is_solved, offset, angle, _, is_valid_input, *_ = report.tolist()
            if is_solved == 1.0:
                return self._result(q, SeedType.NS_MAP, offset, angle)
            if is_valid_input != 1.0:
                checked_pose(T_base_tip)
        return None

    def _from_map(
        self, fast: Searcher, T_base_tip: pin.SE3
    ) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Searches from setpoints, then from coarsely computed starts, unless out of reach."""
        found = fast.search_one_from_map(T_base_tip)
        if found is None:
            return
        yield found
        Ts = T_base_tip.homogeneous[None]
        if not self.explainer.reach.are_outside_shells(Ts).any():
            for q_start in self.starts.coarse(Ts, sum(COARSE_ROUNDS))[0]:
                yield fast.search_one(q_start, T_base_tip)

    def _result(self, q: FloatArray, seed_type: SeedType, offset: float, angle: float) -> IKResult:
        q = q.copy()
        q.setflags(write=False)
        return IKResult(self.arm.joint_names, q, seed_type, offset, angle)


class Batch:
    """Poses, their seeds, and the best attempt for each so far."""

    def __init__(self, Ts: FloatArray, seeds: dict[SeedType, FloatArray], mode: SeedMode) -> None:
        """Store the poses; nothing is tried yet.

        Args:
            Ts: poses as matrices seen from base, shape (n, 4, 4).
            seeds: USER and CURRENT seeds if given, each of shape (n, 7), rad; NaN for none.
            mode: which of them to try.
        """
        count = len(Ts)
        self._Ts = Ts
        self._seeds = seeds
        self._mode = mode
        self._q = np.zeros((count, 7))
        self._seed_type = np.full(count, int(SeedType.INVALID))
        self._best_type = np.full(count, int(SeedType.INVALID))
        self._offset = np.full(count, np.inf)
        self._angle = np.full(count, np.inf)
        self._starts = np.zeros((count, len(SeedType)), dtype=np.intp)
        self._is_hopeless = np.zeros(count, dtype=np.bool_)

    def solve(self, solver: Solver) -> None:
        """Search until every pose is solved, proven out of reach, or out of starts."""
        for seed_type in self._mode.seed_types:
            if seed_type is SeedType.NS_MAP:
                self._search_from_map(solver)
            elif seed_type in self._seeds:
                self._search_from_seeds(solver, seed_type)
        self._polish(solver.search)
        self._measure_untried(solver)
        self._search_as_last_resort(solver)

    def _search_as_last_resort(self, solver: Solver) -> None:
        """Search once more from the best attempt at each pose that is left.

        A result in the requested orientation replaces a nearer one in another orientation.
        """
        poses = self._open(self._starts.sum(axis=1) > 0)
        search = solver.last_resort if poses.size else None
        if search:
            seed_types = self._best_type[poses]
            self._starts[poses, seed_types] += 1
            found = search.search(self._q[poses], self._Ts[poses])
            self._offset[poses[found.orientation_error_rad <= ORIENTATION_TOLERANCE_RAD]] = np.inf
            self._take(poses, seed_types, found)

    def results(self, solver: Solver) -> Iterator[IKResult]:
        """The results, in the order of the poses."""
        self._q.setflags(write=False)
        names, explainer = solver.arm.joint_names, solver.explainer
        columns = (self._seed_type.tolist(), self._offset.tolist(), self._angle.tolist())
        rows = zip(self._q, *columns, strict=True)
        for i, (q, seed_type, offset, angle) in enumerate(rows):
            if seed_type:
                yield IKResult(names, q, _SEED_TYPES[seed_type], offset, angle)
            else:
                failure = pending_failure(partial(self._why, i, explainer))
                yield IKResult(names, q, SeedType.INVALID, offset, angle, failure)

    def _search_from_seeds(self, solver: Solver, seed_type: SeedType) -> None:
        seeds = self._seeds[seed_type]
        has_seed = ~np.isnan(seeds[:, 0])
        count = 1 if self._mode is SeedMode.AUTO else SEED_STARTS
        for starts in starts_around(solver.arm, seeds, count):
            poses = self._open(has_seed)
            self._try(poses, seed_type, solver.search, starts[poses], 1)

    def _search_from_map(self, solver: Solver) -> None:
        """Search from setpoints, from coarse and fine computed starts, then from everywhere.

        In between, poses that are proven out of reach are given up, by cheap proofs first.
        """
        search, starts, reach = solver.search, solver.starts, solver.explainer.reach
        self._give_up(reach.are_outside_shells)  # in microseconds
        poses = self._open()
        if poses.size:
            self._starts[poses, SeedType.NS_MAP] += MAP_STARTS
            self._take(poses, SeedType.NS_MAP, search.search_from_map(self._Ts[poses]))
        self._give_up(partial(reach.are_proven, levels=1))  # in some ten microseconds each
        self._search_from_computed(starts.coarse, COARSE_ROUNDS, search)
        self._give_up(reach.are_proven)  # in less than a millisecond each
        self._search_from_computed(starts.fine, search.fine_rounds, search)
        self._give_up(reach.are_beyond_limits)  # in some milliseconds each
        self._search_from_everywhere(starts.scattered, search)

    def _search_from_computed(
        self, computed: Starts, rounds: tuple[int, ...], search: Search
    ) -> None:
        """Give every pose the same number of starts in a round, and more in later rounds."""
        first = self._open()
        if not first.size:
            return
        starts = computed(self._Ts[first], sum(rounds))
        edges = np.cumsum((0, *rounds)).tolist()
        for begin, end in pairwise(edges):
            poses = self._open()
            q_starts = starts[np.searchsorted(first, poses), begin:end].reshape(-1, 7)
            self._try(poses, SeedType.NS_MAP, search, q_starts, end - begin)

    def _search_from_everywhere(self, scattered: Starts, search: Search) -> None:
        """Search pose by pose from all over the joint ranges, and on from the nearest attempts.

        At a singularity between limits most attempts get stuck nearby, even the best of them, while
        others only converge slowly.
        """
        count, left = search.scattered_starts, self._open()
        if not count or not left.size:
            return
        for pose, q_starts in zip(left, scattered(self._Ts[left], count), strict=True):
            q, T, poses = q_starts, self._Ts[pose], np.array([pose])
            self._starts[pose, SeedType.NS_MAP] += count
            for _ in range(1 + SCATTERED_POLISH_ROUNDS):
                found = search.search(q, np.repeat(T[None], len(q), axis=0))
                self._take(poses, SeedType.NS_MAP, _best_of_each(found, len(q)))
                if self._seed_type[pose] != SeedType.INVALID:
                    break
                q = found.q[_nearest(found)]

    def _try(
        self, poses: Indices, seed_type: SeedType, search: Search, q_starts: FloatArray, count: int
    ) -> None:
        """Search from `count` successive starts for each pose."""
        if poses.size:
            found = search.search(q_starts, np.repeat(self._Ts[poses], count, axis=0))
            self._starts[poses, seed_type] += count
            self._take(poses, seed_type, _best_of_each(found, count))

    def _open(self, among: NDArray[np.bool_] | bool = True) -> Indices:
        """Poses that are neither solved nor hopeless."""
        is_open = (self._seed_type == SeedType.INVALID) & ~self._is_hopeless
        return np.flatnonzero(is_open & among)

    def _polish(self, search: Search) -> None:
        """Continue from the best attempts that are near: at singularities they converge slowly.

        The error does not decrease steadily there, so each continues from its last iterate.
        """
        is_near = (self._offset <= NEAR_M) & (self._angle <= NEAR_RAD)
        poses = self._open(is_near)
        q = self._q[poses]
        for _ in range(POLISH_ROUNDS):
            if not poses.size:
                return
            found = search.search(q, self._Ts[poses])
            self._take(poses, self._best_type[poses], found)
            is_open = self._seed_type[poses] == SeedType.INVALID
            poses, q = poses[is_open], found.q[is_open]

    def _take(self, poses: Indices, seed_type: SeedType | Indices, found: Found) -> None:
        """Keep results that are better than before or valid; mark poses as solved."""
        residual = found.position_error_m + found.orientation_error_rad
        is_better = found.is_valid | (residual < self._offset[poses] + self._angle[poses])
        better = poses[is_better]
        self._q[better] = found.q[is_better]
        self._offset[better] = found.position_error_m[is_better]
        self._angle[better] = found.orientation_error_rad[is_better]
        self._best_type[better] = np.broadcast_to(seed_type, poses.shape)[is_better]
        is_close = (self._offset <= POSITION_TOLERANCE_M) & (
            self._angle <= ORIENTATION_TOLERANCE_RAD
        )
        solved = poses[is_close[poses]]
        self._seed_type[solved] = self._best_type[solved]

    def _give_up(self, are_out_of_reach: Callable[[FloatArray], NDArray[np.bool_]]) -> None:
        """Give up poses that are proven out of reach."""
        poses = self._open()
        if poses.size:
            self._is_hopeless[poses] = are_out_of_reach(self._Ts[poses])

    def _measure_untried(self, solver: Solver) -> None:
        """Give poses without any search their seed, or the neutral arm, as best attempt.

        They were proven out of reach before any search, or the mode's seed was not given.
        """
        untried = np.flatnonzero(self._starts.sum(axis=1) == 0)
        if not untried.size:
            return
        explainer = solver.explainer
        self._q[untried] = solver.arm.neutral
        errors = explainer.errors_in_neutral(self._Ts[untried])
        self._offset[untried], self._angle[untried] = errors
        for table in reversed(self._seeds.values()):  # the user's last, which has priority
            for i in untried[~np.isnan(table[untried, 0])]:
                attempt = explainer.measured(self._Ts[i], table[i])
                self._q[i] = table[i]
                self._offset[i], self._angle[i] = (
                    attempt.position_error_m,
                    attempt.orientation_error_rad,
                )

    def _why(self, i: int, explainer: Explainer) -> IKFailure:
        starts = {kind: int(self._starts[i, kind]) for kind in SeedType if self._starts[i, kind]}
        offset, angle = float(self._offset[i]), float(self._angle[i])
        attempt = BestAttempt(self._Ts[i], self._q[i], offset, angle, starts)
        return explainer.why(attempt, self._mode.name)


def _nearest(found: Found) -> Indices:
    """Indices of at most `SCATTERED_POLISHED` near attempts, nearest first; at least one."""
    residual = found.position_error_m + found.orientation_error_rad
    is_near = (found.position_error_m <= NEAR_M) & (found.orientation_error_rad <= NEAR_RAD)
    count = min(max(int(is_near.sum()), 1), SCATTERED_POLISHED)
    order: Indices = residual.argsort(kind="stable")[:count]
    return order


def _best_of_each(found: Found, count: int) -> Found:
    """Of every `count` successive searches the first valid one, or else the nearest."""
    if count == 1:
        return found
    residual = found.position_error_m + found.orientation_error_rad
    rank = np.where(found.is_valid, -np.inf, residual).reshape(-1, count)
    best = rank.argmin(axis=1) + count * np.arange(len(rank))
    return Found(
        found.q[best],
        found.is_valid[best],
        found.position_error_m[best],
        found.orientation_error_rad[best],
        found.iterations[best],
    )
