"""Support: where a body that falls straight meets what is below, and whether it stands there.

A body touches what is below it where the vertical gap between its underside and the faces below is
at most `SLICE_M`. The underside and what is below are taken face by face: corners and faces of
boxes and meshes, caps and lines of cylinders, points of balls (Shapely enters here). So meshes with
walls, steps and holes support a body only where its own footprint meets them. A body stands when
its centre is above the convex hull of all contacts, the support polygon.

A body comes to rest level where it stands so. Otherwise it lies as its support does, turned by at
most `MAX_TILT_RAD`, which is how far a measured table may be off. The plane that it then lies in is
the lowest at its centre among those above all that is below: the linear program

    minimise a  subject to  a + b . (x - c) >= f(x) - g(x)  at all corners x of overlapping faces,

with the height f of what is below, g of the underside, c the centre and b the slope. Its solution
touches in three contacts around the centre.

Bodies count as evenly heavy, so the middle of the bounding box stands for the centre of mass; of
lopsided bodies that is not true.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pinocchio as pin
import shapely
from numpy.typing import NDArray

from baxter_kin.frames import BASE_HEIGHT_M, raised
from baxter_kin.validation import FloatArray
from planner.scene.bodies import Body, Box, Cylinder, Part, Sphere
from planner.scene.contact import (
    PRESSING_TOLERANCE_M,
    contact_point,
    lift_m,
    travel_to_contact,
)
from planner.scene.mesh import Mesh

FLOOR_Z_M = -BASE_HEIGHT_M
FLOOR = "floor"
UP = np.array([0.0, 0.0, 1.0])

LEVEL_M = 1e-5
"""Supports whose heights differ by less carry a body together."""

SLICE_M = 1e-5
"""Faces whose vertical gap is less touch; points this far from the lowest of a shape lie in one
plane."""

RIM_POINTS = 64
"""Of a cylinder's rim; a polygon of so many corners is 0.12 % of the radius too small."""

EDGE_M = 1e-6
"""A centre this far outside the support polygon is above its edge still."""

MAX_TILT_RAD = math.radians(1.0)
"""A support whose slope is less is a level one that was measured or built inexactly; on a steeper
one nothing is put down."""

ANGLE_RAD = 1e-6
"""Accuracy of a tilt."""

_VERTICAL = 1e-3
"""Faces whose normal has a smaller vertical component are vertical: only their edges count."""

_MAX_TURNS = 3
"""Turns to lie on a support; the first is exact up to second order in the tilt."""

_MAX_LIFTS = 64
"""Rises out of one body after the other."""

_MAX_EXCHANGES = 500
"""Steps to the lowest plane; a few suffice, unless rounding makes them go round in circles."""

_PLANE_M = 1e-9
"""Points this far above a plane lie in it."""

_CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)))
_BOX_NORMALS = np.array([*np.eye(3), *-np.eye(3)])
_QUADS = np.array(
    [[4, 6, 7, 5], [2, 3, 7, 6], [1, 5, 7, 3], [0, 1, 3, 2], [0, 4, 5, 1], [0, 2, 6, 4]]
)
"""Corners of a box of unit edges, the normals of its faces, and the corners of each."""


@dataclass(frozen=True, slots=True, eq=False)
class Landing:
    """The end of a straight fall.

    Attributes:
        body: the body there.
        drop_m: how far it fell, not negative.
        supports: names of what it touches; the floor is one.
        areas: where it touches each, corners seen from above, shape (n, 2), m.
        tilt_rad: how far it is turned from level, because its support lies so; 0 when level.
        slope_rad: slope of the face below its centre where that is more than `MAX_TILT_RAD` and it
            does not stand; else 0.
    """

    body: Body
    drop_m: float
    supports: tuple[str, ...]
    areas: tuple[FloatArray, ...]
    tilt_rad: float = 0.0
    slope_rad: float = 0.0

    @property
    def beside(self) -> FloatArray | None:
        """The way from what it stands on to its centre, shape (2,), m; None when it stands."""
        return beside(self.body.centre_base[:2], self.areas)


def come_down(body: Body, others: Sequence[Body]) -> Landing:
    """Where a body lands that is let go: level where it stands so, else as its support lies."""
    level_body = _levelled(body)
    level = land(level_body, others)
    if level.beside is None:
        return level
    tilt_rad = _angle(level_body.T_base_body, body.T_base_body)
    if ANGLE_RAD < tilt_rad <= MAX_TILT_RAD + ANGLE_RAD:
        lying = land(body, others)
        if lying.drop_m <= PRESSING_TOLERANCE_M and lying.beside is None:
            return replace(lying, tilt_rad=tilt_rad)
    return _turned_to_lie(level, others) or replace(level, slope_rad=_slope(level, others))


def land(body: Body, others: Iterable[Body]) -> Landing:
    """Where a body lands that falls straight, as it is, onto others or the floor.

    What it touches within `PRESSING_TOLERANCE_M` already carries it where it is.
    """
    lifted = body.at(raised(body.T_base_body, PRESSING_TOLERANCE_M))
    room_m = lifted.extent_m(UP)[0] - FLOOR_Z_M
    meetings = [
        (travel, part, below, other.name)
        for other in others
        for part in lifted.placed_parts
        for below in other.placed_parts
        if (travel := travel_to_contact(part, -UP, below, room_m)) is not None
    ]
    travel_m = min((room_m, *(travel for travel, *_ in meetings)))
    landed = lifted.at(raised(lifted.T_base_body, -travel_m))
    met = [meeting for meeting in meetings if meeting[0] <= travel_m + LEVEL_M]
    met.sort(key=lambda meeting: meeting[0])
    names = [name for *_, name in met]
    areas = [
        touched_area(part.at(raised(part.T_body_part, -travel)), below)
        for travel, part, below, _ in met
    ]
    if room_m <= travel_m + LEVEL_M:
        names.append(FLOOR)
        areas.append(bottom_area(landed.placed_parts))
    drop_m = max(0.0, travel_m - PRESSING_TOLERANCE_M)
    return Landing(landed, drop_m, tuple(dict.fromkeys(names)), tuple(areas))


def lifted_out(body: Body, others: Iterable[Body]) -> Body:
    """The body straight above where it is, as low as it is inside none of the others."""
    known = list(others)
    for _ in range(_MAX_LIFTS):
        rise_m = max((lift_m(body, other) for other in known), default=0.0)
        if rise_m == 0.0:
            break
        body = body.at(raised(body.T_base_body, rise_m))
    return body


def _levelled(body: Body) -> Body:
    """The body turned about its centre, by the least angle that makes one of its axes vertical.

    A long one rises as much as its turning would otherwise push it down.
    """
    R = body.T_base_body.rotation
    axis = int(np.abs(R[2]).argmax())
    up = R[:, axis] * np.sign(R[2, axis])
    turned = _turned(body, up, UP)
    sunk_m = body.extent_m(UP)[0] - turned.extent_m(UP)[0]
    return turned.at(raised(turned.T_base_body, max(0.0, sunk_m)))


def touched_area(above: Part, below: Part) -> FloatArray:
    """Where a shape touches another below it, both placed in base: corners, shape (n, 2), m."""
    area = _gaps(_faces(above, -1.0), _faces(below, +1.0), SLICE_M).within(SLICE_M)
    return area if len(area) else contact_point(above, below)[None, :2]


def bottom_area(parts: Iterable[Part]) -> FloatArray:
    """Where shapes placed in base touch a level floor: corners, shape (n, 2), m."""
    slices = [_slice(part, -1.0) for part in parts]
    lowest = min(float(points[:, 2].min()) for points in slices)
    touching = [points for points in slices if points[:, 2].min() <= lowest + SLICE_M]
    return np.concatenate(touching)[:, :2]


def beside(point: FloatArray, areas: Iterable[FloatArray]) -> FloatArray | None:
    """The way from the hull of some areas to a point, shape (2,), m; None when it is above it."""
    way = shapely.shortest_line(_hull(np.concatenate(list(areas))), shapely.Point(point))
    begin, end = shapely.get_coordinates(way)
    found: FloatArray = end - begin
    return None if np.linalg.norm(found) <= EDGE_M else found


def _hull(points: FloatArray) -> shapely.Geometry:
    """The convex hull seen from above: a polygon, a line or a point."""
    return shapely.MultiPoint(points[:, :2]).convex_hull


# Lying on a support that is not level


def _turned_to_lie(level: Landing, others: Sequence[Body]) -> Landing | None:
    """The landing turned as the supports lie; None when it does not stand so within the tilt."""
    landing = level
    for _ in range(_MAX_TURNS):
        body = landing.body
        plane = _support_plane(body, others)
        if plane is None:
            return None
        height_m, slope = plane
        turned = _turned(body, UP, np.array([*-slope, 1.0]))
        tilt_rad = _angle(level.body.T_base_body, turned.T_base_body)
        if tilt_rad > MAX_TILT_RAD + ANGLE_RAD:
            return None
        landing = land(turned.at(raised(turned.T_base_body, height_m)), others)
        if landing.beside is None:
            fallen_m = float(level.body.centre_base[2] - landing.body.centre_base[2])
            drop_m = max(0.0, level.drop_m + fallen_m)
            return replace(landing, drop_m=drop_m, tilt_rad=tilt_rad)
    return None


def _support_plane(body: Body, others: Sequence[Body]) -> tuple[float, FloatArray] | None:
    """Height above the body's centre and slope, shape (2,), of the plane that carries it.

    None when there is none around its centre, or its slope is beyond what is looked for.
    """
    centre, reach_m = body.centre_base[:2], _reach_m(body)
    max_slope = float(np.tan(2 * MAX_TILT_RAD))
    lower = [_faces(part, +1.0) for other in others for part in other.placed_parts]
    lower.append(_floor(centre, reach_m))
    gaps = np.concatenate(
        [
            _gaps(_faces(part, -1.0), below, 2 * reach_m * max_slope).points
            for part, below in product(body.placed_parts, lower)
        ]
    )
    if not len(gaps):
        return None
    offsets = gaps[:, :2] - centre
    # contacts in a line say nothing of the slope across it, nor one contact of any: it is 0
    _, extents, axes = np.linalg.svd(offsets, full_matrices=False)
    axes = axes[extents > EDGE_M]
    found = _lowest_plane(offsets @ axes.T, gaps[:, 2], max_slope)
    if found is None:
        return None
    height_m, along = found
    slope: FloatArray = along @ axes
    return height_m, slope


def _lowest_plane(
    points: FloatArray, heights: FloatArray, max_slope: float
) -> tuple[float, FloatArray] | None:
    """The plane above all points that is lowest at the origin: height there and slope.

    By the dual simplex method: the plane through a few points around the origin, of which one is
    exchanged for the point farthest above it. None when no points lie around the origin, or the
    slope is greater.

    Args:
        points: shape (n, k), m, k up to 2.
        heights: shape (n,), m.
        max_slope: greatest slope.
    """
    count = points.shape[1]
    far_m = 1e3 * max(float(np.abs(points).max(initial=0.0)), 1e-3)
    corners = far_m * np.concatenate([np.eye(count), -np.ones((1, count))])  # around the origin
    points = np.concatenate([corners, points])
    heights = np.concatenate([np.full(count + 1, -max_slope * far_m), heights])
    rows = np.column_stack([np.ones(len(points)), points])
    basis = list(range(count + 1))
    for _ in range(_MAX_EXCHANGES):
        plane: FloatArray = np.linalg.solve(rows[basis], heights[basis]).astype(np.float64)
        above = heights - rows @ plane
        highest = int(above.argmax())
        if above[highest] <= _PLANE_M:
            if min(basis) <= count:  # it leans on a corner that is not there
                return None
            return float(plane[0]), plane[1:]
        shares = np.linalg.solve(rows[basis].T, np.eye(count + 1)[0])
        change = np.linalg.solve(rows[basis].T, rows[highest])
        ratios = np.full(count + 1, np.inf)
        np.divide(shares, change, out=ratios, where=change > 1e-12)
        basis[int(ratios.argmin())] = highest
    return None


def _slope(landing: Landing, others: Iterable[Body]) -> float:
    """The slope of the flat face below a body's centre, rad; 0 when it is small."""
    centre, reach_m = landing.body.centre_base[:2], _reach_m(landing.body)
    spot = shapely.Point(*centre).buffer(EDGE_M)
    bottom_m = landing.body.extent_m(UP)[0]
    highest_m, slope = -np.inf, 0.0
    for other in others:
        if other.name not in landing.supports:
            continue
        for faces in (_faces(part, +1.0) for part in other.placed_parts):
            over = faces.is_flat & shapely.intersects(faces.outlines, spot)
            for plane in faces.planes[over]:
                height_m = float(plane @ [1.0, *centre])
                steep = float(np.hypot(plane[1], plane[2]))
                touches = height_m >= bottom_m - reach_m * steep - SLICE_M
                if touches and height_m > highest_m:
                    highest_m, slope = height_m, steep
    slope_rad = float(np.arctan(slope))
    return slope_rad if slope_rad > MAX_TILT_RAD else 0.0


def _turned(body: Body, begin: FloatArray, end: FloatArray) -> Body:
    """The body turned about its centre, by the least angle from one direction to another."""
    turn = pin.Quaternion.FromTwoVectors(begin, end).toRotationMatrix()
    centre, T = body.centre_base, body.T_base_body
    return body.at(pin.SE3(turn @ T.rotation, centre + turn @ (T.translation - centre)))


def _angle(one: pin.SE3, other: pin.SE3) -> float:
    return float(np.linalg.norm(pin.log3(one.rotation.T @ other.rotation)))


def _reach_m(body: Body) -> float:
    """How far a body reaches sideways, at most."""
    (x0, x1), (y0, y1) = (body.extent_m(axis) for axis in np.eye(3)[:2])
    return math.hypot(x1 - x0, y1 - y0)


# Faces


@dataclass(frozen=True, slots=True, eq=False)
class _Faces:
    """Faces of one shape that are seen from above, or from below, and vertical ones as edges.

    Attributes:
        outlines: polygons, lines or points, shape (n,).
        planes: height at (0, 0) and slope along x and y, shape (n, 3).
        boxes: least x, y and z and greatest, shape (n, 2, 3), m.
        is_flat: whether it is a face, and not where a curved surface is extreme; shape (n,).
    """

    outlines: NDArray[np.object_]
    planes: FloatArray
    boxes: FloatArray
    is_flat: NDArray[np.bool_]

    @classmethod
    def of(cls, corners: FloatArray, *, is_flat: bool, normals: FloatArray | None = None) -> _Faces:
        """Faces of equal numbers of corners, shape (n, k, 3), m; normals where they are known."""
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

    def __add__(self, other: _Faces) -> _Faces:
        return _Faces(
            *(
                np.concatenate([getattr(self, name), getattr(other, name)])
                for name in ("outlines", "planes", "boxes", "is_flat")
            )
        )


def _faces(part: Part, sign: float) -> _Faces:
    """The faces of a shape placed in base that look down (-1) or up (+1)."""
    T, shape = part.T_body_part, part.shape
    up = sign * T.rotation[2]
    if isinstance(shape, Sphere):
        point = T.translation + sign * shape.radius_m * UP
        return _Faces.of(point[None, None], is_flat=False)
    if isinstance(shape, Cylinder):
        return _of_cylinder(shape, T, up)
    if isinstance(shape, Box):
        is_seen = _BOX_NORMALS @ up > _VERTICAL
        corners = (_corners(shape, up) @ T.rotation.T + T.translation)[_QUADS[is_seen]]
        return _Faces.of(corners, is_flat=True, normals=_BOX_NORMALS[is_seen] @ T.rotation.T)
    corners = shape.corners @ T.rotation.T + T.translation
    normals = _normals(corners)
    if shape.is_convex:
        is_seen = sign * normals[:, 2] > _VERTICAL
        return _Faces.of(corners[is_seen], is_flat=True, normals=normals[is_seen])
    is_vertical = np.abs(normals[:, 2]) <= _VERTICAL
    faces = _Faces.of(corners[~is_vertical], is_flat=True, normals=normals[~is_vertical])
    edges = corners[is_vertical][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2, 3)
    is_long = np.linalg.norm(np.ptp(edges[..., :2], axis=1), axis=1) > EDGE_M
    return faces + _Faces.of(edges[is_long], is_flat=False)


def _of_cylinder(shape: Cylinder, T: pin.SE3, up: FloatArray) -> _Faces:
    rim = _corners(shape, up).reshape(2, RIM_POINTS, 3) @ T.rotation.T + T.translation
    bottom, top = rim
    cap = top if up[2] > 0.0 else bottom
    caps = cap[None] if abs(up[2]) > _VERTICAL else cap[None][:0]
    faces = _Faces.of(caps, is_flat=True)
    if np.hypot(up[0], up[1]) <= _VERTICAL:
        return faces
    line = rim[:, 0]  # where the mantle is extreme; the rim's points begin there
    return faces + _Faces.of(line[None], is_flat=False)


def _floor(centre: FloatArray, reach_m: float) -> _Faces:
    """The floor around a place."""
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * 2 * reach_m
    square = np.column_stack([corners + centre, np.full(4, FLOOR_Z_M)])
    return _Faces.of(square[None], is_flat=True)


@dataclass(frozen=True, slots=True, eq=False)
class _Gaps:
    """Where faces of one shape are above faces of another.

    Attributes:
        points: corners of the overlaps seen from above, and how much higher the lower face is
            there, shape (n, 3), m; negative for a gap.
        overlap: to which overlap each belongs, shape (n,).
    """

    points: FloatArray
    overlap: NDArray[np.intp]

    def within(self, gap_m: float) -> FloatArray:
        """Corners of what is no farther apart than that, shape (n, 2), m."""
        xy, excess = self.points[:, :2], self.points[:, 2] + gap_m
        crossing = (self.overlap[1:] == self.overlap[:-1]) & (excess[1:] * excess[:-1] < 0.0)
        first = np.flatnonzero(crossing)
        share = (excess[first] / (excess[first] - excess[first + 1]))[:, None]
        crossed = xy[first] + share * (xy[first + 1] - xy[first])
        return np.concatenate([xy[excess >= 0.0], crossed])


def _gaps(upper: _Faces, lower: _Faces, range_m: float) -> _Gaps:
    """The overlaps of faces above others that come within a range."""
    near = (upper.boxes[:, None, 0, 2] - lower.boxes[None, :, 1, 2]) <= range_m
    for axis in (0, 1):
        near &= upper.boxes[:, None, 0, axis] <= lower.boxes[None, :, 1, axis] + EDGE_M
        near &= lower.boxes[None, :, 0, axis] <= upper.boxes[:, None, 1, axis] + EDGE_M
    i, j = np.nonzero(near)
    one, other = upper.outlines[i], lower.outlines[j]
    overlaps = shapely.intersection(one, other)
    # edges meet, by rounding or not
    thin = shapely.area(overlaps) <= EDGE_M * shapely.length(overlaps)
    if thin.any():
        wider = shapely.buffer(other[thin], EDGE_M, join_style="mitre")
        overlaps[thin] = shapely.intersection(one[thin], wider)
    xy, number = shapely.get_coordinates(overlaps, return_index=True)
    homogeneous = np.column_stack([np.ones(len(xy)), xy])
    floor_m = (lower.planes[j[number]] * homogeneous).sum(axis=1)
    underside_m = (upper.planes[i[number]] * homogeneous).sum(axis=1)
    # a widened overlap reaches beyond the faces, which no height does
    floor_m = np.minimum(floor_m, lower.boxes[j[number], 1, 2])
    gaps = floor_m - np.maximum(underside_m, upper.boxes[i[number], 0, 2])
    count = len(i)
    is_near = np.bincount(number[gaps >= -range_m], minlength=count) > 0
    is_above = np.bincount(number[gaps > PRESSING_TOLERANCE_M], minlength=count) > 0
    kept = (is_near & ~is_above)[number]  # what is above the underside is above the whole body
    return _Gaps(np.column_stack([xy, gaps])[kept], number[kept])


def _normals(corners: FloatArray) -> FloatArray:
    """Unit normals of polygons, shape (n, k, 3) to (n, 3)."""
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    unit: FloatArray = n / np.linalg.norm(n, axis=1, keepdims=True)
    return unit


def _slice(part: Part, sign: float) -> FloatArray:
    """The lowest (-1) or highest (+1) points of a shape placed in base, shape (n, 3)."""
    T, shape = part.T_body_part, part.shape
    points = np.array([T.act(point) for point in _corners(shape, sign * T.rotation[2])])
    heights = sign * points[:, 2]
    found: FloatArray = points[heights >= heights.max() - SLICE_M]
    return found


def _corners(shape: Box | Cylinder | Sphere | Mesh, up: FloatArray) -> FloatArray:
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
