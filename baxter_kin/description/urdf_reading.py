"""Reads the tree of a robot from a URDF of any origin, cheaply and without opening other files.

Document type declarations are rejected, so no entity is ever expanded ("billion laughs") or
fetched. Size, nesting and the number of elements are bounded. The parser is Expat, which comes with
Python and resolves nothing by itself. Only the bare name of a mesh is read; no path is looked up.
Error messages start with "it" or "its", so that a caller can prefix the name of the file.
"""

from __future__ import annotations

import math
import re
from codecs import BOM_UTF8
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from xml.parsers import expat

from baxter_kin.description.urdf import (
    SIZES,
    X_AXIS,
    ZERO,
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
from baxter_kin.display import MAX_NAME, quoted, shortened
from baxter_kin.errors import DescriptionError

MAX_TEXT_BYTES = 4 * 2**20
"""The URDF of example-robot-data has 0.05 MB, most of it shapes."""

MAX_NESTING = 50
"""Levels of nested elements; a URDF with plugins of simulators has 8."""

MAX_ELEMENTS = 100_000
"""Elements of one file."""

MAX_NUMBER = 1e6
"""Largest magnitude, in SI units; that of the original is 50,000 N m, for unactuated joints."""

MAX_LINKS = 1_000
"""Links, and likewise joints, of one file."""

MAX_NAME_LENGTH = 100
"""Characters; the longest name in the original has 30."""

MIN_AXIS_LENGTH = 1e-3
"""Length below which an axis has no direction."""

UNIT_AXIS_TOLERANCE = 1e-9
"""Deviation of the length of an axis from 1 up to which it is kept as written."""

UNACTUATED_JOINTS = ("torso_t0", "head_nod")
"""Joints that some files declare movable although no Baxter can move them to an angle: the first
has no motor, and the screen nods only on a message. They need no range and no axis."""

LINKS_WITH_SHAPES = ("_finger", "_tool_")
"""Parts of the names of links whose shapes are read."""

MAX_SHAPES = 100
"""Shapes of one link."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_XACRO_SIGNS = ("${", "$(")
_RUN_XACRO = "run xacro first, and give what it prints"


@dataclass(slots=True)
class Element:
    """An XML element.

    Attributes:
        name: its tag, as written.
        attributes: text by name.
        children: the elements inside, in order.
        text: the text before the first child.
    """

    name: str
    attributes: dict[str, str]
    children: list[Element] = field(default_factory=list)
    text: str = ""

    def all(self, name: str) -> Iterator[Element]:
        """The children of that name."""
        return (child for child in self.children if child.name == name)

    def first(self, name: str) -> Element | None:
        """The first child of that name."""
        return next(self.all(name), None)


def read_xml(text: str | bytes) -> Element:
    """The root element of an XML text.

    Args:
        text: the whole text; bytes are decoded as their first line states, else as UTF-8.
    """
    if isinstance(text, str):
        content, encoding = text.encode("utf-8", "replace"), "utf-8"
    else:
        content, encoding = text, None
    if len(content) > MAX_TEXT_BYTES:
        raise DescriptionError(
            f"it is larger than {MAX_TEXT_BYTES >> 20} MiB, so it cannot be a robot description"
        )
    content = _from_declaration(content)
    reader = _Reader()
    parser = expat.ParserCreate(encoding)
    parser.StartElementHandler = reader.start
    parser.EndElementHandler = reader.end
    parser.buffer_text = True  # one event for a text of many lines
    parser.CharacterDataHandler = reader.read
    parser.StartDoctypeDeclHandler = reader.refuse
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, ValueError, LookupError) as cause:
        raise DescriptionError(f"it is not XML: {shortened(str(cause))}") from None
    return reader.root


def _from_declaration(content: bytes) -> bytes:
    """A text from its XML declaration on, without blanks and comments before it."""
    rest = content.removeprefix(BOM_UTF8).lstrip()
    while rest.startswith(b"<!--") and b"-->" in rest:
        rest = rest.partition(b"-->")[2].lstrip()
    return rest if rest.startswith(b"<?xml") else content


class _Reader:
    """Builds elements from Expat's events."""

    def __init__(self) -> None:
        self._open: list[Element] = [Element("", {})]
        self._count = 0

    @property
    def root(self) -> Element:
        return self._open[0].children[0]

    def start(self, name: str, attributes: dict[str, str]) -> None:
        self._count += 1
        if len(self._open) > MAX_NESTING or self._count > MAX_ELEMENTS:
            raise DescriptionError(
                f"its element {quoted(name, MAX_NAME)} is nested too deeply or one of too many; at "
                f"most {MAX_NESTING} levels and {MAX_ELEMENTS} elements are read"
            )
        element = Element(name, attributes)
        self._open[-1].children.append(element)
        self._open.append(element)

    def read(self, text: str) -> None:
        element = self._open[-1]
        if not element.children:
            element.text += text

    def end(self, _: str) -> None:
        self._open.pop()

    def refuse(self, name: str, *_: object) -> None:
        raise DescriptionError(
            f"it declares a document type, {quoted(name, MAX_NAME)}, and so may declare "
            "entities; a URDF needs none: remove that declaration"
        )


def read_urdf(text: str | bytes, root: str) -> Urdf:
    """Parse a URDF and return the tree below a link; links outside it are dropped.

    Args:
        text: the URDF.
        root: name of the link.

    Raises:
        DescriptionError: when the text is not XML, not a URDF, exceeds a limit, or lacks the link.
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
        number = sum(1 for _ in root.all(kind))
        if number > MAX_LINKS:
            raise DescriptionError(f"it has {number} {kind}s; at most {MAX_LINKS} are read")
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
    what, written = f"joint {name}", element.attributes.get("type", "")
    is_fixed = written == JointKind.FIXED.value
    has_motor = not is_fixed and name not in UNACTUATED_JOINTS
    kind = _kind(name, written) if is_fixed or has_motor else JointKind.REVOLUTE
    child, origin = _link(name, element, "child"), element.first("origin")
    return UrdfJoint(
        name,
        kind,
        _link(name, element, "parent"),
        child,
        _triple(what, origin, "xyz", ZERO),
        _triple(what, origin, "rpy", ZERO),
        _axis(name, element.first("axis")) if has_motor else X_AXIS,
        _range(name, element.first("limit")) if has_motor else None,
        shapes.get(child, ()),
    )


def _shapes(name: str, link: Element) -> tuple[UrdfShape, ...]:
    """The shapes of a link of a hand: the visual ones, or else those for collisions."""
    if not any(word in name for word in LINKS_WITH_SHAPES):
        return ()
    elements = list(link.all("visual")) or list(link.all("collision"))
    if len(elements) > MAX_SHAPES:
        raise DescriptionError(
            f"its link {name} has {len(elements)} shapes; at most {MAX_SHAPES} are read"
        )
    return tuple(_shape(name, element) for element in elements)


def _shape(name: str, element: Element) -> UrdfShape:
    geometry, origin = element.first("geometry"), element.first("origin")
    elements = [] if geometry is None else geometry.children
    if len(elements) != 1 or elements[0].name not in {kind.value for kind in ShapeKind}:
        given = ", ".join(each.name for each in elements) or "nothing"
        raise DescriptionError(
            f"its link {name} has a shape of {shortened(given, MAX_NAME)}; it must be one "
            "mesh, box, cylinder or sphere"
        )
    kind, what = ShapeKind(elements[0].name), f"link {name}"
    sizes = (_lengths(name, elements[0], *each) for each in SIZES[kind])
    file = elements[0].attributes.get("filename", "").replace("\\", "/")
    return UrdfShape(
        kind,
        tuple(length for size in sizes for length in size),
        file.rpartition("/")[2].partition(".")[0] if kind is ShapeKind.MESH else "",
        _triple(what, origin, "xyz", ZERO),
        _triple(what, origin, "rpy", ZERO),
    )


def _lengths(name: str, shape: Element, key: str, number: int) -> tuple[float, ...]:
    written = shape.attributes.get(key, "")
    lengths = tuple(_parsed(f"link {name}", key, word) for word in written.split())
    if len(lengths) != number or min(lengths) <= 0.0:
        raise DescriptionError(
            f"its link {name} has a <{shape.name}> with {key} {quoted(written, MAX_NAME)}; lengths "
            f"above zero, in m, are needed: {number}"
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
    if not abs(value) <= MAX_NUMBER:
        raise DescriptionError(
            f"its {what} has {key} {quoted(word, MAX_NAME)}; it must be a finite number "
            f"up to {MAX_NUMBER:g}"
        )
    return value + 0.0  # zero without a sign


def _axis(joint: str, element: Element | None) -> Triple:
    """The axis at unit length; unchanged where it has that length already, up to rounding."""
    axis = x, y, z = _triple(f"joint {joint}", element, "xyz", X_AXIS)
    length = math.sqrt(x * x + y * y + z * z)
    if length < MIN_AXIS_LENGTH:
        raise DescriptionError(
            f"its joint {joint} has the axis {x:g} {y:g} {z:g}, which points nowhere"
        )
    return (
        axis if abs(length - 1.0) <= UNIT_AXIS_TOLERANCE else (x / length, y / length, z / length)
    )
