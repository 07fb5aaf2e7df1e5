"""The data file: shapes in their own frames, and which link has which, where.

`planner.robot_body` reads it; `<shape>/cells` says for the tests which part of space each piece
answers for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from body.convex import FAR, Mesh, convex_hull
from body.meshes import Placed
from numpy.typing import NDArray

VERSION = 1

NOTHING: Mesh = (np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))

SIDES = 32
"""Of the prism around a cylinder."""


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A shape in its own frame, mm: surface, pieces, the cells they answer for, stand-out."""

    surface: Mesh
    pieces: Sequence[Mesh]
    cells: Sequence[tuple[Any, Any]]
    stand_out: float


def primitive(kind: str, sizes: tuple[float, ...]) -> Shape:
    """A box or cylinder of the URDF (m) as one piece a micrometre larger."""
    half = np.array(sizes) * 500.0 + 1e-3
    if kind == "box":
        points = np.array(np.meshgrid(*np.column_stack([-half, half]))).reshape(3, -1).T
        stand_out = 0.002
    else:
        radius = (sizes[0] * 1e3 + 1e-3) / np.cos(np.pi / SIDES)
        angles = (np.arange(SIDES) + 0.5) * 2.0 * np.pi / SIDES
        points = np.array(
            [(radius * np.cos(a), radius * np.sin(a), z) for a in angles for z in (-half[1], half[1])]
        )
        stand_out = radius - sizes[0] * 1e3 + 0.002
    return Shape(NOTHING, [convex_hull(points)], [(np.full(3, -FAR), np.full(3, FAR))], stand_out)


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
        meshes = [shape.surface, *shape.pieces]
        arrays[f"{name}/vertices"] = np.concatenate([v for v, _ in meshes]) * 1e-3
        arrays[f"{name}/triangles"] = np.concatenate([f for _, f in meshes]).astype(np.uint16)
        arrays[f"{name}/piece_counts"] = np.array([(len(v), len(f)) for v, f in meshes])
        arrays[f"{name}/margin_standout"] = np.array([0.0, shape.stand_out * 1e-3])
        arrays[f"{name}/cells"] = np.array(shape.cells) * 1e-3
    arrays["link/name"] = np.array([placed.link for placed in links])
    arrays["link/shape"] = np.array([shape_name(placed) for placed in links])
    arrays["link/mesh"] = np.array([placed.mesh for placed in links])
    arrays["link/R_link_shape"] = np.array([placed.R_link_shape for placed in links])
    arrays["link/p_link_shape"] = np.array([placed.p_link_shape for placed in links])
    ordered = sorted((sorted(names), reason) for names, reason in pairs.items())
    arrays["pair/links"] = np.array([names for names, _ in ordered])
    arrays["pair/reason"] = np.array([reason for _, reason in ordered])
    return arrays
