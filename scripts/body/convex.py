"""Convex pieces that contain a closed surface and all it encloses.

Space is cut into boxes ("cells") by planes across the axes; the piece of a cell contains the part of the
surface in the cell and the cell's corners inside the surface. So it contains the part of
the solid in the cell: that part's extreme points are vertices of the surface, points where its edges
leave the cell, where the cell's edges pass through it, or corners of the cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import igl
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

F = NDArray[np.float64]
Mesh = tuple[F, NDArray[np.int64]]

FAR = 1e4
"""Where the outermost cells end, mm."""

MOST_PLANES = 34
"""Of a piece: at most 2 * 34 - 4 = 64 vertices."""

PAD = 2e-3
"""Pieces are larger than what they contain by this, mm: far above all rounding."""


class Cell(NamedTuple):
    """A box from `low` to `high`, and what it has of the surface: triangles (n, 3, 3)."""

    low: F
    high: F
    soup: F


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
    """What of the triangles lies where `sign * (coordinate - bound) <= 0`."""
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


def whole(soup: F) -> Cell:
    """One cell around everything."""
    return Cell(np.full(3, -FAR), np.full(3, FAR), soup)


def cells_at(soup: F, boxes: Sequence[tuple[tuple[float, ...], tuple[float, ...]]]) -> list[Cell]:
    """The cells of given boxes, which together cover the mesh."""
    return [
        Cell(np.array(low), np.array(high), clipped(soup, np.array(low), np.array(high)))
        for low, high in boxes
    ]


def cut_up(soup: F, most: int, gain: float = 0.01) -> list[Cell]:
    """Cells from the cuts that take most volume off the hulls, one after the other.

    Stops at `most` cells or when a cut gains less than that part of the first hull.
    """
    first = whole(soup)
    queue = [_best_cut(first)]
    total = _volume(soup)
    while len(queue) < most:
        index = max(range(len(queue)), key=lambda i: queue[i][0])
        won, cell, axis, at = queue[index]
        if won < gain * total:
            break
        queue[index : index + 1] = [_best_cut(part) for part in _cut(cell, axis, at)]
    return [cell for _, cell, _, _ in queue]


def _best_cut(cell: Cell) -> tuple[float, Cell, int, float]:
    best = (0.0, cell, 0, 0.0)
    volume = _volume(cell.soup)
    points = cell.soup.reshape(-1, 3)
    for axis in range(3):
        for at in np.linspace(points[:, axis].min(), points[:, axis].max(), 16)[1:-1]:
            parts = _cut(cell, axis, float(at))
            won = volume - sum(_volume(part.soup) for part in parts)
            if won > best[0]:
                best = (won, cell, axis, float(at))
    return best


def _cut(cell: Cell, axis: int, at: float) -> tuple[Cell, Cell]:
    high, low = cell.high.copy(), cell.low.copy()
    high[axis] = low[axis] = at
    return (
        Cell(cell.low, high, _half(cell.soup, axis, at, 1.0)),
        Cell(low, cell.high, _half(cell.soup, axis, at, -1.0)),
    )


def _volume(soup: F) -> float:
    try:
        return float(ConvexHull(soup.reshape(-1, 3)).volume)
    except (QhullError, ValueError):
        return 0.0


def piece(cell: Cell, solid: F, *, tolerance: float = 0.03, inner: F | None = None) -> Mesh:
    """The convex piece of a cell: few planes around its part of the surface.

    Planes are added until the piece stands out from the hull by less than `tolerance` (mm) or has
    `MOST_PLANES`; those that face along `inner` first.
    """
    corners = np.array(np.meshgrid(*np.array([cell.low, cell.high]).T)).reshape(3, -1).T
    points = np.concatenate([cell.soup.reshape(-1, 3), corners[_inside(corners, solid)]])
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
        if len(normals) >= MOST_PLANES or beyond.max() < tolerance + PAD:
            return convex_hull(_merged(vertices))
        normals.append(facets[np.unravel_index((beyond * weight).argmax(), beyond.shape)[1], :3])


def _merged(points: F) -> F:
    """Points without repetitions within a nanometre; where planes meet, they come out often."""
    _, first = np.unique(np.rint(points * 1e6), axis=0, return_index=True)
    return points[first]


def _inside(points: F, soup: F) -> NDArray[np.bool_]:
    """Which points the triangles wind around."""
    corners = np.ascontiguousarray(soup.reshape(-1, 3))
    faces = np.arange(len(corners)).reshape(-1, 3)
    return np.asarray(np.abs(igl.winding_number(corners, faces, points)) > 0.5)
