"""Convex polyhedra around parts of a mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, HalfspaceIntersection

F = NDArray[np.float64]
Mesh = tuple[F, NDArray[np.int64]]

MOST_PLANES = 34
"""Of a piece: at most 2 * 34 - 4 = 64 vertices."""

GRID = 1e-3
"""Of the corners of pieces, mm, so that none are nearly the same."""

PAD = 2e-3
"""Pieces are larger than what they contain by this, mm: far above all rounding."""


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


def around(points: F, *, tolerance: float, inner: F | None = None) -> Mesh:
    """A convex polyhedron that contains points, with few planes.

    Planes are added until it stands out from the hull by less than `tolerance` (mm) or has
    `MOST_PLANES`; those that face along `inner` first.
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
        if len(normals) >= MOST_PLANES or beyond.max() < tolerance + PAD:
            return convex_hull(_merged(vertices))
        normals.append(facets[np.unravel_index((beyond * weight).argmax(), beyond.shape)[1], :3])


def _merged(points: F) -> F:
    """Points on a grid, none twice: where planes meet, they come out often; by less than `PAD`."""
    return np.unique(np.rint(points / GRID), axis=0) * GRID
