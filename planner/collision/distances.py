"""Distances between the shapes of a geometry model, as closely as each question needs.

A convex shape's distance is exact. That of triangles takes a hundred times as long, but whether
they are farther apart than a share of their distance is found out nearly as fast. So of a pair that
was far apart before, only a share of that is asked for, where a lower bound will do; and where a
few convex shapes contain the triangles, these are asked first, and how deep something is in them.

Triangles are a surface, and what is wholly inside touches none of them. Where a closed surface
around what they enclose is known, as of a robot's links, that is found out by its winding number
about a point of the other shape (Jacobson, Kavan and Sorkine-Hornung, "Robust inside-outside
segmentation using generalized winding numbers", ACM Trans. Graphics 32(4), 2013), and only where a
motion begins and ends: none leads inside without crossing triangles, but through their openings.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin.validation import FloatArray, Indices
from planner.scene.contact import DISTANCE_TOLERANCE_M

ACCURACY_M = 1e-5
"""By how much coal's distances may be wrong up to 1 m; in proportion beyond. Its iterations end at
1e-6; against planes between random shapes of up to 10 m no distance was wrong by more than 2e-6."""

RESOLUTION_M = 2 * ACCURACY_M
"""Coal does not tell a distance within this of a needed one from a contact."""

UNKNOWN_DEPTH_M = -0.01
"""Stands for the distance where coal finds shapes inside each other but not how deep."""

NO_DISTANCE_M = -1e6
"""What coal says is less than this where it finds no distance."""

FIRST_M, EASY, BOLDER = 0.02, 0.8, 1.1
"""What is asked for first where more would be of no use; of a distance that a pair had, the share
that is asked for then; and by how much more each time that it was there."""

MAX_CONTACTS = 32
"""Triangles that are looked at to say how deep something is in a surface."""

POINTS_SLACK_M = 1e-6
"""How much farther than a distance that is known its points are sought."""

INSIDE = 0.5
"""A closed surface winds about a point inside once, about one outside not at all."""


@dataclass(frozen=True, eq=False)
class Enclosure:
    """A closed surface around what a shape of triangles encloses.

    Attributes:
        vertices: shape (n, 3), m, in the shape's own frame; none where it encloses nothing.
        triangles: shape (m, 3), turned outwards.
    """

    vertices: FloatArray
    triangles: Indices

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """The corners of the box around what it encloses; the wrong way round for nothing."""
        return self.vertices.min(axis=0, initial=np.inf), self.vertices.max(axis=0, initial=-np.inf)

    @classmethod
    def none(cls) -> Enclosure:
        """Nothing counts as inside."""
        return cls(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.intp))

    def winds_about(self, point: FloatArray) -> bool:
        """Whether it encloses a point of its own frame, shape (3,)."""
        low, high = self.bounds
        if (point < low).any() or (point > high).any():
            return False
        a, b, c = (self.vertices[self.triangles] - point).swapaxes(0, 1)
        la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        below = la * lb * lc + (
            np.einsum("ij,ij->i", a, b) * lc
            + np.einsum("ij,ij->i", b, c) * la
            + np.einsum("ij,ij->i", c, a) * lb
        )
        return bool(2.0 * np.arctan2(volume, below).sum() > INSIDE * 4.0 * np.pi)


class Distances:
    """Distances of pairs of shapes, at poses that are set; not to be shared between threads.

    Attributes:
        is_slow: whether a pair has triangles, shape (pairs,).
    """

    def __init__(
        self,
        geometry: pin.GeometryModel,
        enclosures: Sequence[Enclosure | None],
        pieces: Mapping[int, Sequence[int]],
        pairs: Sequence[tuple[int, int]],
        padding_m: Sequence[float],
    ) -> None:
        """For pairs of shapes of a geometry model.

        Args:
            geometry: the shapes; kept alive here, as coal keeps bare pointers.
            enclosures: of each shape of triangles what it encloses; None for a convex one.
            pieces: of some shapes of triangles, convex ones on the same joint that contain them.
            pairs: numbers of two shapes each.
            padding_m: what is subtracted from the distance of each pair.
        """
        self._pairs, self._padding_m, self._pieces = pairs, padding_m, pieces
        self._shapes = [shape.geometry for shape in geometry.geometryObjects]
        self._enclosures = list(enclosures)
        is_slow = [any(enclosures[i] is not None for i in pair) for pair in pairs]
        self.is_slow: NDArray[np.bool_] = np.array(is_slow, dtype=np.bool_)
        self._functors: dict[tuple[int, int], coal.ComputeDistance] = {}
        self._easy_m: dict[int, float] = {}
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
        self._request.gjk_tolerance = DISTANCE_TOLERANCE_M
        self._poses = np.zeros((0, 4, 4))
        self._placed: list[coal.Transform3s | None] = []

    def place(self, poses: FloatArray) -> None:
        """Bring the shapes to poses in base, shape (n, 4, 4)."""
        self._poses = poses
        self._placed = [None] * len(poses)

    def measure(self, pair: int, within_m: float = np.inf, exact_below_m: float = np.inf) -> float:
        """The distance of a pair; where it is not less than `within_m`, that or more.

        Where it is not less than `exact_below_m`, it may be a lower bound that is not either.
        Negative when they are inside each other, as far as triangles can tell that.
        """
        first, second = self._pairs[pair]
        padding_m: float = self._padding_m[pair]
        if self._enclosures[first] is None and self._enclosures[second] is None:
            return self._distance(first, second, np.inf) - padding_m
        easy_m = self._easy_m.get(pair, FIRST_M)
        ask_m = min(within_m, max(exact_below_m, easy_m))
        for inside_m in self._of_pieces(first, second):
            if inside_m - padding_m >= min(ask_m, exact_below_m):
                return min(ask_m, inside_m - padding_m)
        found = self._distance(first, second, ask_m + padding_m)
        if found <= 0.0:
            return -self._depth(first, second) - padding_m
        if found < ask_m + padding_m:
            self._easy_m[pair] = EASY * (found - padding_m)
            return found - padding_m
        self._easy_m[pair] = max(easy_m, BOLDER * ask_m)
        return ask_m

    def is_within(self, pair: int) -> bool:
        """Whether one shape of a pair is wholly inside what the other encloses.

        Asked where their triangles do not touch.
        """
        first, second = self._pairs[pair]
        return self._encloses(first, second) or self._encloses(second, first)

    def points(self, pair: int, distance_m: float) -> FloatArray:
        """The two points of a pair's shapes where they are nearest, in base, shape (2, 3), m.

        Their distance is that of the pair, and the padding. Where the shapes are inside each other
        it is twice a point where they touch, as far as that can be told.

        Args:
            pair: which one.
            distance_m: as `measure` found it, without a bound.
        """
        first, second = self._pairs[pair]
        if distance_m + self._padding_m[pair] <= 0.0:
            return self._touching_point(first, second)
        self._distance(first, second, distance_m + self._padding_m[pair] + POINTS_SLACK_M)
        result = self._result
        return np.array([result.getNearestPoint1(), result.getNearestPoint2()])

    def _touching_point(self, first: int, second: int) -> FloatArray:
        request, result = coal.CollisionRequest(), coal.CollisionResult()
        request.enable_contact = True
        shapes, poses = self._shapes, (self._pose(first), self._pose(second))
        coal.collide(shapes[first], poses[0], shapes[second], poses[1], request, result)
        if not result.isCollision():
            return np.tile(self._poses[second][:3, 3], (2, 1))
        return np.tile(result.getContact(0).pos, (2, 1))

    def _encloses(self, outer: int, inner: int) -> bool:
        enclosure = self._enclosures[outer]
        if enclosure is None:
            return False
        T, T_inner = self._poses[outer], self._poses[inner]
        point_base = T_inner[:3, :3] @ _point_of(self._shapes[inner]) + T_inner[:3, 3]
        return enclosure.winds_about(T[:3, :3].T @ (point_base - T[:3, 3]))

    def _of_pieces(self, first: int, second: int) -> Iterator[float]:
        """How far what contains one of two shapes is from the other, where there is such."""
        for around, other in ((first, second), (second, first)):
            if around in self._pieces and self._enclosures[other] is None:
                yield min(self._distance(piece, other, np.inf) for piece in self._pieces[around])

    def _distance(self, first: int, second: int, within_m: float) -> float:
        """Without padding; where it is not less than `within_m`, that."""
        pair = first, second
        if pair not in self._functors:
            self._functors[pair] = coal.ComputeDistance(self._shapes[first], self._shapes[second])
        result = self._result
        result.clear()
        if within_m < np.inf:
            result.min_distance = within_m
        T_first, T_second = self._pose(first), self._pose(second)
        found: float = self._functors[pair](T_first, T_second, self._request, result)
        return found if found > NO_DISTANCE_M else UNKNOWN_DEPTH_M

    def _depth(self, first: int, second: int) -> float:
        """How deep pieces are in a convex shape, or some triangle in a shape; at least that."""
        for distance_m in self._of_pieces(first, second):
            return max(-distance_m, 0.0)
        request, result = coal.CollisionRequest(), coal.CollisionResult()
        request.num_max_contacts = MAX_CONTACTS
        request.enable_contact = True
        shapes, poses = self._shapes, (self._pose(first), self._pose(second))
        count = coal.collide(shapes[first], poses[0], shapes[second], poses[1], request, result)
        depths = [-result.getContact(i).penetration_depth for i in range(min(count, MAX_CONTACTS))]
        return max((depth for depth in depths if depth < -NO_DISTANCE_M), default=0.0)

    def _pose(self, shape: int) -> coal.Transform3s:
        placed = self._placed[shape]
        if placed is None:
            T = self._poses[shape]
            placed = self._placed[shape] = coal.Transform3s(T[:3, :3], T[:3, 3])
        return placed


def _point_of(geometry: coal.CollisionGeometry) -> FloatArray:
    """A point of a shape, in its own frame, shape (3,), m."""
    if isinstance(geometry, coal.BVHModelBase):
        return np.array(geometry.vertex(0))
    if isinstance(geometry, coal.ConvexBase):
        return np.array(geometry.center)
    return np.zeros(3)
