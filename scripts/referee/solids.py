"""Solids: triangles as FCL sees them, and what is inside.

A convex solid of the scene can be eroded: shrunk so that every point of it is at least so deep in
the original. What touches the eroded solid is so deep in the original. Cylinders and spheres become
inscribed polyhedra, so what is reported is never more than what is there; what is lost is below
5 um for radii up to 3 cm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import fcl
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection

Array = NDArray[np.float64]
Faces = NDArray[np.int64]

CYLINDER_SIDES = 192
SPHERE_SUBDIVISIONS = 5
SMALLEST_M = 1e-7
"""What is left of a solid counts as nothing below this."""

DIRECTIONS = 200
"""Rays that ask whether a point is enclosed by a mesh."""

ENCLOSED = 0.9
"""A point is when so many of them are stopped: the links are open where the next one begins."""

PIECE_FACES = 1500
"""Meshes of more triangles are bounded by several boxes; at most `MOST_PIECES`."""
MOST_PIECES = 16


@dataclass(eq=False)
class Solid:
    """Triangles in a frame of their own.

    Attributes:
        name: link or body.
        vertices: shape (n, 3), m.
        faces: shape (m, 3).
        depth_m: of a convex solid, how deep points, shape (n, 3), are inside; negative outside.
            None of a mere surface.
        shrink: of a convex solid, what is left of it when so much is taken off everywhere.
    """

    name: str
    vertices: Array
    faces: Faces
    depth_m: Callable[[Array], Array] | None = None
    shrink: Callable[[float], Solid | None] | None = None
    _eroded: dict[float, Solid | None] = field(default_factory=dict, repr=False)

    @classmethod
    def surface(cls, name: str, vertices: Array, faces: Faces) -> Solid:
        """A mesh that may have holes."""
        corners = vertices[faces]
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        kept = np.linalg.norm(areas, axis=1) > 0.0
        return cls(name, np.array(vertices, dtype=float), np.array(faces[kept], dtype=np.int64))

    @property
    def is_convex(self) -> bool:
        """Whether it is solid and convex, not a mere surface."""
        return self.depth_m is not None

    def eroded(self, depth_m: float) -> Solid | None:
        """What is left of it when so much is taken off everywhere; a mere surface stays itself.

        None when nothing is left.
        """
        if depth_m == 0.0 or self.shrink is None:
            return self
        if depth_m not in self._eroded:
            self._eroded[depth_m] = self.shrink(depth_m)
        return self._eroded[depth_m]

    @cached_property
    def fcl_object(self) -> Any:
        """For FCL, as the first of a pair."""
        return fcl.CollisionObject(self._bvh)

    @cached_property
    def fcl_other(self) -> Any:
        """For FCL, as the second of a pair."""
        return fcl.CollisionObject(self._bvh)

    @cached_property
    def _bvh(self) -> Any:
        model = fcl.BVHModel()
        model.beginModel(len(self.faces), len(self.vertices))
        model.addSubModel(self.vertices, self.faces)
        model.endModel()
        return model

    @cached_property
    def boxes(self) -> Array:
        """Axis-aligned boxes around all its triangles, shape (k, 2, 3): low and high corners."""
        corners = self.vertices[self.faces]
        pieces = [corners]
        while len(pieces) < MOST_PIECES and max(map(len, pieces)) > PIECE_FACES:
            largest = max(range(len(pieces)), key=lambda i: len(pieces[i]))
            pieces += _halves(pieces.pop(largest))
        return np.array([[p.min(axis=(0, 1)), p.max(axis=(0, 1))] for p in pieces])

    @cached_property
    def corners(self) -> Array:
        """The corners of the box around it, shape (8, 3)."""
        return box_corners(self.box)

    @cached_property
    def box(self) -> Array:
        """The box around all of it, low and high corner, shape (2, 3)."""
        return np.array([self.boxes[:, 0].min(axis=0), self.boxes[:, 1].max(axis=0)])

    @property
    def centre(self) -> Array:
        """The mean of its vertices, shape (3,)."""
        middle: Array = self.vertices.mean(axis=0)
        return middle

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """Whether points, shape (n, 3), are inside: in a convex solid, or enclosed by a surface."""
        if self.depth_m is not None:
            return self.depth_m(points) > 0.0
        in_hull = (points @ self._hull[:, :3].T + self._hull[:, 3]).max(axis=1) < 0.0
        inside = np.zeros(len(points), dtype=np.bool_)
        for number in np.flatnonzero(in_hull):
            inside[number] = self._encloses(points[number])
        return inside

    @cached_property
    def _hull(self) -> Array:
        return ConvexHull(self.vertices).equations

    def _encloses(self, point: Array) -> bool:
        """Whether hardly a ray out of a point is free."""
        free = sum(not self._is_hit(point, direction) for direction in _directions())
        return free <= (1.0 - ENCLOSED) * DIRECTIONS

    def _is_hit(self, point: Array, direction: Array) -> bool:
        """Whether a ray meets a triangle (Moller and Trumbore 1997)."""
        a, b, c = np.moveaxis(self.vertices[self.faces], 1, 0)
        first, second = b - a, c - a
        h = np.cross(direction, second)
        determinant = np.einsum("ij,ij->i", first, h)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = point - a
            u = np.einsum("ij,ij->i", s, h) / determinant
            k = np.cross(s, first)
            v = k @ direction / determinant
            t = np.einsum("ij,ij->i", second, k) / determinant
            return bool(((u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0)).any())


def box_mesh(size_m: Array) -> trimesh.Trimesh:
    """A cuboid about the origin."""
    return trimesh.creation.box(size_m)


def cylinder_mesh(radius_m: float, length_m: float) -> trimesh.Trimesh:
    """A prism in a cylinder about z."""
    return trimesh.creation.cylinder(radius_m, length_m, sections=CYLINDER_SIDES)


def solid_of(name: str, shape: Any) -> Solid:
    """A shape of the scene, in its own frame; which it is, its measures say."""
    if hasattr(shape, "size_m"):
        return box_solid(name, np.array(shape.size_m))
    if hasattr(shape, "length_m"):
        return cylinder_solid(name, shape.radius_m, shape.length_m)
    if hasattr(shape, "radius_m"):
        return sphere_solid(name, shape.radius_m)
    if shape.is_convex:
        return hull_solid(name, np.array(shape.vertices))
    return Solid.surface(name, np.array(shape.vertices), np.array(shape.triangles))


def box_solid(name: str, size_m: Array) -> Solid:
    """A cuboid about the origin."""
    mesh = box_mesh(size_m)

    def depth_m(points: Array) -> Array:
        return (size_m / 2 - np.abs(points)).min(axis=1)

    def shrink(off_m: float) -> Solid | None:
        left = size_m - 2 * off_m
        return box_solid(name, left) if left.min() > SMALLEST_M else None

    return Solid(name, np.array(mesh.vertices), np.array(mesh.faces), depth_m, shrink)


def cylinder_solid(name: str, radius_m: float, length_m: float) -> Solid:
    """A cylinder about z."""
    mesh = cylinder_mesh(radius_m, length_m)

    def depth_m(points: Array) -> Array:
        side = radius_m - np.hypot(points[:, 0], points[:, 1])
        return np.minimum(side, length_m / 2 - np.abs(points[:, 2]))

    def shrink(off_m: float) -> Solid | None:
        radius, length = radius_m - off_m, length_m - 2 * off_m
        return cylinder_solid(name, radius, length) if min(radius, length) > SMALLEST_M else None

    return Solid(name, np.array(mesh.vertices), np.array(mesh.faces), depth_m, shrink)


def sphere_solid(name: str, radius_m: float) -> Solid:
    """A ball about the origin."""
    mesh = trimesh.creation.icosphere(SPHERE_SUBDIVISIONS, radius_m)

    def depth_m(points: Array) -> Array:
        return radius_m - np.linalg.norm(points, axis=1)

    def shrink(off_m: float) -> Solid | None:
        return sphere_solid(name, radius_m - off_m) if radius_m - off_m > SMALLEST_M else None

    return Solid(name, np.array(mesh.vertices), np.array(mesh.faces), depth_m, shrink)


def hull_solid(name: str, points: Array) -> Solid:
    """The convex hull of points."""
    hull = ConvexHull(points)
    number = np.full(len(points), -1)
    number[hull.vertices] = np.arange(len(hull.vertices))
    planes = hull.equations

    def depth_m(others: Array) -> Array:
        return -(others @ planes[:, :3].T + planes[:, 3]).max(axis=1)

    def shrink(off_m: float) -> Solid | None:
        inner = planes + np.array([0.0, 0.0, 0.0, off_m])
        # the deepest point: max r with normal @ x + offset + r <= 0
        ones, bounds = np.ones((len(inner), 1)), [(None, None)] * 3 + [(0.0, None)]
        found = linprog([0, 0, 0, -1], np.hstack([inner[:, :3], ones]), -inner[:, 3], bounds=bounds)
        if not found.success or found.x[3] < SMALLEST_M:
            return None
        return hull_solid(name, HalfspaceIntersection(inner, found.x[:3]).intersections)

    return Solid(name, points[hull.vertices], number[hull.simplices], depth_m, shrink)


def box_corners(box: Array) -> Array:
    """The eight corners of a box of low and high, shape (2, 3)."""
    return np.array(
        [[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    )


def _halves(corners: Array) -> list[Array]:
    centres = corners.mean(axis=1)
    axis = int(np.ptp(centres, axis=0).argmax())
    order = centres[:, axis].argsort()
    return [corners[order[: len(order) // 2]], corners[order[len(order) // 2 :]]]


def _directions() -> Array:
    """Directions spread evenly over a sphere (a Fibonacci lattice), shape (n, 3)."""
    i = np.arange(DIRECTIONS) + 0.5
    z, turn = 1.0 - 2.0 * i / DIRECTIONS, np.pi * (1.0 + 5.0**0.5) * i
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)
