"""What the URDF shows of every link, as coal's shapes placed on their links.

A link is what its `<visual>` elements show; one that has none is what its `<collision>` elements
are. The robot's own text shows what is on its hands; all other links are those of the stock URDF.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from baxter_kin.description import StockFiles
from baxter_kin.errors import DescriptionError
from baxter_kin.validation import FloatArray
from planner.scene.contact import surface
from planner.verification.body.collada import read_collada

_PACKAGE = "package://"


@dataclass(frozen=True, slots=True, eq=False)
class UrdfShape:
    """One shape of a link.

    Attributes:
        link: its name.
        T_link_shape: where the shape sits on it.
        shape: of coal; the same object wherever the URDF names the same mesh at the same scale.
    """

    link: str
    T_link_shape: pin.SE3
    shape: Any


def link_shapes(
    files: StockFiles, left_out: tuple[str, ...], own_text: str = "<robot/>"
) -> list[UrdfShape]:
    """The shapes of every link whose name has none of some words in it.

    Args:
        files: the URDF that shows most links, and where meshes are.
        left_out: the words.
        own_text: another URDF; what it shows of a link counts in place of that.

    Raises:
        DescriptionError: when a URDF or a mesh cannot be read, or a shape is of no known kind.
    """
    shapes = _shapes_of(files)
    try:
        own = {link.get("name", ""): link for link in ET.fromstring(own_text).iter("link")}
        shown = {name: link for name, link in own.items() if len(link)}
        stock = {link.get("name", ""): link for link in ET.parse(files.urdf).iter("link")}
        return [
            shape
            for name, link in {**stock, **shown}.items()
            if not any(word in name for word in left_out)
            for shape in _of_link(link, shapes)
        ]
    except (OSError, ET.ParseError, ValueError) as cause:
        raise DescriptionError(f"cannot read {files.urdf}: {cause}") from cause


@cache
def _shapes_of(files: StockFiles) -> _Shapes:
    return _Shapes(files)


class _Shapes:
    """Makes shapes, and each mesh once."""

    def __init__(self, files: StockFiles) -> None:
        self._files = files
        self._surfaces: dict[tuple[str, tuple[float, ...]], Any] = {}

    def of(self, element: ET.Element) -> Any:
        """Coal's shape for what is in a `<geometry>`."""
        if element.tag == "mesh":
            return self._surface(element)
        if element.tag == "box":
            return coal.Box(*_numbers(element, "size", 3))
        if element.tag == "sphere":
            return coal.Sphere(*_numbers(element, "radius", 1))
        if element.tag == "cylinder":
            return coal.Cylinder(*_numbers(element, "radius", 1), *_numbers(element, "length", 1))
        raise ValueError(f"a shape <{element.tag}> is not a mesh, box, sphere or cylinder")

    def _surface(self, element: ET.Element) -> Any:
        name = element.get("filename", "")
        scale = _numbers(element, "scale", 3, "1 1 1")
        key = name, tuple(scale.tolist())
        if key not in self._surfaces:
            vertices, triangles = read_collada(self._path(name))
            self._surfaces[key] = surface(vertices * scale, triangles)
        return self._surfaces[key]

    def _path(self, name: str) -> Path:
        if not name.startswith(_PACKAGE):
            raise ValueError(f"the mesh {name!r} is not given as {_PACKAGE}...")
        return self._files.package_dir / name.removeprefix(_PACKAGE)


def _of_link(link: ET.Element, shapes: _Shapes) -> Iterator[UrdfShape]:
    name = link.get("name", "")
    for element in link.findall("visual") or link.findall("collision"):
        kind = element.find("geometry/*")
        if kind is None:
            raise ValueError(f"a shape of the link {name} has no geometry")
        yield UrdfShape(name, _origin(element), shapes.of(kind))


def _origin(element: ET.Element) -> pin.SE3:
    origin = element.find("origin")
    if origin is None:
        return pin.SE3.Identity()
    rpy, xyz = (_numbers(origin, key, 3, "0 0 0") for key in ("rpy", "xyz"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def _numbers(element: ET.Element, key: str, size: int, otherwise: str = "") -> FloatArray:
    values = np.array([float(word) for word in element.get(key, otherwise).split()])
    if values.shape != (size,) or not np.isfinite(values).all():
        raise ValueError(
            f"{key} of a <{element.tag}> is {element.get(key)!r}; finite numbers needed: {size}"
        )
    return values
