"""Contact between shapes: gaps, and how far one may move until it touches another.

coal enters here; the geometry models of `planner.collision.checker` are made of its shapes.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product
from typing import Any, TypeAlias

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin.errors import expect, quoted
from baxter_kin.validation import FloatArray, Indices, finite_array, finite_scalar
from planner.errors import SceneError
from planner.scene.bodies import Body, Box, Cylinder, Part, Scene, Shape, Sphere
from planner.scene.mesh import Mesh

CONTACT_TOLERANCE_M = 1e-9
"""Shapes closer than this touch."""

PRESSING_TOLERANCE_M = 5e-4
"""How deep an allowed contact may press before it counts as a collision."""

DISTANCE_TOLERANCE_M = 1e-8
"""Accuracy of distances where a contact is sought; coal's default, 1e-6, overshoots."""

SLIDING = 1e-3
"""Shapes in contact that close in by less than this share of the way slide along each other."""

UNIT_TOLERANCE = 1e-9
"""How far the length of a unit vector may be from 1 by rounding."""

MOST_TOUCHED_TRIANGLES = 1000
"""How many triangles a mesh may have that is not convex and something touches on purpose."""

_MAX_ADVANCES = 1000

_Placed: TypeAlias = tuple[coal.CollisionGeometry, coal.Transform3s]

FLAT_M = 1e-5
"""Triangles whose extent along some axis is less than this get so thick that they have a hull."""


def travel_to_contact(
    moving: Part, direction: ArrayLike, still: Part, room_m: float
) -> float | None:
    """How far a shape moves along a line until it touches another; None if it does not.

    Conservative advancement (Mirtich 1996): two planes across the shortest connection keep convex
    shapes apart, so a shape may move until it has used up the gap between them, and never touches
    when it does not move towards them. Shapes in contact touch at once, unless one slides along
    the other or leaves it. A mesh that is not convex is taken triangle by triangle, so what slides
    along its surface stops at the next edge.

    Args:
        moving: the shape that moves, placed in some frame.
        direction: unit vector in that frame, shape (3,).
        still: the other shape, placed in the same frame.
        room_m: how far it may move at most.

    Raises:
        SceneError: when an argument is malformed, the direction is not of unit length, or a mesh
            that is not convex has more than `MOST_TOUCHED_TRIANGLES`.
    """
    along = _unit(direction)
    finite_scalar(room_m, "room_m", SceneError)
    for part in (moving, still):
        expect(part, Part, "a shape to move", SceneError)
    travels = (
        _travel(first, second, along, room_m)
        for first, second in product(_pieces(moving), _pieces(still))
    )
    return min((travel for travel in travels if travel is not None), default=None)


def _travel(moving: _Placed, still: _Placed, along: FloatArray, room_m: float) -> float | None:
    """The same for one convex shape and another."""
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
        if closing <= 0.0 or gap > closing * (room_m - travel) + CONTACT_TOLERANCE_M:
            return None
        travel = min(travel + gap / closing, room_m)
    return travel


def gap_m(first: Part, second: Part) -> float:
    """Distance of two shapes placed in one frame; negative inside each other."""
    return _nearest(_pieces(first), _pieces(second))[0]


def contact_point(first: Part, second: Part) -> FloatArray:
    """The point of a shape that is nearest to another, both placed in one frame, shape (3,), m."""
    return _nearest(_pieces(first), _pieces(second))[1]


def touching(body: Body, scene: Scene) -> frozenset[str]:
    """Names of the other bodies that a body touches within `PRESSING_TOLERANCE_M`."""
    placed = _placed(body)
    return frozenset(
        other.name
        for other in scene
        if other.name != body.name and _nearest(placed, _placed(other))[0] <= PRESSING_TOLERANCE_M
    )


@lru_cache(maxsize=64)
def coal_shape(shape: Shape) -> coal.CollisionGeometry:
    """Our shape as coal's; made once, for as long as it is in use."""
    if isinstance(shape, Box):
        return coal.Box(*shape.size_m)
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.radius_m, shape.length_m)
    if isinstance(shape, Sphere):
        return coal.Sphere(shape.radius_m)
    if shape.is_convex:
        return convex(shape.vertices, shape.triangles)
    return surface(shape.vertices, shape.triangles)


def convex_pieces(shape: Shape) -> tuple[coal.ShapeBase, ...]:
    """A shape as convex shapes of coal, whose depth inside another is known: itself, or triangles.

    Raises:
        SceneError: when it is a mesh that is not convex, of more than `MOST_TOUCHED_TRIANGLES`.
    """
    if not isinstance(shape, Mesh) or shape.is_convex:
        return (coal_shape(shape),)
    if len(shape.triangles) > MOST_TOUCHED_TRIANGLES:
        raise SceneError(
            f"a mesh that is not convex is touched, but has {len(shape.triangles)} triangles; at "
            f"most {MOST_TOUCHED_TRIANGLES} can be: thin it out, or give its convex hull"
        )
    both_sides = np.array([[0, 1, 2], [0, 2, 1]])
    return tuple(convex(corners, both_sides) for corners in shape.corners)


def has_depth(geometry: coal.CollisionGeometry) -> bool:
    """Whether coal knows how deep something is inside a shape: not inside one made of triangles."""
    return isinstance(geometry, coal.ShapeBase)


def coal_pose(T: pin.SE3) -> coal.Transform3s:
    """Our pose as coal's."""
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
        if extent_m < FLAT_M:  # which Qhull does not survive
            vertices = np.concatenate([vertices - FLAT_M * axis, vertices + FLAT_M * axis])
    return hull_of(vertices)


def hull_of(points: FloatArray) -> coal.Convex:
    """The convex hull of points that are not all in a plane, shape (n, 3), m."""
    vertices = coal.StdVec_Vec3s()
    for point in points:
        vertices.append(point)
    return coal.Convex.convexHull(vertices, True, "Qt")


def triangles_of(geometry: coal.ConvexBase) -> tuple[FloatArray, Indices]:
    """The surface of a convex shape of coal, shapes (n, 3), m, and (m, 3), seen from outside."""
    faces = [geometry.polygons(i) for i in range(geometry.num_polygons)]
    triangles: Indices = np.array([[face[k] for k in range(3)] for face in faces])
    return np.array(geometry.points()), triangles


def surface(vertices: FloatArray, triangles: Indices) -> coal.BVHModelOBBRSS:
    """Coal's triangles, shapes (n, 3), m, and (m, 3); nothing is known of inside and outside."""
    return _filled(coal.BVHModelOBBRSS(), vertices, triangles)


def surface_for_contacts(vertices: FloatArray, triangles: Indices) -> coal.BVHModelOBB:
    """The same in a tree of oriented boxes, in which contacts are found fastest.

    Coal bounds a box, or another convex shape, by a swept sphere too loosely to leave out triangles
    that are within the shape's own thickness of it: a finger tip 4 mm beside a block took a
    thousand times as long in the tree that distances need.
    """
    return _filled(coal.BVHModelOBB(), vertices, triangles)


def boxed(made: coal.BVHModelOBBRSS) -> coal.BVHModelOBB:
    """That of triangles that coal has; they are read one by one."""
    corners = [made.tri_indices(i) for i in range(made.num_tris)]
    triangles = np.array([[each[k] for k in range(3)] for each in corners])
    return surface_for_contacts(np.array(made.vertices()), triangles)


def _filled(empty: coal.BVHModelBase, vertices: FloatArray, triangles: Indices) -> Any:
    empty.beginModel(len(triangles), len(vertices))
    empty.addVertices(vertices)
    empty.addTriangles(triangles)
    empty.endModel()
    return empty


def shape_of(geometry: coal.CollisionGeometry) -> Shape:
    """Coal's shape as ours.

    Raises:
        SceneError: when it is neither box, cylinder, sphere nor convex.
    """
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
        f"only boxes, cylinders, spheres and convex shapes are known, not {type(geometry).__name__}"
    )


def _nearest(first: list[_Placed], second: list[_Placed]) -> tuple[float, FloatArray]:
    """The least distance of some shapes to others, and the point of the first where that is."""
    request, result, found = coal.DistanceRequest(), coal.DistanceResult(), []
    for one, other in product(first, second):
        result.clear()
        gap = float(coal.distance(*one, *other, request, result))
        found.append((gap, np.array(result.getNearestPoint1())))
    return min(found, key=lambda pair: pair[0])


def _pieces(part: Part) -> list[_Placed]:
    pose = coal_pose(part.T_body_part)
    return [(piece, pose) for piece in convex_pieces(part.shape)]


def _placed(body: Body) -> list[_Placed]:
    poses = [body.T_base_body * part.T_body_part for part in body.parts]
    return [
        (coal_shape(part.shape), coal_pose(T)) for part, T in zip(body.parts, poses, strict=True)
    ]


def _unit(direction: ArrayLike) -> FloatArray:
    along = finite_array(direction, (3,), "direction", SceneError)
    length = float(np.linalg.norm(along))
    if abs(length - 1.0) > UNIT_TOLERANCE:
        raise SceneError(
            f"direction {quoted(along.tolist())} has length {length:.6g}; it must have 1"
        )
    return along
