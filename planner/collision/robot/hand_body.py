"""The body of a robot with its own hands: fingers and tips of other meshes, and tools.

The body that comes with the package is that of the stock robot. A finger or tip of another mesh has
the body of that mesh; which is on the same finger of some hand, so it is placed alike. A tool is
polyhedra around its shapes: boxes as they are, cylinders and spheres circumscribed, so that they
are farther out by at most 0.13 % and 1.9 % of their radius.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import product

import numpy as np
import pinocchio as pin

from baxter_kin.description import RobotDescription
from baxter_kin.description.hands import is_finger, is_tool
from baxter_kin.description.urdf import ShapeKind, UrdfJoint, UrdfShape
from baxter_kin.fields import FrozenMapping
from baxter_kin.validation import FloatArray
from planner.collision.robot.robot_body import LinkBody, RobotBody, Triangulated
from planner.errors import SceneError
from planner.scene.contact import hull_of, triangles_of

PRISM_SIDES = 64
"""Of the prism around a cylinder: outside it by 1 / cos(pi / 64) - 1 of its radius."""

BALL_POINTS = 200
"""Of the polyhedron around a ball: outside it by at most 1.9 % of its radius."""

NOTHING = Triangulated(np.empty((0, 3)), np.empty((0, 3), np.int64))


@lru_cache(maxsize=8)
def fitted(body: RobotBody, description: RobotDescription) -> RobotBody:
    """A body as the robot's hands have it; the same object where they are as in the body.

    Links that the robot lacks stay in it.
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
        points = np.array(list(product((-0.5, 0.5), repeat=3))) * shape.size_m
    elif shape.kind is ShapeKind.CYLINDER:
        radius, length = shape.size_m
        angles = 2 * math.pi * np.arange(PRISM_SIDES) / PRISM_SIDES
        rim = radius / math.cos(math.pi / PRISM_SIDES) * np.array([np.cos(angles), np.sin(angles)])
        ends = (np.full(PRISM_SIDES, z) for z in (-length / 2, length / 2))
        points = np.concatenate([np.column_stack([*rim, end]) for end in ends])
    else:
        (radius,) = shape.size_m
        on_ball = _directions(BALL_POINTS)
        vertices, triangles = triangles_of(hull_of(on_ball))
        a, b, c = vertices[triangles].swapaxes(0, 1)
        normals = np.cross(b - a, c - a)
        depths = np.einsum("ij,ij->i", normals, a) / np.linalg.norm(normals, axis=1)
        points = radius / depths.min() * on_ball
    R = pin.rpy.rpyToMatrix(np.array(shape.rpy))
    vertices, triangles = triangles_of(hull_of(points))
    placed = np.ascontiguousarray(vertices @ R.T + np.array(shape.xyz))
    return Triangulated(placed, triangles.astype(np.int64))


def _directions(count: int) -> FloatArray:
    """Unit vectors all over a ball, shape (count, 3): a spiral by the golden angle (Vogel 1979)."""
    number = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * number / count, math.pi * (1.0 + math.sqrt(5.0)) * number
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)
