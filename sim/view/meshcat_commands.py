"""Meshcat's commands: what its viewer understands, as plain dictionaries, and as bytes.

The form is that of Meshcat 0.3, whose objects are those of three.js' object format 4. Importing
Meshcat's Python side for it would cost a third of a second, and a server in a process of its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
import umsgpack
from numpy.typing import NDArray

from baxter_kin.validation import FloatArray

Command: TypeAlias = dict[str, Any]
"""One command of Meshcat: its `type`, the `path` of a node, and what the type needs."""

Rgb: TypeAlias = tuple[float, float, float]
"""Red, green and blue, 0 .. 1, as shown on the screen."""

_EXTENSIONS = {
    "int8": 0x11,
    "uint8": 0x12,
    "int16": 0x13,
    "uint16": 0x14,
    "int32": 0x15,
    "uint32": 0x16,
    "float32": 0x17,
}
"""Codes of msgpack-lite, Meshcat's decoder, for arrays of a NumPy type."""

_BOTH_SIDES = 2
_SHININESS = 30.0

TUBE_STEP_M = 2.0**-12
"""Corners of tubes are rounded to this, a quarter of a millimetre."""


def packed(command: object) -> bytes:
    """A command, or any tree of values with NumPy arrays in it, as Meshcat decodes it."""
    return bytes(umsgpack.packb(command, ext_handlers={np.ndarray: _extension}))


def shared_geometries(
    commands: Iterable[Command],
) -> tuple[dict[str, Command], list[Command]]:
    """The geometries by name, each once, and the commands with only the names of theirs."""
    shared: dict[str, Command] = {}
    named: list[Command] = []
    for command in commands:
        if command["type"] == "set_object":
            drawn = command["object"]
            shared.update((geometry["uuid"], geometry) for geometry in drawn["geometries"])
            names = [{"uuid": geometry["uuid"]} for geometry in drawn["geometries"]]
            command = command | {"object": drawn | {"geometries": names}}  # noqa: PLW2901
        named.append(command)
    return shared, named


def set_object(
    path: str, geometry: Command, material: Command, matrix: Sequence[float] | None = None
) -> Command:
    """Draw a geometry at a node, first multiplied by `matrix`: 16 numbers, column by column."""
    geometry = {"uuid": f"geometry of {path}"} | geometry
    material = {"uuid": f"material of {path}"} | material
    drawn: Command = {"uuid": path, "type": "Mesh"}
    drawn |= {"geometry": geometry["uuid"], "material": material["uuid"]}
    if matrix is not None:
        drawn |= {"matrix": list(matrix)}
    description = {
        "metadata": {"version": 4.5, "type": "Object"},
        "geometries": [geometry],
        "materials": [material],
        "object": drawn,
    }
    return {"type": "set_object", "path": path, "object": description}


def set_transform(path: str, T_parent_node: pin.SE3) -> Command:
    """Place a node, seen from the node above."""
    matrix = T_parent_node.homogeneous.T.reshape(-1).tolist()
    return {"type": "set_transform", "path": path, "matrix": matrix}


def set_property(path: str, key: str, value: object) -> Command:
    """Set `position` (3), `quaternion` (x, y, z, w), `visible` or another property of a node."""
    return {"type": "set_property", "path": path, "property": key, "value": value}


def delete(path: str) -> Command:
    """Remove a node and all below it."""
    return {"type": "delete", "path": path}


def material(rgb: Rgb, *, opacity: float = 1.0, gloss: float = 0.16) -> Command:
    """A lit surface, drawn from both sides; `gloss` is how bright lights are mirrored, 0 .. 1."""
    return {
        "type": "MeshPhongMaterial",
        "color": _hex(rgb),
        "specular": _hex((gloss, gloss, gloss)),
        "shininess": _SHININESS,
        "opacity": opacity,
        "transparent": opacity < 1.0,
        "side": _BOTH_SIDES,
    }


def painted(*, gloss: float) -> Command:
    """A lit surface in the colours of its geometry, which may be transparent."""
    white = material((1.0, 1.0, 1.0), gloss=gloss)
    return white | {"vertexColors": True, "transparent": True}


def translucent(rgb: Rgb, opacity: float) -> Command:
    """A lit translucent surface, which hides nothing behind it."""
    return material(rgb, opacity=opacity, gloss=0.0) | {"depthWrite": False}


def glowing(rgb: Rgb) -> Command:
    """A surface of the same colour in light and shadow."""
    return {"type": "MeshBasicMaterial", "color": _hex(rgb), "side": _BOTH_SIDES}


def triangles(
    vertices: NDArray[Any],
    faces: NDArray[Any],
    normals: NDArray[Any] | None = None,
    *,
    colours: NDArray[Any] | None = None,
    uuid: str | None = None,
) -> Command:
    """A geometry of triangles.

    Args:
        vertices: shape (n, 3), int16 or float32.
        faces: shape (m, 3), uint16 or uint32.
        normals: shape (n, 3), of any length; int8 or float32.
        colours: shape (n, 4), red, green, blue and opacity, 0 .. 1; float32.
        uuid: a name, for a geometry drawn more than once.
    """
    attributes = {"position": _attribute(vertices)}
    if normals is not None:
        attributes["normal"] = _attribute(normals)
    if colours is not None:
        attributes["color"] = _attribute(colours)
    index = {"type": array_name(faces), "array": faces.reshape(-1), "itemSize": 1}
    data = {"attributes": attributes, "index": index}
    geometry = {"type": "BufferGeometry", "data": data}
    return geometry if uuid is None else geometry | {"uuid": uuid}


def tube(points: FloatArray, radius_m: float) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """A square prism along each segment of the line: vertices (8 n, 3) and faces (8 n, 3)."""
    along = np.diff(points, axis=0)
    upright = np.abs(along[:, 2]) > 0.9 * np.linalg.norm(along, axis=1)
    helper = np.where(upright[:, None], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    u = np.cross(along, helper)
    u /= np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-12)
    w = np.cross(along, u)
    w /= np.maximum(np.linalg.norm(w, axis=1, keepdims=True), 1e-12)
    ring = radius_m * np.stack([u, w, -u, -w], axis=1)
    vertices = np.concatenate([points[:-1, None] + ring, points[1:, None] + ring], axis=1)
    side = np.array([[i, (i + 1) % 4, i + 4] for i in range(4)])
    other = np.array([[(i + 1) % 4, (i + 1) % 4 + 4, i + 4] for i in range(4)])
    first = 8 * np.arange(len(along))[:, None, None]
    faces = (first + np.concatenate([side, other])).reshape(-1, 3)
    return short_numbers(vertices.reshape(-1, 3), TUBE_STEP_M), faces.astype(np.uint32)


def compact(faces: NDArray[Any]) -> NDArray[Any]:
    """The same faces in 16 bits where these are enough, else in 32."""
    return faces.astype(np.uint16 if faces.max(initial=0) < 2**16 else np.uint32)


def short_numbers(values: NDArray[Any], step: float) -> NDArray[np.float32]:
    """The values rounded to a step, a power of two: their last bits are 0 and compress well."""
    return (np.round(values / step) * step).astype(np.float32)


def _attribute(values: NDArray[Any]) -> Command:
    return {
        "type": array_name(values),
        "array": values.reshape(-1),
        "itemSize": values.shape[1],
        "normalized": False,
    }


def _hex(rgb: Rgb) -> int:
    red, green, blue = (round(255 * min(max(channel, 0.0), 1.0)) for channel in rgb)
    return red << 16 | green << 8 | blue


def array_name(values: NDArray[Any]) -> str:
    """JavaScript's name of the array type, such as "Int16Array" for int16."""
    return f"{values.dtype.name.capitalize()}Array"


def _extension(values: NDArray[Any]) -> Any:
    if values.dtype.name not in _EXTENSIONS:
        raise TypeError(f"pages have no arrays of {values.dtype}; use {', '.join(_EXTENSIONS)}")
    little_endian = values.astype(values.dtype.newbyteorder("<"), copy=False)
    return umsgpack.Ext(_EXTENSIONS[values.dtype.name], little_endian.tobytes())
