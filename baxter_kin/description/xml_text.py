"""XML from anywhere, read so that it costs little and opens nothing.

A document type declaration is refused, since that is where entities are declared: so nothing is
expanded ("billion laughs") and nothing is fetched. Size, nesting and the number of elements are
bounded. The parser is Expat, as it comes with Python; it resolves nothing by itself.
"""

from __future__ import annotations

from codecs import BOM_UTF8
from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

from baxter_kin.display import MAX_NAME, quoted, shortened
from baxter_kin.errors import DescriptionError

MAX_TEXT_BYTES = 4 * 2**20
"""The URDF of example-robot-data has 0.05 MB, of which most are shapes."""

MAX_NESTING = 50
"""Elements inside of each other; a URDF with plugins of simulators has 8."""

MAX_ELEMENTS = 100_000


@dataclass(slots=True)
class Element:
    """An element of a text.

    Attributes:
        name: its name, as it is written.
        attributes: text by name.
        children: the elements in it, in order.
        text: what is written in it before its first child.
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
    """The root of a text, with all that is in it.

    Args:
        text: the whole text; bytes are decoded as their first line says, else as UTF-8.
    """
    content, encoding = (
        (text.encode("utf-8", "replace"), "utf-8") if isinstance(text, str) else (text, None)
    )
    if len(content) > MAX_TEXT_BYTES:
        raise DescriptionError(
            f"it is larger than {MAX_TEXT_BYTES >> 20} MB, so it is no description of a robot"
        )
    content = _from_declaration(content)
    reader = _Reader()
    parser = expat.ParserCreate(encoding)
    parser.StartElementHandler = reader.start
    parser.EndElementHandler = reader.end
    parser.buffer_text = True  # few pieces of text, however many lines it has
    parser.CharacterDataHandler = reader.read
    parser.StartDoctypeDeclHandler = reader.refuse
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, ValueError, LookupError) as cause:
        raise DescriptionError(f"it is no XML: {shortened(str(cause))}") from None
    return reader.root


def _from_declaration(content: bytes) -> bytes:
    """A text without the blanks and comments before its XML declaration, where XML allows none."""
    rest = content.removeprefix(BOM_UTF8).lstrip()
    while rest.startswith(b"<!--") and b"-->" in rest:
        rest = rest.partition(b"-->")[2].lstrip()
    return rest if rest.startswith(b"<?xml") else content


class _Reader:
    """What Expat tells, as elements."""

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
                f"its element {quoted(name, MAX_NAME)} is nested too deeply or one of "
                f"too many; read are {MAX_NESTING} inside of each other, {MAX_ELEMENTS} in all"
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
            "entities; a URDF needs none: take that declaration out"
        )
