"""Support: where a body that falls straight down lands, and whether it stands there.

A body stands when its centre is above the convex hull of all its contacts (`planner.scene.faces`),
the support polygon. It comes to rest level where it stands so. Otherwise it lies as its support
does, turned by at most `MAX_TILT_RAD`, the possible error of a measured table. The plane that it
then lies in is the lowest at its centre among those above everything below: the linear program

    minimise a  subject to  a + b . (x - c) >= f(x) - g(x)  at all corners x of overlapping faces,

with the height f of what is below, g of the underside, c the centre and b the slope. Its solution
touches in three contacts around the centre.

Bodies are taken to be of even density, so the middle of the bounding box stands for the centre of
mass; this does not hold for lopsided bodies.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pinocchio as pin

from baxter_kin.frames import raised
from baxter_kin.validation import FloatArray
from planner.scene.bodies import Body
from planner.scene.contact import PRESSING_TOLERANCE_M, lift_m, travel_to_contact
from planner.scene.faces import (
    EDGE_M,
    FLOOR_Z_M,
    SLICE_M,
    UP,
    bottom_area,
    faces_of,
    floor_around,
    offset_from_hull,
    overlaps_between,
    touched_area,
)

FLOOR = "floor"

LEVEL_TOLERANCE_M = 1e-5
"""Supports whose heights differ by less carry a body together."""

MAX_TILT_RAD = math.radians(1.0)
"""Slopes up to this count as measurement error of a level support; nothing is placed on a steeper
one."""

TILT_TOLERANCE_RAD = 1e-6
"""Accuracy of a tilt."""

_MAX_TURNS = 3
"""Maximum number of turns until a body lies on a support; the first is exact up to second order."""

_MAX_LIFTS = 64
"""Maximum number of rises out of other bodies."""

_MAX_EXCHANGES = 500
"""Maximum number of steps to the lowest plane; a few suffice, unless rounding makes them cycle."""

_PLANE_TOLERANCE_M = 1e-9
"""Points less than this above a plane count as lying in it."""


@dataclass(frozen=True, slots=True, eq=False)
class Landing:
    """The end of a straight fall.

    Attributes:
        body: the body there.
        drop_m: height of the fall, not negative.
        supports: names of what it touches; `FLOOR` is one.
        areas: corners of its contacts seen from above, shape (n, 2), m each.
        tilt_rad: its tilt, because its support is tilted; 0 when level.
        slope_rad: slope of the face below its centre where it does not stand because that is more
            than `MAX_TILT_RAD`; else 0.
    """

    body: Body
    drop_m: float
    supports: tuple[str, ...]
    areas: tuple[FloatArray, ...]
    tilt_rad: float = 0.0
    slope_rad: float = 0.0

    @property
    def overhang(self) -> FloatArray | None:
        """Vector from its support polygon to its centre, shape (2,), m; None when it is stable."""
        return offset_from_hull(self.body.centre_base[:2], self.areas)


def settle(body: Body, others: Sequence[Body]) -> Landing:
    """Where a released body comes to rest: level if it is stable so, else tilted as its support."""
    level_body = _levelled(body)
    level = fall_straight(level_body, others)
    if level.overhang is None:
        return level
    tilt_rad = _angle(level_body.T_base_body, body.T_base_body)
    if TILT_TOLERANCE_RAD < tilt_rad <= MAX_TILT_RAD + TILT_TOLERANCE_RAD:
        lying = fall_straight(body, others)
        if lying.drop_m <= PRESSING_TOLERANCE_M and lying.overhang is None:
            return replace(lying, tilt_rad=tilt_rad)
    return _turned_to_lie(level, others) or replace(level, slope_rad=_slope(level, others))


def fall_straight(body: Body, others: Iterable[Body]) -> Landing:
    """Where a body lands that falls straight down without turning, onto others or the floor.

    A body that it presses on by up to `PRESSING_TOLERANCE_M` carries it where it is.
    """
    lifted = body.at(raised(body.T_base_body, PRESSING_TOLERANCE_M))
    max_fall_m = lifted.extent_m(UP)[0] - FLOOR_Z_M
    meetings = [
        (travel, part, below, other.name)
        for other in others
        for part in lifted.placed_parts
        for below in other.placed_parts
        if (travel := travel_to_contact(part, -UP, below, max_fall_m)) is not None
    ]
    travel_m = min((max_fall_m, *(travel for travel, *_ in meetings)))
    landed = lifted.at(raised(lifted.T_base_body, -travel_m))
    met = [meeting for meeting in meetings if meeting[0] <= travel_m + LEVEL_TOLERANCE_M]
    met.sort(key=lambda meeting: meeting[0])
    names = [name for *_, name in met]
    areas = [
        touched_area(part.at(raised(part.T_body_part, -travel)), below)
        for travel, part, below, _ in met
    ]
    if max_fall_m <= travel_m + LEVEL_TOLERANCE_M:
        names.append(FLOOR)
        areas.append(bottom_area(landed.placed_parts))
    drop_m = max(0.0, travel_m - PRESSING_TOLERANCE_M)
    return Landing(landed, drop_m, tuple(dict.fromkeys(names)), tuple(areas))


def lifted_out(body: Body, others: Iterable[Body]) -> Body:
    """The body raised straight up, by as little as moves it out of all others.

    The last position, if that takes more than `_MAX_LIFTS` rises.
    """
    known = list(others)
    for _ in range(_MAX_LIFTS):
        rise_m = max((lift_m(body, other) for other in known), default=0.0)
        if rise_m == 0.0:
            break
        body = body.at(raised(body.T_base_body, rise_m))
    return body


def _levelled(body: Body) -> Body:
    """The body turned about its centre, by the smallest angle that makes one of its axes vertical.

    It rises by as much as turning would otherwise push it down.
    """
    R = body.T_base_body.rotation
    axis = int(np.abs(R[2]).argmax())
    up = R[:, axis] * np.sign(R[2, axis])
    turned = _turned(body, up, UP)
    sunk_m = body.extent_m(UP)[0] - turned.extent_m(UP)[0]
    return turned.at(raised(turned.T_base_body, max(0.0, sunk_m)))


def _turned_to_lie(level: Landing, others: Sequence[Body]) -> Landing | None:
    """The landing tilted as the supports; None when it does not stand so within `MAX_TILT_RAD`."""
    landing = level
    for _ in range(_MAX_TURNS):
        body = landing.body
        plane = _support_plane(body, others)
        if plane is None:
            return None
        height_m, slope = plane
        turned = _turned(body, UP, np.array([*-slope, 1.0]))
        tilt_rad = _angle(level.body.T_base_body, turned.T_base_body)
        if tilt_rad > MAX_TILT_RAD + TILT_TOLERANCE_RAD:
            return None
        landing = fall_straight(turned.at(raised(turned.T_base_body, height_m)), others)
        if landing.overhang is None:
            fallen_m = float(level.body.centre_base[2] - landing.body.centre_base[2])
            drop_m = max(0.0, level.drop_m + fallen_m)
            return replace(landing, drop_m=drop_m, tilt_rad=tilt_rad)
    return None


def _support_plane(body: Body, others: Sequence[Body]) -> tuple[float, FloatArray] | None:
    """Height above the body's centre and slope, shape (2,), of the plane that carries it.

    None when no support surrounds its centre, or the slope is too large.
    """
    centre, reach_m = body.centre_base[:2], _reach_m(body)
    max_slope = float(np.tan(2 * MAX_TILT_RAD))  # from a body that is tilted itself
    lower = [faces_of(part, +1.0) for other in others for part in other.placed_parts]
    lower.append(floor_around(centre, reach_m))
    gaps = np.concatenate(
        [
            overlaps_between(faces_of(part, -1.0), below, 2 * reach_m * max_slope).points
            for part, below in product(body.placed_parts, lower)
        ]
    )
    if not len(gaps):
        return None
    offsets = gaps[:, :2] - centre
    # contacts in a line do not determine the slope across it, nor does one contact: it is 0
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
    """The plane above all points that is lowest at the origin: its height there and its slope.

    The dual simplex method takes the plane through a few points around the origin, and repeatedly
    exchanges one of them for the point farthest above the plane. None when the points do not
    surround the origin, or the slope is larger than allowed.

    Args:
        points: shape (n, k), m, k up to 2.
        heights: shape (n,), m.
        max_slope: maximum slope.
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
        if above[highest] <= _PLANE_TOLERANCE_M:
            if min(basis) <= count:  # it rests on an artificial corner
                return None
            return float(plane[0]), plane[1:]
        shares = np.linalg.solve(rows[basis].T, np.eye(count + 1)[0])
        change = np.linalg.solve(rows[basis].T, rows[highest])
        ratios = np.full(count + 1, np.inf)
        np.divide(shares, change, out=ratios, where=change > 1e-12)
        basis[int(ratios.argmin())] = highest
    return None


def _slope(landing: Landing, others: Iterable[Body]) -> float:
    """Slope of the flat face below a body's centre, rad; 0 up to `MAX_TILT_RAD`."""
    centre, reach_m = landing.body.centre_base[:2], _reach_m(landing.body)
    bottom_m = landing.body.extent_m(UP)[0]
    highest_m, slope = -np.inf, 0.0
    for other in others:
        if other.name not in landing.supports:
            continue
        for part in other.placed_parts:
            for plane in faces_of(part, +1.0).flat_planes_at(centre):
                height_m = float(plane @ [1.0, *centre])
                steep = float(np.hypot(plane[1], plane[2]))
                touches = height_m >= bottom_m - reach_m * steep - SLICE_M
                if touches and height_m > highest_m:
                    highest_m, slope = height_m, steep
    slope_rad = float(np.arctan(slope))
    return slope_rad if slope_rad > MAX_TILT_RAD else 0.0


def _turned(body: Body, begin: FloatArray, end: FloatArray) -> Body:
    """The body turned about its centre, by the smallest angle from one direction to another."""
    turn = pin.Quaternion.FromTwoVectors(begin, end).toRotationMatrix()
    centre, T = body.centre_base, body.T_base_body
    return body.at(pin.SE3(turn @ T.rotation, centre + turn @ (T.translation - centre)))


def _angle(one: pin.SE3, other: pin.SE3) -> float:
    return float(np.linalg.norm(pin.log3(one.rotation.T @ other.rotation)))


def _reach_m(body: Body) -> float:
    """An upper bound on the horizontal extent of a body."""
    (x0, x1), (y0, y1) = (body.extent_m(axis) for axis in np.eye(3)[:2])
    return math.hypot(x1 - x0, y1 - y0)
