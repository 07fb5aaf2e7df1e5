"""The robot's and the scene's shapes during one run of moves, and the pairs that are checked.

The robot's shapes are read from the URDF with the pairs that the SRDF rules out removed. What
stands still to each other during the run is left out: what is fixed to the base, and the hand's
own shapes with what it holds. A contact is possible on purpose between the fingers and a body that
is grasped or released, and between a held body and what it touches when it is taken or put down.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pinocchio as pin

from baxter_kin.arrays import Vector
from baxter_kin.description import RobotDescription
from planner.contact import coal_shape, convex_pieces
from planner.scene import Body
from planner.verification.certificate import Worst
from planner.verification.story import Run
from planner.verification.urdf_robot import UrdfRobot, read_model


@dataclass(frozen=True, slots=True)
class Pair:
    """Two shapes whose distance is checked.

    Attributes:
        number: in the geometry model.
        first: link or body.
        second: link or body.
        body: name of the body that the fingers, or what they hold, may touch on purpose in it;
            None for all other pairs.
    """

    number: int
    first: str
    second: str
    body: str | None = None

    def __str__(self) -> str:
        """Both names."""
        return f"{self.first} with {self.second}"


@cache
def robot_shapes(files: RobotDescription) -> pin.GeometryModel:
    """The URDF's collision shapes, with all pairs but those that the SRDF rules out.

    Read once for the same files; nobody changes it.
    """
    model, urdf = read_model(files), str(files.urdf)
    folders = [str(files.package_dir)]
    shapes = pin.buildGeomFromUrdf(model, urdf, pin.GeometryType.COLLISION, package_dirs=folders)
    shapes.addAllCollisionPairs()
    pin.removeCollisionPairs(model, shapes, str(files.srdf))
    return shapes


def link_names(robot: UrdfRobot, shapes: pin.GeometryModel) -> list[str]:
    """The link that each shape of the robot belongs to."""
    return [str(robot.model.frames[s.parentFrame].name) for s in shapes.geometryObjects]


class RunGeometry:
    """Shapes and pairs of one run.

    Attributes:
        pairs: all that are checked.
        reach_m: for each joint of the arm, how far anything that it moves is from its axis at
            most, shape (n,).
    """

    def __init__(self, robot: UrdfRobot, shapes: pin.GeometryModel, run: Run) -> None:
        """Add the run's bodies to a copy of the robot's shapes."""
        self._robot, self._run = robot, run
        self._shapes = shapes.copy()
        allowed = [(pair.first, pair.second) for pair in shapes.collisionPairs]
        self._shapes.removeAllCollisionPairs()
        self.pairs: list[Pair] = []
        self._names = link_names(robot, shapes)
        moving = {int(joint) for joint in robot.model.subtrees[robot.arm_joints[0]]}
        hand = {robot.wrist, *robot.fingers}
        joints = [int(shape.parentJoint) for shape in shapes.geometryObjects]
        self._arm = [i for i, joint in enumerate(joints) if joint in moving]
        self._hand = {i for i in self._arm if joints[i] in hand}
        self._others = [i for i, joint in enumerate(joints) if joint not in moving]
        for first, second in allowed:
            if {first, second} & set(self._arm) and not {first, second} <= self._hand:
                self._pair(first, second)
        self._standing = self._add_standing()
        self._carried = self._add_carried()
        self.reach_m = self._reach()
        self._data, self._distances = robot.model.createData(), self._shapes.createData()

    def place(self, q: Vector) -> None:
        """Bring all shapes to where they are at a full configuration."""
        pin.updateGeometryPlacements(
            self._robot.model, self._data, self._shapes, self._distances, q
        )

    def distance_m(self, pair: Pair) -> float:
        """Distance of two shapes where they were placed; negative inside each other."""
        found = pin.computeDistance(self._shapes, self._distances, pair.number)
        return float(found.min_distance)

    def tip_base(self) -> Vector:
        """Where the tip is, seen from base, as it was placed; shape (3,), m."""
        T_base_tip = self._data.oMi[self._robot.wrist] * self._robot.T_wrist_tip()
        return np.array(T_base_tip.translation)

    def _add_standing(self) -> dict[str, list[int]]:
        """The scene's bodies, each against the arm; their shapes by name."""
        standing = {}
        for body in self._run.scene:
            near = body.name in (self._run.released, self._run.wanted)
            standing[body.name] = self._add(body, 0, body.T_base_body, in_pieces=near)
            for shape in standing[body.name]:
                for link in self._arm:
                    is_finger = int(self._parent(link)) in self._robot.fingers
                    self._pair(link, shape, body.name if near and is_finger else None)
        return standing

    def _add_carried(self) -> list[int]:
        """The held body, against all but the hand; its shapes."""
        carried = self._run.carried
        if carried is None:
            return []
        T_wrist_body = self._robot.T_wrist_tip() * carried.T_tip_body
        added = self._add(carried.body, self._robot.wrist, T_wrist_body)
        for shape in added:
            for link in [*self._others, *(set(self._arm) - self._hand)]:
                self._pair(shape, link)
            for name, standing in self._standing.items():
                for other in standing:
                    self._pair(shape, other, name)
        return added

    def _add(
        self, body: Body, joint: int, T_joint_body: pin.SE3, *, in_pieces: bool = False
    ) -> list[int]:
        added = []
        for part in body.parts:
            pieces = convex_pieces(part.shape) if in_pieces else (coal_shape(part.shape),)
            for piece in pieces:
                name = f"{body.name}/{self._shapes.ngeoms}"
                placement = T_joint_body * part.T_body_part
                shape = pin.GeometryObject(name, joint, placement, piece)
                added.append(int(self._shapes.addGeometryObject(shape)))
                self._names.append(body.name)
        return added

    def _pair(self, first: int, second: int, body: str | None = None) -> None:
        number = len(self.pairs)
        self._shapes.addCollisionPair(pin.CollisionPair(first, second))
        self.pairs.append(Pair(number, self._names[first], self._names[second], body))

    def _parent(self, shape: int) -> int:
        return int(self._shapes.geometryObjects[shape].parentJoint)

    def _reach(self) -> Vector:
        """Bounds on lever arms: the way from joint to joint, then to a shape's farthest point."""
        model, arm = self._robot.model, self._robot.arm_joints
        farthest = dict.fromkeys([*arm, *self._robot.fingers], 0.0)
        for shape in [*self._arm, *self._carried]:
            joint = self._parent(shape)
            farthest[joint] = max(farthest[joint], self._radius(shape))
        for finger in self._robot.fingers:
            away = float(np.linalg.norm(model.jointPlacements[finger].translation))
            reach = away + self._robot.stroke_m + farthest[finger]
            farthest[self._robot.wrist] = max(farthest[self._robot.wrist], reach)
        reaches: list[float] = []
        beyond = 0.0
        for joint in reversed(arm):
            beyond = max(farthest[joint], beyond)
            reaches.append(beyond)
            beyond += float(np.linalg.norm(model.jointPlacements[joint].translation))
        return np.array(reaches[::-1])

    def _radius(self, shape: int) -> float:
        """The farthest that a point of a shape is from the origin of its joint."""
        placed = self._shapes.geometryObjects[shape]
        placed.geometry.computeLocalAABB()
        centre = placed.placement.act(np.array(placed.geometry.aabb_center))
        return float(np.linalg.norm(centre) + placed.geometry.aabb_radius)


def standing_distance(
    robot: UrdfRobot, shapes: pin.GeometryModel, bodies: list[Body], q: Vector
) -> Worst:
    """The least distance of what the arm does not move, head and other arm, and its pair."""
    moving = {int(joint) for joint in robot.model.subtrees[robot.arm_joints[0]]}
    joints = [int(shape.parentJoint) for shape in shapes.geometryObjects]
    pairs = [(pair.first, pair.second) for pair in shapes.collisionPairs]
    kept = [pair for pair in pairs if not {joints[shape] for shape in pair} & moving]
    jointed = [i for i, joint in enumerate(joints) if joint not in {0, *moving}]
    geometry, names = shapes.copy(), link_names(robot, shapes)
    geometry.removeAllCollisionPairs()
    for body in bodies:
        for part in body.parts:
            placement, name = body.T_base_body * part.T_body_part, f"{body.name}/{len(names)}"
            shape = pin.GeometryObject(name, 0, placement, coal_shape(part.shape))
            index = int(geometry.addGeometryObject(shape))
            names.append(body.name)
            kept += [(link, index) for link in jointed]
    for first, second in kept:
        geometry.addCollisionPair(pin.CollisionPair(first, second))
    data, distances = robot.model.createData(), geometry.createData()
    nearest = int(pin.computeDistances(robot.model, data, geometry, distances, q))
    distance = distances.distanceResults[nearest].min_distance
    return Worst(float(distance), " with ".join(names[i] for i in kept[nearest]))
