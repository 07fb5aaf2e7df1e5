"""What the robot looks like: coloured meshes hung on joints, from the asset next to this file.

The meshes are Rethink Robotics' (BSD-3-Clause; the notice is inside the asset), thinned out by
`scripts/build_appearance.py`. They are kept as the graphics card takes them, small integers on a
uniform scale, so that nothing is converted between the file and the browser.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.resources import as_file, files
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from baxter_kin import Baxter
from baxter_kin.copying import FrozenMapping
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


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles of one surface.

    A vertex is at `centre_m + scale_m * vertices`, in the frame of the mesh.

    Attributes:
        name: unique in the asset, such as "W2.0".
        vertices: shape (n, 3), int16.
        normals: shape (n, 3), int8, of length 127; several vertices share a place at sharp edges.
        faces: shape (m, 3), uint16, counter-clockwise seen from outside.
        centre_m: shape (3,), metres.
        scale_m: metres for each unit of `vertices`.
    """

    name: str
    vertices: NDArray[np.int16]
    normals: NDArray[np.int8]
    faces: NDArray[np.uint16]
    centre_m: NDArray[np.float64]
    scale_m: float

    def __post_init__(self) -> None:
        """Check that faces and vertices belong together, and freeze the arrays."""
        if self.vertices.shape != self.normals.shape or self.faces.max() >= len(self.vertices):
            raise SimulationError(f"{_ASSET} is damaged: mesh {self.name}; reinstall the package")
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
        mesh: what to draw.
        joint: the joint it moves with; "universe" does not move.
        T_joint_mesh: where it sits, seen from the joint's moving frame.
        rgb: red, green and blue, 0 .. 1, as shown on the screen.
    """

    mesh: Mesh
    joint: str
    T_joint_mesh: pin.SE3
    rgb: tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Appearance:
    """All of the robot that can be seen.

    Attributes:
        meshes: by name, each one once, though arms and fingers share them.
        parts: what hangs where.
        notice: the licence of the meshes.
    """

    meshes: Mapping[str, Mesh]
    parts: tuple[RobotPart, ...]
    notice: str

    @classmethod
    def of(cls, robot: Baxter) -> Appearance:
        """That of a robot: every mesh on its link, wherever the robot's own description puts it.

        A hand without gripper is bare. Where a link is rigid to the one that a joint moves, the
        meshes go along when it sits elsewhere than on the stock robot.

        Raises:
            SimulationError: when the asset is missing or damaged.
        """
        stock = Baxter.load().model
        whole = cls.load()
        parts = (_on(robot.model, stock, part) for part in whole.parts)
        return replace(whole, parts=tuple(part for part in parts if part is not None))

    @classmethod
    def load(cls) -> Appearance:
        """Read the asset, about half a megabyte; needs no mesh of the robot description.

        Raises:
            SimulationError: when the asset is missing or damaged.
        """
        try:
            with as_file(files("sim") / _ASSET) as path, np.load(path) as arrays:
                return _from_arrays(dict(arrays))
        except (OSError, KeyError, ValueError) as cause:
            raise SimulationError(
                f"cannot read {_ASSET}: {cause}; reinstall the package"
            ) from cause


def _on(model: pin.Model, stock: pin.Model, part: RobotPart) -> RobotPart | None:
    """A part of the stock robot where a robot has it; None where it has no such link."""
    finger = part.joint.removesuffix("_joint")
    link = _FIXED_LINKS.get(part.mesh.name.split(".")[0], "")
    link = link.format(side=part.joint.split("_")[0], finger=finger)
    if not model.existJointName(part.joint) or (link and not model.existFrame(link)):
        return None
    if not link:
        return part
    own, drawn = (tree.frames[tree.getFrameId(link)].placement for tree in (model, stock))
    T_joint_mesh = own * drawn.inverse() * part.T_joint_mesh
    return part if own == drawn else replace(part, T_joint_mesh=T_joint_mesh)


def _from_arrays(arrays: Mapping[str, NDArray[Any]]) -> Appearance:
    names = [str(name) for name in arrays["part_mesh"]]
    meshes = {name: _mesh(name, arrays) for name in dict.fromkeys(names)}
    parts = tuple(
        RobotPart(meshes[name], str(joint), pin.XYZQUATToSE3(pose), (float(r), float(g), float(b)))
        for name, joint, pose, (r, g, b) in zip(
            names,
            arrays["part_joint"],
            arrays["part_xyz_quat_xyzw"],
            arrays["part_rgb"],
            strict=True,
        )
    )
    return Appearance(FrozenMapping(meshes), parts, str(arrays["notice"]))


def _mesh(name: str, arrays: Mapping[str, NDArray[Any]]) -> Mesh:
    *centre, scale = arrays[f"{name}/centre_scale"]
    return Mesh(
        name=name,
        vertices=arrays[f"{name}/vertices"],
        normals=arrays[f"{name}/normals"],
        faces=arrays[f"{name}/faces"],
        centre_m=np.array(centre),
        scale_m=float(scale),
    )
