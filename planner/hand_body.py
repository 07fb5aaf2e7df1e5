"""The body of a robot with its own hands: fingers and tips of other meshes, and tools.

The body that comes with the package is that of the stock robot. A finger or tip of another mesh has
the body of that mesh; which is on the same finger of some hand, so it is placed alike. A tool is
polyhedra around its shapes: boxes as they are, cylinders and spheres circumscribed, so that they
are farther out by at most 0.13 % and 2.3 % of their radius.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pinocchio as pin

from baxter_kin.arrays import Vector
from baxter_kin.copying import FrozenMapping
from baxter_kin.description import RobotDescription
from baxter_kin.description.mounting import is_finger, is_tool
from baxter_kin.description.urdf import ShapeKind, UrdfJoint, UrdfShape
from planner.errors import SceneError
from planner.robot_body import LinkBody, RobotBody, Triangulated

PRISM_SIDES = 64
"""Of the prism around a cylinder: outside it by 1 / cos(pi / 64) - 1 of its radius."""

SUBDIVISIONS = 2
"""How often the icosahedron's triangles are divided in four for what is around a sphere."""

NOTHING = Triangulated(np.empty((0, 3)), np.empty((0, 3), np.int64))


@lru_cache(maxsize=8)
def fitted(body: RobotBody, description: RobotDescription) -> RobotBody:
    """A body as the robot's hands have it; the same object where they are as in the body.

    Links that the robot lacks stay in it.

    Raises:
        SceneError: when the body has no finger or tip of a mesh that the robot has.
    """
    other = {link.name: link for link in _other_links(body, description)}
    if not other:
        return body
    return RobotBody(FrozenMapping({**body.links, **other}), body.skipped_pairs)


def _other_links(body: RobotBody, description: RobotDescription) -> Iterator[LinkBody]:
    for joint in description.tree.joints:
        known = body.links.get(joint.child)
        if is_tool(joint.child):
            yield _tool(joint, body)
        elif known is not None and is_finger(joint.child) and joint.shapes[0].mesh != known.mesh:
            found = _of_mesh(body, joint.child, joint.shapes[0].mesh)
            yield replace(found, name=known.name, padding_m=known.padding_m)


def _of_mesh(body: RobotBody, link: str, mesh: str) -> LinkBody:
    """Some finger or tip of a mesh, on the same finger of its hand as a link is on."""
    finger = "_l_finger" if "_l_finger" in link else "_r_finger"
    for other in body.links.values():
        if other.mesh == mesh and finger in other.name:
            return other
    raise SceneError(f"the link {link} has the mesh {mesh}, of which the body has no shape")


def _tool(joint: UrdfJoint, body: RobotBody) -> LinkBody:
    """A shape of a tool, as thick as the hand that it is on."""
    (shape,) = joint.shapes
    hand = body.links.get(joint.parent)
    piece = around(shape)
    return LinkBody(
        joint.child, "", NOTHING, 0.0, NOTHING, (piece,), padding_m=hand.padding_m if hand else 0.0
    )


def around(shape: UrdfShape) -> Triangulated:
    """A convex polyhedron around a box, cylinder or sphere, in the frame of its link."""
    if shape.kind is ShapeKind.BOX:
        x, y, z = (edge / 2 for edge in shape.size_m)
        corners = np.array([(x, y), (-x, y), (-x, -y), (x, -y)])
        points, triangles = _prism(corners, z)
    elif shape.kind is ShapeKind.CYLINDER:
        radius, length = shape.size_m
        angles = 2 * math.pi * np.arange(PRISM_SIDES) / PRISM_SIDES
        corners = (
            radius / math.cos(math.pi / PRISM_SIDES) * np.array([np.cos(angles), np.sin(angles)])
        )
        points, triangles = _prism(corners.T, length / 2)
    else:
        points, triangles = _ball(*shape.size_m)
    R = pin.rpy.rpyToMatrix(np.array(shape.rpy))
    return Triangulated(np.ascontiguousarray(points @ R.T + np.array(shape.xyz)), triangles)


def _prism(
    corners: Vector, half: float
) -> tuple[Vector, np.ndarray[tuple[int, ...], np.dtype[np.int64]]]:
    """Upright on a convex polygon, shape (n, 2), counter-clockwise from above."""
    n = len(corners)
    points = np.vstack([np.column_stack([corners, np.full(n, side)]) for side in (-half, half)])
    after = [(i, (i + 1) % n) for i in range(n)]
    sides = [t for i, j in after for t in ((i, j, n + j), (i, n + j, n + i))]
    lids = [t for i in range(1, n - 1) for t in ((0, i + 1, i), (n, n + i, n + i + 1))]
    return points, np.array(sides + lids, np.int64)


def _ball(radius: float) -> tuple[Vector, np.ndarray[tuple[int, ...], np.dtype[np.int64]]]:
    """A geodesic polyhedron whose faces are at least so far from the middle."""
    golden = (1 + math.sqrt(5)) / 2
    rectangle = [np.array([0.0, a, b * golden]) for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
    corners = [np.roll(p, k) / np.linalg.norm(p) for p in rectangle for k in range(3)]
    near = [
        (i, j, k)
        for i in range(12)
        for j in range(i)
        for k in range(j)
        if all(corners[a] @ corners[b] > 0.4 for a, b in ((i, j), (j, k), (k, i)))
    ]
    triangles = [np.array([corners[i] for i in three]) for three in near]
    for _ in range(SUBDIVISIONS):
        triangles = [part for three in triangles for part in _quartered(three)]
    outward = [t if np.linalg.det(t) > 0.0 else t[::-1] for t in triangles]
    soup = np.array(outward)
    points_at, index = np.unique(soup.reshape(-1, 3).round(12), axis=0, return_inverse=True)
    normals = np.cross(soup[:, 1] - soup[:, 0], soup[:, 2] - soup[:, 0])
    depths = np.einsum("ij,ij->i", normals, soup[:, 0]) / np.linalg.norm(normals, axis=1)
    return radius / depths.min() * points_at, index.reshape(-1, 3).astype(np.int64)


def _quartered(corners: Vector) -> Iterator[Vector]:
    """A triangle on the unit sphere as four, shape (3, 3) each."""
    a, b, c = corners
    ab, bc, ca = (p / np.linalg.norm(p) for p in (a + b, b + c, c + a))
    yield from (np.array(three) for three in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)))
