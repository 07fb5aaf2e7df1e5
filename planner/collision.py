"""Distances between the robot and its scene (coal enters here).

Pinocchio and coal work on one geometry model: the robot's collision shapes, the bodies of the
scene, and the body in the hand. A model is built for each situation and never changed afterwards,
because adding shapes to one in use corrupts its memory.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin import Arm, Baxter
from baxter_kin.arrays import Vector, finite_array, finite_scalar
from baxter_kin.errors import ConfigurationError, UnknownNameError
from baxter_kin.frames import checked_pose
from planner.errors import SceneError, expect
from planner.scene import Body, Box, Cylinder, Part, Scene, Shape, Sphere

CONTACT_TOLERANCE_M = 1e-9
"""Shapes closer than this touch."""

PRESSING_TOLERANCE_M = 5e-4
"""How deep an allowed contact may press before it counts as a collision."""

DISTANCE_TOLERANCE_M = 1e-8
"""Accuracy of distances where a contact is sought; coal's default, 1e-6, overshoots."""

SLIDING = 1e-3
"""Shapes in contact that close in by less than this share of the way slide along each other."""

UNIT_TOLERANCE = 1e-9
"""How far the length of a unit vector may be from 1 by rounding."""

_MAX_ADVANCES = 1000


@dataclass(frozen=True, slots=True)
class Clearance:
    """The least distance that was found, and where.

    Attributes:
        distance_m: negative when the two are inside each other.
        first: link or body.
        second: link or body.
    """

    distance_m: float
    first: str
    second: str


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


class RobotShapes:
    """The robot's collision shapes and the pairs of them worth checking."""

    def __init__(self, robot: Baxter) -> None:
        """Remember the robot; nothing is read before it is asked for."""
        self.robot = robot

    @cached_property
    def model(self) -> pin.GeometryModel:
        """Every collision shape, with all pairs but those that the SRDF rules out."""
        files = self.robot.description
        shapes = pin.buildGeomFromUrdf(
            self.robot.model,
            str(files.urdf),
            pin.GeometryType.COLLISION,
            package_dirs=[str(files.package_dir)],
        )
        shapes.addAllCollisionPairs()
        pin.removeCollisionPairs(self.robot.model, shapes, str(files.srdf))
        return shapes

    def part_at_tip(self, name: str, arm: Arm) -> Part:
        """A collision shape of the hand, seen from the tip with the fingers closed.

        Raises:
            UnknownNameError: when the robot has no such shape.
        """
        expect(arm, Arm, "arm", SceneError)
        names = [str(shape.name) for shape in self.model.geometryObjects]
        if not isinstance(name, str) or name not in names:
            raise UnknownNameError("collision shape", name, names)
        shape = self.model.geometryObjects[self.model.getGeometryId(name)]
        model, data = self.robot.model, self.robot.model.createData()
        pin.framesForwardKinematics(model, data, np.zeros(model.nq))
        T_base_tip = data.oMf[model.getFrameId(arm.tip_frame)]
        T_base_part = data.oMi[shape.parentJoint] * shape.placement
        return Part(shape_of(shape.geometry), T_base_tip.inverse() * T_base_part)


class ClearanceChecker:
    """How close one arm comes to anything it must not touch, in one situation.

    Checked are the arm's shapes against the rest of the robot, against themselves and against the
    bodies of the scene, and a held body against all but the hand. Not checked are the pairs that
    the SRDF rules out and the shapes of one hand among themselves. Some contacts are allowed on
    purpose: the fingers with the body they are about to grasp or have just released, and a held
    body with what it stood or will stand on. They count only when they press in by more than
    `PRESSING_TOLERANCE_M`.
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
        self._robot = shapes.robot.model
        self._geometry = shapes.model.copy()
        self._arm_shapes = _shapes_of(shapes, arm)
        self._hand_shapes = [i for i in self._arm_shapes if _is_of_hand(self._name(i))]
        self._contacts: list[int] = []  # indices of the pairs that may touch
        self._keep_pairs_of_arm()
        supports = self._add_scene(scene, touchable, held)
        if held is not None:
            self._add_held(held, arm, supports)
        self._data = self._robot.createData()
        self._distances = self._geometry.createData()

    def clearance(self, q: ArrayLike) -> Clearance:
        """The least distance at a full configuration, shape (19,), allowed contacts left out.

        Raises:
            ConfigurationError: when `q` has another shape or is not finite.
        """
        full = finite_array(q, (self._robot.nq,), "q", ConfigurationError)
        pin.computeDistances(self._robot, self._data, self._geometry, self._distances, full)
        found = [result.min_distance for result in self._distances.distanceResults]
        for contact in self._contacts:
            if found[contact] > -PRESSING_TOLERANCE_M:
                found[contact] = np.inf
        nearest = int(np.argmin(found))
        pair = self._geometry.collisionPairs[nearest]
        return Clearance(float(found[nearest]), self._link(pair.first), self._link(pair.second))

    def _keep_pairs_of_arm(self) -> None:
        kept = [(pair.first, pair.second) for pair in self._geometry.collisionPairs]
        self._geometry.removeAllCollisionPairs()
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
            for index in self._add_body(body, 0, body.T_base_body):
                if held is not None and body.name in held.supports:
                    supports.add(index)
                for other in self._arm_shapes:
                    self._add_pair(other, index, may_touch=other in fingers)
        return supports

    def _add_held(self, held: Held, arm: Arm, supports: set[int]) -> None:
        tip = self._robot.frames[self._robot.getFrameId(arm.tip_frame)]
        shapes = self._geometry.geometryObjects
        others = [
            i
            for i in range(self._geometry.ngeoms)
            if i not in self._hand_shapes and shapes[i].parentJoint != tip.parentJoint
        ]
        for index in self._add_body(held.body, tip.parentJoint, tip.placement * held.T_tip_body):
            for other in others:
                self._add_pair(index, other, may_touch=other in supports)

    def _add_body(self, body: Body, joint: int, T_joint_body: pin.SE3) -> list[int]:
        indices = []
        for number, part in enumerate(body.parts):
            placement = T_joint_body * part.T_body_part
            name = f"{body.name}/{number}"
            shape = pin.GeometryObject(name, joint, placement, coal_shape(part.shape))
            indices.append(self._geometry.addGeometryObject(shape))
        return indices

    def _add_pair(self, first: int, second: int, *, may_touch: bool = False) -> None:
        if may_touch:
            self._contacts.append(len(self._geometry.collisionPairs))
        self._geometry.addCollisionPair(pin.CollisionPair(first, second))

    def _name(self, index: int) -> str:
        return str(self._geometry.geometryObjects[index].name)

    def _link(self, index: int) -> str:
        """The link or body that a shape belongs to: its name without the running number."""
        name = self._name(index)
        return name.rsplit("/", 1)[0] if "/" in name else name.rsplit("_", 1)[0]


def travel_to_contact(
    moving: Part, direction: ArrayLike, still: Part, room_m: float
) -> float | None:
    """How far a convex shape moves along a line until it touches another; None if it does not.

    Conservative advancement (Mirtich 1996): two planes across the shortest connection keep convex
    shapes apart, so a shape may move until it has used up the gap between them, and never touches
    when it does not move towards them. Shapes in contact touch at once, unless one slides along
    the other or leaves it.

    Args:
        moving: the shape that moves, placed in some frame.
        direction: unit vector in that frame, shape (3,).
        still: the other shape, placed in the same frame.
        room_m: how far it may move at most.

    Raises:
        SceneError: when an argument is malformed, or the direction is not of unit length.
    """
    along = _unit(direction)
    finite_scalar(room_m, "room_m", SceneError)
    first, second = (
        coal_shape(expect(part, Part, "a shape to move", SceneError).shape)
        for part in (moving, still)
    )
    pair = coal.ComputeDistance(first, second)  # keeps bare pointers: both must stay alive here
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance = DISTANCE_TOLERANCE_M
    R, p = moving.T_body_part.rotation, moving.T_body_part.translation
    T_still = coal.Transform3s(still.T_body_part.rotation, still.T_body_part.translation)
    travel = 0.0
    for _ in range(_MAX_ADVANCES):
        result.clear()
        gap = pair(coal.Transform3s(R, p + travel * along), T_still, request, result)
        closing = float(along @ result.normal)  # gap lost per distance moved
        if gap <= CONTACT_TOLERANCE_M:
            return travel if travel > 0.0 or closing > SLIDING else None
        if closing <= 0.0 or gap > closing * (room_m - travel):
            return None
        travel += gap / closing
    return travel


def touching(body: Body, scene: Scene) -> frozenset[str]:
    """Names of the other bodies that a body touches within `PRESSING_TOLERANCE_M`."""
    return frozenset(
        other.name
        for other in scene
        if other.name != body.name and _gap_m(body, other) <= PRESSING_TOLERANCE_M
    )


def coal_shape(shape: Shape) -> coal.CollisionGeometry:
    """Our shape as coal's."""
    if isinstance(shape, Box):
        return coal.Box(*shape.size_m)
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.radius_m, shape.length_m)
    return coal.Sphere(shape.radius_m)


def shape_of(geometry: coal.CollisionGeometry) -> Shape:
    """Coal's shape as ours.

    Raises:
        SceneError: when it is neither box, cylinder nor sphere.
    """
    if isinstance(geometry, coal.Box):
        x, y, z = (2 * geometry.halfSide).tolist()
        return Box((x, y, z))
    if isinstance(geometry, coal.Cylinder):
        return Cylinder(geometry.radius, 2 * geometry.halfLength)
    if isinstance(geometry, coal.Sphere):
        return Sphere(geometry.radius)
    raise SceneError(f"only boxes, cylinders and spheres are known, not {type(geometry).__name__}")


def least(clearances: Iterable[Clearance]) -> Clearance | None:
    """The smallest of several, or None of none."""
    return min(clearances, key=lambda clearance: clearance.distance_m, default=None)


def _check_situation(scene: Scene, touchable: str | None, held: Held | None) -> None:
    expect(scene, Scene, "scene", SceneError)
    if touchable is not None:
        _ = scene[touchable]  # says what there is
    if held is not None and expect(held, Held, "held", SceneError).body.name in scene.bodies:
        raise SceneError(f"{held.body.name!r} is in the hand; take it out of the scene")


def _gap_m(body: Body, other: Body) -> float:
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    gaps = []
    for first, second in product(_placed(body), _placed(other)):
        result.clear()
        gaps.append(coal.distance(*first, *second, request, result))
    return float(min(gaps))


def _placed(body: Body) -> list[tuple[coal.CollisionGeometry, coal.Transform3s]]:
    poses = [body.T_base_body * part.T_body_part for part in body.parts]
    return [
        (coal_shape(part.shape), coal.Transform3s(T.rotation, T.translation))
        for part, T in zip(body.parts, poses, strict=True)
    ]


def _unit(direction: ArrayLike) -> Vector:
    along = finite_array(direction, (3,), "direction", SceneError)
    length = float(np.linalg.norm(along))
    if abs(length - 1.0) > UNIT_TOLERANCE:
        raise SceneError(f"direction {along.tolist()} has length {length:.6g}; it must have 1")
    return along


def _is_of_hand(name: str) -> bool:
    return "gripper" in name or "hand" in name


def _shapes_of(shapes: RobotShapes, arm: Arm) -> list[int]:
    model = shapes.robot.model
    root = model.getJointId(arm.joint_names[0])
    moving = set(model.subtrees[root].tolist())
    return [i for i, s in enumerate(shapes.model.geometryObjects) if s.parentJoint in moving]
