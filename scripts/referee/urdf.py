"""The robot from its URDF: frames, limits and what is to be seen of it.

Read with `xml.etree`, forward kinematics in NumPy over many samples at once. A link is what its
visuals show: the original meshes with every triangle, and its visual boxes and cylinders (the
hand's camera, the sonar ring). The tips on the right are paddles, as on the left. A link without a
visual is its collision shape if that is its only description: `<side>_hand_link`. The 1 mm spheres
that stand for nothing, the red spheres around the head and the cylinders that repeat the upper arm
and forearm under another name are left out.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import distribution
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from referee.solids import Solid, box_mesh, cylinder_mesh

Array = NDArray[np.float64]

PLACEHOLDER_M = 0.002
"""Spheres smaller than this stand for nothing."""

REPEATED = "_visual"
"""Links whose name ends so repeat the next link, fixed to the link before it."""

NOT_THE_ROBOT = "collision_head"
"""Links whose name begins so are marks around the head."""


@dataclass(frozen=True)
class Joint:
    """A joint, or a fixed connection; `lower` .. `upper` and `speed` are of a joint that moves."""

    name: str
    kind: str
    parent: str
    child: str
    T_parent_joint: Array
    axis: Array
    lower: float = 0.0
    upper: float = 0.0
    speed: float = 0.0

    @property
    def is_fixed(self) -> bool:
        """Whether it never moves."""
        return self.kind == "fixed"

    def motion(self, q: Array | float) -> Array:
        """Poses of the child seen from the joint, shape (..., 4, 4)."""
        values = np.asarray(q, dtype=float)
        T = np.zeros((*values.shape, 4, 4))
        T[...] = np.eye(4)
        if self.kind == "prismatic":
            T[..., :3, 3] = values[..., None] * self.axis
        elif not self.is_fixed:
            x, y, z = self.axis
            K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            s, c = np.sin(values)[..., None, None], np.cos(values)[..., None, None]
            T[..., :3, :3] = np.eye(3) + s * K + (1.0 - c) * (K @ K)  # Rodrigues
        return T


@dataclass(frozen=True, eq=False)
class Robot:
    """Joints from the root outwards, and one or more solids a link, placed in its frame."""

    root: str
    joints: tuple[Joint, ...]
    solids: Mapping[str, tuple[Solid, ...]]
    group: Mapping[str, str] = field(repr=False)

    def poses(self, q: Mapping[str, Array | float]) -> dict[str, Array]:
        """Every link seen from base, shape (4, 4) or (n, 4, 4), for joint values by name.

        Args:
            q: a value of shape () or (n,) for each joint that moves; rad, m.
        """
        T = {self.root: np.eye(4)}
        for joint in self.joints:
            placed = T[joint.parent] @ joint.T_parent_joint
            T[joint.child] = placed if joint.is_fixed else placed @ joint.motion(q[joint.name])
        return T

    def joint(self, name: str) -> Joint:
        """The joint of that name."""
        return next(joint for joint in self.joints if joint.name == name)

    def below(self, joint_names: set[str]) -> set[str]:
        """The links that move when any of some joints does."""
        moving: set[str] = set()
        for joint in self.joints:
            if joint.parent in moving or joint.name in joint_names:
                moving.add(joint.child)
        return moving

    @cache  # noqa: B019 - there is one robot
    def are_joined(self, first: str, second: str) -> bool:
        """Whether two links are rigid to each other, or only one joint is between them."""
        return self.group[second] in self._around(self.group[first])

    @cache  # noqa: B019 - there is one robot
    def are_neighbours(self, first: str, second: str) -> bool:
        """The same with two joints between them."""
        return any(self.are_joined(link, second) for link in self._around(self.group[first]))

    def _around(self, group: str) -> set[str]:
        """The first links of what is joined to a rigid group, itself among them."""
        ends = [{self.group[joint.parent], self.group[joint.child]} for joint in self.joints]
        return {group}.union(*(pair for pair in ends if group in pair))


@cache
def load_robot() -> Robot:
    """Baxter, as the installed example-robot-data describes it."""
    files = distribution("example-robot-data").files or []
    urdf = next(file for file in files if file.as_posix().endswith("/urdf/baxter.urdf"))
    path = Path(str(urdf.locate()))
    root = ET.parse(path).getroot()
    joints = _ordered([_joint(element) for element in root.findall("joint")])
    share = next(parent for parent in path.parents if parent.name == "example-robot-data").parent
    links = {str(link.get("name")): link for link in root.findall("link")}
    for finger in "lr":  # the toolkit mounts the left hand's tips on the right one, too
        links[f"r_gripper_{finger}_finger_tip"] = links[f"l_gripper_{finger}_finger_tip"]
    solids = {name: tuple(_solids(link, share)) for name, link in links.items()}
    return Robot(joints[0].parent, joints, solids, _groups(joints))


def _joint(element: ET.Element) -> Joint:
    names = [str(_child(element, end).get("link")) for end in ("parent", "child")]
    limit, axis = element.find("limit"), element.find("axis")
    bounds = [0.0] * 3
    if limit is not None:
        bounds = [float(limit.get(key, "0")) for key in ("lower", "upper", "velocity")]
    along = np.array([1.0, 0.0, 0.0]) if axis is None else _numbers(axis.get("xyz"))
    kind = str(element.get("type"))
    if kind == "fixed":
        along = np.array([1.0, 0.0, 0.0])
    along = along / np.linalg.norm(along)
    return Joint(str(element.get("name")), kind, *names, _origin(element), along, *bounds)


def _child(element: ET.Element, tag: str) -> ET.Element:
    found = element.find(tag)
    if found is None:
        raise ValueError(f"<{element.tag} name={element.get('name')!r}> has no <{tag}>")
    return found


def _numbers(text: str | None) -> Array:
    return np.array([float(word) for word in (text or "0 0 0").split()])


def _origin(element: ET.Element) -> Array:
    origin = element.find("origin")
    T = np.eye(4)
    if origin is None:
        return T
    (r, p, y), T[:3, 3] = _numbers(origin.get("rpy")), _numbers(origin.get("xyz"))
    Rx = np.array([[1, 0, 0], [0, np.cos(r), -np.sin(r)], [0, np.sin(r), np.cos(r)]])
    Ry = np.array([[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]])
    Rz = np.array([[np.cos(y), -np.sin(y), 0], [np.sin(y), np.cos(y), 0], [0, 0, 1]])
    T[:3, :3] = Rz @ Ry @ Rx
    return T


def _ordered(joints: list[Joint]) -> tuple[Joint, ...]:
    """Parents before children."""
    children = {joint.child for joint in joints}
    known = {joint.parent for joint in joints} - children
    ordered: list[Joint] = []
    while len(ordered) < len(joints):
        found = [joint for joint in joints if joint.parent in known and joint.child not in known]
        if not found:
            raise ValueError("the joints of the URDF are no tree")
        ordered += found
        known |= {joint.child for joint in found}
    return tuple(ordered)


def _groups(joints: tuple[Joint, ...]) -> dict[str, str]:
    """Link -> the first link of those that it is rigid to."""
    group = {joints[0].parent: joints[0].parent}
    for joint in joints:
        group[joint.child] = group[joint.parent] if joint.is_fixed else joint.child
    return group


def _solids(link: ET.Element, share: Path) -> Iterator[Solid]:
    name = str(link.get("name"))
    if name.startswith(NOT_THE_ROBOT) or name.endswith(REPEATED):
        return
    shown = link.findall("visual") or link.findall("collision")
    for number, element in enumerate(shown):
        shape = _child(element, "geometry")[0]
        mesh = _mesh(shape, share)
        if mesh is not None:
            T = _origin(element)
            vertices = np.asarray(mesh.vertices) @ T[:3, :3].T + T[:3, 3]
            label = name if len(shown) == 1 else f"{name} ({number})"
            yield Solid.surface(label, vertices, np.asarray(mesh.faces))


def _mesh(shape: ET.Element, share: Path) -> trimesh.Trimesh | None:
    if shape.tag == "mesh":
        path = share / str(shape.get("filename")).removeprefix("package://")
        return trimesh.load(path, force="mesh", process=False)
    if shape.tag == "box":
        return box_mesh(_numbers(shape.get("size")))
    if shape.tag == "cylinder":
        return cylinder_mesh(float(shape.get("radius", "0")), float(shape.get("length", "0")))
    if float(shape.get("radius", "0")) < PLACEHOLDER_M:
        return None
    raise ValueError(f"a visual sphere of {shape.get('radius')} m: of no known link")
