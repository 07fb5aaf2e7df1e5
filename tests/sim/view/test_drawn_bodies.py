from __future__ import annotations

import numpy as np
import pytest

from planner.scene.bodies import Body, Box, Cylinder, Part, Sphere
from sim.view.drawn_bodies import body_commands, body_path
from sim.view.meshcat_commands import packed
from tests.conftest import at
from tests.planner.conftest import mesh_of


def test_a_slash_in_a_name_makes_one_node() -> None:
    assert body_path("red/block").count("/") == 2


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


def test_a_mesh_is_drawn_with_its_corners_and_outward_normals() -> None:
    mesh = mesh_of([[0.0, 0.0, 0.5], [1.0, 0.0, 0.5], [0.0, 1.0, 0.5]], [[0, 1, 2]])
    body = Body("sail", (Part(mesh, at(0.0, 0.0, 0.0)),), at(0.0, 0.0, 0.0))
    (drawn,) = (c["object"] for c in body_commands(body) if c["type"] == "set_object")
    data = drawn["geometries"][0]["data"]
    corners, normals = (data["attributes"][name]["array"] for name in ("position", "normal"))
    assert np.array_equal(corners.reshape(3, 3)[data["index"]["array"]], mesh.vertices)
    assert np.array_equal(normals.reshape(3, 3), np.tile([0.0, 0.0, 1.0], (3, 1)))


def test_a_mesh_can_be_sent_to_the_browser() -> None:
    part = Part(mesh_of(np.eye(3), [[0, 1, 2]]), at(0.0, 0.0, 0.0))
    commands = list(body_commands(Body("sail", (part,), at(0.0, 0.0, 0.0))))
    assert all(packed(command) for command in commands)


def test_a_cylinder_stands_along_z() -> None:
    part = Part(Cylinder(0.1, 0.2), at(0.0, 0.0, 0.0))
    commands = list(body_commands(Body("can", (part,), at(0.0, 0.0, 0.0))))
    (matrix,) = (c["matrix"] for c in commands if c["type"] == "set_transform")
    axis_of_three_js = np.array(matrix).reshape(4, 4).T @ [0.0, 1.0, 0.0, 0.0]
    assert np.abs(axis_of_three_js[:3]).tolist() == pytest.approx([0.0, 0.0, 1.0])
