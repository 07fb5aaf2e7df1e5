"""Rethink's meshes, where the URDF puts them, and how far triangles are from others.

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
import igl
import numpy as np
import pinocchio as pin
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
"""Meshes that may be mounted on a gripper, and the stock robot's in their place."""


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
    """Every shape of the robot: visuals, and collision shapes of links without visuals.

    Then alternatives that may be mounted on both fingers of a hand, named as in `RobotBody.links`.
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
    R = pin.rpy.rpyToMatrix(*(float(a) for a in (origin.get("rpy") or "0 0 0").split()))
    if kind.tag == "mesh":
        return Placed(link, Path(kind.get("filename", "")).stem, ("", ()), R, p)
    sizes = ("size",) if kind.tag == "box" else ("radius", "length")
    numbers = tuple(float(n) for size in sizes for n in kind.get(size, "").split())
    return Placed(link, "", (kind.tag, numbers), R, p)


def samples(soup: F, spacing: float) -> F:
    """Points on triangles (n, 3, 3), corners included, about `spacing` apart."""
    return samples_of(soup, spacing)[0]


def samples_of(soup: F, spacing: float) -> tuple[F, NDArray[np.int64]]:
    """The same points, and the index of the triangle of each.

    Triangles are halved until no edge is longer; so there are few points on narrow ones.
    """
    pieces, owners = divided(soup, spacing)
    points = np.concatenate([soup.reshape(-1, 3), pieces.mean(axis=1)])
    return points, np.concatenate([np.repeat(np.arange(len(soup)), 3), owners])


def divided(soup: F, longest: float) -> tuple[F, NDArray[np.int64]]:
    """Triangles halved until no edge is longer, and the index of the original of each."""
    owners, pieces, numbers = np.arange(len(soup)), [], []
    while len(soup):
        is_done = longest_edges(soup) <= longest
        pieces.append(soup[is_done])
        numbers.append(owners[is_done])
        soup, owners = halved(soup[~is_done]), np.tile(owners[~is_done], 2)
    return np.concatenate(pieces), np.concatenate(numbers)


def halved(soup: F) -> F:
    """Each triangle cut in two across its longest edge: first all first halves."""
    turned = (np.arange(3) + _edges(soup).argmax(axis=1)[:, None]) % 3
    a, b, c = np.take_along_axis(soup, turned[:, :, None], axis=1).swapaxes(0, 1)
    middle = (a + b) / 2.0
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])


def longest_edges(soup: F) -> F:
    """Longest edge of each triangle."""
    return np.asarray(_edges(soup).max(axis=1))


def _edges(soup: F) -> F:
    """The length of each edge, from each corner on, shape (n, 3)."""
    return np.asarray(np.linalg.norm(soup - np.roll(soup, -1, axis=1), axis=2))


def distances(points: F, soup: F) -> F:
    """The distance of each point to the nearest triangle."""
    corners = np.ascontiguousarray(soup.reshape(-1, 3))
    faces = np.arange(len(corners)).reshape(-1, 3)
    squared = igl.point_mesh_squared_distance(np.ascontiguousarray(points), corners, faces)[0]
    return np.asarray(np.sqrt(squared))
