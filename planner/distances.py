"""Distances between the shapes of a geometry model, as closely as each question needs.

A convex shape's distance is exact. One of triangles that is not convex takes a thousand times as
long, so it has covers: a few convex shapes that contain it. Where these are as far away as is asked
for, so is what they contain; only else are the triangles looked at, and of them only those within
what is asked for.

Triangles are a surface, and what is wholly inside touches none of them. Where a closed surface
around what they enclose is known, as of a robot's links, that is found out by its winding number
about a point of the other shape (Jacobson, Kavan and Sorkine-Hornung, "Robust inside-outside
segmentation using generalized winding numbers", ACM Trans. Graphics 32(4), 2013), and only where a
motion begins and ends: none leads inside without crossing triangles, but through their openings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import coal
import numpy as np
import pinocchio as pin

from baxter_kin.arrays import Indices, Vector
from planner.contact import DISTANCE_TOLERANCE_M, convex

UNKNOWN_DEPTH_M = -0.01
"""Stands for the distance where coal finds shapes inside each other but not how deep."""

_NO_DISTANCE_M = -1e6

LEAST_HALF_M = 1e-6
"""By how much a box around triangles is larger, so that flat ones have a volume around them."""

BOX_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
BOX_SIDES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)
"""A cube around the origin, its triangles counter-clockwise seen from outside."""

MOST_CONTACTS = 32
"""Triangles that are looked at to say how deep something is in a surface."""

INSIDE = 0.5
"""A closed surface winds about a point inside once, about one outside not at all."""


@dataclass(frozen=True, eq=False)
class Cover:
    """What is known of a shape of triangles that is not convex.

    Attributes:
        pieces: convex shapes that contain it, in its own frame.
        vertices: of a closed surface around what it encloses, shape (n, 3), m; none where it
            encloses nothing.
        triangles: of the same, shape (m, 3), turned outwards.
    """

    pieces: tuple[coal.ShapeBase, ...]
    vertices: Vector
    triangles: Indices

    @cached_property
    def bounds(self) -> tuple[Vector, Vector]:
        """The corners of the box around what it encloses; the wrong way round for nothing."""
        return self.vertices.min(axis=0, initial=np.inf), self.vertices.max(axis=0, initial=-np.inf)

    @classmethod
    def box_around(cls, geometry: coal.BVHModelBase) -> Cover:
        """The box around any triangles; nothing counts as inside of them."""
        geometry.computeLocalAABB()
        bounds = geometry.aabb_local
        middle, half = (bounds.max_ + bounds.min_) / 2, (bounds.max_ - bounds.min_) / 2
        box = convex(middle + (half + LEAST_HALF_M) * BOX_CORNERS, BOX_SIDES)
        return cls((box,), np.zeros((0, 3)), np.zeros((0, 3), dtype=np.intp))

    def winds_about(self, point: Vector) -> bool:
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
    """Distances of pairs of shapes, at poses that are set; not to be shared between threads."""

    def __init__(
        self, geometry: pin.GeometryModel, covers: Sequence[Cover | None], padding_m: Vector
    ) -> None:
        """For all pairs of a geometry model.

        Args:
            geometry: the shapes; kept alive here, as coal keeps bare pointers.
            covers: of each shape what its triangles need; None for a convex one.
            padding_m: what is subtracted from the distance of each pair, shape (pairs,).
        """
        self._padding_m = padding_m.tolist()
        self._shapes = [shape.geometry for shape in geometry.geometryObjects]
        self._covers = list(covers)
        self._pairs = [(pair.first, pair.second) for pair in geometry.collisionPairs]
        self._exact: dict[int, coal.ComputeDistance] = {}
        self._coarse: dict[int, list[coal.ComputeDistance]] = {}
        self._is_convex = [cover is None for cover in self._covers]
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
        self._request.gjk_tolerance = DISTANCE_TOLERANCE_M
        self._poses = np.zeros((0, 4, 4))
        self._placed: list[coal.Transform3s | None] = []

    def place(self, poses: Vector) -> None:
        """Bring the shapes to poses in base, shape (n, 4, 4)."""
        self._poses = poses
        self._placed = [None] * len(poses)

    def measure(self, pair: int, within_m: float = np.inf) -> float:
        """The distance of a pair; where it is not less than `within_m`, that or more.

        Negative when they are inside each other, as far as triangles can tell that.
        """
        padding_m: float = self._padding_m[pair]
        return self._bare(pair, within_m + padding_m) - padding_m

    def _bare(self, pair: int, within_m: float) -> float:
        """The same without padding."""
        first, second = self._pairs[pair]
        if self._is_convex[first] and self._is_convex[second]:
            return self._distance(self._functor(pair), first, second, np.inf)
        least_m = self.covers_apart(pair)
        if least_m >= within_m:
            return least_m
        found = self._distance(self._functor(pair), first, second, within_m)
        return found if found > 0.0 else -self._depth(first, second)

    def covers_apart(self, pair: int) -> float:
        """The distance of what covers the shapes of a pair: a lower bound where that is above 0."""
        first, second = self._pairs[pair]
        return min(
            self._distance(functor, first, second, np.inf) for functor in self._covering(pair)
        )

    def is_within(self, pair: int) -> bool:
        """Whether one shape of a pair is wholly inside what the other encloses.

        Asked where their triangles do not touch.
        """
        first, second = self._pairs[pair]
        return self._encloses(first, second) or self._encloses(second, first)

    def _encloses(self, outer: int, inner: int) -> bool:
        cover = self._covers[outer]
        if cover is None:
            return False
        T, T_inner = self._poses[outer], self._poses[inner]
        point_base = T_inner[:3, :3] @ _point_of(self._shapes[inner]) + T_inner[:3, 3]
        return cover.winds_about(T[:3, :3].T @ (point_base - T[:3, 3]))

    def _functor(self, pair: int) -> coal.ComputeDistance:
        if pair not in self._exact:
            first, second = self._pairs[pair]
            self._exact[pair] = coal.ComputeDistance(self._shapes[first], self._shapes[second])
        return self._exact[pair]

    def _covering(self, pair: int) -> list[coal.ComputeDistance]:
        if pair not in self._coarse:
            self._coarse[pair] = [
                coal.ComputeDistance(one, other)
                for one, other in product(*map(self._pieces, self._pairs[pair]))
            ]
        return self._coarse[pair]

    def _pieces(self, shape: int) -> tuple[coal.ShapeBase, ...]:
        cover = self._covers[shape]
        return (self._shapes[shape],) if cover is None else cover.pieces

    def _distance(
        self, functor: coal.ComputeDistance, first: int, second: int, within_m: float
    ) -> float:
        result = self._result
        result.clear()
        if within_m < np.inf:
            result.min_distance = within_m
        found: float = functor(self._pose(first), self._pose(second), self._request, result)
        return found if found > _NO_DISTANCE_M else UNKNOWN_DEPTH_M

    def _depth(self, first: int, second: int) -> float:
        """How deep some triangle is in a shape, or two of them in each other; at least that."""
        request, result = coal.CollisionRequest(), coal.CollisionResult()
        request.num_max_contacts = MOST_CONTACTS
        request.enable_contact = True
        shapes, poses = self._shapes, (self._pose(first), self._pose(second))
        count = coal.collide(shapes[first], poses[0], shapes[second], poses[1], request, result)
        depths = [-result.getContact(i).penetration_depth for i in range(min(count, MOST_CONTACTS))]
        return max((depth for depth in depths if depth < -_NO_DISTANCE_M), default=0.0)

    def _pose(self, shape: int) -> coal.Transform3s:
        placed = self._placed[shape]
        if placed is None:
            T = self._poses[shape]
            placed = self._placed[shape] = coal.Transform3s(T[:3, :3], T[:3, 3])
        return placed


def _point_of(geometry: coal.CollisionGeometry) -> Vector:
    """A point of a shape, in its own frame, shape (3,), m."""
    if isinstance(geometry, coal.BVHModelBase):
        return np.array(geometry.vertex(0))
    if isinstance(geometry, coal.ConvexBase):
        return np.array(geometry.center)
    return np.zeros(3)
