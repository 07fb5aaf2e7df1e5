from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from planner.scene.bodies import Body, Box, Cylinder, Part, Sphere
from sim.view.appearance import Appearance
from sim.view.meshcat_commands import TUBE_STEP_M, packed
from sim.view.scenegraph import (
    FLOOR_RADII_M,
    RobotTree,
    body_commands,
    body_path,
    line_command,
    stage_commands,
)
from tests.conftest import at
from tests.planner.conftest import mesh_of


@pytest.fixture(scope="module")
def tree(robot: Baxter) -> RobotTree:
    return RobotTree(robot.model, Appearance.load())


def test_nodes_nest_as_the_joints_do(tree: RobotTree, robot: Baxter) -> None:
    path = tree.paths[robot.joint_names.index("left_s1")]
    assert path == "/robot/left_s0/moves/left_s1/moves"


@pytest.mark.parametrize("joint", range(19))
def test_a_node_moves_as_its_joint_does(tree: RobotTree, robot: Baxter, joint: int) -> None:
    q = pin.neutral(robot.model)
    q[joint] = 0.02
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    placement = robot.model.jointPlacements[joint + 1]
    wanted = placement.inverse() * data.liMi[joint + 1]
    key, value = tree.motion(joint, q[joint])
    shown = {"position": [0.0, 0.0, 0.0], "quaternion": [0.0, 0.0, 0.0, 1.0]} | {key: value}
    T_shown = pin.XYZQUATToSE3(np.array([*shown["position"], *shown["quaternion"]]))
    assert T_shown.isApprox(wanted, 1e-12)
    values = np.array([-0.3, 0.0, 0.7])
    key, rows = tree.motions(joint, values)
    assert [(key, row) for row in rows.tolist()] == [tree.motion(joint, value) for value in values]


@pytest.mark.parametrize("axis", [0, 2])
def test_a_line_is_as_thick_as_asked_in_any_direction(axis: int) -> None:
    points = np.zeros((3, 3))
    points[:, axis] = [0.0, 0.5, 1.0]
    command = line_command("/path", points, 0.01, (0.0, 0.0, 1.0))
    position = command["object"]["geometries"][0]["data"]["attributes"]["position"]
    across = np.linalg.norm(np.delete(position["array"].reshape(-1, 3), axis, axis=1), axis=1)
    assert across == pytest.approx(0.01, abs=TUBE_STEP_M)


def test_the_floor_fades_out_and_faces_up() -> None:
    (floor,) = (c["object"] for c in stage_commands() if c["type"] == "set_object")
    data = floor["geometries"][0]["data"]
    corners = data["attributes"]["position"]["array"].reshape(-1, 3)
    opacities = data["attributes"]["color"]["array"].reshape(-1, 4)[:, 3]
    a, b, c = corners[data["index"]["array"].reshape(-1, 3)].transpose(1, 0, 2)
    assert (np.cross(b - a, c - a)[:, 2] > -1e-9).all()
    assert np.linalg.norm(corners[opacities == 0.0], axis=1) == pytest.approx(FLOOR_RADII_M[-1])


def test_every_shape_of_a_body_is_drawn() -> None:
    shapes = (
        Box((0.1, 0.1, 0.1)),
        Cylinder(0.1, 0.2),
        Sphere(0.1),
        mesh_of(np.eye(3), [[0, 1, 2]]),
    )
    parts = tuple(Part(shape, at(0.0, 0.0, 0.0)) for shape in shapes)
    commands = list(body_commands(Body("thing", parts, at(0.0, 0.0, 0.0))))
    drawn = [c["object"]["geometries"][0]["type"] for c in commands if c["type"] == "set_object"]
    assert drawn == ["BoxGeometry", "CylinderGeometry", "SphereGeometry", "BufferGeometry"]
    assert all(packed(command) for command in commands)
    assert body_path("red/block").count("/") == 2  # one node


def test_a_mesh_is_drawn_with_its_corners_and_outward_normals() -> None:
    mesh = mesh_of([[0.0, 0.0, 0.5], [1.0, 0.0, 0.5], [0.0, 1.0, 0.5]], [[0, 1, 2]])
    body = Body("sail", (Part(mesh, at(0.0, 0.0, 0.0)),), at(0.0, 0.0, 0.0))
    (drawn,) = (c["object"] for c in body_commands(body) if c["type"] == "set_object")
    data = drawn["geometries"][0]["data"]
    corners, normals = (data["attributes"][name]["array"] for name in ("position", "normal"))
    assert np.array_equal(corners.reshape(3, 3)[data["index"]["array"]], mesh.vertices)
    assert np.array_equal(normals.reshape(3, 3), np.tile([0.0, 0.0, 1.0], (3, 1)))


def test_a_cylinder_stands_along_z() -> None:
    part = Part(Cylinder(0.1, 0.2), at(0.0, 0.0, 0.0))
    commands = list(body_commands(Body("can", (part,), at(0.0, 0.0, 0.0))))
    (matrix,) = (c["matrix"] for c in commands if c["type"] == "set_transform")
    axis_of_three_js = np.array(matrix).reshape(4, 4).T @ [0.0, 1.0, 0.0, 0.0]
    assert np.abs(axis_of_three_js[:3]).tolist() == pytest.approx([0.0, 0.0, 1.0])
