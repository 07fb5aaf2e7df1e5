"""Rethink's meshes as the files have them, and where the URDF puts them.

The files are read with pycollada. Pinocchio's reader (through Coal and Assimp) keeps the vertices
but joins the wrong ones wherever a file has several sub-meshes: 10 to 30 % of the triangles of E0,
E1, W0, W1, W2 and of the gripper's base.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import collada
import numpy as np
from collada.common import DaeBrokenRefError, DaeUnsupportedError
from collada.triangleset import BoundTriangleSet
from numpy.typing import NDArray

from baxter_kin.description import StockFiles

F = NDArray[np.float64]

NO_PART_OF_THE_ROBOT = ("collision_head_link_1", "collision_head_link_2")
"""Red spheres beside the head, 22 cm as collision shapes: they keep other planners' arms away."""


class Placed(NamedTuple):
    """A shape of a link: mesh file or primitive, and its placement in the link's frame (m)."""

    link: str
    mesh: str
    primitive: tuple[str, tuple[float, ...]]
    R_link_shape: F
    p_link_shape: F


IN_PLACE_OF = {"extended_wide": "extended_narrow"}
"""Meshes of what may be mounted on a gripper, and of what on the stock robot instead."""


@cache
def _files() -> dict[str, Path]:
    root = StockFiles.installed().urdf.parent.parent / "meshes"
    return {file.stem: file for file in sorted(root.rglob("*.DAE"))}


@cache
def triangles(mesh: str) -> F:
    """All triangles of a mesh file, shape (n, 3, 3), mm; those without area are left out."""
    document = collada.Collada(str(_files()[mesh]), ignore=[DaeUnsupportedError, DaeBrokenRefError])
    found = []
    for geometry in document.scene.objects("geometry"):
        for primitive in geometry.primitives():
            part = primitive.triangleset() if hasattr(primitive, "triangleset") else primitive
            if isinstance(part, BoundTriangleSet) and len(part):
                corners = np.asarray(part.vertex, dtype=np.float64)
                found.append(corners[np.asarray(part.vertex_index).reshape(-1, 3)])
    soup = np.concatenate(found) * 1e3
    area = np.linalg.norm(np.cross(soup[:, 1] - soup[:, 0], soup[:, 2] - soup[:, 0]), axis=1)
    return np.ascontiguousarray(soup[area > 0.0])


def placed_shapes() -> Iterator[Placed]:
    """Every shape that is part of the robot: visuals, and collision shapes of links without.

    Then what may be mounted instead, on both fingers of a hand; see `RobotBody.links` for its name.
    """
    shapes = list(_shapes_of_the_urdf())
    yield from shapes
    for mesh, stock in IN_PLACE_OF.items():
        for shape in shapes:
            if shape.mesh == stock and shape.link.startswith("l_gripper"):
                yield shape._replace(link=f"{shape.link}:{mesh}", mesh=mesh)


def _shapes_of_the_urdf() -> Iterator[Placed]:
    root = ET.parse(StockFiles.installed().urdf).getroot()
    for link in root.findall("link"):
        name = link.get("name", "")
        shapes = link.findall("visual")
        if not shapes and name.endswith("_hand_link"):
            shapes = link.findall("collision")
        if name not in NO_PART_OF_THE_ROBOT:
            yield from (_placed(name, shape) for shape in shapes)


def _placed(link: str, shape: ET.Element) -> Placed:
    origin, geometry = shape.find("origin"), shape.find("geometry")
    if origin is None or geometry is None:
        raise SystemExit(f"{link}: a shape without origin or geometry")
    kind = geometry[0]
    p = np.array((origin.get("xyz") or "0 0 0").split(), dtype=float)
    R = _rotation(*(float(a) for a in (origin.get("rpy") or "0 0 0").split()))
    if kind.tag == "mesh":
        return Placed(link, Path(kind.get("filename", "")).stem, ("", ()), R, p)
    sizes = ("size",) if kind.tag == "box" else ("radius", "length")
    numbers = tuple(float(n) for size in sizes for n in kind.get(size, "").split())
    return Placed(link, "", (kind.tag, numbers), R, p)


def _rotation(roll: float, pitch: float, yaw: float) -> F:
    """URDF's fixed-axis angles as a rotation matrix."""
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    Rx = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    Ry = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    Rz = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return np.asarray(Rz @ Ry @ Rx)
