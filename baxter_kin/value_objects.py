"""What value objects have in common: they are shown in one line, copied whole, and read-only.

A class that inherits from `OneLine` is shown as its name and a few facts in parentheses. Of a
dataclass that names none, the facts are its fields, those left out that are as they are by default:
`Noise(position_m=0.003)`. A dataclass needs `repr=False`, so that Python writes none of its own.
A line is there to be read, not to be evaluated or parsed: numbers are rounded.

A `Frozen` dataclass is made anew when it is copied or unpickled, so its checks run again.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, NoReturn, TypeVar

import numpy as np
import pinocchio as pin

from baxter_kin.errors import CopyError, quoted, shortened

K = TypeVar("K")
V = TypeVar("V")


class FrozenMapping(Mapping[K, V]):
    """A mapping that nobody can change; unlike `types.MappingProxyType` it can be pickled."""

    __slots__ = ("_items",)

    def __init__(self, items: Mapping[K, V]) -> None:
        self._items = dict(items)

    def __getitem__(self, key: K) -> V:
        return self._items[key]

    def __iter__(self) -> Iterator[K]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __repr__(self) -> str:
        return repr(self._items)


class Frozen:
    """Base of frozen dataclasses with arrays: these are read-only in a copy as well.

    NumPy forgets that an array is read-only when it is pickled.
    """

    __slots__ = ()

    def __reduce__(self) -> tuple[Any, ...]:
        cls: Any = type(self)
        return _remade, (cls, tuple(getattr(self, each.name) for each in fields(cls)))


class NotCopied:
    """Base of what holds an open file, a socket or a thread."""

    __slots__ = ()

    def __reduce__(self) -> NoReturn:
        """Refuse.

        Raises:
            CopyError: always.
        """
        raise CopyError(
            f"a {type(self).__name__} holds an open file, socket or thread and cannot be pickled or"
            " copied; make another one where it is needed"
        )


def _remade(cls: Any, values: tuple[Any, ...]) -> Any:
    """An instance with these values of its fields; they were checked when the first was made."""
    made = object.__new__(cls)
    for each, value in zip(fields(cls), values, strict=True):
        object.__setattr__(made, each.name, with_read_only_arrays(value))
    return made


def with_read_only_arrays(value: Any) -> Any:
    """The same value, its arrays made read-only, also those in tuples and mappings."""
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif isinstance(value, (tuple, FrozenMapping)):
        for part in value.values() if isinstance(value, FrozenMapping) else value:
            with_read_only_arrays(part)
    return value


LONGEST = 120
"""Characters of a line."""

LONGEST_PART = 60
"""Characters of one fact that is the text or the name of something else."""

LEAST_PART = 20
"""Characters that are left of a fact at least when it is shortened."""

LONG_M, LONG_S = 10.0, 1e5
"""From here on lengths are shown in metres, and times without hundredths."""

MOST_NUMBERS = 8
"""Of an array that is shown by its numbers; of another one the shape is shown."""


class OneLine:
    """Base of what is shown in one line."""

    __slots__ = ()

    def __repr__(self) -> str:
        return line(type(self).__name__, self._facts())

    def _facts(self) -> tuple[str, ...]:
        """What matters about it; what is empty is left out."""
        return tuple(_changed_fields(self)) if is_dataclass(self) else ()


def line(name: str, facts: Iterable[str]) -> str:
    """A name, and in parentheses the facts that are not empty; of bounded length, on one line.

    Where it would be too long, the longest fact is shortened.
    """
    shown = [" ".join(fact.split()) for fact in facts if fact]
    excess = len(_joined(name, shown)) - LONGEST
    if excess > 0:
        number = max(range(len(shown)), key=lambda i: len(shown[i]))
        shown[number] = shortened(shown[number], max(len(shown[number]) - excess, LEAST_PART))
    return shortened(" ".join(_joined(name, shown).split()), LONGEST)


def _joined(name: str, facts: Iterable[str]) -> str:
    return f"{name}({', '.join(facts)})"


def phrase(text: object) -> str:
    """A sentence or a name, as part of a line."""
    return shortened(str(text), LONGEST_PART)


def sentence(text: object) -> str:
    """A sentence that is a fact of a line and may fill it; the line shortens it."""
    return str(text)


def count(number: int, noun: str) -> str:
    """How many there are: "1 move", "2 moves", "2 bodies"."""
    plural = f"{noun[:-1]}ies" if noun.endswith("y") else f"{noun}s"
    return f"{number} {noun if number == 1 else plural}"


def listing(items: Collection[str], noun: str) -> str:
    """How many named things there are, and which: "2 bodies: table, block"."""
    listed = f": {phrase(', '.join(items))}" if items else ""
    return f"{count(len(items), noun)}{listed}"


def position(T: pin.SE3) -> str:
    """Where a pose is: "(0.7, 0.15, -0.129) m"."""
    return f"{numbers(T.translation.round(3))} m"


def numbers(values: Iterable[float]) -> str:
    """Some numbers, rounded: "(0.7, 0.15, -0.129)"."""
    return f"({', '.join(f'{value + 0.0:.4g}' for value in values)})"


def millimetres(length_m: float) -> str:
    """A length in the unit in which clearances and strokes are read: "18.8 mm"."""
    if abs(length_m) >= LONG_M:
        return f"{length_m:.4g} m"
    return f"{round(1e3 * length_m, 1) + 0.0:.1f} mm"


def clear(proven_m: float) -> str:
    """A clearance that is proven, rounded down: "18.7 mm clear"."""
    step_m = 1e-4 if abs(proven_m) < LONG_M else 1.0
    floor_m = math.floor(proven_m / step_m) * step_m if math.isfinite(proven_m) else proven_m
    return f"{millimetres(floor_m)} clear"


def seconds(time_s: float) -> str:
    """A time or duration: "4.31 s"."""
    return f"{round(time_s, 2) + 0.0:.2f} s" if abs(time_s) < LONG_S else f"{time_s:.4g} s"


def side_of(joint_names: Sequence[str]) -> str:
    """Whose joints these are: "left", or how many where that is not told by their names."""
    sides = {name.split("_")[0] for name in joint_names}
    return sides.pop() if len(sides) == 1 else count(len(joint_names), "joint")


def _changed_fields(value: Any) -> Iterator[str]:
    for field in fields(value):
        given = getattr(value, field.name)
        if field.repr and (field.default is MISSING or not is_default(given, field.default)):
            yield f"{field.name}={shown(given)}"


def is_default(given: object, default: object) -> bool:
    """Whether the value of a field is that of its default, so that nothing is shown of it."""
    if isinstance(given, Mapping) and isinstance(default, Mapping):
        return not given and not default
    is_array = isinstance(given, np.ndarray)
    return given is default or (
        type(given) is type(default) and not is_array and bool(given == default)
    )


def shown(value: object) -> str:
    """A value as part of a line: numbers rounded, of a large array the shape."""
    if isinstance(value, (float, np.floating)):
        return f"{value:.4g}"
    if isinstance(value, tuple) and value and all(type(each) is float for each in value):
        return numbers(value)
    if isinstance(value, np.ndarray):
        is_short = value.ndim == 1 and value.size <= MOST_NUMBERS and value.dtype.kind in "iuf"
        return numbers(value) if is_short else f"{' x '.join(map(str, value.shape))} array"
    return quoted(value, LONGEST_PART)
