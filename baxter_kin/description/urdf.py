"""Urdf: the tree of links and joints that a URDF describes, read, changed and written.

Every number is kept as it was written, so that `text` means the same to any other reader. Inertias,
colours, extensions of simulators, and the shapes of most links are left out. Of fingers and tools
the shapes are read; of the file of a mesh, its bare name. No path is looked up or opened. Invalid
text is refused in one sentence that begins with "it" or "its".
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import TypeAlias
from xml.sax.saxutils import quoteattr

from baxter_kin.description.xml_text import Element, read_xml
from baxter_kin.display import MAX_NAME, quoted, shortened
from baxter_kin.errors import DescriptionError
from baxter_kin.fields import FrozenMapping
from baxter_kin.validation import check_fields

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
    """Refuse a name that is there twice."""
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


LARGEST_NUMBER = 1e6
"""In SI units. The greatest of the original is 50,000 N m, for joints that have no motor."""

MAX_LINKS = 1_000

MAX_NAME_LENGTH = 100
"""Characters; the longest name in the original has 30."""

MIN_AXIS_LENGTH = 1e-3
"""The length of an axis below which nothing is said of where it points."""

ROUNDING = 1e-9
"""How far from 1 the length of an axis may be where it counts as written in full."""

WITHOUT_MOTOR = ("torso_t0", "head_nod")
"""Joints that some files let move and no Baxter can: the first has no motor, and the screen nods by
a message of its own, not to an angle. They need no range and no axis."""

SHAPED = ("_finger", "_tool_")
"""In names of links whose shapes are read."""

MAX_SHAPES = 100
"""Of a link."""

_LENGTHS = {
    "mesh": (),
    "box": (("size", 3),),
    "cylinder": (("radius", 1), ("length", 1)),
    "sphere": (("radius", 1),),
}
"""The attributes of a shape, and how many lengths each states."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_XACRO_SIGNS = ("${", "$(")
_RUN_XACRO = "run xacro first, and give what it prints"


def read_urdf(text: str | bytes, root: str) -> Urdf:
    """What a text describes from one link on; links that are not on that one are left out."""
    robot = _checked_robot(read_xml(text))
    names = [_name(link) for link in robot.all("link")]
    shapes = {
        name: _shapes(name, link) for name, link in zip(names, robot.all("link"), strict=True)
    }
    joints = [_joint(joint, shapes) for joint in robot.all("joint")]
    check_once("link", names)
    check_once("joint", [joint.name for joint in joints])
    links = frozenset(names)
    if root not in links:
        raise DescriptionError(f"it lacks the link {root!r}, from which poses are seen")
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in links:
                name = quoted(link, MAX_NAME)
                raise DescriptionError(
                    f"its joint {joint.name} names a link {name}, which it lacks"
                )
    return Urdf(root, below(root, joints))


def _checked_robot(root: Element) -> Element:
    if root.name != "robot":
        raise DescriptionError(
            f"its root is <{shortened(root.name, MAX_NAME)}>, that of a URDF is <robot>"
        )
    for child in root.children:
        if child.name.startswith("xacro:"):
            raise DescriptionError(
                f"it holds <{shortened(child.name, MAX_NAME)}>, so it is xacro: {_RUN_XACRO}"
            )
    for kind in ("link", "joint"):
        count = sum(1 for _ in root.all(kind))
        if count > MAX_LINKS:
            raise DescriptionError(f"it has {count} {kind}s; at most {MAX_LINKS} are read")
    return root


def _name(element: Element) -> str:
    name = element.attributes.get("name", "")
    if any(sign in name for sign in _XACRO_SIGNS):
        raise DescriptionError(
            f"it has a {element.name} {quoted(name, MAX_NAME)}, so it is xacro: {_RUN_XACRO}"
        )
    if not name.isprintable() or not name.strip() or len(name) > MAX_NAME_LENGTH:
        raise DescriptionError(
            f"it has a {element.name} of the name {quoted(name, MAX_NAME)}; names have 1 to "
            f"{MAX_NAME_LENGTH} printable characters"
        )
    return name


def _joint(element: Element, shapes: Mapping[str, tuple[UrdfShape, ...]]) -> UrdfJoint:
    name = _name(element)
    origin, axis = element.first("origin"), element.first("axis")
    if name in WITHOUT_MOTOR:
        is_fixed = element.attributes.get("type") == JointKind.FIXED.value
        kind = JointKind.FIXED if is_fixed else JointKind.REVOLUTE
    else:
        kind = _kind(name, element.attributes.get("type", ""))
    moves = kind is not JointKind.FIXED and name not in WITHOUT_MOTOR
    child = _link(name, element, "child")
    return UrdfJoint(
        name,
        kind,
        _link(name, element, "parent"),
        child,
        _triple(f"joint {name}", origin, "xyz", (0.0, 0.0, 0.0)),
        _triple(f"joint {name}", origin, "rpy", (0.0, 0.0, 0.0)),
        _unit(name, _triple(f"joint {name}", axis, "xyz", X_AXIS)) if moves else X_AXIS,
        _range(name, element.first("limit")) if moves else None,
        shapes.get(child, ()),
    )


def _shapes(name: str, link: Element) -> tuple[UrdfShape, ...]:
    """What a link of a hand is: what it shows, or else what is said to collide."""
    if not any(word in name for word in SHAPED):
        return ()
    elements = list(link.all("visual")) or list(link.all("collision"))
    if len(elements) > MAX_SHAPES:
        raise DescriptionError(
            f"its link {name} has {len(elements)} shapes; at most {MAX_SHAPES} are read"
        )
    return tuple(_shape(name, element) for element in elements)


def _shape(name: str, element: Element) -> UrdfShape:
    geometry, origin = element.first("geometry"), element.first("origin")
    kinds = [] if geometry is None else geometry.children
    if len(kinds) != 1 or kinds[0].name not in _LENGTHS:
        given = ", ".join(kind.name for kind in kinds) or "nothing"
        raise DescriptionError(
            f"its link {name} has a shape of {shortened(given, MAX_NAME)}; it must be one "
            "mesh, box, cylinder or sphere"
        )
    (kind,) = kinds
    sizes = (_lengths(name, kind, *each) for each in _LENGTHS[kind.name])
    file = kind.attributes.get("filename", "").replace("\\", "/")
    return UrdfShape(
        ShapeKind(kind.name),
        tuple(length for size in sizes for length in size),
        file.rpartition("/")[2].partition(".")[0] if kind.name == "mesh" else "",
        _triple(f"link {name}", origin, "xyz", (0.0, 0.0, 0.0)),
        _triple(f"link {name}", origin, "rpy", (0.0, 0.0, 0.0)),
    )


def _lengths(name: str, shape: Element, key: str, count: int) -> tuple[float, ...]:
    words = shape.attributes.get(key, "").split()
    lengths = tuple(_parsed(f"link {name}", key, word) for word in words)
    if len(lengths) != count or min(lengths) <= 0.0:
        raise DescriptionError(
            f"its link {name} has a <{shape.name}> with {key} "
            f"{quoted(shape.attributes.get(key, ''), MAX_NAME)}; lengths above zero, in m, are "
            f"needed: {count}"
        )
    return lengths


def _kind(name: str, written: str) -> JointKind:
    if written not in {kind.value for kind in JointKind}:
        raise DescriptionError(
            f"its joint {name} is of type {quoted(written, MAX_NAME)}; the joints of Baxter "
            "are fixed, revolute or prismatic"
        )
    return JointKind(written)


def _link(joint: str, element: Element, role: str) -> str:
    found = [link.attributes.get("link", "") for link in element.all(role)]
    if len(found) != 1:
        raise DescriptionError(
            f"its joint {joint} has {len(found)} links as {role}; it must have one"
        )
    return found[0]


def _range(joint: str, limit: Element | None) -> JointRange:
    if limit is None:
        raise DescriptionError(f"its joint {joint} has no <limit>")
    found = JointRange(
        _number(f"joint {joint}", limit, "lower", "0"),
        _number(f"joint {joint}", limit, "upper", "0"),
        _number(f"joint {joint}", limit, "velocity"),
        _number(f"joint {joint}", limit, "effort", "0"),
    )
    if found.lower >= found.upper:
        raise DescriptionError(
            f"its joint {joint} has an empty range: lower {found.lower:g} is not below upper "
            f"{found.upper:g}"
        )
    if found.velocity <= 0.0 or found.effort < 0.0:
        raise DescriptionError(
            f"its joint {joint} has velocity {found.velocity:g} and effort {found.effort:g}; the "
            "first must be above zero, the second not below"
        )
    return found


def _triple(what: str, element: Element | None, key: str, otherwise: Triple) -> Triple:
    if element is None or key not in element.attributes:
        return otherwise
    words = element.attributes[key].split()
    if len(words) != 3:
        raise DescriptionError(
            f"its {what} has {key} {quoted(element.attributes[key], MAX_NAME)}; three "
            "numbers are needed"
        )
    x, y, z = (_parsed(what, key, word) for word in words)
    return x, y, z


def _number(what: str, element: Element, key: str, otherwise: str | None = None) -> float:
    written = element.attributes.get(key, otherwise)
    if written is None:
        raise DescriptionError(f"its {what} has a <{element.name}> without {key}")
    return _parsed(what, key, written.strip())


def _parsed(what: str, key: str, word: str) -> float:
    if any(sign in word for sign in _XACRO_SIGNS):
        raise DescriptionError(
            f"its {what} has {key} {quoted(word, MAX_NAME)}, so it is xacro: {_RUN_XACRO}"
        )
    value = float(word) if _NUMBER.fullmatch(word) else math.nan
    if not abs(value) <= LARGEST_NUMBER:
        raise DescriptionError(
            f"its {what} has {key} {quoted(word, MAX_NAME)}; it must be a finite number "
            f"up to {LARGEST_NUMBER:g}"
        )
    return value + 0.0  # so that zero has no sign


def _unit(joint: str, axis: Triple) -> Triple:
    """The axis at unit length; as it is written where it is so long already, but for rounding."""
    x, y, z = axis
    length = math.sqrt(x * x + y * y + z * z)
    if length < MIN_AXIS_LENGTH:
        raise DescriptionError(
            f"its joint {joint} has the axis {x:g} {y:g} {z:g}, which points nowhere"
        )
    return axis if abs(length - 1.0) <= ROUNDING else (x / length, y / length, z / length)
