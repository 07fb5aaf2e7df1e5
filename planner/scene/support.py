"""Support: where a body that falls straight meets what is below, and whether it stands there.

Where two convex shapes meet in a level plane, they touch in the overlap of the slices that lie in
it: corners of boxes and meshes, rims of cylinders, single points of balls. A body stands on the
convex hull of all of these (its support polygon; Shapely enters here). Bodies count as evenly
heavy, so the middle of the bounding box stands for the centre of mass; of lopsided bodies that is
not true.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np
import pinocchio as pin
import shapely

from baxter_kin.frames import BASE_HEIGHT_M, raised
from baxter_kin.validation import FloatArray
from planner.scene.bodies import Body, Box, Cylinder, Part, Sphere
from planner.scene.contact import PRESSING_TOLERANCE_M, contact_point, travel_to_contact
from planner.scene.mesh import Mesh

FLOOR_Z_M = -BASE_HEIGHT_M
FLOOR = "floor"
UP = np.array([0.0, 0.0, 1.0])

LEVEL_M = 1e-5
"""Supports whose heights differ by less carry a body together."""

SLICE_M = 1e-5
"""Points this far from the lowest or highest of a shape lie in the same plane."""

RIM_POINTS = 64
"""Of a cylinder's rim; a polygon of so many corners is 0.12 % of the radius too small."""

EDGE_M = 1e-6
"""A centre this far outside the support polygon is above its edge still."""


@dataclass(frozen=True, slots=True, eq=False)
class Landing:
    """The end of a straight fall.

    Attributes:
        body: the body there.
        drop_m: how far it fell, not negative.
        supports: names of what it touches; the floor is one.
        areas: where it touches each, corners seen from above, shape (n, 2), m.
    """

    body: Body
    drop_m: float
    supports: tuple[str, ...]
    areas: tuple[FloatArray, ...]

    @property
    def beside(self) -> FloatArray | None:
        """The way from what it stands on to its centre, shape (2,), m; None when it stands."""
        return beside(self.body.centre_base[:2], self.areas)


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


def levelled(body: Body) -> Body:
    """The body turned about its centre, by the least angle that makes one of its axes vertical.

    A long one rises as much as its turning would otherwise push it down.
    """
    R = body.T_base_body.rotation
    axis = int(np.abs(R[2]).argmax())
    up = R[:, axis] * np.sign(R[2, axis])
    turn = pin.Quaternion.FromTwoVectors(up, UP).toRotationMatrix()
    centre = body.centre_base
    shifted = centre + turn @ (body.T_base_body.translation - centre)
    turned = body.at(pin.SE3(turn @ R, shifted))
    sunk_m = body.extent_m(UP)[0] - turned.extent_m(UP)[0]
    return turned.at(raised(turned.T_base_body, max(0.0, sunk_m)))


def touched_area(above: Part, below: Part) -> FloatArray:
    """Where a shape touches another below it, both placed in base: corners, shape (n, 2), m."""
    bottom, top = _slice(above, -1.0), _slice(below, +1.0)
    if abs(float(bottom[0, 2] - top[0, 2])) <= 2 * SLICE_M:
        lower, upper = _hull(top), _hull(bottom)
        overlap = upper.intersection(lower)
        if overlap.area <= EDGE_M * overlap.length:  # edges meet, by rounding or not
            overlap = upper.intersection(lower.buffer(EDGE_M, join_style="mitre"))
        corners: FloatArray = shapely.get_coordinates(overlap)
        if len(corners):
            return corners
    return contact_point(above, below)[None, :2]


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
