"""The robot's shapes: every link with a mesh, where Pinocchio places it."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin.description import RobotDescription, StockFiles
from planner.scene.contact import shape_of
from planner.verification.body.robot_body import NO_PARTS, SolidBody, robot_body
from planner.verification.urdf_robot import read_model

FILES = StockFiles.installed()
ROBOT = RobotDescription.installed()

SAME_PLACE = 1e-12
"""Rounding, of sines and of m."""


@pytest.fixture(scope="module")
def body() -> SolidBody:
    return robot_body(ROBOT)


def test_every_shape_is_where_pinocchio_places_it() -> None:
    model = read_model(ROBOT)
    shapes = pin.buildGeomFromUrdf(
        model, str(FILES.urdf), pin.GeometryType.VISUAL, package_dirs=[str(FILES.package_dir)]
    )
    ours = {solid.name: solid for solid in robot_body(ROBOT).solids}
    for theirs in shapes.geometryObjects:
        name = str(model.frames[theirs.parentFrame].name)
        if not any(word in name for word in NO_PARTS):
            solid = ours.pop(name)
            assert solid.joint == theirs.parentJoint
            off = solid.T_joint_shape.homogeneous - theirs.placement.homogeneous
            assert np.abs(off).max() < SAME_PLACE
            assert solid.is_surface or shape_of(solid.shape) == shape_of(theirs.geometry)
    assert sorted(ours) == ["left_hand_link", "right_hand_link"]


def test_both_arms_share_a_mesh() -> None:
    solids = {solid.name: solid for solid in robot_body(ROBOT).solids}
    left, right = solids["left_wrist"], solids["right_wrist"]
    assert left.shape is right.shape
    assert left.cover is right.cover
    assert left.joint != right.joint


def test_every_link_with_a_mesh_is_there_and_what_is_no_part_is_not(body: SolidBody) -> None:
    names = [solid.name for solid in body.solids]
    assert body.source == "Rethink's meshes"
    assert {"torso", "pedestal", "left_hand_link", "right_wrist", "l_gripper_r_finger_tip"} <= set(
        names
    )
    assert not [name for name in names if "collision_head" in name or name.endswith("_visual")]
