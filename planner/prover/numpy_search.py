"""Rows found by NumPy, without a C compiler: the same rows, a hundred times slower.

A task (two clusters and a cell of time) is separated by the line between their middles, or by a
direction found by the algorithm of Gilbert, Johnson and Keerthi for the volume between both ends of
the cell. Otherwise the larger cluster is cut, or the cell of time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.certificate.clusters import LEAF, Clusters, Nodes
from planner.certificate.intervals import Array, Interval, Pose
from planner.certificate.motion import Polynomials
from planner.certificate.rows import (
    BY_DIRECTION,
    BY_FINE_DIRECTION,
    BY_MIDDLES,
    CUT_FIRST,
    CUT_SECOND,
    CUT_TIME,
    Joints,
    Judge,
    Mover,
    Pair,
    Step,
    Tasks,
    Trace,
)
from planner.prover.problem import (
    SPARE_M,
    Chain,
    Found,
    Near,
    NotShownError,
    Outcome,
    PlacedShapes,
    Rows,
)

MIN_CELL_S = 2e-5
"""Shorter cells of time are not cut."""

SCALE, FINE_SCALE = 127.0, 32767.0
"""Directions are integers up to this."""

MAX_ITERATIONS = 25

_SUBSETS = [s for size in (1, 2, 3, 4) for s in combinations(range(4), size)]

_UP = np.array([0.0, 0.0, 1.0])


def rows_of(robot: Joints, clusters: Clusters, step: Step, margin_m: float) -> Rows:
    """Find the rows of one step.

    Args:
        robot: the arm that moves.
        clusters: all clusters of the step.
        step: the step and its pairs.
        margin_m: clearance of counted pairs, where they need not keep more.

    Raises:
        NotShownError: when none are found.
    """
    pairs = [
        replace(pair, least_m=max(pair.least_m, margin_m)) if pair.is_counted else pair
        for pair in step.pairs
    ]
    judge = Judge(robot, clusters, replace(step, pairs=pairs))
    is_counted = np.array([pair.is_counted for pair in pairs], np.bool_)
    levels: list[Trace] = []
    proven_m, tasks = np.inf, judge.tasks()
    while len(tasks):
        judge.place(np.unique(np.concatenate([tasks.start_s, tasks.end_s])))
        found, n = _Level(judge, clusters, tasks).search()
        levels.append(Trace.of(found, n))
        counted = np.flatnonzero((found <= BY_MIDDLES) & is_counted[tasks.pair])
        gaps_m = judge.gaps_m(tasks.only(counted), n[counted])
        proven_m = min(proven_m, float(gaps_m.min(initial=np.inf)))
        tasks = judge.cut(tasks, found)
    return Rows(Trace.joined(levels), proven_m - SPARE_M)


def search(
    chain: Chain,
    there: PlacedShapes,
    pairs: np.ndarray[Any, Any],
    motion: Polynomials | Array,
    *,
    margin_m: float = 0.0,
) -> Found:
    """Like `planner.prover.kernel.Kernel.search`; the nearest pair is not found."""
    clusters, steps = laid_out(there, pairs)
    of_arm = motion if isinstance(motion, Polynomials) else None
    q = motion.start[0] if isinstance(motion, Polynomials) else motion
    none, empty = Near(-1, np.inf, 0.0), np.zeros((0, 3))
    try:
        found = rows_of(chain, clusters, Step("the motion", steps, of_arm, q), margin_m)
    except NotShownError as reason:
        near = none if reason.near is None else reason.near
        return Found(Outcome.NOT_SHOWN, 0.0, none, near, np.zeros(0, np.uint8), empty, empty)
    trace = found.trace
    columns = trace.letters, trace.directions, trace.fine
    return Found(Outcome.PROVEN, found.proven_m, none, none, *columns)


def laid_out(there: PlacedShapes, pairs: np.ndarray[Any, Any]) -> tuple[Clusters, Sequence[Pair]]:
    """Shapes and pairs of type `PAIR` in the form of the checker's code."""
    clusters, found = Clusters(), []
    roots = [
        clusters.add(
            replace(shape, ball_m=shape.ball_m + thicker), Pose(Interval(rotation), Interval(place))
        )
        for shape, rotation, place, thicker in zip(*there, strict=True)
    ]
    for first, second, k, m, is_counted, least, begin, end, slides in pairs.tolist():
        one = Mover("one", roots[first], k, tuple(slides[:2]))
        other = Mover("another", roots[second], m, tuple(slides[2:]))
        found.append(Pair(one, other, least, begin, end, is_counted=bool(is_counted)))
    return clusters, found


@dataclass
class _Level:
    """The search for directions for all open tasks of one level."""

    judge: Judge
    clusters: Clusters
    tasks: Tasks

    def search(self) -> tuple[Nodes, Array]:
        """A letter for each task, and a direction where the letter needs one."""
        tasks = self.tasks
        letters = np.full(len(tasks), -1, np.intp)
        n = np.zeros((len(tasks), 3))
        middles = self.judge.between_middles(tasks)
        is_apart = self._spare_m(tasks, middles) > 0.0
        letters[is_apart], n[is_apart] = BY_MIDDLES, middles[is_apart]
        open_ = np.flatnonzero(letters < 0)
        if len(open_):
            self._separate(open_, letters, n, middles[open_])
        return letters, n

    def _spare_m(self, tasks: Tasks, n: Array) -> Array:
        gaps = self.judge.gaps_m(tasks, n)
        spare: Array = gaps - self.judge.least_m[tasks.pair] - SPARE_M
        return spare

    def _separate(self, open_: Nodes, letters: Nodes, n: Array, first: Array) -> None:
        judge, tasks = self.judge, self.tasks.only(open_)
        goal = judge.sag_m(tasks) + judge.least_m[tasks.pair]
        ends, far = self.judge.supports(tasks, first)
        count = len(open_)
        simplex, used = np.zeros((count, 4, 3)), np.zeros((count, 4), np.bool_)
        simplex[:, 0], used[:, 0] = ends[0] - far, True
        v = simplex[:, 0].copy()
        reach = np.linalg.norm(v, axis=1)
        sweep = np.linalg.norm(ends[1] - ends[0], axis=1)
        active = reach > goal
        for _ in range(MAX_ITERATIONS):
            at = np.flatnonzero(active)
            if not len(at):
                break
            sub = tasks.only(at)
            length = np.linalg.norm(v[at], axis=1)
            d = np.where((length < 1e-9)[:, None], _UP, v[at])
            whole = np.rint(SCALE * d / np.abs(d).max(axis=1, keepdims=True))
            is_good = self._spare_m(sub, whole) > 0.0
            letters[open_[at[is_good]]] = BY_DIRECTION
            n[open_[at[is_good]]] = whole[is_good]
            ends, far = self.judge.supports(sub, d)
            along = [np.einsum("ki,ki->k", d, end - far) for end in ends]
            w = np.where((along[0] < along[1])[:, None], ends[0], ends[1]) - far
            gain = length**2 - np.minimum(*along)
            is_stuck = gain < 1e-3 * length * np.abs(length - goal[at]) + 1e-9
            free = (~used[at]).argmax(axis=1)
            simplex[at, free], used[at, free] = w, True
            shares = least_norm_weights(simplex[at], used[at])
            used[at] = shares > 1e-12
            v[at] = np.einsum("nk,nkj->nj", shares, simplex[at])
            reach[at] = np.minimum(reach[at], np.linalg.norm(v[at], axis=1))
            is_open = (reach[at] > goal[at]) & ~used[at].all(axis=1) & (length >= 1e-9)
            active[at] = ~is_good & ~is_stuck & is_open
        self._by_axes(tasks, open_, letters, n)
        self._finely(v, open_, letters, n)
        self._cut(tasks, open_, letters, reach, sweep)

    def _by_axes(self, tasks: Tasks, open_: Nodes, letters: Nodes, n: Array) -> None:
        """Try the axes of both shapes, which separate intended contacts best."""
        may_touch = self.judge.least_m[tasks.pair] <= 0.0
        at = np.flatnonzero((letters[open_] < 0) & may_touch & (self.judge.sag_m(tasks) < 2e-3))
        if not len(at):
            return
        sub = tasks.only(at)
        best, chosen = np.zeros(len(at)), np.zeros((len(at), 3))
        R = self.judge.rotations(sub, sub.start_s)
        frames = (
            self.clusters.rotations(sub.second),
            R @ self.clusters.rotations(sub.first),
            R,
        )
        for frame in frames:
            for axis in range(3):
                for sign in (1.0, -1.0):
                    d = sign * frame[:, :, axis]
                    whole = np.rint(SCALE * d / np.abs(d).max(axis=1, keepdims=True))
                    spare = self._spare_m(sub, whole)
                    is_better = spare > best
                    best[is_better], chosen[is_better] = spare[is_better], whole[is_better]
        is_good = best > 0.0
        letters[open_[at[is_good]]] = BY_DIRECTION
        n[open_[at[is_good]]] = chosen[is_good]

    def _finely(self, v: Array, open_: Nodes, letters: Nodes, n: Array) -> None:
        """Try finer directions, which large clusters near each other need."""
        at = np.flatnonzero((letters[open_] < 0) & (np.abs(v).max(axis=1) > 0.0))
        fine = np.rint(FINE_SCALE * v[at] / np.abs(v[at]).max(axis=1, keepdims=True))
        is_good = self._spare_m(self.tasks.only(open_[at]), fine) > 0.0
        letters[open_[at[is_good]]] = BY_FINE_DIRECTION
        n[open_[at[is_good]]] = fine[is_good]

    def _cut(self, tasks: Tasks, open_: Nodes, letters: Nodes, reach: Array, sweep: Array) -> None:
        """Cut the time where the swept volume is large, otherwise the larger cluster."""
        at = np.flatnonzero(letters[open_] < 0)
        if not len(at):
            return
        sub, judge = tasks.only(at), self.judge
        sizes = [
            np.where(self.clusters.children(x)[:, 0] == LEAF, 0.0, self.clusters.extents_m(x))
            for x in (sub.first, sub.second)
        ]
        sag, least = judge.sag_m(sub), judge.least_m[sub.pair]
        spare = np.maximum(reach[at] - least, 0.0)
        is_long = sub.end_s - sub.start_s > MIN_CELL_S
        is_late = (sag > 0.5 * spare) & (sag > 2e-4) & (sag > 1e-2 * np.maximum(*sizes))
        in_time = np.where(is_long & (sag > 0.0), np.maximum(2.0 * sweep[at], 1e3 * is_late), 0.0)
        hopeless = np.flatnonzero((sizes[0] == 0.0) & (sizes[1] == 0.0) & (in_time <= 0.0))
        if len(hopeless):
            i = int(hopeless[0])
            near = Near(int(sub.pair[i]), float(reach[at[i]]), float(sub.start_s[i]))
            raise NotShownError.of(judge.step, near)
        choice = np.argmax([*sizes, in_time + 1e-12], axis=0)
        letters[open_[at]] = np.array([CUT_FIRST, CUT_SECOND, CUT_TIME])[choice]


def least_norm_weights(simplices: Array, used: NDArray[np.bool_]) -> Array:
    """Weights of the points of smallest norm of simplices, shape (n, 4); 0 for unused corners.

    Args:
        simplices: four corners each, shape (n, 4, 3).
        used: whether each corner counts, shape (n, 4).
    """
    best, weights = np.full(len(simplices), np.inf), np.zeros((len(simplices), 4))
    for subset in _SUBSETS:
        at = np.flatnonzero(used[:, subset].all(axis=1))
        if not len(at):
            continue
        P, k = simplices[at][:, subset], len(subset)
        K = np.zeros((len(at), k + 1, k + 1))
        K[:, :k, :k] = P @ P.swapaxes(1, 2) + 1e-14 * np.eye(k)
        K[:, k, :k] = K[:, :k, k] = 1.0
        right = np.zeros((len(at), k + 1, 1))
        right[:, k] = 1.0
        w = np.linalg.solve(K, right)[:, :k, 0]
        norm = np.linalg.norm(np.einsum("nk,nkj->nj", w, P), axis=1)
        is_good = (w > -1e-12).all(axis=1) & (norm < best[at] - 1e-12)
        good = at[is_good]
        best[good] = norm[is_good]
        weights[good] = 0.0
        weights[np.ix_(good, subset)] = w[is_good]
    return weights
