"""What this layer raises.

```
BaxterError
├── DescriptionError          the robot's URDF cannot be found or read
├── UnknownNameError          a limb, frame or joint that does not exist   (also ValueError)
├── ConfigurationError        joint values: shape, finiteness, limits      (also ValueError)
├── LimitsError               joint limits that make no sense              (also ValueError)
├── PoseError                 a position, quaternion or pose that is none  (also ValueError)
├── RequestError              an IK request that contradicts itself        (also ValueError)
├── CopyError                 what cannot be pickled or copied              (also TypeError)
├── FileError                 a file that cannot be read, written or trusted
└── MissingLibraryError       a library of the system, or a package        (also ImportError)
```

Malformed input raises one of these. "No solution" is a result with a reason, never an exception.
What is valid but probably not meant warns: `QuaternionOrderWarning`.

Where a number would make sense in another unit, the message asks whether it is in that one:
`millimetres_hint`, `degrees_hint`; where a name is nearly one that exists, whether that was meant:
`name_hint`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from difflib import SequenceMatcher
from enum import Enum
from itertools import islice
from reprlib import Repr
from typing import Any, TypeVar

T = TypeVar("T")
E = TypeVar("E", bound=Enum)

LONGEST_NAME = 60
"""How much of an unknown name a message repeats."""

LONGEST_QUOTE = 200
"""How much of any other input a message repeats, in characters."""

MOST_QUOTED = 20
"""How many elements of a sequence or a mapping are looked at for that."""

LONGEST_INTEGER_BITS = 1024
"""Integers beyond are told by their size: Python refuses to write those of some thousand digits."""

MOST_READ = 1_000_000
"""How many things a sequence may have: what never ends is found out with some megabytes."""

LEAST_MILLIMETRES, MOST_MILLIMETRES = 10.0, 1e4
"""Lengths in metres between these are taken for millimetres: nothing on or around Baxter is 10 m
long, and what is farther away than 10,000 mm is neither."""

MOST_DEGREES = 360.0

ALIKE = 0.6
"""How alike a name must be to one that may have been meant, by difflib's ratio."""


class BaxterError(Exception):
    """Root of every error the toolkit raises on purpose."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _remade, (type(self), self.args, self.__dict__)


class DescriptionError(BaxterError):
    """The robot description is missing or does not contain what it should."""


class UnknownNameError(BaxterError, ValueError):
    """A name that does not exist.

    Attributes:
        kind: what was looked up, such as "limb".
        name: the name that came.
        allowed: the names that exist.
    """

    def __init__(self, kind: str, name: object, allowed: Iterable[str], advice: str = "") -> None:
        self.kind = kind
        self.name = name
        self.allowed = tuple(allowed)
        shown = quoted(name, LONGEST_NAME)
        hint = name_hint(name, self.allowed) or advice
        super().__init__(f"unknown {kind} {shown}; use one of: {', '.join(self.allowed)}{hint}")


def member_of(choices: type[E], kind: str, name: object) -> E:
    """The member of an enumeration of names that has that name.

    Args:
        choices: the enumeration.
        kind: what it lists, such as "frame".
        name: its value, or the member itself.

    Raises:
        UnknownNameError: when there is none.
    """
    try:
        return choices(name)
    except ValueError:
        raise UnknownNameError(kind, name, [each.value for each in choices]) from None


class ConfigurationError(BaxterError, ValueError):
    """Joint values of the wrong shape, not finite, or outside the limits."""


class LimitsError(BaxterError, ValueError):
    """Joint limits that are not finite, not positive, or empty."""


class PoseError(BaxterError, ValueError):
    """A position, rotation or quaternion that is not one."""


class RequestError(BaxterError, ValueError):
    """An IK request whose parts do not fit together."""


class FileError(BaxterError):
    """A file that cannot be read, written or trusted.

    Attributes:
        action: what was tried: "read", "write" or "use".
        path: which file, as it was given.
        reason: why not.
    """

    def __init__(self, action: str, path: object, reason: str) -> None:
        self.action = action
        self.path = path
        self.reason = reason
        super().__init__(f"cannot {action} {shown_path(path)}: {reason}")


class CopyError(BaxterError, TypeError):
    """Something that holds an open file, a socket or a thread was pickled or copied."""


class MissingLibraryError(BaxterError, ImportError):
    """A library that a dependency leaves to the system, or a package, is not there."""


class QuaternionOrderWarning(UserWarning):
    """A quaternion that was probably written with w first, where it is read as x, y, z, w."""


def _remade(cls: type[BaxterError], args: tuple[Any, ...], facts: dict[str, Any]) -> BaxterError:
    error = cls.__new__(cls, *args)
    error.args = args
    error.__dict__.update(facts)
    return error


def quoted(value: object, longest: int = LONGEST_QUOTE) -> str:
    """What a message repeats of a value that came: its `repr` on one line, cut to a length.

    The work is bounded too, however large the value is.
    """
    return shortened(" ".join(_QUOTE.repr(value).split()), longest)


def shortened(text: str, longest: int = LONGEST_QUOTE) -> str:
    """A text of at most so many characters, its middle left out where it was longer.

    It is cut between words, unless there is no blank in the last third of what is kept.
    What no output can show, as half a surrogate pair in a file's name, is written as an escape.
    """
    if len(text) > longest:
        kept = longest - len("...")
        head, tail = text[: kept - kept // 2], text[len(text) - kept // 2 :]
        end, begin = head.rfind(" ", 2 * len(head) // 3), tail.find(" ", 0, len(tail) // 3)
        head, tail = head if end < 0 else head[: end + 1], tail[max(begin, 0) :]
        text = f"{head}...{tail}"
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def millimetres_hint(*lengths_m: float, least: float = LEAST_MILLIMETRES) -> str:
    """What a refusal adds where the longest of some lengths seems to be in millimetres, else "".

    Args:
        lengths_m: lengths or coordinates, of any sign, as they came.
        least: from where on no such length makes sense in metres.
    """
    longest = max(map(float, lengths_m), key=abs)
    if not least <= abs(longest) <= MOST_MILLIMETRES:
        return ""
    shown = round(longest)
    return f"; are these millimetres? Lengths are in metres: {shown} mm is {1e-3 * shown:g} m"


def degrees_hint(*angles_rad: float, least: float = 2.0 * math.pi) -> str:
    """What a refusal adds where the largest of some angles seems to be in degrees, else "".

    Args:
        angles_rad: angles of any sign, as they came.
        least: up to where such an angle makes sense in radians.
    """
    largest = max(map(float, angles_rad), key=abs)
    if not least < abs(largest) <= MOST_DEGREES:
        return ""
    return (
        f"; are these degrees? Angles are in radians: {largest:.4g} deg is "
        f"{math.radians(largest):.4g} rad"
    )


def name_hint(name: object, known: Iterable[str]) -> str:
    """What a refusal adds where a name that does not exist is nearly one that does, else ""."""
    near = nearest_name(name, known)
    return f"; did you mean {near}?" if near else ""


def nearest_name(name: object, known: Iterable[str], alike: float = ALIKE) -> str:
    """The name that may have been meant by one that does not exist; "" where none is near.

    Args:
        name: what came; whether its letters are large or small counts for nothing.
        known: the names that exist. Where several are equally near, none is guessed.
        alike: how alike they must be, by difflib's ratio, 0..1.
    """
    if not isinstance(name, str) or len(name) > LONGEST_NAME:
        return ""
    matcher, by_ratio = SequenceMatcher(b=name.lower()), dict[float, list[str]]()
    for each in known:
        matcher.set_seq1(each.lower())
        by_ratio.setdefault(matcher.ratio(), []).append(each)
    best = max(by_ratio, default=0.0)
    return by_ratio[best][0] if best >= alike and len(by_ratio[best]) == 1 else ""


def shown_path(path: object) -> str:
    """A file's name as messages repeat it."""
    return shortened(str(path))


class _Quote(Repr):
    """Writes values of any size shortly."""

    def __init__(self) -> None:
        super().__init__()
        self.maxtuple = self.maxlist = self.maxarray = self.maxdict = MOST_QUOTED
        self.maxset = self.maxfrozenset = self.maxdeque = MOST_QUOTED
        self.maxstring = self.maxother = self.maxlong = LONGEST_QUOTE

    def repr_int(self, x: int, level: int) -> str:
        """The number, or how large it is."""
        bits = x.bit_length()
        is_short = bits <= LONGEST_INTEGER_BITS
        return super().repr_int(x, level) if is_short else f"an integer of {bits} bits"


_QUOTE = _Quote()


def expect(value: object, kind: type[T], what: str, error: type[BaxterError]) -> T:
    """`value`, known to be of that class.

    Raises:
        BaxterError: of class `error`, when it is of another.
    """
    if not isinstance(value, kind):
        raise error(f"{what} must be of class {kind.__name__}, got {type(value).__name__}")
    return value


def expect_all(values: object, kind: type[T], what: str, error: type[BaxterError]) -> tuple[T, ...]:
    """All `values`, known to be of that class.

    Raises:
        BaxterError: of class `error`, when they are no sequence, one is of another class, or they
            are more than `MOST_READ`.
    """
    if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
        raise error(f"{what} must be a sequence, got {type(values).__name__}")
    first = islice(values, MOST_READ + 1)
    checked = tuple(expect(value, kind, f"each of {what}", error) for value in first)
    if len(checked) > MOST_READ:
        raise error(f"{what} are more than {MOST_READ}, or never end; give fewer")
    return checked
