"""Faces: where shapes touch what is below them, and whether a point is above that.

The underside of a shape and what is below it are compared face by face: corners and faces of boxes
and meshes, caps and lines of cylinders, points of balls. Shapely enters here. Shapes touch where
the vertical gap between two faces is at most `SLICE_M`; a mesh with walls, steps and holes thus
supports a body only where the body's own footprint meets it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np
import pinocchio as pin
import shapely
from numpy.typing import NDArray

from baxter_kin.frames import BASE_HEIGHT_M
from baxter_kin.validation import FloatArray
from planner.scene.bodies import Box, Cylinder, Part, Shape, Sphere
from planner.scene.contact import PRESSING_TOLERANCE_M, contact_point
from planner.scene.mesh import Mesh

FLOOR_Z_M = -BASE_HEIGHT_M
UP = np.array([0.0, 0.0, 1.0])

SLICE_M = 1e-5
"""Faces whose vertical gap is smaller touch; points this close to the lowest of a shape lie in one
plane."""

RIM_POINTS = 64
"""Corners of the polygon of a cylinder's rim, which is 0.12 % of the radius too small."""

EDGE_M = 1e-6
"""A point this far outside an area is still above its edge."""

_VERTICAL = 1e-3
"""Faces whose normal has a smaller vertical component are vertical: only their edges count."""

_CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)))
_BOX_NORMALS = np.array([*np.eye(3), *-np.eye(3)])
_QUADS = np.array(
    [[4, 6, 7, 5], [2, 3, 7, 6], [1, 5, 7, 3], [0, 1, 3, 2], [0, 4, 5, 1], [0, 2, 6, 4]]
)
"""Corners of a box of unit edges, the normals of its faces, and the corners of each face."""


def touched_area(above: Part, below: Part) -> FloatArray:
    """Where a shape touches another below it, both placed in base: corners, shape (n, 2), m."""
    area = overlaps_between(faces_of(above, -1.0), faces_of(below, +1.0), SLICE_M).within(SLICE_M)
    return area if len(area) else contact_point(above, below)[None, :2]


def bottom_area(parts: Iterable[Part]) -> FloatArray:
    """Where shapes placed in base touch a level floor: corners, shape (n, 2), m."""
    slices = [_lowest_points(part) for part in parts]
    lowest = min(float(points[:, 2].min()) for points in slices)
    touching = [points for points in slices if points[:, 2].min() <= lowest + SLICE_M]
    return np.concatenate(touching)[:, :2]


def offset_from_hull(point: FloatArray, areas: Iterable[FloatArray]) -> FloatArray | None:
    """The shortest way from the hull of some areas to a point; None when the point is above it.

    Args:
        point: shape (2,), m, as all points here seen from above.
        areas: their corners, each of shape (n, 2), m.

    Returns:
        Shape (2,), m.
    """
    hull = shapely.MultiPoint(np.concatenate(list(areas))).convex_hull
    way = shapely.shortest_line(hull, shapely.Point(point))
    begin, end = shapely.get_coordinates(way)
    found: FloatArray = end - begin
    return None if np.linalg.norm(found) <= EDGE_M else found


@dataclass(frozen=True, slots=True, eq=False)
class Faces:
    """Faces of one shape that look up, or down, and the edges of its vertical faces.

    Attributes:
        outlines: polygons, lines or points seen from above, shape (n,).
        planes: height at (0, 0) and slope along x and y, shape (n, 3).
        boxes: minimum and maximum x, y and z, shape (n, 2, 3), m.
        is_flat: whether it is a face, not a line or point of a curved surface or an edge; shape
            (n,).
    """

    outlines: NDArray[np.object_]
    planes: FloatArray
    boxes: FloatArray
    is_flat: NDArray[np.bool_]

    @classmethod
    def of(cls, corners: FloatArray, *, is_flat: bool, normals: FloatArray | None = None) -> Faces:
        """Faces by their corners, shape (n, k, 3), m, and unit normals, (n, 3), where known."""
        count = corners.shape[1]
        flat = corners[..., :2]
        if count == 1:
            outlines = shapely.points(flat[:, 0])
        elif count == 2:
            outlines = shapely.linestrings(flat)
        else:
            outlines = shapely.polygons(flat)
        first = corners[:, 0]
        slopes = np.zeros((len(corners), 2))
        if count == 2:
            way = corners[:, 1] - first
            slopes = way[:, 2:] * way[:, :2] / (way[:, :2] ** 2).sum(axis=1, keepdims=True)
        elif count > 2:
            n = _normals(corners) if normals is None else normals
            slopes = -n[:, :2] / n[:, 2:]
        heights = first[:, 2] - (slopes * first[:, :2]).sum(axis=1)
        planes = np.column_stack([heights, slopes])
        boxes = np.stack([corners.min(axis=1), corners.max(axis=1)], axis=1)
        return cls(outlines, planes, boxes, np.full(len(corners), is_flat))

    def flat_planes_at(self, point: FloatArray) -> FloatArray:
        """The planes of flat faces above or below a point, shape (2,), m, shape (k, 3)."""
        spot = shapely.Point(*point).buffer(EDGE_M)
        planes: FloatArray = self.planes[self.is_flat & shapely.intersects(self.outlines, spot)]
        return planes

    def __add__(self, other: Faces) -> Faces:
        return Faces(
            *(
                np.concatenate([getattr(self, name), getattr(other, name)])
                for name in ("outlines", "planes", "boxes", "is_flat")
            )
        )


def faces_of(part: Part, sign: float) -> Faces:
    """The faces of a shape placed in base that look up (+1) or down (-1)."""
    T, shape = part.T_body_part, part.shape
    up = sign * T.rotation[2]
    if isinstance(shape, Sphere):
        point = T.translation + sign * shape.radius_m * UP
        return Faces.of(point[None, None], is_flat=False)
    if isinstance(shape, Cylinder):
        return _of_cylinder(shape, T, up)
    if isinstance(shape, Box):
        is_seen = _BOX_NORMALS @ up > _VERTICAL
        corners = (_corners(shape, up) @ T.rotation.T + T.translation)[_QUADS[is_seen]]
        return Faces.of(corners, is_flat=True, normals=_BOX_NORMALS[is_seen] @ T.rotation.T)
    corners = shape.corners @ T.rotation.T + T.translation
    normals = _normals(corners)
    if shape.is_convex:
        is_seen = sign * normals[:, 2] > _VERTICAL
        return Faces.of(corners[is_seen], is_flat=True, normals=normals[is_seen])
    is_vertical = np.abs(normals[:, 2]) <= _VERTICAL
    faces = Faces.of(corners[~is_vertical], is_flat=True, normals=normals[~is_vertical])
    edges = corners[is_vertical][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2, 3)
    is_long = np.linalg.norm(np.ptp(edges[..., :2], axis=1), axis=1) > EDGE_M
    return faces + Faces.of(edges[is_long], is_flat=False)


def _of_cylinder(shape: Cylinder, T: pin.SE3, up: FloatArray) -> Faces:
    rim = _corners(shape, up).reshape(2, RIM_POINTS, 3) @ T.rotation.T + T.translation
    bottom, top = rim
    cap = top if up[2] > 0.0 else bottom
    caps = cap[None] if abs(up[2]) > _VERTICAL else cap[None][:0]
    faces = Faces.of(caps, is_flat=True)
    if np.hypot(up[0], up[1]) <= _VERTICAL:
        return faces
    line = rim[:, 0]  # the highest or lowest of the mantle; the rim's points begin there
    return faces + Faces.of(line[None], is_flat=False)


def floor_around(centre: FloatArray, reach_m: float) -> Faces:
    """The floor around a point, shape (2,), m."""
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * 2 * reach_m
    square = np.column_stack([corners + centre, np.full(4, FLOOR_Z_M)])
    return Faces.of(square[None], is_flat=True)


@dataclass(frozen=True, slots=True, eq=False)
class Overlaps:
    """Overlaps of faces of one shape with faces of another below it, seen from above.

    Attributes:
        points: corners of the overlaps: x, y, and the height of the lower face minus that of the
            upper one, shape (n, 3), m; negative where there is a gap.
        overlap: number of the overlap that each corner belongs to, shape (n,).
    """

    points: FloatArray
    overlap: NDArray[np.intp]

    def within(self, gap_m: float) -> FloatArray:
        """Corners of the areas whose gap is at most `gap_m`, shape (n, 2), m."""
        xy, excess = self.points[:, :2], self.points[:, 2] + gap_m
        crossing = (self.overlap[1:] == self.overlap[:-1]) & (excess[1:] * excess[:-1] < 0.0)
        first = np.flatnonzero(crossing)
        share = (excess[first] / (excess[first] - excess[first + 1]))[:, None]
        crossed = xy[first] + share * (xy[first + 1] - xy[first])
        return np.concatenate([xy[excess >= 0.0], crossed])


def overlaps_between(upper: Faces, lower: Faces, range_m: float) -> Overlaps:
    """The overlaps of faces with faces below them whose gap is within a range somewhere."""
    near = (upper.boxes[:, None, 0, 2] - lower.boxes[None, :, 1, 2]) <= range_m
    for axis in (0, 1):
        near &= upper.boxes[:, None, 0, axis] <= lower.boxes[None, :, 1, axis] + EDGE_M
        near &= lower.boxes[None, :, 0, axis] <= upper.boxes[:, None, 1, axis] + EDGE_M
    i, j = np.nonzero(near)
    one, other = upper.outlines[i], lower.outlines[j]
    overlaps = shapely.intersection(one, other)
    # edges and points intersect only if rounding happens to allow it
    thin = shapely.area(overlaps) <= EDGE_M * shapely.length(overlaps)
    if thin.any():
        wider = shapely.buffer(other[thin], EDGE_M, join_style="mitre")
        overlaps[thin] = shapely.intersection(one[thin], wider)
    xy, number = shapely.get_coordinates(overlaps, return_index=True)
    homogeneous = np.column_stack([np.ones(len(xy)), xy])
    floor_m = (lower.planes[j[number]] * homogeneous).sum(axis=1)
    underside_m = (upper.planes[i[number]] * homogeneous).sum(axis=1)
    # a widened overlap reaches beyond the faces; heights do not
    floor_m = np.minimum(floor_m, lower.boxes[j[number], 1, 2])
    gaps = floor_m - np.maximum(underside_m, upper.boxes[i[number], 0, 2])
    count = len(i)
    is_near = np.bincount(number[gaps >= -range_m], minlength=count) > 0
    is_above = np.bincount(number[gaps > PRESSING_TOLERANCE_M], minlength=count) > 0
    kept = (is_near & ~is_above)[number]  # a face above the underside is above the whole body
    return Overlaps(np.column_stack([xy, gaps])[kept], number[kept])


def _normals(corners: FloatArray) -> FloatArray:
    """Unit normals of polygons, shape (n, k, 3) to (n, 3)."""
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    unit: FloatArray = n / np.linalg.norm(n, axis=1, keepdims=True)
    return unit


def _lowest_points(part: Part) -> FloatArray:
    """The lowest points of a shape placed in base, shape (n, 3), m."""
    T = part.T_body_part
    points = np.array([T.act(point) for point in _corners(part.shape, -T.rotation[2])])
    heights = points[:, 2]
    found: FloatArray = points[heights <= heights.min() + SLICE_M]
    return found


def _corners(shape: Shape, up: FloatArray) -> FloatArray:
    """Points of a shape, in its frame, whose hull has the same extremes along a direction."""
    if isinstance(shape, Box):
        return _CORNERS * shape.size_m
    if isinstance(shape, Sphere):
        return shape.radius_m * up[None]
    if isinstance(shape, Mesh):
        return shape.vertices
    start = float(np.arctan2(up[1], up[0]))  # the rim's extreme point is among them
    angles = start + np.linspace(0.0, 2 * np.pi, RIM_POINTS, endpoint=False)
    rim = shape.radius_m * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ends = (-shape.length_m / 2, shape.length_m / 2)
    return np.concatenate([np.column_stack([rim, np.full(RIM_POINTS, z)]) for z in ends])
