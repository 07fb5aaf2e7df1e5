"""RobotShapes: the robot's collision shapes, and the pairs of them worth checking."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pinocchio as pin

from baxter_kin import Arm, Baxter
from baxter_kin.errors import expect
from planner.contact import has_depth, shape_of
from planner.distances import Cover
from planner.errors import SceneError
from planner.scene import Part


class RobotShapes:
    """The robot's collision shapes and the pairs of them worth checking."""

    def __init__(self, robot: Baxter) -> None:
        """Remember the robot; nothing is read before it is asked for."""
        self.robot = robot

    @cached_property
    def model(self) -> pin.GeometryModel:
        """Every shape, without pairs."""
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

    @cached_property
    def links(self) -> tuple[str, ...]:
        """The link that each shape belongs to."""
        frames = self.robot.model.frames
        return tuple(str(frames[s.parentFrame].name) for s in self.model.geometryObjects)

    @cached_property
    def covers(self) -> tuple[Cover | None, ...]:
        """What the triangles of each shape need; None for convex ones."""
        return tuple(
            Cover.box_around(s.geometry) if not has_depth(s.geometry) else None
            for s in self.model.geometryObjects
        )

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """The pairs of shapes that may meet."""
        return tuple((pair.first, pair.second) for pair in self.model.collisionPairs)

    def of_arm(self, arm: Arm) -> frozenset[int]:
        """The shapes that an arm moves, those of its hand among them."""
        return self._below(arm.joint_names[0])

    def of_hand(self, arm: Arm) -> frozenset[int]:
        """The shapes that move with the last joint of an arm, its wrist among them."""
        return self._below(arm.joint_names[-1])

    def of_fingers(self, arm: Arm) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """The shapes of both fingers, those of the one that opens along +y of the tip first."""
        first, second = (
            tuple(sorted(self._below(f"{arm.side[0]}_gripper_{finger}_finger_joint")))
            for finger in "lr"
        )
        return first, second

    def of_palm(self, arm: Arm) -> frozenset[int]:
        """The shapes of the hand that are not of a finger."""
        return self.of_hand(arm).difference(*self.of_fingers(arm))

    def of_pads(self, arm: Arm) -> frozenset[int]:
        """The shapes of both finger tips, which may press on what is grasped."""
        fingers = {index for finger in self.of_fingers(arm) for index in finger}
        return frozenset(index for index in fingers if self.links[index].endswith("_tip"))

    def part_at_tip(self, index: int, arm: Arm) -> Part:
        """A shape of the hand, seen from the tip with the fingers closed."""
        expect(arm, Arm, "arm", SceneError)
        shape = self.model.geometryObjects[index]
        return Part(shape_of(shape.geometry), self._T_tip_shape(index, arm))

    def highest_at_tip_m(self, index: int, arm: Arm) -> float:
        """How far the box around a shape of the hand reaches along z of the tip."""
        geometry = self.model.geometryObjects[index].geometry
        geometry.computeLocalAABB()
        middle = (geometry.aabb_local.max_ + geometry.aabb_local.min_) / 2
        T_tip_shape = self._T_tip_shape(index, arm)
        reach = np.abs(T_tip_shape.rotation[2]) @ (geometry.aabb_local.max_ - middle)
        return float(T_tip_shape.act(middle)[2] + reach)

    def _T_tip_shape(self, index: int, arm: Arm) -> pin.SE3:
        shape = self.model.geometryObjects[index]
        model, data = self.robot.model, self.robot.model.createData()
        pin.framesForwardKinematics(model, data, np.zeros(model.nq))
        T_base_tip = data.oMf[model.getFrameId(arm.tip_frame)]
        return T_base_tip.inverse() * data.oMi[shape.parentJoint] * shape.placement

    def _below(self, joint: str) -> frozenset[int]:
        model = self.robot.model
        moved = set(model.subtrees[model.getJointId(joint)].tolist())
        shapes = self.model.geometryObjects
        return frozenset(i for i, shape in enumerate(shapes) if shape.parentJoint in moved)
