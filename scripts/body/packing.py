"""The data file: shapes in their own frames, and which link has which, where."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from body.convex import Mesh, convex_hull
from body.meshes import Placed

VERSION = 3

NOTHING: Mesh = (np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))

SIDES = 32
"""Of the prism around a cylinder."""

LARGER = 1e-3
"""What primitives are larger by, mm, so that rounding makes none smaller."""


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A shape in its own frame, mm: triangles and how far they deviate, what is inside, pieces.

    And whether it touches things on purpose with these.
    """

    pieces: Sequence[Mesh]
    surface: Mesh = NOTHING
    enclosure: Mesh = NOTHING
    deviation: float = 0.0
    is_touching: bool = False


def primitive(kind: str, sizes: tuple[float, ...]) -> Shape:
    """A box or cylinder of the URDF (m) as one piece."""
    half = np.array(sizes) * 500.0 + LARGER
    if kind == "box":
        points = np.array(np.meshgrid(*np.column_stack([-half, half]))).reshape(3, -1).T
    else:
        radius = (sizes[0] * 1e3 + LARGER) / np.cos(np.pi / SIDES)
        angles = (np.arange(SIDES) + 0.5) * 2.0 * np.pi / SIDES
        points = np.array(
            [
                (radius * np.cos(angle), radius * np.sin(angle), z)
                for angle in angles
                for z in (-half[1], half[1])
            ]
        )
    return Shape([convex_hull(points)])


def shape_name(placed: Placed) -> str:
    """The mesh's name, or that of the link without its side."""
    return placed.mesh or placed.link.removeprefix("left_").removeprefix("right_")


def packed(
    shapes: Mapping[str, Shape],
    links: Sequence[Placed],
    pairs: Mapping[frozenset[str], str],
    notice: str,
) -> dict[str, NDArray[Any]]:
    """Every array of the file, in metres."""
    arrays: dict[str, NDArray[Any]] = {"version": np.array(VERSION), "notice": np.array(notice)}
    for name, shape in sorted(shapes.items()):
        meshes = [shape.surface, shape.enclosure, *shape.pieces]
        triangles = np.concatenate([v for v, _ in meshes[:2]]) * 1e-3
        arrays[f"{name}/vertices"] = triangles.astype(np.float32)
        arrays[f"{name}/corners"] = np.concatenate([v for v, _ in shape.pieces]) * 1e-3
        arrays[f"{name}/triangles"] = np.concatenate([f for _, f in meshes]).astype(np.uint16)
        arrays[f"{name}/counts"] = np.array([(len(v), len(f)) for v, f in meshes])
        arrays[f"{name}/margin_m"] = np.array(shape.deviation * 1e-3)
        arrays[f"{name}/is_touching"] = np.array(shape.is_touching)
    arrays["link/name"] = np.array([placed.link for placed in links])
    arrays["link/shape"] = np.array([shape_name(placed) for placed in links])
    arrays["link/mesh"] = np.array([placed.mesh for placed in links])
    arrays["link/R_link_shape"] = np.array([placed.R_link_shape for placed in links])
    arrays["link/p_link_shape"] = np.array([placed.p_link_shape for placed in links])
    ordered = sorted((sorted(names), reason) for names, reason in pairs.items())
    arrays["pair/links"] = np.array([names for names, _ in ordered])
    arrays["pair/reason"] = np.array([reason for _, reason in ordered])
    return arrays
