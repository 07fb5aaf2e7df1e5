"""One `<geometry>` of a COLLADA file as triangles.

Its primitives, `<triangles>`, `<polylist>` and `<polygons>`, index several arrays at once: each
corner is a group of numbers, one for each offset, of which the one for positions counts here.
"""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from baxter_kin.validation import FloatArray, Indices

Surface: TypeAlias = tuple[FloatArray, Indices]
"""Vertices, shape (n, 3), and triangles, shape (m, 3)."""

_UNREAD = ("trifans", "tristrips")


def surface_of(geometry: ET.Element, named: Mapping[str, ET.Element]) -> Surface:
    """The vertices of a geometry, in its own unit, and its triangles.

    Args:
        geometry: the element.
        named: every element of the file by its id.

    Raises:
        ValueError: when it is not a mesh, or its numbers do not fit together.
    """
    mesh = geometry.find("{*}mesh")
    if mesh is None:
        raise ValueError(f"its geometry {geometry.get('id')!r} is not a mesh")
    positions = mesh.find("{*}vertices/{*}input[@semantic='POSITION']")
    if positions is None:
        raise ValueError(f"its geometry {geometry.get('id')!r} has no positions")
    vertices = _positions(_source(positions, named))
    found = [np.empty((0, 3), np.intp)]
    for element in mesh:
        kind = element.tag.rpartition("}")[2]
        if kind in _UNREAD:
            raise ValueError(f"it has <{kind}>, which is not supported")
        if kind in _CORNERS:
            found.append(_fans(*_CORNERS[kind](element)))
    triangles = np.concatenate(found)
    if triangles.size and not 0 <= triangles.min() <= triangles.max() < len(vertices):
        raise ValueError(
            f"its triangles name vertices {triangles.min()} .. {triangles.max()}; there are "
            f"0 .. {len(vertices) - 1}"
        )
    return vertices, triangles


def numbers(element: ET.Element) -> FloatArray:
    """The numbers in an element.

    Raises:
        ValueError: when there is something else, or one is not finite.
    """
    values = _read(element, float)
    if not np.isfinite(values).all():
        raise ValueError(f"a <{element.tag.rpartition('}')[2]}> has numbers that are not finite")
    return values


def _integers(element: ET.Element) -> Indices:
    return _read(element, int)


def _read(element: ET.Element, kind: type[Any]) -> NDArray[Any]:
    """All that is in an element as numbers, int or float; numpy reads them at once."""
    text = (element.text or "").strip()
    if not text:
        return np.empty(0, kind)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # which is all that older ones have
        try:
            return np.fromstring(text, kind, sep=" ")
        except (DeprecationWarning, ValueError):
            return np.array([kind(word) for word in text.split()])  # says which is none


def _source(reference: ET.Element, named: Mapping[str, ET.Element]) -> ET.Element:
    found = named.get(reference.get("source", "").removeprefix("#"))
    if found is None:
        raise ValueError(f"it lacks the source {reference.get('source', '')[:60]!r}")
    return found


def _positions(source: ET.Element) -> FloatArray:
    """The points of a source, shape (n, 3)."""
    accessor, array = source.find("{*}technique_common/{*}accessor"), source.find("{*}float_array")
    if accessor is None or array is None:
        raise ValueError(f"its source {source.get('id')!r} lacks an accessor or numbers")
    first, count, stride = (int(accessor.get(key, "0")) for key in ("offset", "count", "stride"))
    values = numbers(array)
    if first < 0 or count < 0 or stride < 3 or first + count * stride > len(values):
        raise ValueError(
            f"its source {source.get('id')!r} has {len(values)} numbers, not {count} points of "
            f"{stride} from {first} on"
        )
    return values[first : first + count * stride].reshape(count, stride)[:, :3]


def _of_triangles(element: ET.Element) -> tuple[Indices, Indices]:
    """The corners of a primitive's polygons, one after the other, and how many each has."""
    corners = _one_list(element)
    if len(corners) % 3:
        raise ValueError(f"its triangles have {len(corners)} corners, not three each")
    return corners, np.full(len(corners) // 3, 3)


def _of_polylist(element: ET.Element) -> tuple[Indices, Indices]:
    found = element.find("{*}vcount")
    counts = np.empty(0, np.intp) if found is None else _integers(found)
    corners = _one_list(element)
    if (counts < 0).any() or counts.sum() != len(corners):
        raise ValueError(f"its polygons count {counts.sum()} corners, but name {len(corners)}")
    return corners, counts


def _of_polygons(element: ET.Element) -> tuple[Indices, Indices]:
    if element.find("{*}ph") is not None:
        raise ValueError("it has polygons with holes, which are not supported")
    parts = [_corners(element, part) for part in element.iterfind("{*}p")]
    joined = np.concatenate([np.empty(0, np.intp), *parts])
    return joined, np.array([len(part) for part in parts], dtype=np.intp)


_CORNERS: dict[str, Callable[[ET.Element], tuple[Indices, Indices]]] = {
    "triangles": _of_triangles,
    "polylist": _of_polylist,
    "polygons": _of_polygons,
}


def _one_list(element: ET.Element) -> Indices:
    found = element.find("{*}p")
    return np.empty(0, np.intp) if found is None else _corners(element, found)


def _corners(element: ET.Element, found: ET.Element) -> Indices:
    """The vertex of every corner in a list that holds other numbers as well."""
    offsets = {e.get("semantic"): int(e.get("offset", "0")) for e in element.iterfind("{*}input")}
    if "VERTEX" not in offsets or min(offsets.values()) < 0:
        raise ValueError("one of its primitives names no vertices")
    group = 1 + max(int(e.get("offset", "0")) for e in element.iterfind("{*}input"))
    values = _integers(found)
    if len(values) % group:
        raise ValueError(f"one of its primitives has {len(values)} numbers, not {group} a corner")
    return values.reshape(-1, group)[:, offsets["VERTEX"]]


def _fans(corners: Indices, counts: Indices) -> Indices:
    """Convex polygons as fans of triangles around their first corners, shape (m, 3)."""
    pieces = np.maximum(counts - 2, 0)
    first = np.repeat(np.cumsum(counts) - counts, pieces)
    step = np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    triangles: Indices = corners[np.stack([first, first + step + 1, first + step + 2], axis=1)]
    return triangles
