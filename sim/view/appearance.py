"""The robot's appearance: coloured meshes on joints, from the asset next to this file.

The meshes are Rethink Robotics' (BSD-3-Clause; the notice is inside the asset), thinned out by
`scripts/build_appearance.py`. They are kept as the graphics card takes them, small integers on a
uniform scale, so that nothing is converted between the file and the browser.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import as_file, files
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin import Baxter
from baxter_kin.description import RobotDescription
from baxter_kin.description.hands import is_finger, is_tool
from baxter_kin.description.urdf import Urdf, UrdfJoint
from baxter_kin.fields import FrozenMapping, evolve
from planner.collision.robot.robot_body import polyhedron_around
from sim.errors import SimulationError

_ASSET = "appearance.npz"

_FIXED_LINKS: Mapping[str, str] = FrozenMapping(
    {
        "base_link": "torso",
        "pedestal_link_collision": "pedestal",
        "sonar_ring": "sonar_ring",
        "H1": "screen",
        "display": "display",
        "hand_camera": "{side}_hand_camera_link",
        "hand_range": "{side}_hand_range_link",
        "electric_gripper_base": "{side}_gripper_base_link",
        "paddle_tip": "{finger}_tip",
        "half_round_tip": "{finger}_tip",
    }
)
"""The link that a mesh belongs to, where it is not the one that a joint moves."""

TOOL_RGB = (0.45, 0.47, 0.50)


@dataclass(frozen=True, slots=True, eq=False)
class LinkMesh:
    """Triangles of one surface; `points_m` are its vertices in the frame of the mesh.

    Attributes:
        name: unique in the asset, such as "W2.0".
        vertices: shape (n, 3), int16.
        normals: shape (n, 3), int8, of length 127; several vertices share a place at sharp edges.
        faces: shape (m, 3), uint16, counter-clockwise seen from outside.
        centre_m: the vertex 0, shape (3,), m.
        scale_m: metres per unit of `vertices`.
    """

    name: str
    vertices: NDArray[np.int16]
    normals: NDArray[np.int8]
    faces: NDArray[np.uint16]
    centre_m: NDArray[np.float64]
    scale_m: float

    def __post_init__(self) -> None:
        for array in (self.vertices, self.normals, self.faces, self.centre_m):
            array.setflags(write=False)

    @property
    def points_m(self) -> NDArray[np.float64]:
        """The vertices in the frame of the mesh, shape (n, 3), metres."""
        return self.centre_m + self.scale_m * self.vertices


@dataclass(frozen=True, slots=True, eq=False)
class RobotPart:
    """One mesh, painted and fixed to a joint.

    Attributes:
        mesh: its shape.
        joint: the joint that moves it; "universe" does not move.
        T_joint_mesh: pose of the mesh, seen from the joint's moving frame.
        rgb: red, green and blue, 0 .. 1, as shown on the screen.
    """

    mesh: LinkMesh
    joint: str
    T_joint_mesh: pin.SE3
    rgb: tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Appearance:
    """All visible parts of a robot.

    Attributes:
        parts: the meshes on the joints; arms and fingers share meshes.
        notice: the licence of the meshes.
        spares: parts of hands that the stock robot lacks, as mounted on its left hand.
    """

    parts: tuple[RobotPart, ...]
    notice: str
    spares: tuple[RobotPart, ...] = ()

    @classmethod
    def of(cls, robot: Baxter) -> Appearance:
        """The appearance of a robot: every mesh on its link, where the robot's description has it.

        A hand without gripper is bare; fingers and tips are those that are mounted, and a tool has
        its own shapes.
        """
        drawn = Baxter.load(RobotDescription.as_in_urdf().text).model
        whole, tree = cls.load(), robot.description.tree
        known = (*whole.parts, *whole.spares)
        shown = (_of_own_mesh(part, known, tree) for part in whole.parts)
        parts = [_on(robot.model, drawn, part) for part in shown]
        parts += [_tool(robot.model, joint) for joint in tree.joints if is_tool(joint.child)]
        return Appearance(tuple(part for part in parts if part is not None), whole.notice)

    @classmethod
    def load(cls) -> Appearance:
        """Read the asset, about half a megabyte; needs no mesh of the robot description."""
        try:
            with as_file(files("sim.view") / _ASSET) as path, np.load(path) as arrays:
                return _from_arrays(dict(arrays))
        except (OSError, KeyError, ValueError) as cause:
            raise SimulationError(
                f"cannot read {_ASSET}: {cause}; reinstall the package"
            ) from cause


def _stem(part: RobotPart) -> str:
    """The name of the mesh file of a part."""
    return part.mesh.name.split(".")[0]


def _link(part: RobotPart) -> str:
    """The link of a part, unless it is the one that a joint moves; then ""."""
    finger = part.joint.removesuffix("_joint")
    return _FIXED_LINKS.get(_stem(part), "").format(side=part.joint.split("_")[0], finger=finger)


def _of_own_mesh(part: RobotPart, parts: Sequence[RobotPart], tree: Urdf) -> RobotPart:
    """A part, with the mesh of the finger or tip that the robot has there."""
    link = _link(part) or part.joint.removesuffix("_joint")
    if not is_finger(link) or link not in tree.by_child:
        return part
    mesh = tree.by_child[link].shapes[0].mesh
    finger = "_l_finger" if "_l_finger" in link else "_r_finger"
    own = next(each for each in parts if _stem(each) == mesh and finger in each.joint)
    return part if _stem(part) == mesh else evolve(own, joint=part.joint)


def _tool(model: pin.Model, joint: UrdfJoint) -> RobotPart:
    """A shape of a tool, with flat faces."""
    vertices, triangles = polyhedron_around(joint.shapes[0])
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals *= 127.0 / np.linalg.norm(normals, axis=1, keepdims=True)
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    scale = float(np.abs(vertices - centre).max()) / np.iinfo(np.int16).max
    mesh = LinkMesh(
        name=joint.child,
        vertices=np.rint((corners.reshape(-1, 3) - centre) / scale).astype(np.int16),
        normals=np.repeat(np.rint(normals), 3, axis=0).astype(np.int8),
        faces=np.arange(3 * len(triangles), dtype=np.uint16).reshape(-1, 3),
        centre_m=centre,
        scale_m=scale,
    )
    frame = model.frames[model.getFrameId(joint.child, pin.FrameType.BODY)]
    return RobotPart(mesh, model.names[frame.parentJoint], frame.placement, TOOL_RGB)


def _on(model: pin.Model, stock: pin.Model, part: RobotPart) -> RobotPart | None:
    """A part of the stock robot where another robot has it; None where that lacks the link."""
    link = _link(part)
    if not model.existJointName(part.joint) or (link and not model.existFrame(link)):
        return None
    if not link:
        return part
    own, drawn = (tree.frames[tree.getFrameId(link)].placement for tree in (model, stock))
    T_joint_mesh = own * drawn.inverse() * part.T_joint_mesh
    return part if own == drawn else evolve(part, T_joint_mesh=T_joint_mesh)


def _from_arrays(arrays: Mapping[str, NDArray[Any]]) -> Appearance:
    meshes: dict[str, LinkMesh] = {}
    parts: dict[str, list[RobotPart]] = {"part": [], "spare": []}
    for kind, found in parts.items():
        columns = (arrays[f"{kind}_{name}"] for name in ("mesh", "joint", "xyz_quat_xyzw", "rgb"))
        for mesh, joint, pose, (r, g, b) in zip(*columns, strict=True):
            name = str(mesh)
            meshes[name] = meshes.get(name) or _mesh(name, arrays)
            rgb = float(r), float(g), float(b)
            found.append(RobotPart(meshes[name], str(joint), pin.XYZQUATToSE3(pose), rgb))
    return Appearance(tuple(parts["part"]), str(arrays["notice"]), tuple(parts["spare"]))


def _mesh(name: str, arrays: Mapping[str, NDArray[Any]]) -> LinkMesh:
    *centre, scale = arrays[f"{name}/centre_scale"]
    vertices, normals, faces = (arrays[f"{name}/{x}"] for x in ("vertices", "normals", "faces"))
    return LinkMesh(name, vertices, normals, faces, np.array(centre), float(scale))
