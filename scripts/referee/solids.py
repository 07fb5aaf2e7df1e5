"""Solids: triangles for FCL, their distances, and what is inside.

A convex solid of the scene can be eroded: shrunk so that every point of it is at least so deep in
the original. What touches the eroded solid is so deep in the original. Cylinders and spheres become
inscribed polyhedra, so no reported depth is more than the true one; what is lost is below 5 um for
radii up to 3 cm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import fcl
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection

Array = NDArray[np.float64]

CYLINDER_SIDES = 192
SPHERE_SUBDIVISIONS = 5

MIN_SIZE_M = 1e-7
"""A smaller rest of an eroded solid counts as nothing."""

RAYS = 200
"""Rays that decide whether a point is enclosed by a mesh."""

MIN_STOPPED = 0.9
"""Share of them that are stopped around an enclosed point: links are open where the next begins."""

TOUCHING_M = 1e-9
"""Rounding of FCL's distance, which is zero where two solids intersect."""

MAX_DEPTH_M = 0.05
"""Greater depths are reported as this."""

STILL = fcl.Transform()


@dataclass(eq=False)
class Solid:
    """Triangles in a frame of their own.

    Attributes:
        name: link or body.
        vertices: shape (n, 3), m.
        faces: shape (m, 3).
        shrink: of a convex solid, what is left when so much is taken off everywhere, or None; None
            of a mere surface.
    """

    name: str
    vertices: Array
    faces: NDArray[np.int64]
    shrink: Callable[[float], Solid | None] | None = None

    @classmethod
    def surface(cls, name: str, vertices: Array, faces: NDArray[np.int64]) -> Solid:
        """A mesh that may have holes."""
        corners = vertices[faces]
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        kept = np.linalg.norm(areas, axis=1) > 0.0
        return cls(name, np.array(vertices, dtype=float), np.array(faces[kept], dtype=np.int64))

    @property
    def is_convex(self) -> bool:
        """Whether it is solid and convex, not a mere surface."""
        return self.shrink is not None

    @cached_property
    def fcl(self) -> Any:
        """The triangles for FCL."""
        model = fcl.BVHModel()
        model.beginModel(len(self.faces), len(self.vertices))
        model.addSubModel(self.vertices, self.faces)
        model.endModel()
        return fcl.CollisionObject(model)

    @cached_property
    def box(self) -> Array:
        """The box around its triangles, low and high corner, shape (2, 3)."""
        corners = self.vertices[self.faces]
        return np.array([corners.min(axis=(0, 1)), corners.max(axis=(0, 1))])

    @cached_property
    def corners(self) -> Array:
        """The corners of that box, shape (8, 3)."""
        return trimesh.bounds.corners(self.box)

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """Whether points, shape (n, 3), are inside: in a convex solid, or enclosed by a surface."""
        planes = self._hull.equations
        inside = (points @ planes[:, :3].T + planes[:, 3]).max(axis=1) < 0.0
        if not self.is_convex:
            inside[inside] = [self._encloses(point) for point in points[inside]]
        return inside

    @cached_property
    def _hull(self) -> ConvexHull:
        return ConvexHull(self.vertices)

    def _encloses(self, point: Array) -> bool:
        """Whether the mesh stops nearly every ray from a point.

        A ray along d meets the triangle a, b, c if d is in the cone of the three.
        """
        a, b, c = np.moveaxis(self.vertices[self.faces] - point, 1, 0)
        normals = np.stack([np.cross(a, b), np.cross(b, c), np.cross(c, a)])
        volume = np.einsum("ij,ij->i", a, normals[1])
        sides = np.sign(volume) * (_directions() @ normals.swapaxes(1, 2))
        is_met = (sides >= 0.0).all(axis=0) & (volume != 0.0)
        return bool(is_met.any(axis=1).mean() >= MIN_STOPPED)


# Pairs


def distance_m(first: Solid, second: Solid, T_second_first: Array) -> float:
    """Distance of surfaces; 0 where they intersect."""
    first.fcl.setTransform(fcl.Transform(T_second_first[:3, :3], T_second_first[:3, 3]))
    second.fcl.setTransform(STILL)
    found = fcl.distance(first.fcl, second.fcl, fcl.DistanceRequest(), fcl.DistanceResult())
    return float(found) if found > TOUCHING_M else 0.0


def eroded(first: Solid, second: Solid, off_m: float) -> tuple[Solid, Solid] | None:
    """The pair with one of both eroded, the second where it is convex; None if nothing is left."""
    if off_m == 0.0:
        return first, second
    small = second if second.shrink is not None else first
    left = small if small.shrink is None else small.shrink(off_m)
    if left is None:
        return None
    return (first, left) if small is second else (left, second)


def depth_m(first: Solid, second: Solid, T_second_first: Array) -> float:
    """Greatest depth of a point of one surface in the other solid; nan for two mere surfaces."""
    if not (first.is_convex or second.is_convex):
        return float("nan")
    low, high = 0.0, MAX_DEPTH_M
    while high - low > max(1e-6, 0.02 * low):
        middle = (low + high) / 2
        pair = eroded(first, second, middle)
        is_so_deep = pair is not None and distance_m(*pair, T_second_first) == 0.0
        low, high = (middle, high) if is_so_deep else (low, middle)
    return low


def is_inside(first: Solid, second: Solid, T_second_first: Array) -> bool:
    """Whether one of two whose surfaces do not meet is wholly inside the other.

    False for two mere surfaces, so for two links of the robot, which cannot have got there.
    """
    if not (first.is_convex or second.is_convex):
        return False
    T = T_second_first
    return holds(second, first, T) or holds(first, second, inverse(T))


def holds(outer: Solid, inner: Solid, T_outer_inner: Array) -> bool:
    """Whether points of one solid are inside another."""
    low, high = outer.box
    points = inner.vertices if outer.is_convex else inner.vertices.mean(axis=0)[None]
    points = placed(T_outer_inner, points)
    within = ((points > low) & (points < high)).all(axis=1)
    return bool(within.any()) and bool(outer.contains(points[within]).any())


def placed(T: Array, points: Array) -> Array:
    """Points, shape (n, 3), seen through poses, shape (..., 4, 4)."""
    found: Array = points @ np.swapaxes(T[..., :3, :3], -1, -2) + T[..., None, :3, 3]
    return found


def inverse(T: Array) -> Array:
    """The inverse of poses, shape (..., 4, 4)."""
    back = np.zeros(T.shape)
    back[..., :3, :3] = np.swapaxes(T[..., :3, :3], -1, -2)
    back[..., :3, 3] = -(back[..., :3, :3] @ T[..., :3, 3, None])[..., 0]
    back[..., 3, 3] = 1.0
    return back


# Shapes


def box_mesh(size_m: Array) -> trimesh.Trimesh:
    """A cuboid about the origin."""
    return trimesh.creation.box(size_m)


def cylinder_mesh(radius_m: float, length_m: float) -> trimesh.Trimesh:
    """A prism in a cylinder about z."""
    return trimesh.creation.cylinder(radius_m, length_m, sections=CYLINDER_SIDES)


def _ball_mesh(radius_m: float) -> trimesh.Trimesh:
    return trimesh.creation.icosphere(SPHERE_SUBDIVISIONS, radius_m)


def solid_of(name: str, shape: Any) -> Solid:
    """A shape of the scene, in its own frame; its measures say which it is."""
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
    return _solid(name, box_mesh, size_m)


def cylinder_solid(name: str, radius_m: float, length_m: float) -> Solid:
    """A cylinder about z."""
    return _solid(name, lambda size: cylinder_mesh(size[0] / 2, size[1]), [2 * radius_m, length_m])


def sphere_solid(name: str, radius_m: float) -> Solid:
    """A ball about the origin."""
    return _solid(name, lambda size: _ball_mesh(size[0] / 2), [2 * radius_m])


def _solid(name: str, mesh_of: Callable[[Array], trimesh.Trimesh], extents_m: Any) -> Solid:
    """A shape about the origin that erosion shortens by twice the depth along each extent."""
    extents = np.asarray(extents_m, dtype=float)
    mesh = mesh_of(extents)

    @cache
    def shrink(off_m: float) -> Solid | None:
        left = extents - 2 * off_m
        return _solid(name, mesh_of, left) if left.min() > MIN_SIZE_M else None

    return Solid(name, np.array(mesh.vertices), np.array(mesh.faces), shrink)


def hull_solid(name: str, points: Array) -> Solid:
    """The convex hull of points."""
    hull = ConvexHull(points)
    number = np.full(len(points), -1)
    number[hull.vertices] = np.arange(len(hull.vertices))

    @cache
    def shrink(off_m: float) -> Solid | None:
        inner = hull.equations + np.array([0.0, 0.0, 0.0, off_m])
        # the deepest point: max r with normal @ x + offset + r <= 0
        ones, bounds = np.ones((len(inner), 1)), [(None, None)] * 3 + [(0.0, None)]
        found = linprog([0, 0, 0, -1], np.hstack([inner[:, :3], ones]), -inner[:, 3], bounds=bounds)
        if not found.success or found.x[3] < MIN_SIZE_M:
            return None
        return hull_solid(name, HalfspaceIntersection(inner, found.x[:3]).intersections)

    return Solid(name, points[hull.vertices], number[hull.simplices], shrink)


@cache
def _directions() -> Array:
    """Directions spread evenly over a sphere (a Fibonacci lattice), shape (n, 3)."""
    i = np.arange(RAYS) + 0.5
    z, turn = 1.0 - 2.0 * i / RAYS, np.pi * (1.0 + 5.0**0.5) * i
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)
