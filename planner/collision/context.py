"""CollisionContext: one arm in one situation, or both, and what is free and clear there.

A search for a path tests some thousand configurations, so `is_free` gives a mere yes or no:
Pinocchio moves coal's shapes, a tree of their bounding boxes (broad phase) leaves few pairs to
test, and the first contact ends the test. `clearance`, which also measures distances, is fifty
times slower. A motion is screened at samples (`looks_clear`), which rejects it quickly, and then
proven (`planner.collision.proof`). `planner.pick_place.phases` makes the contexts of a pick and
place.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import cached_property, lru_cache
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from baxter_kin import Arm
from baxter_kin.display import OneLine, millimetres
from baxter_kin.errors import ConfigurationError
from baxter_kin.validation import FloatArray, expect, finite_array, float_array
from planner.clearance import Clearance, ContinuousResult, checked_margin_m
from planner.collision.checker import ClearanceChecker
from planner.collision.obstacles import KEPT_SHARE, Obstacles
from planner.collision.proof import prove_clear
from planner.errors import SceneError, TrajectoryError
from planner.scene.coal_shapes import has_depth
from planner.trajectory import Trajectory

IsFree: TypeAlias = Callable[[FloatArray], bool]
"""Whether an arm touches nothing at a configuration, shape (n,), rad."""

SCREENING_STEP_RAD = 0.03
"""Maximum motion of a joint between two samples that screen a motion before its proof."""

NEAR_RAD = 100.0
"""An array of joints below this is not checked further, as `is_free` is called very often."""


class CollisionContext(OneLine):
    """One arm in one situation, or both arms, and the distance that they keep.

    The checker defines the pairs of shapes, the intended contacts and their allowed depths; a
    configuration is free exactly where all other pairs are farther apart than the margin. Not to be
    shared between threads.

    Attributes:
        checker: of the arms that move, in the situation.
        margin_m: distance that everything keeps, intended contacts excluded.
    """

    def __init__(
        self, checker: ClearanceChecker, q_others: ArrayLike, *, margin_m: float = 0.0
    ) -> None:
        """Set the positions of all other joints; the arm may have a gripper, a tool, or nothing.

        Args:
            checker: of the arm that moves, in the situation.
            q_others: a full configuration, shape (19,), for all joints but the arm's.
            margin_m: distance to keep, not negative.

        Raises:
            SceneError: when the checker is of another class.
            ConfigurationError: when `q_others` has another shape or is not finite.
            MotionError: when the margin is not a number, or negative.
        """
        self.checker = expect(checker, ClearanceChecker, "checker", SceneError)
        self.margin_m = checked_margin_m(margin_m)
        self._q_full = self.checker.configuration(q_others, "q_others").copy()
        self._where = np.array(checker.shapes.robot.indices(checker.mover.joint_names))

    @property
    def arms(self) -> tuple[Arm, ...]:
        """The arms that move: one, or the left and the right."""
        return self.checker.arms

    @property
    def joints(self) -> int:
        """Number of joints that move, J."""
        return len(self._where)

    def alone(self, side: str, q_other: FloatArray | None = None) -> CollisionContext:
        """The context of one of two arms, as of `ClearanceChecker.alone`."""
        checker, q_full = self.checker.alone(side, q_other), self._q_full.copy()
        if q_other is not None:
            is_other = [not name.startswith(side) for name in self.checker.mover.joint_names]
            q_full[self._where[is_other]] = q_other
        return CollisionContext(checker, q_full, margin_m=self.margin_m)

    @property
    def q_others(self) -> FloatArray:
        """A full configuration, shape (19,); its values for the arm have no meaning."""
        return self._q_full.copy()

    def is_free(self, q: ArrayLike) -> bool:
        """Whether the arm keeps the margin at `q`, shape (7,), rad.

        Raises:
            ConfigurationError: when `q` has another shape or is not finite.
        """
        return not self._touches(self._full(q))

    def clearance(self, q: ArrayLike) -> Clearance:
        """The smallest distance at `q`, shape (7,), rad.

        Raises:
            ConfigurationError: when `q` has another shape or is not finite.
        """
        return self.checker.clearance(self._full(q))

    def prove(self, trajectory: Trajectory) -> ContinuousResult:
        """A proof that a motion keeps the margin, or the contact that prevents it."""
        return prove_clear(self.checker, trajectory, self._q_full, margin_m=self.margin_m)

    def is_clear(self, trajectory: Trajectory) -> bool:
        """Whether a motion is proven to keep the margin; samples are tested first.

        Raises:
            TrajectoryError: when the motion is of another class, or of other joints.
        """
        expect(trajectory, Trajectory, "trajectory", TrajectoryError)
        is_candidate = looks_clear(trajectory, self.is_free, SCREENING_STEP_RAD)
        return is_candidate and self.prove(trajectory).is_clear

    def with_margin(
        self, margin_m: float, *ends: ArrayLike, only_between_arms: bool = False
    ) -> CollisionContext:
        """The same context with another margin.

        Args:
            margin_m: distance to keep, not negative.
            ends: free configurations, each of shape (7,), rad, that remain free: two shapes nearer
                there than the margin keep `KEPT_SHARE` of that distance instead.
            only_between_arms: whether `is_free` tests nothing but one arm against the other, each
                with what it holds.

        Raises:
            MotionError: when the margin is not a number, or negative.
            ConfigurationError: when an end has another shape or is not finite.
        """
        other = CollisionContext(self.checker, self._q_full, margin_m=margin_m)
        full_ends = [self._full(q).copy() for q in ends]
        left_out: list[int] = []
        if only_between_arms:
            left_out = np.flatnonzero(~self.checker.is_between_arms).tolist()
            other._touches = Touches(self.checker, margin_m, left_out=left_out)
        if any(other._touches(end) for end in full_ends):
            nearest_m = self._nearest(full_ends, margin_m)
            other._touches = Touches(self.checker, margin_m, nearest_m, left_out)
        return other

    def obstacles(self, margin_m: float, resting: ArrayLike) -> Obstacles:
        """The obstacles around the arm, for motion programs.

        Args:
            margin_m: distance to keep, not negative, as far as it is kept where the arm rests.
            resting: configurations at which the arm rests, shape (k, 7), rad.

        Raises:
            MotionError: when the margin is not a number, or negative.
            ConfigurationError: when the configurations have another shape or are not finite.
        """
        qs = np.atleast_2d(float_array(resting, "resting", ConfigurationError))
        at = [self._full(q)[self._where] for q in qs]
        at_rest = np.array(at).reshape(-1, len(self._where))
        return Obstacles(self.checker, self.q_others, at_rest, checked_margin_m(margin_m))

    def _facts(self) -> tuple[str, ...]:
        return repr(self.checker), f"margin {millimetres(self.margin_m)}" if self.margin_m else ""

    @cached_property
    def _touches(self) -> Touches:
        return Touches(self.checker, self.margin_m)

    def _full(self, q: ArrayLike) -> FloatArray:
        """The full configuration of the robot at `q`; the next call overwrites it."""
        is_array = type(q) is np.ndarray and q.dtype == np.float64 and q.shape == (self.joints,)
        if not (is_array and np.abs(q).max() < NEAR_RAD):  # nor where one is NaN
            q = finite_array(q, (self.joints,), "q", ConfigurationError)
            full = self._q_full.copy()
            full[self._where] = q
            self.checker.configuration(full)
        self._q_full[self._where] = q
        return self._q_full

    def _nearest(self, qs_full: list[FloatArray], margin_m: float) -> FloatArray:
        """The smallest distance of every pair at some full configurations, shape (pairs,), m.

        Distances that are large enough for the whole margin are not measured exactly.
        """
        pairs, within_m = range(len(self.checker.may_touch)), margin_m / KEPT_SHARE
        found = [self.checker.distances_m(q, pairs, within_m) for q in qs_full]
        least: FloatArray = np.min(found, axis=0)
        return least


class Touches:
    """Whether any pair of shapes is nearer than its own margin.

    The shapes are the checker's. Geometry, data and broad phase are this object's own, as the broad
    phase keeps bare pointers into them. A negative margin is a depth up to which shapes may be
    inside each other; where coal does not know a depth, in meshes that are not convex, any contact
    counts.
    """

    def __init__(
        self,
        checker: ClearanceChecker,
        margin_m: float = 0.0,
        nearest_m: FloatArray | None = None,
        left_out: Iterable[int] = (),
    ) -> None:
        """Build the geometry.

        Args:
            checker: of the arm that moves.
            margin_m: distance that every pair keeps.
            nearest_m: the smallest distance of every pair that remains allowed, shape (pairs,), m.
            left_out: numbers of pairs that are ignored.
        """
        self._made_of = checker, margin_m, nearest_m, tuple(left_out)
        self._model, self._geometry = checker.robot, checker.for_contacts.copy()
        self._data, self._results = self._model.createData(), self._geometry.createData()
        margins_m = np.full(len(checker.pairs), margin_m)
        if nearest_m is not None:
            margins_m = np.minimum(margins_m, KEPT_SHARE * np.maximum(nearest_m, 0.0))
        if margin_m < 0.0:
            margins_m[~_with_depth(checker)] = 0.0
        contacts = checker.may_touch
        margins_m[contacts] = checker.checked.min_distances_m[contacts]
        margins_m += checker.checked.thickness_m
        for request, margin in zip(self._results.collisionRequests, margins_m, strict=True):
            request.security_margin = float(margin)
        for pair in self._made_of[-1]:
            self._results.deactivateCollisionPair(pair)
        self._broad_phase = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(
            self._model, self._geometry, self._results
        )

    def __reduce__(self) -> tuple[type[Touches], tuple[object, ...]]:
        return type(self), self._made_of

    def __call__(self, q_full: FloatArray) -> bool:
        """Whether they touch at a valid full configuration, shape (19,)."""
        found = pin.computeCollisions(self._model, self._data, self._broad_phase, q_full, True)
        return bool(found)

    def pairs(self, q_full: FloatArray) -> list[int]:
        """Numbers of all pairs that touch at a valid full configuration, shape (19,)."""
        results = self._results.collisionResults
        for result in results:
            result.clear()  # only pairs whose boxes meet are computed again
        pin.computeCollisions(self._model, self._data, self._broad_phase, q_full, False)
        return [pair for pair, result in enumerate(results) if result.isCollision()]


def _with_depth(checker: ClearanceChecker) -> NDArray[np.bool_]:
    """Whether coal measures depths for each pair, shape (pairs,)."""
    known = np.array([has_depth(shape.geometry) for shape in checker.geometry.geometryObjects])
    first, second = checker.pairs.T
    of_pairs: NDArray[np.bool_] = np.logical_and(known[first], known[second])
    return of_pairs


def looks_clear(trajectory: Trajectory, is_free: IsFree, step_rad: float) -> bool:
    """Whether a motion is free at samples, ends first, then by bisection.

    This rejects a motion quickly, but never proves that it is clear.

    Args:
        trajectory: the motion.
        is_free: called for each sample.
        step_rad: maximum motion of a joint between two samples, above zero.
    """
    times = sample_times(trajectory, step_rad)
    qs = trajectory.sample(times).q
    return all(is_free(qs[i]) for i in bisecting(len(times)))


def sample_times(trajectory: Trajectory, step_rad: float) -> FloatArray:
    """Times between which no joint moves by more than `step_rad`, both ends included."""
    if trajectory.duration == 0.0:
        return np.zeros(1)
    lengths = _top_speeds(trajectory) * np.diff(trajectory.knots_s)
    way = np.concatenate([[0.0], np.cumsum(lengths)])  # no joint has moved farther by then
    count = max(1, math.ceil(way[-1] / step_rad))
    return np.interp(np.linspace(0.0, way[-1], count + 1), way, trajectory.knots_s)


@lru_cache(maxsize=1024)
def bisecting(count: int) -> tuple[int, ...]:
    """The numbers 0 .. `count` - 1 in the order of bisection: both ends, the middle, the quarters.

    In this order, a collision in the middle of a motion is found after few samples.
    """
    inner = sorted(range(1, count - 1), key=lambda number: -(number & -number))
    return tuple(dict.fromkeys([0, count - 1, *inner])) if count else ()


def _top_speeds(trajectory: Trajectory) -> FloatArray:
    """Exact maximum speed of any joint in every segment, shape (m,), rad/s."""
    v = trajectory.v
    speeds: FloatArray = np.abs([v[:-1], v[1:], trajectory.turning_velocities]).max(axis=(0, 2))
    return speeds
