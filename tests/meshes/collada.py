"""COLLADA files (.dae, version 1.4 or 1.5) as triangles, read with the standard library.

Pinocchio's reader joins wrong vertices where a mesh has several materials; here every triangle has
the corners that the file names. As its reader and ROS do, the axes of the file are taken for those
of the link, whatever its `up_axis` says; lengths are scaled to metres.

Source: COLLADA 1.4.1 specification (Khronos 2008), chapter 5. Polygons are taken for convex, and
lines are left out. What could add to the surface and is not read, is refused: skins, instanced
nodes, strips and fans of triangles, polygons with holes; so are `lookat` and `skew`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from baxter_kin.errors import DescriptionError
from baxter_kin.validation import FloatArray, Indices
from tests.meshes.collada_mesh import Surface, numbers, surface_of

LARGEST_FILE = 64 * 2**20
"""Bytes; Baxter's largest has 6 MB."""

MAX_TRIANGLES = 2_000_000
"""Of one file, its instances counted; Baxter's largest has 74 707."""

LONGEST_REASON = 200
"""How much of what is wrong with a file, which may quote it, a message repeats."""

_UNREAD = ("instance_node", "instance_controller", "lookat", "skew")


def read_collada(path: Path) -> tuple[FloatArray, Indices]:
    """Vertices, shape (n, 3), m, and triangles, shape (m, 3), of all that the file's scene shows.

    Every vertex is in a triangle. A triangle with two corners in one point has no area and is left
    out; in Baxter's files each of these is an edge of another triangle.

    Raises:
        DescriptionError: when the file cannot be read, is too large or malformed, or shows nothing.
    """
    try:
        return _without_slivers(*_joined(_shown(_root(path))))
    except (OSError, ET.ParseError, LookupError, ValueError, OverflowError) as cause:
        reason = " ".join(str(getattr(cause, "strerror", None) or cause).split())
        raise DescriptionError(f"cannot read {path}: {reason[:LONGEST_REASON]}") from cause


class _NoEntities(ET.TreeBuilder):
    """A tree of a document that defines no entities."""

    def doctype(self, *_: str | None) -> None:
        """Called by the parser where a document type is declared."""
        raise ValueError("a COLLADA file declares no document type")


def _root(path: Path) -> ET.Element:
    with path.open("rb") as file:
        text = file.read(LARGEST_FILE + 1)
    if len(text) > LARGEST_FILE:
        raise ValueError(f"it has more than {LARGEST_FILE} bytes")
    root: ET.Element = ET.fromstring(text, ET.XMLParser(target=_NoEntities()))
    if root.tag.rpartition("}")[2] != "COLLADA":
        raise ValueError(f"its root is <{root.tag}>, not <COLLADA>")
    return root


def _shown(root: ET.Element) -> Iterator[Surface]:
    """The surface of every geometry in the scene, placed, in metres."""
    named = {element.get("id", ""): element for element in root.iter() if element.get("id")}
    surfaces: dict[str, Surface] = {}
    for url, T in _instances(_scene(root, named), _metres(root)):
        if url not in surfaces:
            surfaces[url] = surface_of(_target(named, url), named)
        vertices, triangles = surfaces[url]
        yield vertices @ T[:3, :3].T + T[:3, 3], triangles


def _metres(root: ET.Element) -> FloatArray:
    """What scales the file's lengths to metres, shape (4, 4)."""
    unit = root.find("{*}asset/{*}unit")
    metres = 1.0 if unit is None else float(unit.get("meter", "1"))
    if not 0.0 < metres < np.inf:
        raise ValueError(f"its unit is {metres:g} m")
    return np.diag([metres, metres, metres, 1.0])


def _scene(root: ET.Element, named: dict[str, ET.Element]) -> ET.Element:
    instance = root.find("{*}scene/{*}instance_visual_scene")
    if instance is None:
        raise ValueError("it shows no visual scene")
    return _target(named, instance.get("url", ""))


def _target(named: dict[str, ET.Element], url: str) -> ET.Element:
    found = named.get(url.removeprefix("#"))
    if found is None:
        raise ValueError(f"it lacks what {url[:60]!r} refers to")
    return found


def _instances(scene: ET.Element, T_file: FloatArray) -> Iterator[tuple[str, FloatArray]]:
    """Every geometry of the scene and where it is."""
    pending = [(node, T_file) for node in reversed(scene.findall("{*}node"))]
    while pending:
        node, T_parent = pending.pop()
        for tag in _UNREAD:
            if node.find(f"{{*}}{tag}") is not None:
                raise ValueError(f"its node {node.get('id')!r} has <{tag}>, which is not supported")
        T = T_parent @ _T_parent_node(node)
        for instance in node.iterfind("{*}instance_geometry"):
            yield instance.get("url", ""), T
        pending += [(child, T) for child in reversed(node.findall("{*}node"))]


def _T_parent_node(node: ET.Element) -> FloatArray:
    """The product of the node's transforms in the order of the file, shape (4, 4)."""
    T = np.eye(4)
    for element in node:
        kind = element.tag.rpartition("}")[2]
        if kind in _TRANSFORMS:
            size, matrix = _TRANSFORMS[kind]
            values = numbers(element)
            if len(values) != size:
                raise ValueError(f"a <{kind}> has {len(values)} numbers, not {size}")
            T = T @ matrix(values)
    return T


def _matrix(values: FloatArray) -> FloatArray:
    T = values.reshape(4, 4)
    if not np.array_equal(T[3], [0.0, 0.0, 0.0, 1.0]):
        raise ValueError(f"the last row of a <matrix> is {T[3].tolist()}, not 0 0 0 1")
    return T


def _translation(values: FloatArray) -> FloatArray:
    T = np.eye(4)
    T[:3, 3] = values
    return T


def _rotation(values: FloatArray) -> FloatArray:
    """About an axis by degrees (Rodrigues)."""
    length = float(np.linalg.norm(values[:3]))
    if length == 0.0:
        raise ValueError("a <rotate> has an axis of no length")
    x, y, z = values[:3] / length
    angle = np.radians(values[3])
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    T = np.eye(4)
    T[:3, :3] += np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)
    return T


def _scaling(values: FloatArray) -> FloatArray:
    return np.diag([*values, 1.0])


_TRANSFORMS = {
    "matrix": (16, _matrix),
    "translate": (3, _translation),
    "rotate": (4, _rotation),
    "scale": (3, _scaling),
}
"""How many numbers each has, and what makes a matrix of them."""


def _joined(surfaces: Iterator[Surface]) -> Surface:
    all_vertices, all_triangles = [np.empty((0, 3))], [np.empty((0, 3), np.intp)]
    vertex_count = triangle_count = 0
    for vertices, triangles in surfaces:
        triangle_count += len(triangles)
        if triangle_count > MAX_TRIANGLES:
            raise ValueError(f"it has more than {MAX_TRIANGLES} triangles")
        all_vertices.append(vertices)
        all_triangles.append(triangles + vertex_count)
        vertex_count += len(vertices)
    return np.concatenate(all_vertices), np.concatenate(all_triangles)


def _without_slivers(vertices: FloatArray, triangles: Indices) -> Surface:
    """Without triangles that have two corners in one point, and without vertices in none."""
    corners = vertices[triangles]
    is_flat = (corners == corners[:, [1, 2, 0]]).all(axis=2).any(axis=1)
    if is_flat.all():
        raise ValueError("its scene shows no triangles")
    used, numbered = np.unique(triangles[~is_flat], return_inverse=True)
    return vertices[used], numbered.reshape(-1, 3)
