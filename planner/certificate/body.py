"""The robot's body: the trees of clusters of each link.

`body.npz` holds the trees of Rethink's meshes, built by `scripts/build_body_clusters.py`, and
assigns them to the stock links. A link with shapes in the robot's own URDF has those instead:
meshes of the file, boxes, cylinders and spheres.
"""

from __future__ import annotations

import hashlib
import io
import xml.etree.ElementTree as ET
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from planner.certificate.clusters import Shape
from planner.certificate.errors import NotCertifiedError, require
from planner.certificate.intervals import Interval, Pose

STOCK_FILE = Path(__file__).with_name("body.npz")

NOT_SOLID = ("collision_head_link_", "_upper_forearm_visual", "_upper_elbow_visual")
"""In names of links that are not parts of the robot: spheres that MoveIt's configuration added
beside the head, and cylinders that are not visible."""

MESH_BALL_M = 2e-8
"""By how much every cluster of a mesh is widened: the file has points in single precision, within
4e-9 m of the numbers in Rethink's files on every axis."""

MAX_FILE_BYTES = 64 * 2**20


@dataclass(frozen=True, eq=False)
class LinkShape:
    """A shape of a link, and its pose there."""

    link: str
    shape: Shape
    T_link_shape: Pose


class Body:
    """All shapes of a robot.

    Attributes:
        shapes: of all links.
        digest: SHA-256 of the file of clusters.
        bare: names of the links of the URDF that have no shape, in order.
    """

    def __init__(self, urdf: str, file: Path = STOCK_FILE) -> None:
        """Read the clusters, and the shapes of the URDF's links.

        Raises:
            NotCertifiedError: when the file is damaged, or the URDF has an unknown shape.
        """
        self.digest, self._meshes, stock = _stored() if file == STOCK_FILE else _read(file)
        own = {link: list(found) for link, found in self._shown(urdf)}
        there = [shape for shape in stock if not own.get(shape.link)]
        named = {shape.link for shape in there}
        self.shapes = [s for s in there if s.link in own]
        self.shapes += [shape for shapes in own.values() for shape in shapes]
        self.bare = tuple(link for link, shapes in own.items() if not shapes and link not in named)

    def mesh(self, name: str) -> Shape:
        """The tree of a mesh of the file, by its name without suffix."""
        return self._meshes[name]

    def _shown(self, urdf: str) -> Iterator[tuple[str, Iterator[LinkShape]]]:
        """Every link of a URDF, with its shapes."""
        try:
            links = list(ET.fromstring(urdf).iter("link"))
        except ET.ParseError as cause:
            raise NotCertifiedError(f"the URDF is malformed: {cause}") from cause
        for link in links:
            name = link.get("name", "")
            is_solid = not any(word in name for word in NOT_SOLID)
            elements = (link.findall("visual") or link.findall("collision")) if is_solid else []
            yield name, (self._shape(name, element) for element in elements)

    def _shape(self, link: str, element: ET.Element) -> LinkShape:
        geometry = element.find("geometry/*")
        origin = element.find("origin")
        try:
            if geometry is None:
                raise ValueError("no geometry")
            place = [
                [
                    float(x)
                    for x in ("0 0 0" if origin is None else origin.get(key, "0 0 0")).split()
                ]
                for key in ("xyz", "rpy")
            ]
            sizes = {
                key: [float(word) for word in geometry.get(key, "").split()]
                for key in ("size", "radius", "length", "scale")
            }
            shape = self._of_kind(geometry.tag, geometry.get("filename", ""), sizes)
            return LinkShape(link, shape, Pose.of_urdf(*place))
        except (ValueError, IndexError, KeyError) as cause:
            raise NotCertifiedError(f"the URDF has an unknown shape of {link}: {cause}") from cause

    def _of_kind(self, kind: str, filename: str, sizes: dict[str, list[float]]) -> Shape:
        if kind == "mesh":
            if sizes["scale"] not in ([], [1.0, 1.0, 1.0]):
                raise ValueError("a scaled mesh")
            return self._meshes[PurePosixPath(filename).stem]
        return primitive(kind, sizes["size"] or sizes["radius"] + sizes["length"])


def primitive(kind: str, sizes: list[float]) -> Shape:
    """A box (three sizes), a cylinder (radius and length) or a sphere (radius) of a URDF.

    Raises:
        NotCertifiedError: when it is of another kind, or malformed.
    """
    if kind == "box":
        return Shape.of_file({"type": "Box", "size_m": sizes}, kind)
    if kind == "cylinder":
        data: dict[str, Any] = {"type": "Cylinder", "radius_m": sizes[0], "length_m": sizes[1]}
        return Shape.of_file(data, kind)
    return Shape.of_file({"type": kind.capitalize(), "radius_m": sizes[0]}, kind)


_Clusters = tuple[str, dict[str, Shape], list[LinkShape]]


@cache
def _stored() -> _Clusters:
    """The content of the package's own file, read once."""
    return _read(STOCK_FILE)


def _read(file: Path) -> _Clusters:
    """Digest of a file, trees of its meshes by name, and shapes of the stock links."""
    content = file.read_bytes()
    require(len(content) <= MAX_FILE_BYTES, f"{file.name} is too large")
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as data:
            arrays = {name: data[name] for name in data.files}
        meshes = _trees(arrays)
        stock = list(_stock(arrays, meshes))
    except (KeyError, ValueError, OSError, EOFError, zipfile.BadZipFile, zlib.error) as cause:
        raise NotCertifiedError(f"{file.name} is damaged: {cause!r}") from cause
    return hashlib.sha256(content).hexdigest(), meshes, stock


def _trees(arrays: dict[str, Any]) -> dict[str, Shape]:
    """The trees of all meshes, by file name without suffix."""
    meshes, nodes = arrays["meshes"].tolist(), arrays["nodes"]
    counts, children = arrays["counts"], arrays["children"]
    columns = np.ascontiguousarray(arrays["points"].T)  # the layout that the prover's kernel needs
    found, node, point = {}, 0, 0
    for mesh, size in zip(meshes, nodes.tolist(), strict=True):
        own, kids = counts[node : node + size], children[node : node + size]
        total = int(own.sum())
        points = columns[:, point : point + total].T
        found[mesh] = Shape(points, own, kids, ball_m=MESH_BALL_M)
        node, point = node + size, point + total
    return found


def _stock(arrays: dict[str, Any], meshes: dict[str, Shape]) -> Iterator[LinkShape]:
    columns = ("links", "link_meshes", "link_kinds", "link_sizes")
    rows = zip(*(arrays[name].tolist() for name in columns), strict=True)
    places = zip(arrays["link_rotations"], arrays["link_translations"], strict=True)
    for (link, mesh, kind, sizes), (R, p) in zip(rows, places, strict=True):
        if any(word in link for word in NOT_SOLID):
            continue
        used = {"box": 3, "cylinder": 2, "sphere": 1}.get(kind, 0)
        shape = meshes[mesh] if kind == "mesh" else primitive(kind, sizes[:used])
        yield LinkShape(link, shape, Pose(Interval(R), Interval(p)))
