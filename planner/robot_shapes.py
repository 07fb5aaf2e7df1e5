"""RobotShapes: the robot's collision shapes, and the pairs of them worth checking."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pinocchio as pin

from baxter_kin import Arm, Baxter
from baxter_kin.errors import UnknownNameError, expect
from planner.contact import shape_of
from planner.errors import SceneError
from planner.scene import Part


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
