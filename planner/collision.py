"""Distances between the robot and its scene.

Pinocchio and coal work on one geometry model: the robot's collision shapes, the bodies of the
scene, and the body in the hand. A model is built for each situation and never changed afterwards,
because adding shapes to one in use corrupts its memory.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from baxter_kin import Arm
from baxter_kin.arrays import Indices, Vector, finite_array
from baxter_kin.errors import ConfigurationError, expect
from baxter_kin.frames import checked_pose
from planner.contact import PRESSING_TOLERANCE_M, coal_shape, convex_pieces
from planner.errors import SceneError
from planner.robot_shapes import RobotShapes
from planner.scene import Body, Scene

__all__ = ["Clearance", "ClearanceChecker", "Held", "RobotShapes", "least"]

FARTHEST_JOINT = 1000.0
"""Joint values beyond this, rad or m, are none; distances would lose digits."""

UNKNOWN_DEPTH_M = -0.01
"""Stands for the distance where coal finds shapes inside each other but not how deep."""

_NO_DISTANCE_M = -1e6


@dataclass(frozen=True, slots=True)
class Clearance:
    """The least distance that was found, and where.

    Attributes:
        distance_m: negative when the two are inside each other.
        first: link or body.
        second: link or body.
        time_s: when, from the start of the motion; None when it was at no time of one.
    """

    distance_m: float
    first: str
    second: str
    time_s: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """A body in the hand.

    Attributes:
        body: what is held.
        T_tip_body: its pose seen from the tip.
        supports: names of the bodies it may touch, because it stood or will stand on them.
    """

    body: Body
    T_tip_body: pin.SE3
    supports: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        """Check and copy."""
        expect(self.body, Body, "a held body", SceneError)
        object.__setattr__(self, "T_tip_body", checked_pose(self.T_tip_body))
        object.__setattr__(self, "supports", frozenset(self.supports))


class ClearanceChecker:
    """How close one arm comes to anything it must not touch, in one situation.

    Checked are the arm's shapes against the rest of the robot, against themselves and against the
    bodies of the scene, and a held body against all but the hand. Not checked are the pairs that
    the SRDF rules out and the shapes of one hand among themselves. Some contacts are allowed on
    purpose: the fingers with the body they are about to grasp or have just released, and a held
    body with what it stood or will stand on. They count only when they press in by more than
    `PRESSING_TOLERANCE_M`.

    Attributes:
        arm: the arm that moves.
        robot: the model of the whole robot.
        geometry: all shapes, and the pairs of them that are checked.
    """

    def __init__(
        self,
        shapes: RobotShapes,
        arm: Arm,
        scene: Scene,
        *,
        touchable: str | None = None,
        held: Held | None = None,
    ) -> None:
        """Build the geometry of that situation.

        Args:
            shapes: the robot's.
            arm: the arm that moves.
            scene: bodies that stand still; not the held one.
            touchable: name of a body that the fingers may touch.
            held: what the hand carries.

        Raises:
            SceneError: when the touchable body is not in the scene, or the held one is.
        """
        expect(shapes, RobotShapes, "shapes", SceneError)
        expect(arm, Arm, "arm", SceneError)
        _check_situation(scene, touchable, held)
        self.arm = arm
        self.robot: pin.Model = shapes.robot.model
        self.geometry: pin.GeometryModel = shapes.model.copy()
        self._arm_shapes = _shapes_of(shapes, arm)
        self._hand_shapes = [i for i in self._arm_shapes if _is_of_hand(self._name(i))]
        self._contacts: list[int] = []  # indices of the pairs that may touch
        self._keep_pairs_of_arm()
        supports = self._add_scene(scene, touchable, held)
        if held is not None:
            self._add_held(held, arm, supports)
        self._data = self.robot.createData()
        self._distances = self.geometry.createData()

    def clearance(self, q: ArrayLike) -> Clearance:
        """The least distance at a full configuration, shape (19,), allowed contacts left out.

        Raises:
            ConfigurationError: when `q` has another shape or is not finite.
        """
        full = self.configuration(q)
        pin.computeDistances(self.robot, self._data, self.geometry, self._distances, full)
        found = [_known(result.min_distance) for result in self._distances.distanceResults]
        for contact in self._contacts:
            if found[contact] > -PRESSING_TOLERANCE_M:
                found[contact] = np.inf
        nearest = int(np.argmin(found))
        return self.between(nearest, found[nearest])

    def configuration(self, q: ArrayLike) -> Vector:
        """A full configuration, shape (19,), known to be one that distances can be measured in.

        Raises:
            ConfigurationError: when it has another shape, is not finite or beyond `FARTHEST_JOINT`.
        """
        full = finite_array(q, (self.robot.nq,), "q", ConfigurationError)
        if np.abs(full).max() > FARTHEST_JOINT:
            raise ConfigurationError(
                f"a joint stands at {np.abs(full).max():g}; up to {FARTHEST_JOINT:g} is measured"
            )
        return full

    @property
    def pairs(self) -> Indices:
        """The shapes of every pair, shape (n, 2)."""
        return np.array([(pair.first, pair.second) for pair in self.geometry.collisionPairs])

    @property
    def may_touch(self) -> NDArray[np.bool_]:
        """Whether a pair is an allowed contact, shape (n,)."""
        allowed = np.zeros(len(self.geometry.collisionPairs), dtype=np.bool_)
        allowed[self._contacts] = True
        return allowed

    def distances_m(self, full: Vector, pairs: Iterable[int]) -> list[float]:
        """The distances of some pairs at a checked full configuration, shape (19,)."""
        geometry, distances = self.geometry, self._distances
        pin.updateGeometryPlacements(self.robot, self._data, geometry, distances, full)
        measure = pin.computeDistance
        return [_known(measure(geometry, distances, pair).min_distance) for pair in pairs]

    def between(self, pair: int, distance_m: float, time_s: float | None = None) -> Clearance:
        """A distance of a pair, by its names."""
        shapes = self.geometry.collisionPairs[pair]
        names = self._link(shapes.first), self._link(shapes.second)
        return Clearance(float(distance_m), *names, time_s)

    def _keep_pairs_of_arm(self) -> None:
        kept = [(pair.first, pair.second) for pair in self.geometry.collisionPairs]
        self.geometry.removeAllCollisionPairs()
        hand = set(self._hand_shapes)
        for first, second in kept:
            moving = first in self._arm_shapes or second in self._arm_shapes
            if moving and not (first in hand and second in hand):
                self._add_pair(first, second)

    def _add_scene(self, scene: Scene, touchable: str | None, held: Held | None) -> set[int]:
        """Add the bodies; returns the shapes of those that the held body may touch."""
        supports = set()
        for body in scene:
            fingers = set(self._hand_shapes) if body.name == touchable else set()
            carries = held is not None and body.name in held.supports
            in_pieces = carries or body.name == touchable
            for index in self._add_body(body, 0, body.T_base_body, in_pieces=in_pieces):
                if carries:
                    supports.add(index)
                for other in self._arm_shapes:
                    self._add_pair(other, index, may_touch=other in fingers)
        return supports

    def _add_held(self, held: Held, arm: Arm, supports: set[int]) -> None:
        tip = self.robot.frames[self.robot.getFrameId(arm.tip_frame)]
        shapes = self.geometry.geometryObjects
        others = [
            i
            for i in range(self.geometry.ngeoms)
            if i not in self._hand_shapes and shapes[i].parentJoint != tip.parentJoint
        ]
        T_joint_body = tip.placement * held.T_tip_body
        in_pieces = bool(supports)
        for index in self._add_body(held.body, tip.parentJoint, T_joint_body, in_pieces=in_pieces):
            for other in others:
                self._add_pair(index, other, may_touch=other in supports)

    def _add_body(
        self, body: Body, joint: int, T_joint_body: pin.SE3, *, in_pieces: bool
    ) -> list[int]:
        """Add its shapes; in convex pieces where a depth must be known, as in allowed contacts."""
        indices = []
        for number, part in enumerate(body.parts):
            placement = T_joint_body * part.T_body_part
            shapes = convex_pieces(part.shape) if in_pieces else (coal_shape(part.shape),)
            for piece, shape in enumerate(shapes):
                name = f"{body.name}/{number}.{piece}"
                placed = pin.GeometryObject(name, joint, placement, shape)
                indices.append(self.geometry.addGeometryObject(placed))
        return indices

    def _add_pair(self, first: int, second: int, *, may_touch: bool = False) -> None:
        if may_touch:
            self._contacts.append(len(self.geometry.collisionPairs))
        self.geometry.addCollisionPair(pin.CollisionPair(first, second))

    def _name(self, index: int) -> str:
        return str(self.geometry.geometryObjects[index].name)

    def _link(self, index: int) -> str:
        """The link or body that a shape belongs to: its name without the running number."""
        name = self._name(index)
        return name.rsplit("/", 1)[0] if "/" in name else name.rsplit("_", 1)[0]


def least(clearances: Iterable[Clearance]) -> Clearance | None:
    """The smallest of several, or None of none."""
    return min(clearances, key=lambda clearance: clearance.distance_m, default=None)


def _check_situation(scene: Scene, touchable: str | None, held: Held | None) -> None:
    expect(scene, Scene, "scene", SceneError)
    if touchable is not None:
        _ = scene[touchable]  # says what there is
    if held is not None and expect(held, Held, "held", SceneError).body.name in scene.bodies:
        raise SceneError(f"{held.body.name!r} is in the hand; take it out of the scene")


def _known(distance_m: float) -> float:
    """Coal's number, unless it is the one that says it failed to find a depth."""
    return distance_m if distance_m > _NO_DISTANCE_M else UNKNOWN_DEPTH_M


def _is_of_hand(name: str) -> bool:
    return "gripper" in name or "hand" in name


def _shapes_of(shapes: RobotShapes, arm: Arm) -> list[int]:
    model = shapes.robot.model
    root = model.getJointId(arm.joint_names[0])
    moving = set(model.subtrees[root].tolist())
    return [i for i, s in enumerate(shapes.model.geometryObjects) if s.parentJoint in moving]
