"""Reads a URDF as a tree of links and joints.

Inertias, colours, what simulators add, and the shapes of most links are passed over. Of fingers
and tools the shapes are read; of the file of a mesh, its bare name. No path is looked up, still
less opened. What makes no sense is refused in one sentence that begins with "it" or "its".
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from baxter_kin.description.urdf import (
    X_AXIS,
    JointKind,
    JointRange,
    ShapeKind,
    Triple,
    Urdf,
    UrdfJoint,
    UrdfShape,
    below,
    check_once,
)
from baxter_kin.description.xml_text import Element, read_xml
from baxter_kin.errors import LONGEST_NAME, DescriptionError, quoted, shortened

LARGEST_NUMBER = 1e6
"""In SI units. The greatest of the original is 50,000 N m, for joints that have no motor."""

MOST_LINKS = 1_000

LONGEST_URDF_NAME = 100
"""Characters; the longest name in the original has 30."""

LEAST_AXIS = 1e-3
"""The length of an axis below which nothing is said of where it points."""

ROUNDING = 1e-9
"""How far from 1 the length of an axis may be where it counts as written in full."""

WITHOUT_MOTOR = ("torso_t0", "head_nod")
"""Joints that some files let move and no Baxter can: the first has no motor, and the screen nods by
a message of its own, not to an angle. They need no range and no axis."""

SHAPED = ("_finger", "_tool_")
"""In names of links whose shapes are read."""

MOST_SHAPES = 100
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
    """What a text describes from one link on; links that are not on that one are left out.

    Raises:
        DescriptionError: when it is no URDF, lacks that link, or says something that makes no
            sense.
    """
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
                name = quoted(link, LONGEST_NAME)
                raise DescriptionError(
                    f"its joint {joint.name} names a link {name}, which it lacks"
                )
    return Urdf(root, below(root, joints))


def _checked_robot(root: Element) -> Element:
    if root.name != "robot":
        raise DescriptionError(
            f"its root is <{shortened(root.name, LONGEST_NAME)}>, that of a URDF is <robot>"
        )
    for child in root.children:
        if child.name.startswith("xacro:"):
            raise DescriptionError(
                f"it holds <{shortened(child.name, LONGEST_NAME)}>, so it is xacro: {_RUN_XACRO}"
            )
    for kind in ("link", "joint"):
        count = sum(1 for _ in root.all(kind))
        if count > MOST_LINKS:
            raise DescriptionError(f"it has {count} {kind}s; at most {MOST_LINKS} are read")
    return root


def _name(element: Element) -> str:
    name = element.attributes.get("name", "")
    if any(sign in name for sign in _XACRO_SIGNS):
        raise DescriptionError(
            f"it has a {element.name} {quoted(name, LONGEST_NAME)}, so it is xacro: {_RUN_XACRO}"
        )
    if not name.isprintable() or not name.strip() or len(name) > LONGEST_URDF_NAME:
        raise DescriptionError(
            f"it has a {element.name} of the name {quoted(name, LONGEST_NAME)}; names have 1 to "
            f"{LONGEST_URDF_NAME} printable characters"
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
    if len(elements) > MOST_SHAPES:
        raise DescriptionError(
            f"its link {name} has {len(elements)} shapes; at most {MOST_SHAPES} are read"
        )
    return tuple(_shape(name, element) for element in elements)


def _shape(name: str, element: Element) -> UrdfShape:
    geometry, origin = element.first("geometry"), element.first("origin")
    kinds = [] if geometry is None else geometry.children
    if len(kinds) != 1 or kinds[0].name not in _LENGTHS:
        given = ", ".join(kind.name for kind in kinds) or "nothing"
        raise DescriptionError(
            f"its link {name} has a shape of {shortened(given, LONGEST_NAME)}; it must be one "
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
            f"{quoted(shape.attributes.get(key, ''), LONGEST_NAME)}; lengths above zero, in m, are "
            f"needed: {count}"
        )
    return lengths


def _kind(name: str, written: str) -> JointKind:
    if written not in {kind.value for kind in JointKind}:
        raise DescriptionError(
            f"its joint {name} is of type {quoted(written, LONGEST_NAME)}; the joints of Baxter "
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
            f"its {what} has {key} {quoted(element.attributes[key], LONGEST_NAME)}; three "
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
            f"its {what} has {key} {quoted(word, LONGEST_NAME)}, so it is xacro: {_RUN_XACRO}"
        )
    value = float(word) if _NUMBER.fullmatch(word) else math.nan
    if not abs(value) <= LARGEST_NUMBER:
        raise DescriptionError(
            f"its {what} has {key} {quoted(word, LONGEST_NAME)}; it must be a finite number "
            f"up to {LARGEST_NUMBER:g}"
        )
    return value + 0.0  # so that zero has no sign


def _unit(joint: str, axis: Triple) -> Triple:
    """The axis at unit length; as it is written where it is so long already, but for rounding."""
    x, y, z = axis
    length = math.sqrt(x * x + y * y + z * z)
    if length < LEAST_AXIS:
        raise DescriptionError(
            f"its joint {joint} has the axis {x:g} {y:g} {z:g}, which points nowhere"
        )
    return axis if abs(length - 1.0) <= ROUNDING else (x / length, y / length, z / length)
