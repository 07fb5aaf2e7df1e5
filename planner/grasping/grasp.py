"""Grasp and Miss: the two results of closing a hand on a body, and the measures behind them.

The model is quasi-static and knows no forces. The pad that touches first pushes the body along the
closing axis until the other pad touches. The body keeps its orientation: a body that lies askew
stays askew, is held at two edges, and is wider between the pads than the distance of its faces, by
`cos(yaw) + sin(yaw)` for a cube, where real pads would turn a slightly askew body until its faces
are flush. It is placed with the same yaw. A closing axis that is not level lifts the pushed body,
or presses it down, by the sine of its slope: 14 um per mm with the demo's tool.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import product
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from baxter_kin.display import millimetres, millimetres_hint
from baxter_kin.fields import frozen
from baxter_kin.validation import FloatArray
from planner.errors import SceneError
from planner.scene.bodies import Body, Box, Cylinder, Part, Sphere, part_extent_m
from planner.scene.contact import gap_m, travel_to_contact
from planner.scene.mesh import Mesh, cuboid

MIN_PAD_M = 0.002
"""A body with less of a pad on it slips off. Chosen: no value is published for these pads."""

NEAR_EDGE_M = 0.010
"""A grasp with less of a pad on the body is near an edge: a quarter of the left hand's pads."""

AS_NEAR_M = 1e-4
"""Parts this much farther from each other than the nearest ones touch, too: pads are of rubber, and
their mesh has this accuracy."""

ROUNDING_M = 1e-12
"""Maximum distance of a point on the edge of a pad from it, due to rounding."""

PLATE_M = 0.01
"""Thickness of the plate that measures the extent of a round shape; the value does not matter."""

_Interval: TypeAlias = tuple[float, float]

_WHOLE_M = 1e-6
"""Maximum length missing from a pad that is used wholly, due to rounding."""


class MissKind(str, Enum):
    """Why a hand holds nothing after closing."""

    NOTHING = "nothing between the pads"
    TOO_WIDE = "too wide"
    TOO_THIN = "too thin"
    NOT_BETWEEN = "reaches into a finger"
    EDGE = "only the edge of a pad"
    BLOCKED = "a finger is blocked"
    CROWDED = "several bodies between the pads"


@frozen(error=SceneError, eq=True)
class Miss:
    """The reason why a hand holds nothing after closing; `str()` of it is a phrase.

    Attributes:
        kind: the reason.
        text: the reason with names and numbers.
        body: name of the body concerned; None when there is none.
        amount_m: the number in the text: width, depth in the finger, length of a pad on the body,
            or distance from the tip; None when there is none.
    """

    kind: MissKind
    text: str
    body: str | None = None
    amount_m: float | None = None

    def __str__(self) -> str:
        return self.text

    def _facts(self) -> tuple[str, ...]:
        return (self.text,)


@frozen(error=SceneError)
class Grasp:
    """A body that both pads touch.

    Attributes:
        finger_m: finger position, 0 .. stroke.
        T_tip_body: the body's pose seen from the tip once both pads touch it.
        width_m: distance between the pads where they are nearest to each other: Rethink's pads are
            hollow by up to 0.9 mm, so it may be smaller than the body's width.
        push_m: distance that the first pad pushed the body along the closing axis before the second
            touched; positive along y of the gripper.
        pad_m: length of a pad on the body, along the shorter side of their overlap; the smaller of
            both pads.
        centre_off_m: distance of the body's centre from the pads, seen along the closing axis; 0
            when it is between them.
        is_near_edge: whether less than `NEAR_EDGE_M` of a pad is on a body that is large enough for
            more.
    """

    finger_m: float
    T_tip_body: pin.SE3
    width_m: float
    push_m: float
    pad_m: float
    centre_off_m: float
    is_near_edge: bool

    def _facts(self) -> tuple[str, ...]:
        pushed = f"pushed {millimetres(self.push_m)}"
        near = "near the edge of a pad" if self.is_near_edge else ""
        return (
            f"{millimetres(self.width_m)} wide",
            f"fingers at {millimetres(self.finger_m)}",
            pushed,
            near,
        )


@dataclass(frozen=True, slots=True)
class Overlap:
    """The overlap of a pad and a body, seen along the closing axis.

    Both are taken as the rectangles of their extents along x and z of the gripper, which is exact
    for boxes that lie straight in the hand, and too large for round or askew shapes.

    Attributes:
        least_m: its shorter side; not positive when they do not overlap.
        possible_m: its shorter side if one were wholly on the other.
    """

    least_m: float
    possible_m: float

    @property
    def is_enough(self) -> bool:
        """Whether enough of the pad is on the body to hold it."""
        return self.least_m >= MIN_PAD_M or self._is_whole

    @property
    def is_near_edge(self) -> bool:
        """Whether the pad holds the body near its edge only."""
        return self.least_m < NEAR_EDGE_M and not self._is_whole

    @property
    def _is_whole(self) -> bool:
        return self.least_m >= self.possible_m - _WHOLE_M

    @classmethod
    def of(cls, pad: Sequence[Part], parts: Sequence[Part]) -> Overlap:
        """The largest overlap of a pad with one of the parts it touches, all seen from the tip.

        The nearest shapes touch, and those about as near (`AS_NEAR_M`).
        """
        gaps = {(p, q): gap_m(pad[p], parts[q]) for p in range(len(pad)) for q in range(len(parts))}
        least = min(gaps.values())
        touching = [pair for pair, gap in gaps.items() if gap <= least + AS_NEAR_M]
        pieces = [pad[p] for p in sorted({p for p, _ in touching})]
        spans = [_span(pieces, axis) for axis in (0, 2)]
        overlaps = (_overlap(spans, parts[q]) for q in sorted({q for _, q in touching}))
        return max(overlaps, key=lambda found: found.least_m)


def extent(part: Part, axis: int) -> tuple[float, float]:
    """The interval that a placed part covers along an axis of the same frame, m."""
    return part_extent_m(part, np.eye(3)[axis])


def width_between_m(pads: Sequence[Part], parts: Sequence[Part], gap_m: float) -> float:
    """The width between the pads, along the closing axis; 0 where nothing is between them.

    Only the space in front of the pads counts: shapes are clipped to the rectangle of the pads
    along x and z, and excluded where nothing of them is within half the gap of the middle. So a mug
    held by its handle is as wide as the handle, and a tray held by its rim as the rim. In a mesh
    that is not convex, each triangle counts by itself.

    Args:
        pads: the shapes of both pads, placed in the frame of the tip.
        parts: shapes, placed in the same frame.
        gap_m: distance between the pads.
    """
    x, z = _span(pads, 0), _span(pads, 2)
    covered = np.concatenate([_covered(part, x, z) for part in parts])
    between = covered[(covered[:, 0] < gap_m / 2) & (covered[:, 1] > -gap_m / 2)]
    return float(between[:, 1].max() - between[:, 0].min()) if len(between) else 0.0


def _covered(part: Part, x: _Interval, z: _Interval) -> FloatArray:
    """The intervals along y that a shape covers inside a rectangle of x and z, shape (n, 2), m."""
    if isinstance(part.shape, (Cylinder, Sphere)):
        return _covered_by_round(part, x, z)
    mesh = part.shape if isinstance(part.shape, Mesh) else cuboid(part.shape.size_m)
    T = part.T_body_part
    intervals = _clipped(mesh.corners @ T.rotation.T + T.translation, x, z)
    if not mesh.is_convex or not len(intervals):
        return intervals
    return np.array([[intervals[:, 0].min(), intervals[:, 1].max()]])


def _covered_by_round(part: Part, x: _Interval, z: _Interval) -> FloatArray:
    """The same for a cylinder or a ball, found by moving a plate towards it from either side."""
    low, high = extent(part, 1)
    size = x[1] - x[0], PLATE_M, z[1] - z[0]
    ends = []
    for sign, start in ((1.0, low), (-1.0, high)):
        middle = np.array([sum(x) / 2, start - sign * PLATE_M, sum(z) / 2])
        plate = Part(Box(size), pin.SE3(np.eye(3), middle))
        travel = travel_to_contact(plate, sign * np.eye(3)[1], part, high - low + PLATE_M)
        if travel is None:
            return np.empty((0, 2))
        ends.append(start + sign * (travel - PLATE_M / 2))
    return np.array([ends])


def _clipped(triangles: FloatArray, x: _Interval, z: _Interval) -> FloatArray:
    """The intervals along y of triangles, shape (n, 3, 3), m, clipped to a rectangle of x and z.

    A clipped triangle is a polygon. Its corners are the corners of the triangle inside the
    rectangle, the points where the triangle's edges cross the sides of the rectangle, and the
    corners of the rectangle that the triangle covers, seen along y.

    Returns:
        The intervals of the triangles that are partly inside, shape (m, 2), m.
    """
    sides = np.array([x, z])
    starts, ways = triangles, triangles[:, [1, 2, 0]] - triangles
    found = [triangles]
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis, bounds in zip((0, 2), sides, strict=True):
            for bound in bounds:
                share = (bound - starts[..., axis]) / ways[..., axis]
                share = np.where((share >= 0.0) & (share <= 1.0), share, np.nan)
                found.append(starts + share[..., None] * ways)
        normals = np.cross(ways[:, 0], ways[:, 1])
        for corner in product(*sides):
            way = np.array([corner[0], 0.0, corner[1]]) - starts[:, 0]
            y = -(normals[:, 0] * way[:, 0] + normals[:, 2] * way[:, 2]) / normals[:, 1]
            above = np.stack(
                [np.full(len(y), corner[0]), starts[:, 0, 1] + y, np.full(len(y), corner[1])], 1
            )
            turns = np.cross(ways, above[:, None] - starts)[..., 1] * np.sign(normals[:, None, 1])
            above[~(turns >= 0.0).all(axis=1)] = np.nan
            found.append(above[:, None])
    points = np.concatenate(found, axis=1)
    inside = np.isfinite(points[..., 1])
    for axis, (low, high) in zip((0, 2), sides, strict=True):
        inside &= (points[..., axis] >= low - ROUNDING_M) & (points[..., axis] <= high + ROUNDING_M)
    lows = np.where(inside, points[..., 1], np.inf).min(axis=1)
    highs = np.where(inside, points[..., 1], -np.inf).max(axis=1)
    return np.stack([lows, highs], axis=1)[inside.any(axis=1)]


def centre_off_m(pads: Sequence[Sequence[Part]], body: Body) -> float:
    """Distance of a body's centre from the pads, seen along y; all are seen from the tip."""
    distances = []
    for axis in (0, 2):
        centre = sum(body.extent_m(np.eye(3)[axis])) / 2
        spans = [_span(pad, axis) for pad in pads]
        low, high = min(low for low, _ in spans), max(high for _, high in spans)
        distances.append(max(low - centre, centre - high, 0.0))
    return math.hypot(*distances)


def _span(pad: Sequence[Part], axis: int) -> tuple[float, float]:
    """The interval that some shapes cover together along an axis."""
    spans = [extent(part, axis) for part in pad]
    return min(low for low, _ in spans), max(high for _, high in spans)


def _overlap(spans: Sequence[tuple[float, float]], part: Part) -> Overlap:
    shared, possible = [], []
    for axis, (low, high) in zip((0, 2), spans, strict=True):
        begin, end = extent(part, axis)
        shared.append(min(high, end) - max(low, begin))
        possible.append(min(high - low, end - begin))
    tightest = int(np.argmin(shared))
    return Overlap(shared[tightest], possible[tightest])


def miss_by_width(kind: MissKind, name: str, width_m: float, gap_m: float) -> Miss:
    """The miss of a body too wide for the open hand, or too thin for the closed one."""
    pads = "whose closed finger pads" if kind is MissKind.TOO_THIN else "whose finger pads"
    text = (
        f"{name} measures {1e3 * width_m:.1f} mm across the hand, {pads} are {1e3 * gap_m:.1f} mm "
        "apart"
    )
    return Miss(kind, text, name, width_m)


def miss_beside(seen: Body) -> Miss:
    """The miss of a body, seen from the tip, that is not between the pads."""
    x, y, z = seen.centre_base
    across = float(np.hypot(x, y))
    is_hinted = millimetres_hint(x, y, z) != ""
    hint = "; was its place given in millimetres? Lengths are in metres" if is_hinted else ""
    text = (
        f"{seen.name} is {1e3 * across:.0f} mm to the side of the tip and {1e3 * abs(z):.0f} mm "
        f"{'ahead of' if z >= 0.0 else 'behind'} it, not between the finger pads{hint}"
    )
    return Miss(MissKind.NOTHING, text, seen.name, across)


def miss_at_edge(name: str, pad_m: float) -> Miss:
    """The miss of a body with too little of a pad on it."""
    text = (
        f"only {1e3 * pad_m:.1f} mm of a finger pad on {name}; less than "
        f"{1e3 * MIN_PAD_M:.1f} mm slip off"
    )
    return Miss(MissKind.EDGE, text, name, pad_m)
