"""Shapes of coal: conversion of a scene's shapes, and meshes made for distances or for contacts.

coal enters here; the geometry models of `planner.collision.checker` consist of these shapes.
"""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from baxter_kin.validation import FloatArray, Indices
from planner.errors import SceneError
from planner.scene.bodies import Box, Cylinder, Shape, Sphere
from planner.scene.mesh import Mesh

MAX_TOUCHED_TRIANGLES = 1000
"""Maximum number of triangles of a mesh that is not convex and has intended contacts."""

BOTH_SIDES = np.array([[0, 1, 2], [0, 2, 1]])
"""The two sides of a triangle: a surface without volume."""

FLAT_M = 1e-5
"""Triangles thinner than this along some axis are thickened by it, so that they have a hull."""


@lru_cache(maxsize=64)
def coal_shape(shape: Shape) -> coal.CollisionGeometry:
    """Coal's shape for ours; made once while it is in use."""
    if isinstance(shape, Box):
        return coal.Box(*shape.size_m)
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.radius_m, shape.length_m)
    if isinstance(shape, Sphere):
        return coal.Sphere(shape.radius_m)
    if shape.is_convex:
        return convex(shape.vertices, shape.triangles)
    return surface_of(shape).for_distances


@lru_cache(maxsize=64)
def surface_of(mesh: Mesh) -> Surface:
    """Coal's trees for a mesh that is not convex; made once while it is in use."""
    return Surface(mesh.vertices, mesh.triangles)


def convex_pieces(shape: Shape) -> tuple[coal.ShapeBase, ...]:
    """Convex shapes of coal, of which depths are known: the shape itself, or its triangles."""
    if not isinstance(shape, Mesh) or shape.is_convex:
        return (coal_shape(shape),)
    if len(shape.triangles) > MAX_TOUCHED_TRIANGLES:
        raise SceneError(
            f"a mesh that is not convex and has intended contacts has {len(shape.triangles)} "
            f"triangles; at most {MAX_TOUCHED_TRIANGLES} are allowed: simplify it, or give its "
            "convex hull"
        )
    return tuple(convex(corners, BOTH_SIDES) for corners in shape.corners)


def has_depth(geometry: coal.CollisionGeometry) -> bool:
    """Whether coal measures depths inside a shape: not where it consists of triangles."""
    return isinstance(geometry, coal.ShapeBase)


def coal_pose(T: pin.SE3) -> coal.Transform3s:
    """Coal's pose for ours."""
    return coal.Transform3s(T.rotation, T.translation)


def convex(vertices: FloatArray, triangles: Indices) -> coal.Convex:
    """Coal's convex shape of a surface, shapes (n, 3), m, and (m, 3)."""
    points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for vertex in vertices:
        points.append(vertex)
    for triangle in triangles.tolist():
        faces.append(coal.Triangle(*triangle))
    return coal.Convex(points, faces)


def hull(geometry: coal.CollisionGeometry) -> coal.CollisionGeometry:
    """The convex hull of triangles; other shapes, which are convex, as they are."""
    if not isinstance(geometry, coal.BVHModelBase):
        return geometry
    vertices = np.array(geometry.vertices())
    _, _, axes = np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)
    for axis, extent_m in zip(axes, np.ptp(vertices @ axes.T, axis=0), strict=True):
        if extent_m < FLAT_M:  # Qhull fails on flat points
            vertices = np.concatenate([vertices - FLAT_M * axis, vertices + FLAT_M * axis])
    return hull_of(vertices)


def hull_of(points: FloatArray) -> coal.Convex:
    """The convex hull of points that are not all in a plane, shape (n, 3), m."""
    vertices = coal.StdVec_Vec3s()
    for point in points:
        vertices.append(point)
    return coal.Convex.convexHull(vertices, True, "Qt")


def triangles_of(geometry: coal.ConvexBase) -> tuple[FloatArray, Indices]:
    """The surface of a convex shape of coal, turned outwards: shapes (n, 3), m, and (m, 3)."""
    faces = [geometry.polygons(i) for i in range(geometry.num_polygons)]
    triangles: Indices = np.array([[face[k] for k in range(3)] for face in faces])
    return np.array(geometry.points()), triangles


class Surface:
    """A surface of triangles without inside, in coal's trees, which are made when first used.

    Args:
        vertices: shape (n, 3), m.
        triangles: shape (m, 3).
    """

    def __init__(self, vertices: FloatArray, triangles: Indices) -> None:
        self._vertices, self._triangles = vertices, triangles

    @cached_property
    def for_distances(self) -> coal.BVHModelOBBRSS:
        """The tree in which coal can measure distances."""
        return surface(self._vertices, self._triangles)

    @cached_property
    def for_contacts(self) -> coal.BVHModelOBB:
        """The tree of oriented boxes, in which contacts are found fastest.

        The tree that distances need bounds a box, or another convex shape, by a swept sphere, which
        is too loose to exclude triangles within the shape's own thickness: a finger tip 4 mm beside
        a block took a thousand times as long.
        """
        return _filled(coal.BVHModelOBB(), self._vertices, self._triangles)


def surface(vertices: FloatArray, triangles: Indices) -> coal.BVHModelOBBRSS:
    """Coal's tree of triangles for distances, shapes (n, 3), m, and (m, 3)."""
    return _filled(coal.BVHModelOBBRSS(), vertices, triangles)


def _filled(empty: coal.BVHModelBase, vertices: FloatArray, triangles: Indices) -> Any:
    empty.beginModel(len(triangles), len(vertices))
    empty.addVertices(vertices)
    empty.addTriangles(triangles)
    empty.endModel()
    return empty


def shape_of(geometry: coal.CollisionGeometry) -> Shape:
    """Our shape for coal's."""
    if isinstance(geometry, coal.Box):
        x, y, z = (2 * geometry.halfSide).tolist()
        return Box((x, y, z))
    if isinstance(geometry, coal.Cylinder):
        return Cylinder(geometry.radius, 2 * geometry.halfLength)
    if isinstance(geometry, coal.Sphere):
        return Sphere(geometry.radius)
    if isinstance(geometry, coal.ConvexBase):
        return Mesh(*triangles_of(geometry))
    raise SceneError(
        "only boxes, cylinders, spheres and convex shapes are supported, not "
        f"{type(geometry).__name__}"
    )
