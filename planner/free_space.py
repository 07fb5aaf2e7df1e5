"""FreeSpace: which configurations of one arm touch nothing, answered fast, in one situation.

A search for a path asks this some thousand times, so the answer is a bare yes or no: Pinocchio
moves coal's shapes, a tree of their bounding boxes (broad phase) leaves few pairs to look at, and
the first contact ends the check. What touches what, and how deep, is `clearance`, fifty times
slower.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from baxter_kin import Baxter
from baxter_kin.arrays import Vector, finite_array, finite_scalar, float_array
from baxter_kin.display import OneLine
from baxter_kin.errors import ConfigurationError, expect
from planner.collision import Clearance, ClearanceChecker
from planner.contact import has_depth
from planner.errors import SceneError
from planner.manipulator import Manipulator
from planner.motion.obstacles import KEPT_SHARE, Obstacles

NEAR_RAD = 100.0
"""An array with joints below this needs no other check: `is_free` is asked some thousand times."""


class FreeSpace(OneLine):
    """Which configurations of one arm touch nothing, while all else stands still.

    The pairs of shapes, the allowed contacts and the depth from which one of them counts are those
    of the `ClearanceChecker`; a configuration is free exactly where its clearance is above zero.
    Not to be shared between threads.
    """

    def __init__(
        self, manipulator: Manipulator, checker: ClearanceChecker, *, finger_m: float
    ) -> None:
        """Look at a situation.

        Args:
            manipulator: the arm that moves, and where all other joints stand.
            checker: of the same arm, in that situation.
            finger_m: how far its fingers are open.

        Raises:
            SceneError: when one of them is none, or they are of different arms.
            ConfigurationError: when the fingers are outside their stroke.
        """
        expect(manipulator, Manipulator, "manipulator", SceneError)
        self._checker = expect(checker, ClearanceChecker, "checker", SceneError)
        arm = manipulator.arm
        if checker.arm.side != arm.side:
            raise SceneError(f"the checker is for the {checker.arm.side} arm, not the {arm.side}")
        q_full = next(manipulator.configurations(arm.neutral[None], finger_m))
        self._begin(manipulator.robot, checker, q_full)

    @classmethod
    def around(cls, robot: Baxter, checker: ClearanceChecker, q_others: ArrayLike) -> FreeSpace:
        """That of an arm whatever it has on its flange: a gripper, a tool, or nothing.

        Args:
            robot: the robot.
            checker: of the arm that moves, in that situation.
            q_others: a full configuration, which says where all joints but the arm's stand.

        Raises:
            SceneError: when robot or checker is of another class.
            ConfigurationError: when `q_others` has another shape or is not finite.
        """
        expect(robot, Baxter, "robot", SceneError)
        space = cls.__new__(cls)
        space._checker = expect(checker, ClearanceChecker, "checker", SceneError)
        count = len(robot.joint_names)
        q_full = finite_array(q_others, (count,), "q_others", ConfigurationError).copy()
        space._begin(robot, checker, q_full)
        return space

    def _begin(self, robot: Baxter, checker: ClearanceChecker, q_full: Vector) -> None:
        self._q_full = q_full
        self._where = np.array(robot.indices(checker.arm.joint_names))
        self._touches = Touches(checker)

    def is_free(self, q: ArrayLike) -> bool:
        """Whether the arm touches nothing at `q`, shape (7,), rad.

        Raises:
            ConfigurationError: when `q` has another shape or is not finite.
        """
        return not self._touches(self._full(q))

    def clearance(self, q: ArrayLike) -> Clearance:
        """The least distance at `q`, shape (7,), rad, and between what.

        Raises:
            ConfigurationError: when `q` has another shape or is not finite.
        """
        return self._checker.clearance(self._full(q))

    def with_margin(self, margin_m: float, *ends: ArrayLike) -> GuardedSpace:
        """This space less what is nearer than a margin to anything.

        Args:
            margin_m: distance to keep, not negative.
            ends: free configurations, each of shape (7,), rad, that stay free: two shapes nearer
                there than the margin keep `KEPT_SHARE` of that distance instead.

        Raises:
            SceneError: when the margin is not a number, or negative.
            ConfigurationError: when an end has another shape or is not finite.
        """
        _check_margin(margin_m)
        full_ends = [self._full(q).copy() for q in ends]
        touches = Touches(self._checker, margin_m)
        if any(touches(end) for end in full_ends):
            touches = Touches(self._checker, margin_m, self._nearest(full_ends, margin_m))
        return GuardedSpace(self, touches)

    def obstacles(self, resting: ArrayLike, margin_m: float) -> Obstacles:
        """What stands around, for motion programs.

        Args:
            resting: configurations at which the arm rests, shape (k, 7), rad.
            margin_m: distance to keep, not negative, as far as it is kept there.

        Raises:
            SceneError: when the margin is not a number, or negative.
            ConfigurationError: when the configurations have another shape or are not finite.
        """
        _check_margin(margin_m)
        qs = float_array(resting, "resting", ConfigurationError)
        full = [self._full(q).copy() for q in (qs if qs.ndim == 2 else [qs])]
        at = np.array(full).reshape(-1, len(self._q_full))[:, self._where]
        return Obstacles(self._checker, self._q_full.copy(), at, margin_m)

    def _facts(self) -> tuple[str, ...]:
        return (repr(self._checker),)

    def _full(self, q: ArrayLike) -> Vector:
        """A configuration with the rest of the robot, shape (19,); the next call overwrites it."""
        if not _is_near(q):
            q = finite_array(q, (7,), "q", ConfigurationError)
            full = self._q_full.copy()
            full[self._where] = q
            self._checker.configuration(full)
        self._q_full[self._where] = q
        return self._q_full

    def _nearest(self, qs_full: list[Vector], margin_m: float) -> Vector:
        """The least distance of every pair over some full configurations, shape (pairs,), m.

        Those beyond what makes them keep the whole margin are not measured any closer.
        """
        pairs, within_m = range(len(self._checker.may_touch)), margin_m / KEPT_SHARE
        found = [self._checker.distances_m(q, pairs, within_m) for q in qs_full]
        least: Vector = np.min(found, axis=0)
        return least


def _check_margin(margin_m: float) -> None:
    if finite_scalar(margin_m, "margin_m", SceneError) < 0.0:
        raise SceneError(f"margin_m must not be negative, got {margin_m}")


def _is_near(q: ArrayLike) -> bool:
    """Whether it is an array that needs no closer look; False for one that is not finite."""
    is_array = type(q) is np.ndarray and q.dtype == np.float64 and q.shape == (7,)
    return is_array and bool(np.abs(q).max() < NEAR_RAD)


class GuardedSpace:
    """A free space whose configurations keep a distance; made by `FreeSpace.with_margin`."""

    def __init__(self, space: FreeSpace, touches: Touches) -> None:
        self._space = space
        self._touches = touches

    def is_free(self, q: ArrayLike) -> bool:
        """Whether the arm keeps the distance at `q`, shape (7,), rad.

        Raises:
            ConfigurationError: when `q` has another shape or is not finite.
        """
        return not self._touches(self._space._full(q))


class Touches:
    """Whether any pair of shapes is nearer than its own margin.

    The shapes are the checker's; geometry, data and broad phase are made anew for every use, as the
    broad phase keeps bare pointers into them and none may change under it. A margin below zero is
    how deep shapes may be inside each other before they count; where coal does not know a depth, in
    meshes that are not convex, any contact does.
    """

    def __init__(
        self, checker: ClearanceChecker, margin_m: float = 0.0, nearest_m: Vector | None = None
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

    def __call__(self, q_full: Vector) -> bool:
        """At a full configuration, checked, shape (19,)."""
        found = pin.computeCollisions(self._model, self._data, self._broad_phase, q_full, True)
        return bool(found)


def _with_depth(checker: ClearanceChecker) -> NDArray[np.bool_]:
    """Of which pairs it is known how deep they are inside each other, shape (pairs,)."""
    known = np.array([has_depth(shape.geometry) for shape in checker.geometry.geometryObjects])
    first, second = checker.pairs.T
    of_pairs: NDArray[np.bool_] = np.logical_and(known[first], known[second])
    return of_pairs
