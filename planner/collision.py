"""Distances between the robot and its scene.

Pinocchio and coal work on one geometry model: the robot's collision shapes, the bodies of the
scene, and the body in the hand. A model is built for each situation and never changed afterwards,
because adding shapes to one in use corrupts its memory.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin import Arm, Baxter
from baxter_kin.arrays import finite_array
from baxter_kin.errors import ConfigurationError, UnknownNameError, expect
from baxter_kin.frames import checked_pose
from planner.contact import PRESSING_TOLERANCE_M, coal_shape, shape_of
from planner.errors import SceneError
from planner.scene import Body, Part, Scene


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


def least(clearances: Iterable[Clearance]) -> Clearance | None:
    """The smallest of several, or None of none."""
    return min(clearances, key=lambda clearance: clearance.distance_m, default=None)


def _check_situation(scene: Scene, touchable: str | None, held: Held | None) -> None:
    expect(scene, Scene, "scene", SceneError)
    if touchable is not None:
        _ = scene[touchable]  # says what there is
    if held is not None and expect(held, Held, "held", SceneError).body.name in scene.bodies:
        raise SceneError(f"{held.body.name!r} is in the hand; take it out of the scene")


def _is_of_hand(name: str) -> bool:
    return "gripper" in name or "hand" in name


def _shapes_of(shapes: RobotShapes, arm: Arm) -> list[int]:
    model = shapes.robot.model
    root = model.getJointId(arm.joint_names[0])
    moving = set(model.subtrees[root].tolist())
    return [i for i, s in enumerate(shapes.model.geometryObjects) if s.parentJoint in moving]
