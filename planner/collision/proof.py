"""Continuous proof: a motion is clear at every instant, not only at samples.

Rows of separation prove it; `planner.certificate.rows` states the theorem. The links and bodies of
a situation are trees of convex clusters. For every pair of clusters and cell of time there is a
direction whose gap at both ends of the cell, less the largest sag in between, is at least the
required distance of the pair. A kernel in C finds these rows; without a C compiler NumPy does,
about fifty times slower. Intended contacts are proven in the same way, not to press deeper than
`PRESSING_TOLERANCE_M`.

The search proves 0.98 of the smallest distance that it measures, or less where that fails. Where a
motion is not clear, coal measures the two shapes that are too close at the instant at which the
search stopped.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.validation import FloatArray, Indices, expect
from planner.certificate.motion import Polynomials
from planner.certificate.rows import BY_MIDDLES
from planner.clearance import (
    Clearance,
    ContinuousContact,
    ContinuousProof,
    ContinuousResult,
    checked_margin_m,
)
from planner.collision.checker import MAX_JOINT, ClearanceChecker
from planner.collision.distances import UNKNOWN_DEPTH_M
from planner.collision.mover import Walk
from planner.collision.shape_pairs import CheckedPairs
from planner.errors import SceneError, TrajectoryError
from planner.prover.kernel import Trees, rows_kernel
from planner.prover.numpy_search import search
from planner.prover.problem import PAIR, SHARES, Chain, Found, Near, Outcome, PlacedShapes
from planner.trajectory import Trajectory

INSTANTS = 17
"""Number of instants at which the smallest distance is measured where the search gives none."""


def prove_clear(
    checker: ClearanceChecker, trajectory: Trajectory, q: ArrayLike, *, margin_m: float = 0.0
) -> ContinuousResult:
    """Prove that a motion of the checker's arm is clear, or find the contact that prevents it.

    Args:
        checker: the situation.
        trajectory: the motion of its arm.
        q: a full configuration, shape (19,), for all other joints; its values for the arm are not
            used.
        margin_m: distance that all pairs must keep, intended contacts excluded.

    Raises:
        TrajectoryError: when the motion is of other joints than the arm's, or reaches beyond
            `MAX_JOINT`.
        ConfigurationError: when `q` has another shape, is not finite or beyond `MAX_JOINT`.
        MotionError: when the margin is not a number, or negative.
    """
    expect(checker, ClearanceChecker, "checker", SceneError)
    expect(trajectory, Trajectory, "trajectory", TrajectoryError)
    _check_joints(trajectory, checker)
    full = checker.configuration(q)
    return prove_move(checker, trajectory, full, checked_margin_m(margin_m))


def prove_move(
    checker: ClearanceChecker,
    trajectory: Trajectory,
    full: FloatArray,
    margin_m: float,
    pairs: Indices | None = None,
) -> ContinuousResult:
    """`prove_clear` for valid arguments, and optionally for some pairs only.

    Args:
        checker: the situation.
        trajectory: the motion of its arm.
        full: a full configuration, shape (19,), for all other joints.
        margin_m: distance that all pairs without an own requirement must keep.
        pairs: numbers of the pairs; by default all.
    """
    bounds, checked = checker.motion_bounds, checker.checked
    numbers = np.arange(len(checked.pairs)) if pairs is None else pairs

    def poses(time_s: float) -> FloatArray:
        at: FloatArray = bounds.place(full, trajectory.sample(np.array([time_s])).q).shapes[0]
        return at

    if is_any_inside(checked, poses(0.0), numbers):
        needed_m = checked.required_m(margin_m)
        number, distance_m = worst_at(checked, poses(0.0), numbers, needed_m)
        near = checked.clearance_of(number, distance_m, 0.0)
        return ContinuousContact(near, float(needed_m[number]), trajectory.duration, 0, 0)
    arrangement, walk = Arrangement.of_mover(checker, full), checker.walk
    rows: Polynomials | FloatArray = walk.along(trajectory.q[0])
    if trajectory.duration > 0.0:
        at_knots = [walk.along(x) for x in (trajectory.q, trajectory.v, trajectory.a)]
        rows = Polynomials.of_knots(
            trajectory.knots_s, at_knots, walk.along(trajectory.j), "the motion"
        )
    return arrangement.prove(Motion(rows, trajectory.duration, poses), margin_m, numbers)


class Motion(NamedTuple):
    """The motion of the shapes of a situation.

    Attributes:
        rows: the motion of the chain's joints; or their positions, shape (joints,), rad, while
            shapes slide.
        duration_s: duration of the motion.
        poses: gives the poses of all shapes in base at a time, shape (n, 4, 4).
    """

    rows: Polynomials | FloatArray
    duration_s: float
    poses: Callable[[float], FloatArray]

    @property
    def end(self) -> float:
        """The end of its parameter, which is time, or the share of the way that shapes slide."""
        return self.rows.duration_s if isinstance(self.rows, Polynomials) else 1.0

    def time_s(self, at: float) -> float:
        """The time at a value of the parameter."""
        return at if isinstance(self.rows, Polynomials) else at * self.duration_s


class Arrangement:
    """The clusters of a situation on the joints of a chain that moves.

    Attributes:
        chain: the joints that move.
    """

    def __init__(
        self,
        checked: CheckedPairs,
        chain: Chain,
        levels: Indices,
        poses: FloatArray,
        *,
        slides_m: FloatArray | None = None,
        thicker_m: FloatArray | float = 0.0,
    ) -> None:
        """Place the shapes on the chain.

        Args:
            checked: the pairs of the situation, of n shapes.
            chain: the joints that move.
            levels: number of the joint that carries each shape, 0 for one that does not move, -1
                for one that the chain does not pass, shape (w, n). A chain may pass a shape up to w
                times; a pair is proven at the first passage of both.
            poses: of each shape seen from that joint, shape (w, n, 4, 4).
            slides_m: displacement of each shape along y of the last joint at the end, shape (n,).
            thicker_m: additional thickness, besides the padding, of each shape in pairs that must
                keep a margin, shape (n,).
        """
        self._checked, self.chain = checked, chain
        self._thicker_m: FloatArray = checked.shape_padding_m + thicker_m
        self._levels, self._poses = levels, poses
        self._slides_m = np.zeros(levels.shape[1]) if slides_m is None else slides_m

    @classmethod
    def of_mover(
        cls, checker: ClearanceChecker, full: FloatArray, walk: Walk | None = None
    ) -> Arrangement:
        """The arrangement on a checker's mover, all other joints as in a full configuration.

        On a part of the mover's walk, where one is given.
        """
        walk = checker.walk if walk is None else walk
        carriers, T = checker.motion_bounds.carried(full)
        levels, T_level_link = walk.levels[:, carriers], walk.T_level_link[:, carriers]
        return cls(checker.checked, walk.chain, levels, T_level_link @ T)

    def prove(self, motion: Motion, margin_m: float, numbers: Indices) -> ContinuousResult:
        """Prove that pairs keep their required distances, or find one that does not.

        Args:
            motion: their motion.
            margin_m: distance that all pairs without an own requirement must keep.
            numbers: of the pairs.
        """
        checked = self._checked
        numbers = np.unique(checked.representatives[numbers])
        if not len(numbers):
            return ContinuousProof(np.inf, Clearance(np.inf, "", ""), margin_m, 0, 0)
        if rows_kernel() is None:
            found = self._found_slowly(motion, margin_m, numbers)
        else:
            found = self._found(motion, margin_m, numbers)
        size = len(found.letters), int((found.letters <= BY_MIDDLES).sum())
        pair, distance_m, at = found.nearest
        if found.outcome == Outcome.PROVEN:
            near = Clearance(np.inf, "", "")
            if pair >= 0:
                near = checked.clearance_of(int(numbers[pair]), distance_m, motion.time_s(at))
            return ContinuousProof(found.proven_m, near, margin_m, *size)
        pair, _, at = found.stopped if found.stopped.pair >= 0 else found.nearest
        needed_m = checked.required_m(margin_m)
        for first in (0.0, at) if at == motion.end else (at,):  # both ends may be in contact
            time_s = motion.time_s(first)
            number, measured_m = worst_at(checked, motion.poses(time_s), numbers, needed_m)
            if measured_m <= needed_m[number]:
                break
        if measured_m > needed_m[number] or checked.is_contact[numbers[pair]]:
            number = int(numbers[pair])
            time_s, measured_m = _least(checked, motion, number)
        near = checked.clearance_of(number, measured_m, time_s)
        return ContinuousContact(near, float(needed_m[number]), motion.duration_s, *size)

    def _found(self, motion: Motion, margin_m: float, numbers: Indices) -> Found:
        """Search for rows of pairs that are all different."""
        checked, kernel = self._checked, rows_kernel()
        is_contact = checked.is_contact[numbers]
        placed, pairs = self.placed(numbers)
        pairs["is_counted"] = ~is_contact
        pairs["least"] = np.where(is_contact, checked.min_distances_m[numbers], 0.0)
        pairs["end"] = motion.end
        if kernel is None:
            return search(self.chain, placed, pairs, motion.rows, margin_m=margin_m)
        there, request = Trees(kernel, placed), (pairs, motion.rows)
        for share in SHARES:
            found = kernel.search(self.chain, there, *request, margin_m=margin_m, share=share)
            is_of_share = found.stopped.pair >= 0 and not is_contact[found.stopped.pair]
            if found.outcome != Outcome.NOT_SHOWN or not is_of_share:
                break
        return found

    def placed(self, numbers: Indices) -> tuple[PlacedShapes, np.ndarray[Any, Any]]:
        """The trees of pairs that are all different, and the pairs, of type `PAIR`, all counted."""
        checked = self._checked
        shapes, ways = checked.pairs[numbers], len(self._levels)
        way = (self._levels[:, shapes] >= 0).all(axis=2).argmax(axis=0)[:, None]
        levels = self._levels[way, shapes]
        is_swapped = levels[:, :1] < levels[:, 1:]
        shapes, levels = (np.where(is_swapped, x[:, ::-1], x) for x in (shapes, levels))
        is_contact = checked.is_contact[numbers]
        # padding counts where nothing may touch: a shape may occur with and without it
        used, place = np.unique(
            2 * (shapes * ways + way) + is_contact[:, None], return_inverse=True
        )
        index, way, is_bare = used // 2 // ways, used // 2 % ways, used % 2 == 1
        trees = [checked.tree(shape) for shape in index.tolist()]
        R, p = self._poses[way, index, :3, :3], self._poses[way, index, :3, 3]
        p = p + (R @ np.array([tree.p for tree in trees])[..., None])[..., 0]
        R = R @ np.array([tree.R for tree in trees])
        thicker_m = np.array([tree.margin_m for tree in trees])
        thicker_m += np.where(is_bare, 0.0, self._thicker_m[index])
        pairs = np.zeros(len(shapes), PAIR)
        pairs["first"], pairs["second"] = place.reshape(shapes.shape).T
        pairs["k"], pairs["m"] = levels.T
        pairs["is_counted"] = 1
        pairs["slides"][:, 1], pairs["slides"][:, 3] = self._slides_m[shapes].T
        return PlacedShapes([tree.clusters for tree in trees], R, p, thicker_m), pairs

    def _found_slowly(self, motion: Motion, margin_m: float, numbers: Indices) -> Found:
        """The search without C: for shares of the smallest distance measured at some instants."""
        checked, nearest = self._checked, Near(-1, np.inf, 0.0)
        counted = np.flatnonzero(~checked.is_contact[numbers])
        for at in np.linspace(0.0, motion.end, INSTANTS).tolist():
            poses = motion.poses(motion.time_s(at))
            gaps_m = checked.gaps_m(poses[None], np.zeros_like(counted), numbers[counted])
            checked.distances.place(poses)
            for i in np.argsort(gaps_m).tolist():
                if gaps_m[i] >= max(nearest.distance_m, 0.0):
                    break
                pair = int(counted[i])
                found_m = checked.distances.measure(int(numbers[pair]), nearest.distance_m)
                if found_m < nearest.distance_m:
                    nearest = Near(pair, found_m, at)
        for share in SHARES:
            found = self._found(motion, max(margin_m, share * nearest.distance_m), numbers)
            if found.outcome == Outcome.PROVEN:
                break
        return found._replace(nearest=nearest)


def _least(checked: CheckedPairs, motion: Motion, number: int) -> tuple[float, float]:
    """The time and the distance of a pair where it is nearest, at some instants."""
    found = []
    for at in np.linspace(0.0, motion.end, INSTANTS).tolist():
        checked.distances.place(motion.poses(motion.time_s(at)))
        found.append((checked.distances.measure(number), motion.time_s(at)))
    distance_m, time_s = min(found)
    return time_s, distance_m


def is_any_inside(checked: CheckedPairs, poses: FloatArray, numbers: Indices) -> bool:
    """Whether, in some pair, one shape is wholly inside the other's surface without touching it."""
    near = checked.gaps_m(poses[None], np.zeros_like(numbers), numbers) < 0.0
    near &= checked.distances.is_slow[numbers]
    checked.distances.place(poses)
    return any(checked.distances.is_within(number) for number in numbers[near].tolist())


def worst_at(
    checked: CheckedPairs, poses: FloatArray, numbers: Indices, needed_m: FloatArray
) -> tuple[int, float]:
    """The pair that falls short of its required distance by most, and its measured distance."""
    gaps_m = checked.gaps_m(poses[None], np.zeros_like(numbers), numbers)
    short = numbers[gaps_m <= np.maximum(needed_m[numbers], 0.0)]
    checked.distances.place(poses)
    found_m = np.array([checked.distances.measure(number) for number in short.tolist()])
    for i, number in enumerate(short.tolist()):
        if found_m[i] > 0.0 and checked.distances.is_within(number):
            found_m[i] = UNKNOWN_DEPTH_M
    if not len(short):
        return int(numbers[0]), np.inf
    worst = int((found_m - needed_m[short]).argmin())
    return int(short[worst]), float(found_m[worst])


def _check_joints(trajectory: Trajectory, checker: ClearanceChecker) -> None:
    names, moves = checker.mover.joint_names, trajectory.limits.names
    if moves != names:
        raise TrajectoryError(
            f"the motion is of {', '.join(moves)}; the situation is that of the "
            f"{' and the '.join(arm.side for arm in checker.arms)} arm, of {', '.join(names)}"
        )
    farthest = float(np.abs(np.concatenate(trajectory.position_extrema())).max())
    if farthest > MAX_JOINT:
        raise TrajectoryError(
            f"the motion reaches {farthest:g} rad; at most {MAX_JOINT:g} can be measured"
        )
