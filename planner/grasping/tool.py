"""Tools: a body mounted on the flange in place of a hand."""

from __future__ import annotations

import pinocchio as pin

from baxter_kin import Tool
from baxter_kin.description.urdf import ShapeKind, UrdfShape, origin_of
from baxter_kin.frames import PoseLike, checked_pose
from baxter_kin.validation import expect
from planner.errors import SceneError
from planner.scene.bodies import Body, Box, Cylinder, Shape, Sphere


def tool_of(body: Body, T_hand_tip: PoseLike) -> Tool:
    """A tool for `Baxter.load(hands=...)`: a body rigid on the flange, with a tip.

    Args:
        body: boxes, cylinders and spheres. Its `T_base_body` is read as its pose seen from
            `<side>_hand`, whose z points out of the flange, not from base.
        T_hand_tip: pose of the tip seen from `<side>_hand`.

    Raises:
        SceneError: when the body has the wrong type or has a mesh among its shapes.
        ConfigurationError: when it reaches too far, or has too many shapes.
        PoseError: when the pose of the tip is invalid.
    """
    parts = expect(body, Body, "the body of a tool", SceneError).placed_parts
    shapes = tuple(_shape(body.name, part.shape, part.T_body_part) for part in parts)
    return Tool(shapes, checked_pose(T_hand_tip))


def _shape(name: str, shape: Shape, T_hand_shape: pin.SE3) -> UrdfShape:
    kind, size_m = _kind_and_size(name, shape)
    xyz, rpy = origin_of(T_hand_shape)
    return UrdfShape(kind, size_m, xyz=xyz, rpy=rpy)


def _kind_and_size(name: str, shape: Shape) -> tuple[ShapeKind, tuple[float, ...]]:
    if isinstance(shape, Box):
        return ShapeKind.BOX, shape.size_m
    if isinstance(shape, Cylinder):
        return ShapeKind.CYLINDER, (float(shape.radius_m), float(shape.length_m))
    if isinstance(shape, Sphere):
        return ShapeKind.SPHERE, (float(shape.radius_m),)
    raise SceneError(
        f"the tool {name!r} has a mesh among its shapes; use boxes, cylinders or spheres around it"
    )
