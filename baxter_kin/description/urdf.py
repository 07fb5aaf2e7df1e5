"""Urdf: the tree of links and joints that a URDF describes, and the shapes of what is on its hands.

Every number is kept as it was written, so that `text` says the same to any other reader.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import TypeAlias
from xml.sax.saxutils import quoteattr

from baxter_kin.errors import DescriptionError, quoted
from baxter_kin.validation import check_fields
from baxter_kin.value_objects import FrozenMapping

Triple: TypeAlias = "tuple[float, float, float]"

MESH_FILE = (
    "package://example-robot-data/robots/baxter_description/meshes/electric_gripper/fingers/{}.DAE"
)
"""Where the meshes of fingers and tips are, by their names."""

X_AXIS: Triple = (1.0, 0.0, 0.0)
"""The axis of a joint that names none."""


class JointKind(str, Enum):
    """How a joint moves."""

    FIXED = "fixed"
    REVOLUTE = "revolute"
    PRISMATIC = "prismatic"


@dataclass(frozen=True, slots=True)
class JointRange:
    """What a joint may do.

    Attributes:
        lower: lowest position, rad or m.
        upper: highest position.
        velocity: greatest speed, rad/s or m/s.
        effort: greatest torque or force, N m or N.
    """

    lower: float
    upper: float
    velocity: float
    effort: float


class ShapeKind(str, Enum):
    """What a shape is; of each, the lengths in m that it has."""

    MESH = "mesh"
    BOX = "box"
    CYLINDER = "cylinder"
    SPHERE = "sphere"


LENGTHS: Mapping[ShapeKind, int] = FrozenMapping(
    {ShapeKind.MESH: 0, ShapeKind.BOX: 3, ShapeKind.CYLINDER: 2, ShapeKind.SPHERE: 1}
)
"""How many lengths a shape of a kind has."""


@dataclass(frozen=True, slots=True)
class UrdfShape:
    """One shape of a link.

    Attributes:
        kind: what it is.
        size_m: of a box its edges along x, y and z; of a cylinder along z its radius and length; of
            a sphere its radius; of a mesh nothing.
        mesh: the name of a mesh of Rethink's, without folder and ending; empty for all others.
        xyz: where it is on the link, m.
        rpy: how it is turned there: roll, pitch, yaw about the link's x, y, z in this order, rad.

    Raises:
        DescriptionError: when a value is of another class, a number is not finite, or the lengths
            are not as many as the kind has, or not above zero.
    """

    kind: ShapeKind
    size_m: tuple[float, ...] = ()
    mesh: str = ""
    xyz: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        check_fields(self, DescriptionError)
        for name in ("size_m", "xyz", "rpy"):
            numbers = tuple(map(float, getattr(self, name)))
            if not all(map(math.isfinite, numbers)):
                raise DescriptionError(f"{name} of a {self.kind.value} is not finite: {numbers}")
            object.__setattr__(self, name, numbers)
        lengths = LENGTHS[self.kind]
        if len(self.size_m) != lengths or min(self.size_m, default=1.0) <= 0.0:
            raise DescriptionError(
                f"a {self.kind.value} has lengths above zero, {lengths} in number, got "
                f"{quoted(self.size_m)}"
            )


@dataclass(frozen=True, slots=True)
class UrdfJoint:
    """A joint, and with it where its child is.

    Attributes:
        name: of the joint.
        kind: how it moves.
        parent: name of the link that it is on.
        child: name of the link that it moves.
        xyz: where the child is at position zero, seen from the parent, m.
        rpy: how it is turned there: roll, pitch, yaw about the parent's x, y, z in this order, rad.
        axis: of unit length, in the child's frame.
        range: what it may do; None for a fixed one.
        shapes: what its child looks like, where that is up to the owner of the robot: fingers,
            their tips, tools. All other links look as on every Baxter, and state none.
    """

    name: str
    kind: JointKind
    parent: str
    child: str
    xyz: Triple = (0.0, 0.0, 0.0)
    rpy: Triple = (0.0, 0.0, 0.0)
    axis: Triple = X_AXIS
    range: JointRange | None = None
    shapes: tuple[UrdfShape, ...] = ()

    @property
    def is_movable(self) -> bool:
        """Whether it moves at all."""
        return self.kind is not JointKind.FIXED


@dataclass(frozen=True)
class Urdf:
    """A tree of links.

    Attributes:
        root: the link that is on no other.
        joints: in order of the text; each stands for the link that is its child.

    Raises:
        DescriptionError: when two joints or two links have one name, or they are no tree.
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

    @cached_property
    def by_name(self) -> Mapping[str, UrdfJoint]:
        """The joints by their names."""
        return FrozenMapping({joint.name: joint for joint in self.joints})

    @cached_property
    def by_child(self) -> Mapping[str, UrdfJoint]:
        """The joints by the link that each moves."""
        return FrozenMapping({joint.child: joint for joint in self.joints})

    def chain(self, link: str) -> tuple[UrdfJoint, ...]:
        """The joints between the root and a link, the one that the link is on last."""
        found: list[UrdfJoint] = []
        while link != self.root:
            found.append(self.by_child[link])
            link = found[-1].parent
        return tuple(reversed(found))

    @cached_property
    def text(self) -> str:
        """The tree as a URDF: links, shapes of hands, joints, and every number in full."""
        root = f"  <link name={quoteattr(self.root)}/>"
        links = (root, *(line for joint in self.joints for line in _link_lines(joint)))
        joints = (line for joint in self.joints for line in _lines(joint))
        return "\n".join(['<robot name="baxter">', *links, *joints, "</robot>", ""])


def below(root: str, joints: Iterable[UrdfJoint]) -> tuple[UrdfJoint, ...]:
    """The joints that are on a link, over any others, from the root outwards."""
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
    """Refuse a name that is there twice.

    Raises:
        DescriptionError: when one is.
    """
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise DescriptionError(f"its {kind} {twice[0]} is there more than once")


def _link_lines(joint: UrdfJoint) -> Iterator[str]:
    name = quoteattr(joint.child)
    if not joint.shapes:
        yield f"  <link name={name}/>"
        return
    yield f"  <link name={name}>"
    for shape in joint.shapes:
        yield "    <visual>"
        yield f'      <origin xyz="{_words(shape.xyz)}" rpy="{_words(shape.rpy)}"/>'
        yield f"      <geometry>{_geometry(shape)}</geometry>"
        yield "    </visual>"
    yield "  </link>"


def _geometry(shape: UrdfShape) -> str:
    size = tuple(map(repr, shape.size_m))
    if shape.kind is ShapeKind.MESH:
        return f"<mesh filename={quoteattr(MESH_FILE.format(shape.mesh))}/>"
    if shape.kind is ShapeKind.BOX:
        return f'<box size="{" ".join(size)}"/>'
    if shape.kind is ShapeKind.CYLINDER:
        return f'<cylinder radius="{size[0]}" length="{size[1]}"/>'
    return f'<sphere radius="{size[0]}"/>'


def _lines(joint: UrdfJoint) -> Iterator[str]:
    yield f'  <joint name={quoteattr(joint.name)} type="{joint.kind.value}">'
    yield f"    <parent link={quoteattr(joint.parent)}/>"
    yield f"    <child link={quoteattr(joint.child)}/>"
    yield f'    <origin xyz="{_words(joint.xyz)}" rpy="{_words(joint.rpy)}"/>'
    if joint.range is not None:
        each = joint.range
        yield f'    <axis xyz="{_words(joint.axis)}"/>'
        yield (
            f'    <limit lower="{each.lower!r}" upper="{each.upper!r}" '
            f'velocity="{each.velocity!r}" effort="{each.effort!r}"/>'
        )
    yield "  </joint>"


def _words(numbers: Iterable[float]) -> str:
    return " ".join(map(repr, numbers))
