"""Footing: the area on which a body stands, and whether its centre is above it.

Where two convex shapes meet in a level plane, they touch in the overlap of the slices that lie in
it: corners of boxes and meshes, rims of cylinders, single points of balls. A body stands on the
convex hull of all of these. Bodies count as evenly heavy, so the middle of the bounding box stands
for the centre of mass; of lopsided bodies that is not true.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product

import numpy as np

from baxter_kin.arrays import Vector
from planner.contact import contact_point
from planner.mesh import Mesh
from planner.scene import Box, Cylinder, Part, Sphere

SLICE_M = 1e-5
"""Points this far from the lowest or highest of a shape lie in the same plane."""

RIM_POINTS = 64
"""Of a cylinder's rim; a polygon of so many corners is 0.12 % of the radius too small."""

EDGE_M = 1e-6
"""A centre this far outside the footing is above its edge still."""


def touched_area(above: Part, below: Part) -> Vector:
    """Where a shape touches another below it, both placed in base: corners, shape (n, 2), m."""
    bottom, top = _slice(above, -1.0), _slice(below, +1.0)
    if abs(float(bottom[0, 2] - top[0, 2])) <= 2 * SLICE_M:
        overlap = _overlap(_hull(bottom[:, :2]), _hull(top[:, :2]))
        if len(overlap):
            return overlap
    return contact_point(above, below)[None, :2]


def bottom_area(parts: Iterable[Part]) -> Vector:
    """Where shapes placed in base touch a level floor: corners, shape (n, 2), m."""
    slices = [_slice(part, -1.0) for part in parts]
    lowest = min(float(points[:, 2].min()) for points in slices)
    touching = [points for points in slices if points[:, 2].min() <= lowest + SLICE_M]
    return np.concatenate(touching)[:, :2]


def beside(point: Vector, areas: Iterable[Vector]) -> Vector | None:
    """The way from the hull of some areas to a point, shape (2,), m; None when it is above it."""
    hull = _hull(np.concatenate(list(areas)))
    if len(hull) > 2 and _is_inside(point, hull):
        return None
    edges = zip(hull, np.roll(hull, -1, axis=0), strict=True)
    ways = [point - _nearest_on(begin, end, point) for begin, end in edges]
    way = min(ways, key=lambda found: float(np.linalg.norm(found)))
    return None if float(np.linalg.norm(way)) <= EDGE_M else way


def _slice(part: Part, sign: float) -> Vector:
    """The lowest (-1) or highest (+1) points of a shape placed in base, shape (n, 3)."""
    T, shape = part.T_body_part, part.shape
    points = np.array([T.act(point) for point in _corners(shape, sign * T.rotation[2])])
    heights = sign * points[:, 2]
    found: Vector = points[heights >= heights.max() - SLICE_M]
    return found


def _corners(shape: Box | Cylinder | Sphere | Mesh, up: Vector) -> Vector:
    """Points of a shape, in its frame, whose hull has the same extremes along a direction."""
    if isinstance(shape, Box):
        return np.array(list(product((-0.5, 0.5), repeat=3))) * shape.size_m
    if isinstance(shape, Sphere):
        return shape.radius_m * up[None]
    if isinstance(shape, Mesh):
        return shape.vertices
    start = float(np.arctan2(up[1], up[0]))  # the rim's extreme point is among them
    angles = start + np.linspace(0.0, 2 * np.pi, RIM_POINTS, endpoint=False)
    rim = shape.radius_m * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ends = (-shape.length_m / 2, shape.length_m / 2)
    return np.concatenate([np.column_stack([rim, np.full(RIM_POINTS, z)]) for z in ends])


def _hull(points: Vector) -> Vector:
    """The corners of the convex hull, counter-clockwise (Andrew 1979)."""
    ordered = sorted({(float(x), float(y)) for x, y in points})
    if len(ordered) <= 2:
        return np.array(ordered)
    lower, upper = _chain(ordered), _chain(ordered[::-1])
    return np.array(lower[:-1] + upper[:-1])


def _chain(ordered: list[tuple[float, float]]) -> list[tuple[float, float]]:
    chain: list[tuple[float, float]] = []
    for point in ordered:
        while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= 0.0:
            chain.pop()
        chain.append(point)
    return chain


def _overlap(first: Vector, second: Vector) -> Vector:
    """Corners of the overlap of two convex polygons, one of which may be a line or a point."""
    subject, window = (first, second) if len(second) > 2 else (second, first)
    if len(window) <= 2:
        return np.empty((0, 2))
    for begin, end in zip(window, np.roll(window, -1, axis=0), strict=True):
        subject = _clipped(subject, begin, end)
    return subject


def _clipped(polygon: Vector, begin: Vector, end: Vector) -> Vector:
    """What of a polygon lies left of a line (Sutherland and Hodgman 1974)."""
    if not len(polygon):
        return polygon
    length = float(np.linalg.norm(end - begin))
    heights = [_turn(begin, end, point) / length for point in polygon]
    kept = []
    for index, (point, height) in enumerate(zip(polygon, heights, strict=True)):
        before, height_before = polygon[index - 1], heights[index - 1]
        if (height > EDGE_M) != (height_before > EDGE_M) and abs(height - height_before) > EDGE_M:
            share = height_before / (height_before - height)
            kept.append(before + min(max(share, 0.0), 1.0) * (point - before))
        if height >= -EDGE_M:
            kept.append(point)
    return np.array(kept).reshape(-1, 2)


def _is_inside(point: Vector, hull: Vector) -> bool:
    edges = zip(hull, np.roll(hull, -1, axis=0), strict=True)
    return all(_turn(begin, end, point) >= 0.0 for begin, end in edges)


def _nearest_on(begin: Vector, end: Vector, point: Vector) -> Vector:
    along = end - begin
    length2 = float(along @ along)
    share = float(np.clip((point - begin) @ along / length2, 0.0, 1.0)) if length2 > 0.0 else 0.0
    nearest: Vector = begin + share * along
    return nearest


def _turn(
    origin: Vector | tuple[float, float],
    first: Vector | tuple[float, float],
    second: Vector | tuple[float, float],
) -> float:
    """Twice the area of a triangle, positive counter-clockwise."""
    return float(
        (first[0] - origin[0]) * (second[1] - origin[1])
        - (first[1] - origin[1]) * (second[0] - origin[0])
    )
