"""Convex pieces around parts of a mesh, and the file that they are stored in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from body.meshes import Placed

F = NDArray[np.float64]

Mesh = tuple[F, NDArray[np.int64]]

MAX_PLANES = 34
"""Maximum number of planes of a piece, which then has at most 2 * 34 - 4 = 64 vertices."""

GRID = 1e-3
"""Grid of the corners of pieces, mm, so that no two are nearly equal."""

PAD = 2e-3
"""Pieces are larger than their contents by this, mm: far above rounding errors."""


def convex_hull(points: F) -> Mesh:
    """Vertices and triangles of the hull, counter-clockwise from outside."""
    hull = ConvexHull(points)
    faces = hull.simplices.copy()
    a, b, c = (points[faces[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    used, inverse = np.unique(faces, return_inverse=True)
    return points[used], inverse.reshape(-1, 3).astype(np.int64)


def clipped(soup: F, low: F, high: F) -> F:
    """The triangles' parts between two corners of a box, as triangles."""
    for axis in range(3):
        soup = _half(soup, axis, high[axis], 1.0)
        soup = _half(soup, axis, low[axis], -1.0)
    return soup


def _half(soup: F, axis: int, bound: float, sign: float) -> F:
    """The parts of triangles with `sign * (coordinate - bound) <= 0`."""
    height = sign * (soup[:, :, axis] - bound)
    whole = (height <= 0).all(axis=1)
    cut = ~whole & (height < 0).any(axis=1)
    fans = [
        fan
        for triangle, heights in zip(soup[cut], height[cut], strict=True)
        for fan in _fan(triangle, heights, axis, bound)
    ]
    touching = ~whole & ~cut & (height == 0).any(axis=1)
    kept = [soup[whole], np.array(fans).reshape(-1, 3, 3)]
    for triangle, heights in zip(soup[touching], height[touching], strict=True):
        points = triangle[heights == 0]
        kept.append(np.array([[points[0], points[-1], points[-1]]]))
    return np.concatenate(kept)


def _fan(triangle: F, heights: F, axis: int, bound: float) -> list[list[F]]:
    corners: list[F] = []
    for i in range(3):
        j = (i + 1) % 3
        if heights[i] <= 0:
            corners.append(triangle[i])
        if heights[i] * heights[j] < 0:
            point = triangle[i] + (triangle[j] - triangle[i]) * (
                heights[i] / (heights[i] - heights[j])
            )
            point[axis] = bound
            corners.append(point)
    return [[corners[0], corners[i], corners[i + 1]] for i in range(1, len(corners) - 1)]


def around(points: F, *, tolerance: float, inner: F | None = None) -> Mesh:
    """A convex polyhedron that contains points, with few planes.

    Planes are added until it stands out from the hull by less than `tolerance` (mm) or has
    `MAX_PLANES`; those that face along `inner` first.
    """
    hull = ConvexHull(points)
    facets, extreme = hull.equations, points[hull.vertices]
    weight = np.ones(len(facets))
    if inner is not None:
        weight += 6.0 * np.maximum(facets[:, :3] @ inner, 0.0)
    normals = [sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
    while True:
        offsets = [float((extreme @ normal).max()) + PAD for normal in normals]
        planes = np.column_stack([normals, -np.array(offsets)])
        vertices = HalfspaceIntersection(planes, extreme.mean(axis=0)).intersections
        beyond = vertices @ facets[:, :3].T + facets[:, 3]
        if len(normals) >= MAX_PLANES or beyond.max() < tolerance + PAD:
            return convex_hull(_merged(vertices))
        normals.append(facets[np.unravel_index((beyond * weight).argmax(), beyond.shape)[1], :3])


def _merged(points: F) -> F:
    """Points on a grid, none twice: where planes meet, they come out often; by less than `PAD`."""
    return np.unique(np.rint(points / GRID), axis=0) * GRID


CUTS = 16
"""Number of cuts that are tried along each axis."""

GAIN = 0.01
"""Minimum saving of a cut, as a share of the volume of the first hull."""


def cover(soup: F, most: int) -> list[Mesh]:
    """At most `most` convex pieces around triangles (n, 3, 3), mm."""
    total = _volume(soup)
    parts = [(_best_cut(soup), soup)]
    while len(parts) < most:
        index = max(range(len(parts)), key=lambda i: parts[i][0][0])
        (gain, is_first), part = parts[index]
        if gain < GAIN * total:
            break
        halves = part[is_first], part[~is_first]
        parts[index : index + 1] = [(_best_cut(half), half) for half in halves]
    return [around(part.reshape(-1, 3), tolerance=0.2) for _, part in parts]


def _best_cut(soup: F) -> tuple[float, NDArray[np.bool_]]:
    """The volume saved by the best cut, and a mask of the triangles on its first side."""
    centres, volume = soup.mean(axis=1), _volume(soup)
    best = 0.0, np.ones(len(soup), dtype=bool)
    for axis in range(3):
        low, high = centres[:, axis].min(), centres[:, axis].max()
        for at in np.linspace(low, high, CUTS + 2)[1:-1]:
            is_first = centres[:, axis] < at
            saved = volume - _volume(soup[is_first]) - _volume(soup[~is_first])
            if saved > best[0]:
                best = saved, is_first
    return best


def _volume(soup: F) -> float:
    try:
        return float(ConvexHull(soup.reshape(-1, 3)).volume)
    except (QhullError, ValueError):
        return 0.0


VERSION = 3

NOTHING: Mesh = (np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))

SIDES = 32
"""Sides of the prism around a cylinder."""

LARGER = 1e-3
"""Enlargement of primitives, mm, which exceeds rounding errors."""


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
