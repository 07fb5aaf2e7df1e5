"""The robot from its URDF: frames, limits and meshes.

Read with `xml.etree`; forward kinematics in NumPy, over many samples at once. A link is what its
visuals show: the original meshes with every triangle, and visual boxes and cylinders (the hand's
camera, the sonar ring). The tips on the right are paddles, as on the left. A link without a visual
is its collision shape if that is its only description: `<side>_hand_link`. Left out are the 1 mm
spheres of links without a body, the red spheres around the head, and the cylinders that repeat the
upper arm and forearm under another name.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import distribution
from pathlib import Path

import numpy as np
import trimesh

from referee.solids import Array, Solid, box_mesh, cylinder_mesh, placed

PLACEHOLDER_M = 0.002
"""Visual spheres with a smaller radius stand for nothing."""

REPEATED = "_visual"
"""Suffix of links that repeat the next link, fixed to the link before it."""

NOT_THE_ROBOT = "collision_head"
"""Prefix of links that are marks around the head."""


@dataclass(frozen=True)
class Joint:
    """A joint, or a fixed connection; `lower`, `upper` and `speed` are those of a moving joint."""

    name: str
    kind: str
    parent: str
    child: str
    T_parent_joint: Array
    axis: Array
    lower: float
    upper: float
    speed: float

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
        else:
            x, y, z = self.axis
            K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            s, c = np.sin(values)[..., None, None], np.cos(values)[..., None, None]
            T[..., :3, :3] = np.eye(3) + s * K + (1.0 - c) * (K @ K)  # Rodrigues
        return T


@dataclass(frozen=True, eq=False)
class Robot:
    """Joints from the root outwards.

    Attributes:
        joints: parents before children.
        solids: of each link, placed in its frame.
        chains: of each link, the moving joints between the root and it.
    """

    joints: tuple[Joint, ...]
    solids: Mapping[str, tuple[Solid, ...]]
    chains: Mapping[str, frozenset[str]]

    def poses(self, q: Mapping[str, Array | float]) -> dict[str, Array]:
        """The pose of each link in base, shape (4, 4) or (n, 4, 4).

        Args:
            q: a value of shape () or (n,) for each moving joint; rad, m.
        """
        T = {self.joints[0].parent: np.eye(4)}
        for joint in self.joints:
            placed = T[joint.parent] @ joint.T_parent_joint
            T[joint.child] = placed if joint.is_fixed else placed @ joint.motion(q[joint.name])
        return T

    def joint(self, name: str) -> Joint:
        """The joint of that name."""
        return next(joint for joint in self.joints if joint.name == name)

    def below(self, joints: Iterable[str]) -> set[str]:
        """The links that move when any of some joints does."""
        return {link for link, chain in self.chains.items() if chain & set(joints)}

    def rigid_to(self, link: str) -> set[str]:
        """The links that never move relative to one, itself among them."""
        return {name for name, chain in self.chains.items() if chain == self.chains[link]}

    def joints_between(self, first: str, second: str) -> int:
        """How many moving joints are between two links."""
        return len(self.chains[first] ^ self.chains[second])


def arm_joints(limb: str) -> tuple[str, ...]:
    """The seven joints of an arm, from the shoulder on."""
    return tuple(f"{limb}_{name}" for name in ("s0", "s1", "e0", "e1", "w0", "w1", "w2"))


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
    chains = {joints[0].parent: frozenset[str]()}
    for joint in joints:
        own = () if joint.is_fixed else (joint.name,)
        chains[joint.child] = chains[joint.parent].union(own)
    solids = {name: tuple(_solids(name, link, share)) for name, link in links.items()}
    return Robot(joints, solids, chains)


def _joint(element: ET.Element) -> Joint:
    parent, child = (str(_child(element, end).get("link")) for end in ("parent", "child"))
    limit, axis = element.find("limit"), element.find("axis")
    bounds = [
        0.0 if limit is None else float(limit.get(key, "0"))
        for key in ("lower", "upper", "velocity")
    ]
    kind = str(element.get("type"))
    along = np.array([1.0, 0.0, 0.0])
    if axis is not None and kind != "fixed":
        along = _numbers(axis.get("xyz"))
    along /= np.linalg.norm(along)
    return Joint(str(element.get("name")), kind, parent, child, _origin(element), along, *bounds)


def _child(element: ET.Element, tag: str) -> ET.Element:
    found = element.find(tag)
    if found is None:
        raise ValueError(f"<{element.tag} name={element.get('name')!r}> has no <{tag}>")
    return found


def _numbers(text: str | None) -> Array:
    return np.array([float(word) for word in (text or "0 0 0").split()])


def _origin(element: ET.Element) -> Array:
    origin, T = element.find("origin"), np.eye(4)
    if origin is not None:
        T[:3, 3] = _numbers(origin.get("xyz"))
        (cr, cp, cy), (sr, sp, sy) = np.cos(rpy := _numbers(origin.get("rpy"))), np.sin(rpy)
        Rx = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
        Ry = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        Rz = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
        T[:3, :3] = Rz @ Ry @ Rx
    return T


def _ordered(joints: list[Joint]) -> tuple[Joint, ...]:
    """Parents before children."""
    placed = {joint.parent for joint in joints} - {joint.child for joint in joints}
    ordered: list[Joint] = []
    while len(ordered) < len(joints):
        found = [joint for joint in joints if joint.parent in placed and joint.child not in placed]
        if not found:
            raise ValueError("the joints of the URDF are not a tree")
        ordered += found
        placed |= {joint.child for joint in found}
    return tuple(ordered)


def _solids(name: str, link: ET.Element, share: Path) -> Iterator[Solid]:
    if name.startswith(NOT_THE_ROBOT) or name.endswith(REPEATED):
        return
    shown = link.findall("visual") or link.findall("collision")
    for number, element in enumerate(shown):
        mesh = _mesh(_child(element, "geometry")[0], share)
        if mesh is not None:
            label = name if len(shown) == 1 else f"{name} ({number})"
            vertices = placed(_origin(element), np.asarray(mesh.vertices))
            yield Solid.surface(label, vertices, np.asarray(mesh.faces))


def _mesh(shape: ET.Element, share: Path) -> trimesh.Trimesh | None:
    if shape.tag == "mesh":
        path = share / str(shape.get("filename")).removeprefix("package://")
        return trimesh.load(path, force="mesh", process=False)
    if shape.tag == "box":
        return box_mesh(_numbers(shape.get("size")))
    radius = float(shape.get("radius", "0"))
    if shape.tag == "cylinder":
        return cylinder_mesh(radius, float(shape.get("length", "0")))
    if radius < PLACEHOLDER_M:
        return None
    raise ValueError(f"a visual sphere with a radius of {radius} m, of no known link")
