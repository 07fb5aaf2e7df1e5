"""CollisionContext: one arm in one situation, asked what is free, what is clear, and by how much.

A search for a path asks some thousand times whether a configuration is free, so the answer is a
bare yes or no: Pinocchio moves coal's shapes, a tree of their bounding boxes (broad phase) leaves
few pairs to look at, and the first contact ends the check. What touches what, and how deep, is
`clearance`, fifty times slower. The situations of a pick and place are on
`planner.pick_place.phases`.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from baxter_kin.display import OneLine, millimetres
from baxter_kin.errors import ConfigurationError
from baxter_kin.validation import FloatArray, expect, finite_array, float_array
from planner.clearance import Clearance, ContinuousResult, checked_margin_m
from planner.collision.checker import ClearanceChecker
from planner.collision.continuous.proof import prove_clear
from planner.collision.obstacles import KEPT_SHARE, Obstacles
from planner.collision.sampling import SCREENING_STEP_RAD, looks_clear
from planner.errors import SceneError
from planner.scene.contact import has_depth
from planner.trajectory import Trajectory

NEAR_RAD = 100.0
"""An array with joints below this needs no other check: `is_free` is asked some thousand times."""


class CollisionContext(OneLine):
    """What stands around one arm, what it holds and may touch, and the distance that it keeps.

    The pairs of shapes, the allowed contacts and the depth from which one of them counts are those
    of the checker; a configuration is free exactly where all other pairs are farther apart than the
    margin. Not to be shared between threads.

    Attributes:
        checker: of the arm that moves, in that situation.
        margin_m: distance that everything keeps, allowed contacts left out.
    """

    def __init__(
        self, checker: ClearanceChecker, q_others: ArrayLike, *, margin_m: float = 0.0
    ) -> None:
        """For an arm whatever it has on its flange: a gripper, a tool, or nothing.

        Args:
            checker: of the arm that moves, in that situation.
            q_others: a full configuration, shape (19,), which says where all joints but the arm's
                stand.
            margin_m: distance to keep, not negative.

        Raises:
            SceneError: when the checker is of another class.
            ConfigurationError: when `q_others` has another shape or is not finite.
            MotionError: when the margin is not a number, or negative.
        """
        self.checker = expect(checker, ClearanceChecker, "checker", SceneError)
        self.margin_m = checked_margin_m(margin_m)
        q_full = finite_array(q_others, (checker.robot.nq,), "q_others", ConfigurationError)
        self._q_full = self.checker.configuration(q_full).copy()
        self._where = np.array(checker.shapes.robot.indices(checker.mover.joint_names))

    @property
    def joints(self) -> int:
        """How many joints move, J."""
        return len(self._where)

    @property
    def q_others(self) -> FloatArray:
        """Where all other joints stand, shape (19,); of the arm's own it says nothing."""
        return self._q_full.copy()

    def is_free(self, q: ArrayLike) -> bool:
        """Whether the arm keeps the margin at `q`, shape (7,), rad.

        Raises:
            ConfigurationError: when `q` has another shape or is not finite.
        """
        return not self._touches(self._full(q))

    def clearance(self, q: ArrayLike) -> Clearance:
        """The least distance at `q`, shape (7,), rad, and between what.

        Raises:
            ConfigurationError: when `q` has another shape or is not finite.
        """
        return self.checker.clearance(self._full(q))

    def prove(self, trajectory: Trajectory) -> ContinuousResult:
        """A proof that a motion keeps the margin, or what speaks against it."""
        return prove_clear(self.checker, trajectory, self._q_full, margin_m=self.margin_m)

    def is_clear(self, trajectory: Trajectory) -> bool:
        """Whether a motion is proven to keep the margin; looked at in samples first."""
        looks = looks_clear(trajectory, self.is_free, SCREENING_STEP_RAD)
        return looks and self.prove(trajectory).is_clear

    def with_margin(self, margin_m: float, *ends: ArrayLike) -> CollisionContext:
        """The same with another margin.

        Args:
            margin_m: distance to keep, not negative.
            ends: free configurations, each of shape (7,), rad, that stay free: two shapes nearer
                there than the margin keep `KEPT_SHARE` of that distance instead.

        Raises:
            MotionError: when the margin is not a number, or negative.
            ConfigurationError: when an end has another shape or is not finite.
        """
        other = CollisionContext(self.checker, self._q_full, margin_m=margin_m)
        full_ends = [self._full(q).copy() for q in ends]
        if any(other._touches(end) for end in full_ends):
            other._touches = Touches(self.checker, margin_m, self._nearest(full_ends, margin_m))
        return other

    def obstacles(self, margin_m: float, resting: ArrayLike) -> Obstacles:
        """What stands around, for motion programs.

        Args:
            margin_m: distance to keep, not negative, as far as it is kept where the arm rests.
            resting: configurations at which it does, shape (k, 7), rad.

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
        """A configuration with the rest of the robot, shape (19,); the next call overwrites it."""
        is_array = type(q) is np.ndarray and q.dtype == np.float64 and q.shape == (self.joints,)
        if not (is_array and np.abs(q).max() < NEAR_RAD):  # nor where one is NaN
            q = finite_array(q, (self.joints,), "q", ConfigurationError)
            full = self._q_full.copy()
            full[self._where] = q
            self.checker.configuration(full)
        self._q_full[self._where] = q
        return self._q_full

    def _nearest(self, qs_full: list[FloatArray], margin_m: float) -> FloatArray:
        """The least distance of every pair over some full configurations, shape (pairs,), m.

        Those beyond what makes them keep the whole margin are not measured any closer.
        """
        pairs, within_m = range(len(self.checker.may_touch)), margin_m / KEPT_SHARE
        found = [self.checker.distances_m(q, pairs, within_m) for q in qs_full]
        least: FloatArray = np.min(found, axis=0)
        return least


class Touches:
    """Whether any pair of shapes is nearer than its own margin.

    The shapes are the checker's; geometry, data and broad phase are made anew for every use, as the
    broad phase keeps bare pointers into them and none may change under it. A margin below zero is
    how deep shapes may be inside each other before they count; where coal does not know a depth, in
    meshes that are not convex, any contact does.
    """

    def __init__(
        self, checker: ClearanceChecker, margin_m: float = 0.0, nearest_m: FloatArray | None = None
    ) -> None:
        self._made_of = checker, margin_m, nearest_m
        self._model, self._geometry = checker.robot, checker.for_contacts.copy()
        self._data, self._results = self._model.createData(), self._geometry.createData()
        margins_m = np.full(len(checker.pairs), margin_m)
        if nearest_m is not None:
            margins_m = np.minimum(margins_m, KEPT_SHARE * np.maximum(nearest_m, 0.0))
        if margin_m < 0.0:
            margins_m[~_with_depth(checker)] = 0.0
        contacts = checker.may_touch
        margins_m[contacts] = checker.checked.needs_m[contacts]
        margins_m += checker.checked.padding_m
        for request, margin in zip(self._results.collisionRequests, margins_m, strict=True):
            request.security_margin = float(margin)
        self._broad_phase = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(
            self._model, self._geometry, self._results
        )

    def __reduce__(self) -> tuple[type[Touches], tuple[object, ...]]:
        return type(self), self._made_of

    def __call__(self, q_full: FloatArray) -> bool:
        """At a full configuration, checked, shape (19,)."""
        found = pin.computeCollisions(self._model, self._data, self._broad_phase, q_full, True)
        return bool(found)


def _with_depth(checker: ClearanceChecker) -> NDArray[np.bool_]:
    """Of which pairs it is known how deep they are inside each other, shape (pairs,)."""
    known = np.array([has_depth(shape.geometry) for shape in checker.geometry.geometryObjects])
    first, second = checker.pairs.T
    of_pairs: NDArray[np.bool_] = np.logical_and(known[first], known[second])
    return of_pairs
