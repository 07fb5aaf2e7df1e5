"""Urdf: the tree of links and joints that a URDF describes, changed and written.

Every number is kept as it was written, so that `text` means the same to any other reader. Inertias,
colours, extensions of simulators, and the shapes of most links are left out; fingers and tools have
shapes. `baxter_kin.description.urdf_reading` reads such a tree from a text.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from itertools import chain, count
from typing import Any, TypeAlias
from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio as pin

from baxter_kin.display import quoted
from baxter_kin.errors import DescriptionError
from baxter_kin.fields import FrozenMapping, field, frozen
from baxter_kin.validation import float_array

Triple: TypeAlias = tuple[float, float, float]

MESH_FILE = (
    "package://example-robot-data/robots/baxter_description/meshes/electric_gripper/fingers/{}.DAE"
)
"""The path of the mesh of a finger or a tip, by its name."""

ZERO: Triple = (0.0, 0.0, 0.0)

X_AXIS: Triple = (1.0, 0.0, 0.0)
"""The axis of a joint that states none."""

UNIVERSE = "universe"
"""Pinocchio's name of the frame that does not move."""

LINK_ENDING = "_link"
"""The ending of most names of links in example-robot-data, which Rethink's names lack."""

MAX_KEPT_LENGTH = 85
"""Characters of a name that are kept where it gets an ending, so that it can be read again."""


class JointKind(str, Enum):
    """How a joint moves."""

    FIXED = "fixed"
    REVOLUTE = "revolute"
    PRISMATIC = "prismatic"


@dataclass(frozen=True, slots=True)
class JointRange:
    """Limits of a joint.

    Attributes:
        lower: lowest position, rad or m.
        upper: highest position.
        velocity: highest speed, rad/s or m/s.
        effort: highest torque or force, N m or N.
    """

    lower: float
    upper: float
    velocity: float
    effort: float


class ShapeKind(str, Enum):
    """The kind of a shape."""

    MESH = "mesh"
    BOX = "box"
    CYLINDER = "cylinder"
    SPHERE = "sphere"


SIZES: Mapping[ShapeKind, tuple[tuple[str, int], ...]] = {
    ShapeKind.MESH: (),
    ShapeKind.BOX: (("size", 3),),
    ShapeKind.CYLINDER: (("radius", 1), ("length", 1)),
    ShapeKind.SPHERE: (("radius", 1),),
}
"""The attributes that state the size of a shape, and the number of lengths in each."""


def _numbers(name: str) -> Callable[[Any], tuple[float, ...]]:
    """The converter of a field with a row of finite numbers."""

    def converted(given: Any) -> tuple[float, ...]:
        row = float_array(given, name, DescriptionError)
        if row.ndim != 1 or not np.isfinite(row).all():
            raise DescriptionError(f"{name} of a shape must be finite numbers, got {quoted(given)}")
        return tuple(row.tolist())

    return converted


@frozen(error=DescriptionError, eq=True)
class UrdfShape:
    """One shape of a link.

    Attributes:
        kind: box, cylinder, sphere or mesh.
        size_m: the edges of a box along x, y and z; radius and length of a cylinder along z; the
            radius of a sphere; empty for a mesh.
        mesh: the name of a mesh of Rethink's, without folder and ending; empty for all others.
        xyz: position on the link, m.
        rpy: orientation there: roll, pitch, yaw about the link's x, y, z in this order, rad.
    """

    kind: ShapeKind
    size_m: tuple[float, ...] = field(default=(), converter=_numbers("size_m"))
    mesh: str = ""
    xyz: Triple = field(default=ZERO, converter=_numbers("xyz"))
    rpy: Triple = field(default=ZERO, converter=_numbers("rpy"))

    def __attrs_post_init__(self) -> None:
        lengths = sum(number for _, number in SIZES[self.kind])
        if len(self.size_m) != lengths or min(self.size_m, default=1.0) <= 0.0:
            raise DescriptionError(
                f"a {self.kind.value} has lengths above zero, {lengths} in number, got "
                f"{quoted(self.size_m)}"
            )


@dataclass(frozen=True, slots=True)
class UrdfJoint:
    """A joint, which also stands for the link that is its child.

    Attributes:
        name: of the joint.
        kind: how it moves.
        parent: name of the link that carries it.
        child: name of the link that it moves.
        xyz: position of the child at position zero, seen from the parent, m.
        rpy: orientation there: roll, pitch, yaw about the parent's x, y, z in this order, rad.
        axis: of unit length, in the child's frame.
        range: its limits; None for a fixed joint.
        shapes: of its child, where they may differ between robots: fingers, their tips, tools. All
            other links look as on every Baxter, and state none.
    """

    name: str
    kind: JointKind
    parent: str
    child: str
    xyz: Triple = ZERO
    rpy: Triple = ZERO
    axis: Triple = X_AXIS
    range: JointRange | None = None
    shapes: tuple[UrdfShape, ...] = ()

    @property
    def is_movable(self) -> bool:
        """Whether the joint is not fixed."""
        return self.kind is not JointKind.FIXED

    def placed(self, T_parent_child: pin.SE3) -> UrdfJoint:
        """The same joint with its child at a pose seen from the parent."""
        xyz, rpy = origin_of(T_parent_child)
        return replace(self, xyz=xyz, rpy=rpy)


@dataclass(frozen=True)
class Urdf:
    """A tree of links; names occur once, and all joints are on the root, directly or over others.

    Attributes:
        root: the link without a parent.
        joints: in the order of the text.
    """

    root: str
    joints: tuple[UrdfJoint, ...]

    def __post_init__(self) -> None:
        check_once("joint", [joint.name for joint in self.joints])
        check_once("link", [self.root, *(joint.child for joint in self.joints)])
        lost = {joint.name for joint in self.joints}
        lost -= {joint.name for joint in below(self.root, self.joints)}
        if lost:
            raise DescriptionError(
                f"its joint {min(lost)} is not on {self.root!r}, over any joints"
            )

    @classmethod
    def ordered(cls, root: str, joints: Iterable[UrdfJoint]) -> Urdf:
        """The tree of some joints in an order that depends on their names alone."""
        return cls(root, below(root, sorted(joints, key=lambda joint: joint.name)))

    @cached_property
    def by_name(self) -> Mapping[str, UrdfJoint]:
        """The joints by their names."""
        return FrozenMapping({joint.name: joint for joint in self.joints})

    @cached_property
    def by_child(self) -> Mapping[str, UrdfJoint]:
        """The joints by the link that each moves."""
        return FrozenMapping({joint.child: joint for joint in self.joints})

    def chain(self, link: str) -> tuple[UrdfJoint, ...]:
        """The joints from the root to a link, in this order."""
        found: list[UrdfJoint] = []
        while link != self.root:
            found.append(self.by_child[link])
            link = found[-1].parent
        return tuple(reversed(found))

    def moving(self, link: str) -> UrdfJoint | None:
        """The last joint between the root and a link that is not fixed."""
        return next((joint for joint in reversed(self.chain(link)) if joint.is_movable), None)

    def pose(self, first: str, last: str) -> pin.SE3:
        """The pose of a link seen from another that carries it, all joints at position zero."""
        T = pin.SE3.Identity()
        for joint in self.chain(last)[len(self.chain(first)) :]:
            T = T * pin.SE3(pin.rpy.rpyToMatrix(np.array(joint.rpy)), np.array(joint.xyz))
        return T

    @cached_property
    def text(self) -> str:
        """The tree as a URDF: links, shapes of hands, joints, and every number in full."""
        root = f"  <link name={quoteattr(self.root)}/>"
        links = (root, *(line for joint in self.joints for line in _link_lines(joint)))
        joints = (line for joint in self.joints for line in _joint_lines(joint))
        return "\n".join(['<robot name="baxter">', *links, *joints, "</robot>", ""])


def below(root: str, joints: Iterable[UrdfJoint]) -> tuple[UrdfJoint, ...]:
    """The joints on a link, directly or over others, from the link outwards."""
    on: dict[str, list[UrdfJoint]] = {}
    for joint in joints:
        on.setdefault(joint.parent, []).append(joint)
    found: list[UrdfJoint] = []
    outermost = [root]
    while outermost:
        reached = on.pop(outermost.pop(), [])
        found += reached
        outermost += [joint.child for joint in reversed(reached)]
    return tuple(found)


def check_once(kind: str, names: Sequence[str]) -> None:
    """Refuse names that occur more than once."""
    twice = [name for name, number in Counter(names).items() if number > 1]
    if twice:
        raise DescriptionError(f"its {kind} {twice[0]} is there more than once")


def origin_of(T: pin.SE3) -> tuple[Triple, Triple]:
    """Position, and roll, pitch and yaw of a pose."""
    x, y, z = (T.translation + 0.0).tolist()
    roll, pitch, yaw = (pin.rpy.matrixToRpy(T.rotation) + 0.0).tolist()
    return (x, y, z), (roll, pitch, yaw)


def with_unique_names(tree: Urdf) -> Urdf:
    """The same tree, in which links and joints have different names.

    Pinocchio makes a frame of each, also of fixed joints, and cannot find frames of equal names. A
    link with the name of a movable joint gets the ending "_link"; a fixed joint, whose name has no
    meaning here, the ending "_joint".
    """
    taken = {UNIVERSE, *(joint.name for joint in tree.joints if joint.is_movable)}
    links = {}
    for name in (tree.root, *tree.by_child):
        others = taken | (tree.by_child.keys() - {name})
        links[name] = first_free((name, f"{name}{LINK_ENDING}"), others)
        taken.add(links[name])
    joints = []
    for joint in tree.joints:
        name = joint.name
        if name in links.values() or name == UNIVERSE:
            name = first_free((joint_name(name),), taken | tree.by_name.keys())
            taken.add(name)
        joints.append(
            replace(joint, name=name, parent=links[joint.parent], child=links[joint.child])
        )
    return Urdf.ordered(links[tree.root], joints)


def first_free(names: Sequence[str], taken: Collection[str]) -> str:
    """The first of some names that is not taken; if all are, the last one with a number."""
    numbered = (f"{names[-1]}_{number}" for number in count(2))
    return next(name for name in chain(names, numbered) if name not in taken)


def joint_name(name: str) -> str:
    """A name with an ending that marks it as that of a joint."""
    return f"{name[:MAX_KEPT_LENGTH]}_joint"


def _link_lines(joint: UrdfJoint) -> Iterator[str]:
    name = quoteattr(joint.child)
    if not joint.shapes:
        yield f"  <link name={name}/>"
        return
    yield f"  <link name={name}>"
    for shape in joint.shapes:
        yield "    <visual>"
        yield f'      <origin xyz="{words(shape.xyz)}" rpy="{words(shape.rpy)}"/>'
        yield f"      <geometry>{_geometry(shape)}</geometry>"
        yield "    </visual>"
    yield "  </link>"


def _geometry(shape: UrdfShape) -> str:
    if shape.kind is ShapeKind.MESH:
        return f"<mesh filename={quoteattr(MESH_FILE.format(shape.mesh))}/>"
    left, stated = list(shape.size_m), ""
    for key, number in SIZES[shape.kind]:
        stated += f' {key}="{words(left[:number])}"'
        left = left[number:]
    return f"<{shape.kind.value}{stated}/>"


def _joint_lines(joint: UrdfJoint) -> Iterator[str]:
    yield f'  <joint name={quoteattr(joint.name)} type="{joint.kind.value}">'
    yield f"    <parent link={quoteattr(joint.parent)}/>"
    yield f"    <child link={quoteattr(joint.child)}/>"
    yield f'    <origin xyz="{words(joint.xyz)}" rpy="{words(joint.rpy)}"/>'
    if joint.range is not None:
        each = joint.range
        yield f'    <axis xyz="{words(joint.axis)}"/>'
        yield (
            f'    <limit lower="{each.lower!r}" upper="{each.upper!r}" '
            f'velocity="{each.velocity!r}" effort="{each.effort!r}"/>'
        )
    yield "  </joint>"


def words(numbers: Iterable[float]) -> str:
    """Numbers in full, each as the shortest text that reads back as the same float."""
    return " ".join(map(repr, numbers))
