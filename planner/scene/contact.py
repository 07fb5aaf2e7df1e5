"""Contact between shapes: gaps, depths, and how far a shape moves until it touches another.

Intended contacts are values: a `Contact` names two things that may touch, and how deep.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import product
from typing import NamedTuple, TypeAlias

import coal
import numpy as np
import pinocchio as pin

from baxter_kin.display import millimetres, quoted
from baxter_kin.fields import frozen
from baxter_kin.validation import FloatArray, expect, expect_all
from planner.errors import SceneError
from planner.scene.bodies import Body, Box, Cylinder, Part, Scene
from planner.scene.coal_shapes import (
    BOTH_SIDES,
    FLAT_M,
    coal_pose,
    coal_shape,
    convex,
    convex_pieces,
)
from planner.scene.mesh import Mesh

CONTACT_TOLERANCE_M = 1e-9
"""Shapes closer than this touch."""

PRESSING_TOLERANCE_M = 5e-4
"""Maximum depth of an intended contact; deeper ones count as collisions."""

DISTANCE_TOLERANCE_M = 1e-8
"""Accuracy of distances where a contact is sought; coal's default, 1e-6, overshoots."""

SLIDING = 1e-3
"""Shapes in contact that approach by less than this share of their way slide along each other."""

_MAX_ADVANCES = 1000

_Placed: TypeAlias = tuple[coal.CollisionGeometry, coal.Transform3s]


def travel_to_contact(
    moving: Part, direction: FloatArray, still: Part, max_travel_m: float
) -> float | None:
    """Distance that a shape moves along a line until it touches another; None if it does not.

    Conservative advancement (Mirtich 1996): two planes across the shortest connection keep convex
    shapes apart, so a shape may move until the gap between them is used up, and never touches when
    it does not move towards them. Shapes in contact touch at once, unless one slides along the
    other or leaves it. A mesh that is not convex is treated as its triangles, of those in the
    way, so a shape that slides along its surface stops at the next edge.

    Args:
        moving: the shape that moves, placed in some frame.
        direction: unit vector in that frame, shape (3,).
        still: the other shape, placed in the same frame.
        max_travel_m: maximum distance.
    """
    way = max_travel_m * direction
    swept, there = _swept(bounds_m(moving), way), bounds_m(still)
    if _are_apart(swept, there):
        return None
    firsts, seconds = _pieces(moving, _swept(there, -way)), _pieces(still, swept)
    travels = (
        _travel(first, second, direction, max_travel_m)
        for first, second in product(firsts, seconds)
    )
    return min((travel for travel in travels if travel is not None), default=None)


def depth_m(body: Body, other: Body) -> float:
    """Depth of a body inside another: the shortest move that separates two shapes; 0 outside.

    A body wholly inside a mesh that is not convex touches nothing.
    """
    gaps = [_nearest([one], [two])[0] for one, two in _near_pieces(body, other)]
    return max(0.0, -min(gaps, default=0.0))


def lift_m(body: Body, other: Body) -> float:
    """Rise of a body after which no shape of it presses deeper into another's than allowed."""
    up, lifts = np.array([0.0, 0.0, 1.0]), [0.0]
    top_m, bottom_m = other.extent_m(up)[1], body.extent_m(up)[0]
    above_m = max(0.0, top_m - bottom_m) + PRESSING_TOLERANCE_M
    for moving, still in _near_pieces(body, other):
        if _nearest([moving], [still])[0] < -PRESSING_TOLERANCE_M:
            shape, T = moving
            high = shape, coal.Transform3s(T.getRotation(), T.getTranslation() + above_m * up)
            lifts.append(above_m - (_travel(high, still, -up, above_m) or 0.0))
    return max(lifts)


def _travel(
    moving: _Placed, still: _Placed, along: FloatArray, max_travel_m: float
) -> float | None:
    """`travel_to_contact` for two convex shapes."""
    (first, T_first), (second, T_second) = moving, still
    pair = coal.ComputeDistance(first, second)  # keeps bare pointers: both must stay alive here
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance = DISTANCE_TOLERANCE_M
    R, p = T_first.getRotation(), T_first.getTranslation()
    travel = 0.0
    for _ in range(_MAX_ADVANCES):
        result.clear()
        gap = pair(coal.Transform3s(R, p + travel * along), T_second, request, result)
        closing = float(along @ result.normal)  # gap lost per distance moved
        if gap <= CONTACT_TOLERANCE_M:
            return travel if travel > 0.0 or closing > SLIDING else None
        if closing <= 0.0 or gap > closing * (max_travel_m - travel) + CONTACT_TOLERANCE_M:
            return None
        travel = min(travel + gap / closing, max_travel_m)
    return travel


def gap_m(first: Part, second: Part) -> float:
    """Distance of two shapes placed in one frame; negative inside each other."""
    return _nearest(_pieces(first), _pieces(second))[0]


def contact_point(first: Part, second: Part) -> FloatArray:
    """The point of a shape that is nearest to another, both placed in one frame, shape (3,), m."""
    return _nearest(_pieces(first), _pieces(second))[1]


@frozen(error=SceneError, eq=True)
class Contact:
    """An intended contact: two things that may come near each other, or touch.

    Attributes:
        body: name of a body.
        other: name of another body, or the part of a hand: "left hand", "left pads".
        part: number of the part of `body`; None for any.
        other_part: number of the other body's part; None for any.
        least_m: minimum gap, negative where they may press.
        begin_s: time from which it is allowed, since the step began.
        end_s: time until which it is allowed.

    Raises:
        SceneError: when a value is of another class, or a number is NaN.
    """

    body: str
    other: str
    part: int | None = None
    other_part: int | None = None
    least_m: float = 0.0
    begin_s: float = 0.0
    end_s: float = 0.0

    @classmethod
    def of_hand(cls, side: str, body: str, *, may_press: bool) -> tuple[Contact, ...]:
        """Those of a hand that is about to grasp a body or has released it.

        Args:
            side: of the hand.
            body: name of the body.
            may_press: whether the pads may press on the body.

        Raises:
            SceneError: when an argument is of another class.
        """
        expect(may_press, bool, "may_press", SceneError)
        near = cls(body, f"{side} hand")
        return (near, cls(body, f"{side} pads", least_m=-PRESSING_TOLERANCE_M))[: 1 + may_press]

    @classmethod
    def of_supports(cls, body: str, supports: Iterable[PartContact | str]) -> tuple[Contact, ...]:
        """Those of a body with what it stood or will stand on.

        Args:
            body: name of the body.
            supports: pairs of parts, or names of bodies of which any part may be touched.

        Raises:
            SceneError: when an argument is of another class.
        """
        found = (
            cls(body, each, least_m=-PRESSING_TOLERANCE_M)
            if isinstance(each, str)
            else cls(body, each.other, each.part, each.other_part, -PRESSING_TOLERANCE_M)
            for each in checked_supports(supports)
        )
        return tuple(sorted(found, key=lambda contact: contact.pair))

    def _facts(self) -> tuple[str, ...]:
        return (self.pair, millimetres(self.least_m), f"{self.begin_s:.3f}..{self.end_s:.3f} s")

    @property
    def support(self) -> PartContact | str:
        """What a held or pushed body may touch: a pair of parts, or any part of a body."""
        if self.part is None or self.other_part is None:
            return self.other
        return PartContact(self.part, self.other, self.other_part)

    @property
    def pair(self) -> str:
        """The two things as a phrase."""
        numbered = ((self.body, self.part), (self.other, self.other_part))
        return " and ".join(n if i is None else f"{n}, part {i + 1}" for n, i in numbered)


class PartContact(NamedTuple):
    """A part of one body that touches a part of another; `Body.parts` numbers them.

    Attributes:
        part: number of the part of the body itself.
        other: name of the other body.
        other_part: number of that body's part.
    """

    part: int
    other: str
    other_part: int


def checked_supports(supports: Iterable[PartContact | str]) -> frozenset[PartContact | str]:
    """What a held body may touch, refused unless it is names and pairs of parts."""
    given = expect_all(supports, object, "supports", SceneError)
    found = [each for each in given if isinstance(each, (str, PartContact))]
    if len(found) < len(given):
        raise SceneError(f"supports must be names or pairs of parts, got {quoted(given)}")
    return frozenset(found)


def part_contacts(body: Body, scene: Scene) -> frozenset[PartContact]:
    """Pairs of parts of a body and of others in a scene that touch within `PRESSING_TOLERANCE_M`.

    Parts farther apart are no contact, even where other parts of the same two bodies touch.
    """
    placed = _placed(body)
    return frozenset(
        PartContact(part, other.name, other_part)
        for other in scene
        if other.name != body.name
        for (part, one), (other_part, two) in product(enumerate(placed), enumerate(_placed(other)))
        if _nearest([one], [two])[0] <= PRESSING_TOLERANCE_M
    )


def touching(body: Body, scene: Scene) -> frozenset[str]:
    """Names of the other bodies that a body touches within `PRESSING_TOLERANCE_M`."""
    return frozenset(contact.other for contact in part_contacts(body, scene))


def _nearest(first: list[_Placed], second: list[_Placed]) -> tuple[float, FloatArray]:
    """The smallest distance between two lists of shapes, and the point of the first there."""
    request, result, found = coal.DistanceRequest(), coal.DistanceResult(), []
    for one, other in product(first, second):
        result.clear()
        gap = float(coal.distance(*one, *other, request, result))
        found.append((gap, np.array(result.getNearestPoint1())))
    return min(found, key=lambda pair: pair[0])


def _near_pieces(body: Body, other: Body) -> Iterator[tuple[_Placed, _Placed]]:
    """Pairs of convex shapes of two bodies whose bounding boxes are not apart."""
    parts = [(part, bounds_m(part)) for part in body.placed_parts]
    others = [(part, bounds_m(part)) for part in other.placed_parts]
    for (one, here), (two, there) in product(parts, others):
        if not _are_apart(here, there):
            yield from product(_pieces(one, there), _pieces(two, here))


def _pieces(part: Part, near: FloatArray | None = None) -> list[_Placed]:
    """Convex shapes that a part consists of; of triangles, those near a box if one is given.

    Args:
        part: placed in some frame.
        near: minimum and maximum corner in that frame, shape (2, 3), m.
    """
    pose, shape = coal_pose(part.T_body_part), part.shape
    if near is None or not isinstance(shape, Mesh) or shape.is_convex:
        return [(piece, pose) for piece in convex_pieces(shape)]
    corners = _placed_points(shape.corners, part.T_body_part)
    is_far = (corners.min(axis=1) > near[1] + FLAT_M) | (corners.max(axis=1) < near[0] - FLAT_M)
    corners = shape.corners[~is_far.any(axis=1)]
    return [(convex(triangle, BOTH_SIDES), pose) for triangle in corners]


def bounds_m(part: Part) -> FloatArray:
    """The box around a placed part: minimum and maximum corner, shape (2, 3), m."""
    shape, T = part.shape, part.T_body_part
    if isinstance(shape, Mesh):
        points = _placed_points(shape.vertices, T)
        return np.stack([points.min(axis=0), points.max(axis=0)])
    if isinstance(shape, Box):
        half = np.abs(T.rotation) @ shape.size_m / 2
    elif isinstance(shape, Cylinder):
        up = T.rotation[:, 2]
        across = np.sqrt(np.maximum(0.0, 1.0 - up * up))
        half = shape.radius_m * across + np.abs(up) * shape.length_m / 2
    else:
        half = np.full(3, shape.radius_m)
    return np.array([T.translation - half, T.translation + half])


def _placed_points(points: FloatArray, T: pin.SE3) -> FloatArray:
    placed: FloatArray = points @ T.rotation.T + T.translation
    return placed


def _swept(box: FloatArray, way: FloatArray) -> FloatArray:
    """The box around a box that moves."""
    return np.array([box[0] + np.minimum(way, 0.0), box[1] + np.maximum(way, 0.0)])


def _are_apart(box: FloatArray, other: FloatArray) -> bool:
    """Whether two boxes have a gap larger than rounding between them."""
    return bool((box[0] > other[1] + FLAT_M).any() or (box[1] < other[0] - FLAT_M).any())


def _placed(body: Body) -> list[_Placed]:
    poses = [body.T_base_body * part.T_body_part for part in body.parts]
    return [
        (coal_shape(part.shape), coal_pose(T)) for part, T in zip(body.parts, poses, strict=True)
    ]
