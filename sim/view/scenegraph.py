"""The scene as a tree of Meshcat nodes, shared by the live view and the replay.

The robot has two nodes for each joint: `<joint>` is placed once, `<joint>/moves` only turns or
slides. So a frame of motion is one quaternion or one position for each joint that moved, and the
browser does the forward kinematics by drawing. Bodies are beside the robot, under `/bodies`. The
top nodes are in the base frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from urllib.parse import quote
from zlib import crc32

import numpy as np
import pinocchio as pin

from baxter_kin.frames import BASE_HEIGHT_M
from baxter_kin.validation import FloatArray
from planner.collision.robot.robot_body import LinkBody, RobotBody
from planner.scene.bodies import Body, Box, Cylinder, Part
from planner.scene.mesh import Mesh
from sim.view.appearance import Appearance, RobotPart
from sim.view.meshcat_commands import (
    Command,
    Rgb,
    compact,
    glowing,
    material,
    painted,
    set_object,
    set_property,
    set_transform,
    short_numbers,
    triangles,
    tube,
)

FLOOR_RADII_M = (0.0, 1.6, 2.4, 3.2)
FLOOR_OPACITIES = (1.0, 1.0, 0.45, 0.0)
"""The floor fades into the background, so that it has no edge."""

BODY_RGB: Rgb = (0.95, 0.55, 0.12)
BODY_OPACITY = 0.7
BODY_STEP_M = 2.0**-14
"""Colour and opacity of the collision body, and the resolution of its corners, 0.06 mm."""

FLOOR_SEGMENTS = 72
FLOOR_RGB: Rgb = (0.80, 0.82, 0.84)

_LIGHTS: tuple[tuple[str, str, object], ...] = (
    ("AmbientLight", "intensity", 0.50),
    ("FillLight", "intensity", 0.34),
    ("FillLight", "position", [2.0, -6.0, 1.5]),
    ("PointLightNegativeX", "intensity", 0.12),
    ("PointLightPositiveX", "intensity", 0.12),
    ("SpotLight", "intensity", 0.50),
    ("SpotLight", "position", [3.4, 2.6, 5.2]),
    ("SpotLight", "angle", 0.5),
    ("SpotLight", "penumbra", 1.0),
    ("SpotLight", "castShadow", True),
)
"""Meshcat's own lights: light, property, value. Only the one from the left front casts shadows; the
fill light comes from the other side, low, so that shapes in the shade remain visible."""


class RobotTree:
    """The robot as nodes.

    Attributes:
        paths: the moving node of each joint, in the order of a full configuration.
        mesh_paths: the node of each part of the appearance.
    """

    def __init__(self, model: pin.Model, appearance: Appearance, root: str = "") -> None:
        """Name the nodes.

        Args:
            model: the whole robot; every joint turns or slides about one axis.
            appearance: what is attached to its joints.
            root: the node above the robot.
        """
        self._model = model
        self._parts = appearance.parts
        self._moving = _moving_nodes(model, f"{root}/robot")
        self._axes = _axes(model)
        self.mesh_paths = tuple(
            f"{self._moving[part.joint]}/{part.mesh.name}-{index}"
            for index, part in enumerate(self._parts)
        )
        self.paths = tuple(self._moving[name] for name in model.names)[1:]

    def commands(self, surface: Command | None = None) -> Iterator[Command]:
        """Place the joints and draw the parts, with one surface, or each with its own."""
        for path, T_parent_joint in zip(self.paths, self._model.jointPlacements[1:], strict=True):
            yield set_transform(path.removesuffix("/moves"), T_parent_joint)
        for path, part in zip(self.mesh_paths, self._parts, strict=True):
            yield part_command(path, part, part.T_joint_mesh, surface)

    def moving_node(self, joint: str) -> str:
        """The node that a joint moves, by the joint's name; "universe" is the robot's root."""
        return self._moving[joint]

    def body_commands(self, body: RobotBody) -> Iterator[Command]:
        """Draw the collision body on the joints, beside the meshes."""
        for path, link in zip(self.body_paths(body), self._links(body), strict=True):
            vertices, faces = link.whole
            points = short_numbers(vertices, BODY_STEP_M)
            geometry = triangles(points, compact(faces), uuid=f"body {crc32(points.tobytes())}")
            surface = material(BODY_RGB, opacity=BODY_OPACITY) | {"flatShading": True}
            frame = self._model.frames[self._model.getFrameId(link.name)]
            yield set_object(path, geometry, surface)
            yield set_transform(path, frame.placement)

    def body_paths(self, body: RobotBody) -> tuple[str, ...]:
        """The node of each link of the collision body."""
        model, names = self._model, [link.name for link in self._links(body)]
        joints = [model.frames[model.getFrameId(name)].parentJoint for name in names]
        nodes = [self._moving[model.names[joint]] for joint in joints]
        return tuple(f"{node}/body {name}" for node, name in zip(nodes, names, strict=True))

    def _links(self, body: RobotBody) -> list[LinkBody]:
        """The links that the robot has; it may lack a gripper."""
        return [link for link in body.links.values() if self._model.existFrame(link.name)]

    def motion(self, joint: int, value: float) -> tuple[str, list[float]]:
        """The property of its node that a joint sets, and its value at a position, rad or m."""
        key, values = self.motions(joint, np.array([value]))
        return key, values[0].tolist()

    def motions(self, joint: int, values: FloatArray) -> tuple[str, FloatArray]:
        """The property of its node that a joint sets, and its values at positions.

        Args:
            joint: index in a full configuration.
            values: positions, shape (n,), rad or m.

        Returns:
            "position" and an array (n, 3), or "quaternion" and an array (n, 4), x, y, z, w.
        """
        turns, axis = self._axes[joint]
        if not turns:
            return "position", np.outer(values, axis)
        return "quaternion", np.column_stack(
            [np.outer(np.sin(values / 2), axis), np.cos(values / 2)]
        )


def stage_commands() -> Iterator[Command]:
    """Draw the floor and set the lights. Camera and background belong to the page."""
    yield set_property("/Grid", "visible", False)
    yield set_property("/Axes", "visible", False)
    for light, key, value in _LIGHTS:
        yield set_property(f"/Lights/{light}/<object>", key, value)
    yield set_property("/Lights/SpotLight", "visible", True)
    yield set_object("/floor", _fading_disc(), painted(gloss=0.0))
    yield set_transform("/floor", pin.SE3(np.eye(3), np.array([0.0, 0.0, -BASE_HEIGHT_M])))


def body_path(name: str, root: str = "") -> str:
    """The node of a body below a root, also if its name has a slash."""
    return f"{root}/bodies/{quote(name, safe=' ')}"


def body_commands(body: Body, root: str = "", surface: Command | None = None) -> Iterator[Command]:
    """Draw the shapes of a body; `pose_commands` place it.

    Args:
        body: the body.
        root: the node above it.
        surface: used in place of its own colours.
    """
    for index, part in enumerate(body.parts):
        path = f"{body_path(body.name, root)}/{index}"
        red, green, blue, opacity = part.rgba
        own = material((red, green, blue), opacity=opacity) if surface is None else surface
        yield set_object(path, _geometry(part), own)
        yield set_transform(path, part.T_body_part * _T_part_geometry(part))


def _geometry(part: Part) -> Command:
    """The shape of a part as a geometry of three.js."""
    shape = part.shape
    if isinstance(shape, Box):
        return {"type": "BoxGeometry"} | dict(
            zip(("width", "height", "depth"), shape.size_m, strict=True)
        )
    if isinstance(shape, Cylinder):
        size = {
            "radiusTop": shape.radius_m,
            "radiusBottom": shape.radius_m,
            "height": shape.length_m,
        }
        return {"type": "CylinderGeometry", "radialSegments": 48} | size
    if isinstance(shape, Mesh):
        return _flat_faces(shape)
    segments = {"widthSegments": 32, "heightSegments": 24}
    return {"type": "SphereGeometry", "radius": shape.radius_m} | segments


def _flat_faces(mesh: Mesh) -> Command:
    """Triangles that share no corners, each with its normal, so that edges look sharp."""
    corners = mesh.corners
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    vertices = corners.reshape(-1, 3).astype(np.float32)
    faces = np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3)
    return triangles(vertices, faces, np.repeat(normals, 3, axis=0).astype(np.float32))


def _T_part_geometry(part: Part) -> pin.SE3:
    """Cylinders of three.js are along y, ours along z."""
    if isinstance(part.shape, Cylinder):
        return pin.SE3(pin.utils.rotate("x", math.pi / 2), np.zeros(3))
    return pin.SE3.Identity()


def pose_commands(path: str, T_base_node: pin.SE3) -> Iterator[Command]:
    """Move a node to a pose."""
    xyz_xyzw = pin.SE3ToXYZQUAT(T_base_node).tolist()
    yield set_property(path, "position", xyz_xyzw[:3])
    yield set_property(path, "quaternion", xyz_xyzw[3:])


def line_command(
    path: str, points_base: FloatArray, radius_m: float, rgb: Rgb, *, uuid: str | None = None
) -> Command:
    """Draw a line as a thin tube: lines proper are one pixel wide, and need a graphics card.

    The tube has eight triangles for each segment, in the line's order.

    Args:
        path: the node.
        points_base: at least two points, shape (n, 3), m.
        radius_m: of the tube.
        rgb: its colour, the same in light and shadow.
        uuid: a name, for a line drawn more than once.
    """
    vertices, faces = tube(points_base, radius_m)
    return set_object(path, triangles(vertices, compact(faces), uuid=uuid), glowing(rgb))


def _moving_nodes(model: pin.Model, root: str) -> dict[str, str]:
    """The path of the moving node of each joint; "universe" is the robot's root."""
    paths = [root]
    for index in range(1, model.njoints):
        paths.append(f"{paths[model.parents[index]]}/{model.names[index]}/moves")
    return dict(zip(model.names, paths, strict=True))


def _axes(model: pin.Model) -> list[tuple[bool, FloatArray]]:
    """For each joint whether it turns (else it slides), and its axis, shape (3,), unit."""
    data = model.createData()
    axes = []
    for joint in data.joints[1:]:
        linear, angular = np.split(np.asarray(joint.S).reshape(-1), 2)
        turns = bool(angular.any())
        axes.append((turns, angular if turns else linear))
    return axes


def part_command(
    path: str, part: RobotPart, T_parent_mesh: pin.SE3, surface: Command | None = None
) -> Command:
    """Draw a part of the robot.

    Args:
        path: its node.
        part: the part; all nodes that draw it share its triangles.
        T_parent_mesh: pose of its mesh, seen from the node above.
        surface: used in place of its own colour.
    """
    mesh = part.mesh
    geometry = triangles(mesh.vertices, mesh.faces, mesh.normals, uuid=f"mesh {mesh.name}")
    scaling = np.diag([mesh.scale_m, mesh.scale_m, mesh.scale_m, 1.0])
    scaling[:3, 3] = mesh.centre_m
    matrix = (T_parent_mesh.homogeneous @ scaling).T.reshape(-1).tolist()
    return set_object(path, geometry, material(part.rgb) if surface is None else surface, matrix)


def _fading_disc() -> Command:
    """Rings around the origin, facing upwards, each with its opacity."""
    angles = np.linspace(0.0, 2 * math.pi, FLOOR_SEGMENTS, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    vertices = np.concatenate([radius * circle for radius in FLOOR_RADII_M])
    colours = [[*FLOOR_RGB, opacity] for opacity in FLOOR_OPACITIES for _ in angles]
    a = np.arange((len(FLOOR_RADII_M) - 1) * FLOOR_SEGMENTS)
    b = a - a % FLOOR_SEGMENTS + (a + 1) % FLOOR_SEGMENTS
    c, d = a + FLOOR_SEGMENTS, b + FLOOR_SEGMENTS
    faces = np.concatenate([np.column_stack([a, c, d]), np.column_stack([a, d, b])])
    return triangles(
        vertices.astype(np.float32),
        compact(faces),
        np.tile(np.array([0, 0, 127], np.int8), (len(vertices), 1)),
        colours=np.array(colours, np.float32),
    )
