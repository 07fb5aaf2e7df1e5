"""Swept proof: an arm's motion is clear at every instant, not only at samples.

While a motion passes a time interval, no point of a link moves farther from where it is in the
middle of the interval than its lever arms and the exact turns of the joints allow
(`planner.lever_arms`, `planner.joint_span`). The distance of two shapes changes by no more than
the farthest-moving point of one moves, seen from the other. That holds inside each other too,
where the distance is minus the depth: of convex shapes it is the greatest, over all directions, of
the gap between two planes across that direction, and no such gap changes by more. So a pair keeps a
distance above d - s during an interval in whose middle its distance is d, when s bounds that
motion. Where d - s is not enough, the interval is halved, for that pair alone (Schwarzer, Saha and
Latombe, "Adaptive dynamic collision checking for single and multiple articulated robots in
complex environments", IEEE Trans. Robotics 21(3), 2005).

Allowed contacts are proven in the same way, not to press in by more than `PRESSING_TOLERANCE_M`.
Distances are coal's; `ACCURACY_M` is subtracted from each before anything is concluded. Halving
goes on below the needed distance, until the proven clearance is at least `TIGHTNESS` of the least
distance that was found, or `SLACK_M` below it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baxter_kin.arrays import Indices, Vector, finite_scalar
from baxter_kin.errors import expect
from planner.collision import FARTHEST_JOINT, Clearance, ClearanceChecker
from planner.contact import PRESSING_TOLERANCE_M
from planner.errors import MotionError, SceneError, TrajectoryError
from planner.joint_span import JointSpan
from planner.lever_arms import LeverArms
from planner.swept_result import SweptContact, SweptProof, SweptResult
from planner.trajectory import Trajectory

ACCURACY_M = 1e-5
"""By how much coal's distances may be wrong up to 1 m; in proportion beyond. Its iterations end at
1e-6; against planes between random shapes of up to 10 m no distance was wrong by more than 2e-6."""

RESOLUTION_M = 2 * ACCURACY_M
"""What is found within this of the needed distance is not told apart from a contact."""

TIGHTNESS = 0.9
"""How much of the least distance found shall be proven."""

SLACK_M = 1e-3
"""How far below the least distance found the proven one may be, if that is less."""

FIRST_INTERVALS = 8
"""How many intervals a motion is cut into before any is halved."""

MOST_EVALUATIONS = 200_000
"""Distances computed before a proof is given up."""


def prove_clear(
    checker: ClearanceChecker,
    trajectory: Trajectory,
    q: ArrayLike,
    *,
    margin_m: float = 0.0,
) -> SweptResult:
    """A proof that a motion of the checker's arm is free of collision, or what speaks against it.

    Args:
        checker: the situation.
        trajectory: the motion of its arm.
        q: a full configuration, shape (19,), that says where all other joints stand; what it says
            of the arm is not used.
        margin_m: distance that every pair shall keep at least, allowed contacts left out.

    Raises:
        TrajectoryError: when the motion is of other joints than the arm's, or leaves what can be
            measured.
        ConfigurationError: when `q` is malformed.
        MotionError: when the margin is no number, or negative.
    """
    expect(checker, ClearanceChecker, "checker", SceneError)
    expect(trajectory, Trajectory, "trajectory", TrajectoryError)
    _check_joints(trajectory, checker)
    margin_m = checked_margin_m(margin_m)
    return _Search(checker, trajectory, checker.configuration(q), margin_m).run()


def checked_margin_m(margin_m: float) -> float:
    """A safety margin, if it is one.

    Raises:
        MotionError: when it is no number, or negative.
    """
    checked = finite_scalar(margin_m, "margin_m", MotionError)
    if checked < 0.0:
        raise MotionError(f"a safety margin is not negative, got {checked:g} m")
    return checked


@dataclass(frozen=True, slots=True, eq=False)
class _Tasks:
    """Pairs to be proven, each over an interval; pairs of one interval lie together.

    Attributes:
        starts_s: of the intervals, shape (m,).
        ends_s: of the intervals, shape (m,).
        interval: which one, for each task, shape (k,), increasing.
        pair: which pair, for each task, shape (k,).
    """

    starts_s: Vector
    ends_s: Vector
    interval: Indices
    pair: Indices

    @classmethod
    def of(cls, starts_s: Vector, ends_s: Vector, pairs: int) -> _Tasks:
        """Every pair over every interval."""
        count = len(starts_s)
        interval, pair = np.repeat(np.arange(count), pairs), np.tile(np.arange(pairs), count)
        return cls(starts_s, ends_s, interval, pair)

    @property
    def middles_s(self) -> Vector:
        """Middles of the intervals, shape (m,)."""
        return (self.starts_s + self.ends_s) / 2

    def only(self, chosen: NDArray[np.bool_]) -> _Tasks:
        """Some of them."""
        return _Tasks(self.starts_s, self.ends_s, self.interval[chosen], self.pair[chosen])

    def halved(self) -> _Tasks:
        """The same over both halves of their intervals."""
        kept, interval = np.unique(self.interval, return_inverse=True)
        starts, middles, ends = (x[kept] for x in (self.starts_s, self.middles_s, self.ends_s))
        return _Tasks(
            np.concatenate([starts, middles]),
            np.concatenate([middles, ends]),
            np.concatenate([interval, interval + len(kept)]),
            np.concatenate([self.pair, self.pair]),
        )


class _Search:
    """The proof while it is being made."""

    def __init__(
        self, checker: ClearanceChecker, trajectory: Trajectory, full: Vector, margin_m: float
    ) -> None:
        self._checker, self._full, self._margin_m = checker, full, margin_m
        self._duration_s = trajectory.duration
        self._span = JointSpan(trajectory)
        self._levers = LeverArms(checker.robot, checker.geometry, checker.arm)
        self._moving, self._other = _outer_first(checker.pairs, self._levers.depth)
        self._touch = checker.may_touch
        self._needed_m = np.where(self._touch, -PRESSING_TOLERANCE_M, margin_m)
        self._nearest = Clearance(np.inf, "", "")
        self._proven_m = np.inf
        self._intervals = self._evaluations = 0

    def run(self) -> SweptResult:
        """Both ends first, then the intervals between them, level by level."""
        try:
            self._look_at_ends()
            cuts = np.linspace(0.0, self._duration_s, FIRST_INTERVALS + 1)
            tasks = _Tasks.of(cuts[:-1], cuts[1:], len(self._moving))
            while tasks.pair.size:
                tasks = self._unproven(tasks).halved()
        except _NotClearError as stop:
            return stop.contact
        return SweptProof(
            self._proven_m, self._nearest, self._margin_m, self._intervals, self._evaluations
        )

    def _look_at_ends(self) -> None:
        """Measure every pair at both ends, which says how close a proof has to look."""
        ends_s = np.array([0.0, self._duration_s])
        tasks = _Tasks.of(ends_s, ends_s, len(self._moving))
        self._measured(tasks, self._span.around_middle(ends_s, ends_s)[0])

    def _unproven(self, tasks: _Tasks) -> _Tasks:
        """Those of the tasks that need smaller intervals."""
        self._intervals += len(tasks.starts_s)
        qs, turns = self._span.around_middle(tasks.starts_s, tasks.ends_s)
        placed = self._levers.place(self._full, qs)
        moving, other = self._moving[tasks.pair], self._other[tasks.pair]
        seen_from = self._levers.depth[other]
        motions = self._levers.motions_m(placed, turns)[tasks.interval, moving, seen_from]
        gaps = self._levers.gaps_m(placed, tasks.interval, moving, other)
        near = self._open(tasks, _sure(gaps) - motions)
        tasks = tasks.only(near)
        distances = self._measured(tasks, qs)
        return tasks.only(self._open(tasks, _sure(distances) - motions[near]))

    def _open(self, tasks: _Tasks, kept_m: Vector) -> NDArray[np.bool_]:
        """Whether keeping so much, shape (k,), is not enough yet for each task."""
        least_m = self._nearest.distance_m
        wanted_m = max(self._margin_m, min(TIGHTNESS * least_m, least_m - SLACK_M))
        enough = kept_m > np.where(self._touch, self._needed_m, wanted_m)[tasks.pair]
        counted = kept_m[enough & ~self._touch[tasks.pair]]
        self._proven_m = min(self._proven_m, float(counted.min(initial=np.inf)))
        return ~enough

    def _measured(self, tasks: _Tasks, qs: Vector) -> Vector:
        """Distances in the middle of the intervals, where the arm is at `qs`; shape (k,), m.

        Raises:
            _NotClearError: when one is too small, or there are too many.
        """
        distances = self._distances(tasks, qs)
        excess = distances - self._needed_m[tasks.pair]
        if (excess <= RESOLUTION_M).any():
            self._stop(tasks, distances, int(excess.argmin()))
        if self._evaluations > MOST_EVALUATIONS:
            self._stop(tasks, distances, int(excess.argmin()))
        counted = np.where(self._touch[tasks.pair], np.inf, distances)
        if counted.min(initial=np.inf) < self._nearest.distance_m:
            self._nearest = self._found(tasks, distances, int(counted.argmin()))
        return distances

    def _distances(self, tasks: _Tasks, qs: Vector) -> Vector:
        self._evaluations += len(tasks.pair)
        distances = np.empty(len(tasks.pair))
        numbers, begins = np.unique(tasks.interval, return_index=True)
        ends = np.searchsorted(tasks.interval, numbers, side="right")
        full = np.array(self._full)
        for number, begin, end in zip(numbers, begins, ends, strict=True):
            full[self._levers.q_index] = qs[number]
            pairs = tasks.pair[begin:end].tolist()
            distances[begin:end] = self._checker.distances_m(full, pairs)
        return distances

    def _found(self, tasks: _Tasks, distances: Vector, task: int) -> Clearance:
        time_s = float(tasks.middles_s[tasks.interval[task]])
        return self._checker.between(int(tasks.pair[task]), distances[task], time_s)

    def _stop(self, tasks: _Tasks, distances: Vector, task: int) -> NoReturn:
        raise _NotClearError(
            SweptContact(
                self._found(tasks, distances, task),
                float(self._needed_m[tasks.pair[task]]),
                self._duration_s,
                self._intervals,
                self._evaluations,
            )
        )


class _NotClearError(Exception):
    """Ends a search; becomes its result."""

    def __init__(self, contact: SweptContact) -> None:
        self.contact = contact
        super().__init__(str(contact))


def _sure(distances: Vector) -> Vector:
    """What is left of measured distances, shape (k,), m, when they are as wrong as they may be."""
    return distances - ACCURACY_M * np.maximum(1.0, distances)


def _outer_first(pairs: Indices, depth: Indices) -> tuple[Indices, Indices]:
    """The shape of each pair that more joints of the arm move, and the other; shape (n,) both."""
    swap = depth[pairs[:, 0]] < depth[pairs[:, 1]]
    first, second = pairs.T
    return np.where(swap, second, first), np.where(swap, first, second)


def _check_joints(trajectory: Trajectory, checker: ClearanceChecker) -> None:
    names, moves = checker.arm.joint_names, trajectory.limits.names
    if moves != names:
        raise TrajectoryError(
            f"the motion is of {', '.join(moves)}; the situation is the {checker.arm.side} arm's, "
            f"of {', '.join(names)}"
        )
    farthest = float(np.abs(np.concatenate(trajectory.position_extrema())).max())
    if farthest > FARTHEST_JOINT:
        raise TrajectoryError(
            f"the motion reaches {farthest:g} rad; up to {FARTHEST_JOINT:g} is measured"
        )
