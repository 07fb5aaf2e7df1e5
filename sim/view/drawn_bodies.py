"""Bodies of a scene as Meshcat nodes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from urllib.parse import quote

import numpy as np
import pinocchio as pin

from planner.scene.bodies import Body, Box, Cylinder, Part
from planner.scene.mesh import Mesh
from sim.view.meshcat_commands import Command, material, set_object, set_transform, triangles


def body_path(name: str, root: str = "") -> str:
    """The node of a body below a root. A slash in its name does not make two nodes of it."""
    return f"{root}/bodies/{quote(name, safe=' ')}"


def body_commands(body: Body, root: str = "", surface: Command | None = None) -> Iterator[Command]:
    """The shapes of a body; where it stands comes by `pose_commands`.

    Args:
        body: what to draw.
        root: the node below which it is drawn.
        surface: instead of its own colours.
    """
    for index, part in enumerate(body.parts):
        path = f"{body_path(body.name, root)}/{index}"
        red, green, blue, opacity = part.rgba
        own = material((red, green, blue), opacity=opacity) if surface is None else surface
        yield set_object(path, _geometry(part), own)
        yield set_transform(path, part.T_body_part * _T_part_geometry(part))


def _geometry(part: Part) -> Command:
    """The shape of a part as three.js has it."""
    shape = part.shape
    if isinstance(shape, Box):
        return {"type": "BoxGeometry"} | dict(
            zip(("width", "height", "depth"), shape.size_m, strict=True)
        )
    if isinstance(shape, Cylinder):
        size = {
            "radiusTop": shape.radius_m,
            "radiusBottom": shape.radius_m,
            "height": shape.length_m,
        }
        return {"type": "CylinderGeometry", "radialSegments": 48} | size
    if isinstance(shape, Mesh):
        return _flat_faces(shape)
    segments = {"widthSegments": 32, "heightSegments": 24}
    return {"type": "SphereGeometry", "radius": shape.radius_m} | segments


def _flat_faces(mesh: Mesh) -> Command:
    """Every triangle with corners and a normal of its own, so that edges look sharp."""
    corners = mesh.corners
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    vertices = corners.reshape(-1, 3).astype(np.float32)
    faces = np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3)
    return triangles(vertices, faces, np.repeat(normals, 3, axis=0).astype(np.float32))


def _T_part_geometry(part: Part) -> pin.SE3:
    """Cylinders of three.js stand along y, ours along z."""
    if isinstance(part.shape, Cylinder):
        return pin.SE3(pin.utils.rotate("x", math.pi / 2), np.zeros(3))
    return pin.SE3.Identity()
