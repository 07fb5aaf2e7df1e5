"""Continuous proof: an arm's motion is clear at every instant, not only at samples.

While a motion passes a time interval, no point of a link moves farther from where it is in the
middle of the interval than its lever arms and the exact turns of the joints allow
(`planner.collision.continuous.motion_bounds`). The distance of two shapes changes by no more than
their farthest-moving points do, seen from what both hang on. That holds inside each other too,
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

from collections.abc import Sequence
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baxter_kin.errors import expect
from baxter_kin.validation import FloatArray, Indices
from planner.clearance import (
    Clearance,
    ContinuousContact,
    ContinuousProof,
    ContinuousResult,
    checked_margin_m,
)
from planner.collision.checker import FARTHEST_JOINT, ClearanceChecker
from planner.collision.continuous.motion import ArmShapeMotion, ShapeMotion
from planner.collision.continuous.tasks import Tasks
from planner.collision.distances import UNKNOWN_DEPTH_M
from planner.collision.shape_pairs import CheckedPairs
from planner.errors import SceneError, TrajectoryError
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

REFINED = 0.95
"""A distance is known exactly where it is below this share of the least one found so far; else that
it is not less will do. Of triangles, the exact one takes ten times as long."""

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
) -> ContinuousResult:
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
    motion = ArmShapeMotion(checker, trajectory, checker.configuration(q))
    return prove_motion(checker.checked, motion, margin_m)


def prove_motion(
    checked: CheckedPairs, motion: ShapeMotion, margin_m: float, pairs: Indices | None = None
) -> ContinuousResult:
    """A proof that a motion of any kind is clear, or what speaks against it.

    Args:
        checked: the pairs of the situation.
        motion: how their shapes move.
        margin_m: distance that every pair shall keep that has no need of its own.
        pairs: numbers of those that count; all when not given.
    """
    counted = np.arange(len(checked.numbers)) if pairs is None else pairs
    return _Search(checked, motion, margin_m, counted).run()


def contact_of(
    checked: CheckedPairs, motion: ShapeMotion, margin_m: float, pairs: Indices
) -> ContinuousContact | None:
    """What speaks against a motion, as `prove_motion` finds it, and no distance beyond that."""
    result = _Search(checked, motion, margin_m, pairs, least_m=-np.inf).run()
    return result if isinstance(result, ContinuousContact) else None


class _Search:
    """The proof while it is being made."""

    def __init__(
        self,
        checked: CheckedPairs,
        motion: ShapeMotion,
        margin_m: float,
        pairs: Indices,
        least_m: float = np.inf,
    ) -> None:
        self._checked, self._motion, self._margin_m, self._pairs = checked, motion, margin_m, pairs
        self._duration_s = motion.duration_s
        self._touch: NDArray[np.bool_] = checked.is_contact
        self._needed_m = checked.needed_m(margin_m)
        self._too_close_m: FloatArray = np.nextafter(self._needed_m + RESOLUTION_M, np.inf)
        self._nearest = Clearance(least_m, "", "")
        self._proven_m = np.inf
        self._intervals = self._evaluations = 0

    def run(self) -> ContinuousResult:
        """Both ends first, then the intervals between them, level by level."""
        try:
            self._look_at_ends()
            cuts = np.linspace(0.0, self._duration_s, FIRST_INTERVALS + 1)
            tasks = Tasks.of(cuts[:-1], cuts[1:], self._pairs)
            while tasks.pair.size:
                tasks = self._unproven(tasks).halved()
        except _NotClearError as stop:
            return stop.contact
        return ContinuousProof(
            self._proven_m, self._nearest, self._margin_m, self._intervals, self._evaluations
        )

    def _look_at_ends(self) -> None:
        """Measure the pairs at both ends, as long as they matter.

        What is quickly measured comes first, and then the nearest: what is not nearer than the
        least so far need not be known better. What is wholly inside a surface is looked for, too.
        """
        ends_s = np.array([0.0, self._duration_s])
        tasks, around = Tasks.of(ends_s, ends_s, self._pairs), self._motion.around(ends_s, ends_s)
        gaps, distances = around.gaps_m(tasks.interval, tasks.pair), self._checked.distances
        columns = tasks.pair, gaps, self._too_close_m[tasks.pair], self._touch[tasks.pair]
        order = np.lexsort((gaps, distances.is_slow[tasks.pair], tasks.interval))
        found, nearest_m = np.array(gaps), self._nearest.distance_m
        for end, each in enumerate(np.split(order, 2)):
            distances.place(around.poses[end])
            exact = []
            given = (each.tolist(), *(x[each].tolist() for x in columns))
            for task, pair, gap_m, told_m, is_contact in zip(*given, strict=True):
                asked_m = told_m if is_contact else max(told_m, nearest_m)
                if gap_m >= max(asked_m, 0.0):  # bounds below zero say nothing
                    continue
                self._evaluations += 1
                measured_m = distances.measure(pair, asked_m, asked_m)
                if measured_m > 0.0 and distances.is_within(pair):
                    measured_m = UNKNOWN_DEPTH_M
                found[task] = measured_m
                if measured_m < asked_m and not is_contact:
                    exact.append(task)
                    nearest_m = min(nearest_m, measured_m)
            self._judge(tasks, found, each, exact)

    def _unproven(self, tasks: Tasks) -> Tasks:
        """Those of the tasks that need smaller intervals."""
        self._intervals += len(tasks.starts_s)
        around = self._motion.around(tasks.starts_s, tasks.ends_s)
        motions = around.motions_m(tasks.interval, tasks.pair)
        gaps = around.gaps_m(tasks.interval, tasks.pair)
        near = self._open(tasks, _sure(gaps) - motions)
        tasks, gaps, motions = tasks.only(near), gaps[near], motions[near]
        wanted_m = self._wanted_m()[tasks.pair] + motions
        within_m = np.maximum(wanted_m + 2.0 * ACCURACY_M * np.maximum(1.0, wanted_m), 0.0)
        distances = self._measured(tasks, around.poses, gaps, within_m)
        return tasks.only(self._open(tasks, _sure(distances) - motions))

    def _wanted_m(self) -> FloatArray:
        """The distance that each pair shall be proven to keep, as it looks now, shape (n,)."""
        least_m = self._nearest.distance_m
        wanted_m = max(self._margin_m, min(TIGHTNESS * least_m, least_m - SLACK_M))
        return np.where(self._touch, self._needed_m, wanted_m)

    def _open(self, tasks: Tasks, kept_m: FloatArray) -> NDArray[np.bool_]:
        """Whether keeping so much, shape (k,), is not enough yet for each task."""
        enough = kept_m > self._wanted_m()[tasks.pair]
        counted = kept_m[enough & ~self._touch[tasks.pair]]
        self._proven_m = min(self._proven_m, float(counted.min(initial=np.inf)))
        return ~enough

    def _measured(
        self, tasks: Tasks, poses: FloatArray, gaps: FloatArray, within_m: FloatArray
    ) -> FloatArray:
        """Distances in the middle of the intervals, shape (k,), m, or lower bounds on them.

        Args:
            tasks: the pairs and intervals.
            poses: of all shapes in the middles.
            gaps: lower bounds on the distances, shape (k,).
            within_m: what is to be told apart, shape (k,).

        Raises:
            _NotClearError: when one is too small, or there are too many.
        """
        found, distances = np.array(gaps), self._checked.distances
        is_counted = ~self._touch[tasks.pair]
        refined_m = np.where(is_counted, REFINED * self._nearest.distance_m, -np.inf)
        exact_m = np.maximum(self._too_close_m[tasks.pair], refined_m)
        asked_m = np.maximum(within_m, exact_m)
        asked = np.flatnonzero(gaps < asked_m)
        columns = (asked, *(x[asked] for x in (tasks.interval, tasks.pair, asked_m, exact_m)))
        placed = None
        for task, interval, *given in zip(*(x.tolist() for x in columns), strict=True):
            if interval != placed:
                distances.place(poses[interval])
                placed = interval
            found[task] = distances.measure(*given)
        self._evaluations += len(asked)
        exact = asked[is_counted[asked] & (found < exact_m)[asked]]
        self._judge(tasks, found, np.arange(len(found)), exact.tolist())
        return found

    def _judge(self, tasks: Tasks, found: FloatArray, each: Indices, exact: Sequence[int]) -> None:
        """Stop where one of some is too near; and take over the nearest of those known exactly."""
        pairs = tasks.pair[each]
        is_too_close = (found[each] < self._too_close_m[pairs]).any()
        if is_too_close or (len(each) and self._evaluations > MOST_EVALUATIONS):
            excess = found[each] - self._needed_m[pairs]
            self._stop(tasks, found, int(each[excess.argmin()]))
        least = min(exact, key=lambda task: float(found[task]), default=-1)
        if least >= 0 and found[least] < self._nearest.distance_m:
            self._nearest = self._found(tasks, found, least)

    def _found(self, tasks: Tasks, distances: FloatArray, task: int) -> Clearance:
        time_s = float(tasks.middles_s[tasks.interval[task]])
        return self._checked.between(int(tasks.pair[task]), distances[task], time_s)

    def _stop(self, tasks: Tasks, distances: FloatArray, task: int) -> NoReturn:
        raise _NotClearError(
            ContinuousContact(
                self._found(tasks, distances, task),
                float(self._needed_m[tasks.pair[task]]),
                self._duration_s,
                self._intervals,
                self._evaluations,
            )
        )


class _NotClearError(Exception):
    """Ends a search; becomes its result."""

    def __init__(self, contact: ContinuousContact) -> None:
        self.contact = contact
        super().__init__(str(contact))


def _sure(distances: FloatArray) -> FloatArray:
    """What is left of measured distances, shape (k,), m, when they are as wrong as they may be."""
    return distances - ACCURACY_M * np.maximum(1.0, distances)


def _check_joints(trajectory: Trajectory, checker: ClearanceChecker) -> None:
    names, moves = checker.mover.joint_names, trajectory.limits.names
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
