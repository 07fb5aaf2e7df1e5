"""Text for readers: one line for each object; quotations of input and questions in messages.

A class that inherits from `OneLine` is shown as its name and a few facts in parentheses, as in
`World(2 bodies: table, block)`; value classes made by `baxter_kin.fields` show their fields. The
text is meant for readers, not for parsers: numbers are rounded and the length is bounded.

This module loads neither NumPy nor Pinocchio, so that commands show their help at once.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from difflib import SequenceMatcher
from reprlib import Repr
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pinocchio as pin

MAX_QUOTE = 200
"""Characters of an input that a message repeats."""

MAX_NAME = 60
"""Characters of an unknown name that a message repeats."""

MAX_LINE = 120
"""Characters of the line that shows an object."""

MAX_PART = 60
"""Characters of one fact that is a text or a name."""

MIN_PART = 20
"""Characters that remain of a fact that is shortened."""

MAX_QUOTED_ITEMS = 20
"""Elements of a sequence or a mapping that a message repeats."""

MAX_INTEGER_BITS = 1024
"""Larger integers are shown by their size: Python refuses to print some thousand digits."""

MIN_M_WHOLE, MIN_S_WHOLE = 10.0, 1e5
"""From these on, lengths are shown in metres, and times without hundredths."""

MIN_MILLIMETRES, MAX_MILLIMETRES = 10.0, 1e4
"""Lengths given in metres between these are taken for millimetres: nothing on or around Baxter is
10 m long, and nothing is as far away as 10,000 mm."""

MAX_DEGREES = 360.0

MIN_SIMILARITY = 0.6
"""Similarity by difflib from which on a name counts as a misspelling of another."""


class OneLine:
    """Base of classes that are shown in one line; a subclass defines `_facts`."""

    __slots__ = ()

    def __repr__(self) -> str:
        return line(type(self).__name__, self._facts())

    def _facts(self) -> tuple[str, ...]:
        """The facts to show; empty ones are left out."""
        return ()


def quoted(value: object, longest: int = MAX_QUOTE) -> str:
    """The `repr` of a value on one line, shortened, for messages.

    The work is bounded, however large the value is.
    """
    return shortened(" ".join(_QUOTE.repr(value).split()), longest)


def shortened(text: str, longest: int = MAX_QUOTE) -> str:
    """Shorten a text to a number of characters by leaving out its middle.

    It is cut between words, unless there is no blank near the cut. Characters that cannot be
    encoded, such as an unpaired surrogate in a file name, are written as escapes.
    """
    if len(text) > longest:
        kept = longest - len("...")
        head, tail = text[: kept - kept // 2], text[len(text) - kept // 2 :]
        end, begin = head.rfind(" ", 2 * len(head) // 3), tail.find(" ", 0, len(tail) // 3)
        head, tail = head if end < 0 else head[: end + 1], tail[max(begin, 0) :]
        text = f"{head}...{tail}"
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def shown_path(path: object) -> str:
    """A file name, shortened for messages."""
    return shortened(str(path))


def line(name: str, facts: Iterable[str]) -> str:
    """A name with the non-empty facts in parentheses, on one line of at most `MAX_LINE`.

    If the line would be too long, the longest fact is shortened.
    """
    shown = [" ".join(fact.split()) for fact in facts if fact]
    excess = len(_joined(name, shown)) - MAX_LINE
    if excess > 0:
        number = max(range(len(shown)), key=lambda i: len(shown[i]))
        shown[number] = shortened(shown[number], max(len(shown[number]) - excess, MIN_PART))
    return shortened(" ".join(_joined(name, shown).split()), MAX_LINE)


def _joined(name: str, facts: Iterable[str]) -> str:
    return f"{name}({', '.join(facts)})"


def phrase(text: object) -> str:
    """A text shortened to be one fact of a line."""
    return shortened(str(text), MAX_PART)


def count(number: int, noun: str) -> str:
    """A number with its noun: "1 move", "2 moves", "2 bodies"."""
    plural = f"{noun[:-1]}ies" if noun.endswith("y") else f"{noun}s"
    return f"{number} {noun if number == 1 else plural}"


def listing(items: Collection[str], noun: str) -> str:
    """Number and names of things: "2 bodies: table, block"."""
    listed = f": {phrase(', '.join(items))}" if items else ""
    return f"{count(len(items), noun)}{listed}"


def position(T: pin.SE3) -> str:
    """The position of a pose: "(0.7, 0.15, -0.129) m"."""
    return f"{numbers(T.translation.round(3))} m"


def numbers(values: Iterable[float]) -> str:
    """Rounded numbers: "(0.7, 0.15, -0.129)"."""
    return f"({', '.join(f'{value + 0.0:.4g}' for value in values)})"


def millimetres(length_m: float) -> str:
    """A length in millimetres, or in metres if it is long: "18.8 mm"."""
    if abs(length_m) >= MIN_M_WHOLE:
        return f"{length_m:.4g} m"
    return f"{round(1e3 * length_m, 1) + 0.0:.1f} mm"


def clear(proven_m: float) -> str:
    """A proven clearance, rounded down: "18.7 mm clear"."""
    step_m = 1e-4 if abs(proven_m) < MIN_M_WHOLE else 1.0
    floor_m = math.floor(proven_m / step_m) * step_m if math.isfinite(proven_m) else proven_m
    return f"{millimetres(floor_m)} clear"


def seconds(time_s: float) -> str:
    """A time or duration: "4.31 s"."""
    return f"{round(time_s, 2) + 0.0:.2f} s" if abs(time_s) < MIN_S_WHOLE else f"{time_s:.4g} s"


def side_of(joint_names: Sequence[str]) -> str:
    """The side of joints, such as "left", or their number if their names have no common side."""
    sides = {name.split("_")[0] for name in joint_names}
    return sides.pop() if len(sides) == 1 else count(len(joint_names), "joint")


class _Quote(Repr):
    """A short `repr` of values of any size."""

    def __init__(self) -> None:
        super().__init__()
        self.maxtuple = self.maxlist = self.maxarray = self.maxdict = MAX_QUOTED_ITEMS
        self.maxset = self.maxfrozenset = self.maxdeque = MAX_QUOTED_ITEMS
        self.maxstring = self.maxother = self.maxlong = MAX_QUOTE

    def repr_int(self, x: int, level: int) -> str:
        """The number, or its size in bits."""
        bits = x.bit_length()
        is_short = bits <= MAX_INTEGER_BITS
        return super().repr_int(x, level) if is_short else f"an integer of {bits} bits"


_QUOTE = _Quote()


def millimetres_hint(*lengths_m: float, least: float = MIN_MILLIMETRES) -> str:
    """The question whether lengths are in millimetres, if the longest looks so, else "".

    Args:
        lengths_m: lengths or coordinates of any sign, as given.
        least: the smallest value that makes no sense in metres.
    """
    longest = max(map(float, lengths_m), key=abs)
    if not least <= abs(longest) <= MAX_MILLIMETRES:
        return ""
    shown = round(longest)
    return f"; are these millimetres? Lengths are in metres: {shown} mm is {1e-3 * shown:g} m"


def degrees_hint(*angles_rad: float, least: float = 2.0 * math.pi) -> str:
    """The question whether angles are in degrees, if the largest looks so, else "".

    Args:
        angles_rad: angles of any sign, as given.
        least: the largest value that makes sense in radians.
    """
    largest = max(map(float, angles_rad), key=abs)
    if not least < abs(largest) <= MAX_DEGREES:
        return ""
    return (
        f"; are these degrees? Angles are in radians: {largest:.4g} deg is "
        f"{math.radians(largest):.4g} rad"
    )


def name_hint(name: object, known: Iterable[str]) -> str:
    """The question whether a similar known name was meant, else ""."""
    near = nearest_name(name, known)
    return f"; did you mean {near}?" if near else ""


def nearest_name(name: object, known: Iterable[str], alike: float = MIN_SIMILARITY) -> str:
    """The known name that is most similar to a given one; "" if none or several are.

    Args:
        name: the given name; upper and lower case are not distinguished.
        known: the existing names.
        alike: minimum similarity by difflib, 0..1.
    """
    if not isinstance(name, str) or len(name) > MAX_NAME:
        return ""
    matcher, by_ratio = SequenceMatcher(b=name.lower()), dict[float, list[str]]()
    for each in known:
        matcher.set_seq1(each.lower())
        by_ratio.setdefault(matcher.ratio(), []).append(each)
    best = max(by_ratio, default=0.0)
    return by_ratio[best][0] if best >= alike and len(by_ratio[best]) == 1 else ""
