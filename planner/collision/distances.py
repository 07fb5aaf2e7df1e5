"""Distances between the shapes of a geometry model: lower bounds, and measured values.

`Covers` are simple shapes around others, whose distances are lower bounds that cost little.

`Distances` measures with coal. The distance of two convex shapes is exact. That of triangles takes
a hundred times as long, but finding out whether they are farther apart than a given distance is
nearly as fast. So a caller gives the distance up to which it needs the value; and where a few
convex shapes contain the triangles, these are measured first, and give the depth.

Triangles are a surface, and a shape wholly inside touches none of them. Where a closed surface
around them is known, as for a robot's links, such a shape is found by the winding number of the
surface about a point of the shape (Jacobson, Kavan and Sorkine-Hornung, "Robust inside-outside
segmentation using generalized winding numbers", ACM Trans. Graphics 32(4), 2013), and only at the
beginning and the end of a motion: no motion leads inside without crossing triangles, except through
their openings.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin.validation import FloatArray, Indices
from planner.scene.coal_shapes import Surface
from planner.scene.contact import DISTANCE_TOLERANCE_M

ACCURACY_M = 1e-5
"""Maximum error of coal's distances up to 1 m; in proportion beyond. Its iterations end at 1e-6;
compared with planes between random shapes of up to 10 m, no error was larger than 2e-6."""

RESOLUTION_M = 2 * ACCURACY_M
"""A distance closer than this to the required one cannot be distinguished from a contact."""

UNKNOWN_DEPTH_M = -0.01
"""Distance of shapes that coal finds inside each other, where it does not know their depth."""

NO_DISTANCE_M = -1e6
"""Coal returns less than this where it finds no distance."""

MAX_CONTACTS = 32
"""Maximum number of contacts from which the depth in a surface is found."""

POINTS_SLACK_M = 1e-6
"""Excess of the search range for nearest points over their known distance."""

INSIDE = 0.5
"""Minimum winding number about a point inside: it is 1 for those inside, 0 for those outside."""


class Covers(NamedTuple):
    """Simple shapes around n shapes, each in the frame of its shape.

    Attributes:
        lowest, highest: corners of a box, shape (n, 3), m.
        centres, ball_radii: a ball, shapes (n, 3) and (n,), m.
        ends, radii: a capsule, shapes (n, 2, 3) and (n,), m.
    """

    lowest: FloatArray
    highest: FloatArray
    centres: FloatArray
    ball_radii: FloatArray
    ends: FloatArray
    radii: FloatArray

    def gaps_m(
        self, poses: FloatArray, number: Indices, pairs: Indices, within_m: float = np.inf
    ) -> FloatArray:
        """Lower bounds on the distances of pairs, shape (k,), m; negative ones bound a depth.

        They are those of the balls, or, where these are nearer than `within_m`, of the boxes along
        the axes of either one; or of a ball and a box, whichever is largest. The depth is that of
        the shapes' convex hulls.

        Args:
            poses: of all shapes in base, shape (m, n, 4, 4).
            number: which of the m poses each pair is at, shape (k,).
            pairs: numbers of the two shapes of each pair, shape (k, 2).
            within_m: no larger bound matters.
        """
        first, second = pairs.T
        centres = (poses[..., :3, :3] @ self.centres[:, :, None])[..., 0] + poses[..., :3, 3]
        apart = centres[number, second] - centres[number, first]
        gaps: FloatArray = _lengths(apart) - self.ball_radii[first] - self.ball_radii[second]
        near = np.flatnonzero(gaps < within_m)
        R, shapes = poses[..., :3, :3], (first[near], second[near])
        R_base = [R[number[near], each] for each in shapes]
        halves = [(self.highest - self.lowest)[each] / 2 for each in shapes]
        turned = np.abs(R_base[0].swapaxes(1, 2) @ R_base[1])  # axes of the second in the first
        for own, other, R_other in ((0, 1, turned), (1, 0, turned.swapaxes(1, 2))):
            along = np.abs((apart[near, None] @ R_base[own])[:, 0]) - halves[own]
            of_ball = _outside_m(along) - self.ball_radii[shapes[other]]
            of_box = _outside_m(along - (R_other @ halves[other][:, :, None])[..., 0])
            gaps[near] = np.maximum(gaps[near], np.maximum(of_ball, of_box))
        return gaps

    def with_those_of(self, geometries: list[coal.CollisionGeometry]) -> Covers:
        """These covers, followed by those around more shapes."""
        added = Covers.of(geometries)
        return Covers(*(np.concatenate(both) for both in zip(self, added, strict=True)))

    @classmethod
    def of(cls, geometries: list[coal.CollisionGeometry]) -> Covers:
        """The covers around some shapes."""
        lowest, highest = (np.empty((len(geometries), 3)) for _ in range(2))
        axes, radii = np.zeros((len(geometries), 3)), np.empty(len(geometries))
        for number, geometry in enumerate(geometries):
            if geometry.aabb_radius < 0.0:  # not computed yet; slow for thousands of triangles
                geometry.computeLocalAABB()
            box = geometry.aabb_local
            lowest[number], highest[number] = box.min_, box.max_
            half = (highest[number] - lowest[number]) / 2
            axes[number], radii[number] = _capsule(geometry, half)
        centres = (lowest + highest) / 2
        ends = np.stack([centres - axes, centres + axes], axis=1)
        lengths = np.linalg.norm(axes, axis=1)
        round_ends = np.array([isinstance(g, coal.Cylinder | coal.Sphere) for g in geometries])
        balls = np.where(round_ends, np.hypot(lengths, radii), 0.0)
        balls = np.where(round_ends, balls, np.linalg.norm(highest - lowest, axis=1) / 2)
        return cls(lowest, highest, centres, balls, ends, radii)


def _lengths(vectors: FloatArray) -> FloatArray:
    """The lengths of vectors, shape (k, 3): shape (k,)."""
    lengths: FloatArray = np.sqrt(np.einsum("ki,ki->k", vectors, vectors))
    return lengths


def _outside_m(along: FloatArray) -> FloatArray:
    """The distance from a box, given its excess along each axis, shape (k, 3); negative inside."""
    deep = along.max(axis=1)
    distances: FloatArray = np.where(deep > 0.0, _lengths(along.clip(min=0.0)), deep)
    return distances


def _capsule(geometry: coal.CollisionGeometry, half: FloatArray) -> tuple[FloatArray, float]:
    """The vector from centre to end, shape (3,), m, and the radius of a capsule around a shape."""
    axis = np.zeros(3)
    if isinstance(geometry, coal.Sphere):
        return axis, float(geometry.radius)
    if isinstance(geometry, coal.Cylinder):
        axis[2] = geometry.halfLength
        return axis, float(geometry.radius)
    longest = int(half.argmax())
    axis[longest] = half[longest]
    return axis, float(np.linalg.norm(half - axis))


def placed_points(poses: FloatArray, points: FloatArray) -> FloatArray:
    """Points in n frames, shape (n, k, 3), at poses (m, n, 4, 4), seen from base: (m, n, k, 3)."""
    return points @ poses[..., :3, :3].swapaxes(-1, -2) + poses[..., None, :3, 3]


@dataclass(frozen=True, eq=False)
class Enclosure:
    """A closed surface around the volume that a shape of triangles encloses.

    Attributes:
        vertices: shape (n, 3), m, in the shape's own frame; empty where it encloses nothing.
        triangles: shape (m, 3), turned outwards.
    """

    vertices: FloatArray
    triangles: Indices

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """The corners of the bounding box; infinite and reversed where it encloses nothing."""
        return self.vertices.min(axis=0, initial=np.inf), self.vertices.max(axis=0, initial=-np.inf)

    @classmethod
    def none(cls) -> Enclosure:
        """The enclosure of a surface without inside."""
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
    """Distances of pairs of shapes at given poses; not to be shared between threads.

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
        *,
        surfaces: Mapping[int, Surface] | None = None,
    ) -> None:
        """Store the shapes, which coal refers to by bare pointers.

        Args:
            geometry: the shapes.
            enclosures: the enclosure of each shape of triangles; None for a convex shape.
            pieces: for some shapes of triangles, convex shapes on the same joint that contain them.
            pairs: numbers of two shapes each.
            padding_m: amount subtracted from the distance of each pair.
            surfaces: the triangles of shapes that coal cannot measure as they are.
        """
        self._pairs, self._padding_m, self._pieces = pairs, padding_m, pieces
        self._shapes = [shape.geometry for shape in geometry.geometryObjects]
        self._enclosures, self._surfaces = list(enclosures), surfaces or {}
        is_slow = [any(enclosures[i] is not None for i in pair) for pair in pairs]
        self.is_slow: NDArray[np.bool_] = np.array(is_slow, dtype=np.bool_)
        self._functors: dict[tuple[int, int], coal.ComputeDistance] = {}
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
        self._request.gjk_tolerance = DISTANCE_TOLERANCE_M
        self._poses = np.zeros((0, 4, 4))
        self._placed: list[coal.Transform3s | None] = []

    def place(self, poses: FloatArray) -> None:
        """Set the poses of all shapes in base, shape (n, 4, 4)."""
        self._poses = poses
        self._placed = [None] * len(poses)

    def measure(self, pair: int, within_m: float = np.inf) -> float:
        """The distance of a pair; where it is not less than `within_m`, that or a larger value.

        Negative when the two are inside each other, as far as triangles have a depth.
        """
        first, second = self._pairs[pair]
        padding_m: float = self._padding_m[pair]
        if self._enclosures[first] is None and self._enclosures[second] is None:
            return self._distance(first, second, np.inf) - padding_m
        for bound_m in self._of_pieces(first, second):
            if bound_m - padding_m >= within_m:
                return within_m
        found = self._distance(first, second, within_m + padding_m)
        if found <= 0.0:
            return -self._depth(first, second) - padding_m
        return found - padding_m if found < within_m + padding_m else within_m

    def is_within(self, pair: int) -> bool:
        """Whether one of two shapes that do not touch is wholly inside the other's enclosure."""
        first, second = self._pairs[pair]
        return self._encloses(first, second) or self._encloses(second, first)

    def points(self, pair: int, distance_m: float) -> FloatArray:
        """The nearest points of a pair's two shapes, in base, shape (2, 3), m.

        Their distance is that of the pair plus the padding. Where the shapes are inside each other,
        both are one point of their contact, as far as it is known.

        Args:
            pair: number of the pair.
            distance_m: result of `measure` without `within_m`.
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
        one, other = self._measurable(first), self._measurable(second)
        coal.collide(one, self._pose(first), other, self._pose(second), request, result)
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
        """Distances from each of two shapes to the pieces that contain the other, where known."""
        for around, other in ((first, second), (second, first)):
            if around in self._pieces and self._enclosures[other] is None:
                yield min(self._distance(piece, other, np.inf) for piece in self._pieces[around])

    def _distance(self, first: int, second: int, within_m: float) -> float:
        """The distance without padding, or `within_m` where it is not less."""
        pair = first, second
        if pair not in self._functors:
            self._functors[pair] = coal.ComputeDistance(*map(self._measurable, pair))
        result = self._result
        result.clear()
        if within_m < np.inf:
            result.min_distance = within_m
        T_first, T_second = self._pose(first), self._pose(second)
        found: float = self._functors[pair](T_first, T_second, self._request, result)
        return found if found > NO_DISTANCE_M else UNKNOWN_DEPTH_M

    def _depth(self, first: int, second: int) -> float:
        """A lower bound on the depth: of pieces in a convex shape, or of a triangle in a shape."""
        for distance_m in self._of_pieces(first, second):
            return max(-distance_m, 0.0)
        request, result = coal.CollisionRequest(), coal.CollisionResult()
        request.num_max_contacts = MAX_CONTACTS
        request.enable_contact = True
        one, other = self._measurable(first), self._measurable(second)
        count = coal.collide(one, self._pose(first), other, self._pose(second), request, result)
        depths = [-result.getContact(i).penetration_depth for i in range(min(count, MAX_CONTACTS))]
        return max((depth for depth in depths if depth < -NO_DISTANCE_M), default=0.0)

    def _measurable(self, shape: int) -> coal.CollisionGeometry:
        """A shape as coal can measure distances to it."""
        surface = self._surfaces.get(shape)
        return self._shapes[shape] if surface is None else surface.for_distances

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
