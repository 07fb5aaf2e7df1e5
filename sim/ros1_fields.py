"""How the values of a ROS 1 message's fields are checked and filled in."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from baxter_kin.display import quoted
from sim.errors import RosMessageError

if TYPE_CHECKING:  # an extra
    from rosbags.interfaces.typing import FieldDesc
    from rosbags.typesys.store import Typestore

Message: TypeAlias = Any
"""A message, made by a `MessageType`: its class is made by the library while the program runs."""

Fill: TypeAlias = Callable[[object], object]

NANOSECONDS = 1_000_000_000

LEAST_AND_MOST = {
    f"{sign}int{bits}": (0, 2**bits - 1) if sign else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    for sign in ("u", "")
    for bits in (8, 16, 32, 64)
}
LEAST_AND_MOST |= {"char": LEAST_AND_MOST["uint8"], "byte": LEAST_AND_MOST["int8"]}
"""Of integers, by ROS 1's name."""

DTYPES = {name: np.dtype(name) for name in LEAST_AND_MOST if "int" in name}
DTYPES |= {"char": np.dtype("uint8"), "byte": np.dtype("uint8")}
DTYPES |= {"float32": np.dtype("float32"), "float64": np.dtype("float64"), "bool": np.dtype("bool")}

_EMPTY: dict[str, Callable[[], object]]
_EMPTY = {"string": str, "bool": bool, "float32": float, "float64": float}
"""What makes a value that is not given; others are integers."""

_BASE, _NAMED, _ARRAY = 1, 2, 3
"""How the library numbers the kinds of field: one value, one message, an array of fixed length;
what is left is an array of any length."""

_TIMES = {"builtin_interfaces/msg/Time": "time", "builtin_interfaces/msg/Duration": "duration"}
"""What the library calls ROS 1's times, and what ROS 1 does."""

_HIDDEN = "structure_needs_at_least_one_member"
"""The library's field of a message without fields."""


class _FieldKind(NamedTuple):
    """What a field holds.

    Attributes:
        name: ROS 1's name of a plain value's kind, or the full name of a message's type.
        is_message: which of both.
        is_array: whether it holds several.
        length: how many, where that is fixed.
    """

    name: str
    is_message: bool
    is_array: bool
    length: int | None


class MessageMaker:
    """Makes the messages of one type, and checks those that others made or changed."""

    def __init__(self, full_name: str, store: Typestore) -> None:
        """A maker of a store's messages.

        Args:
            full_name: the library's, such as "sensor_msgs/msg/JointState".
            store: where their types are.
        """
        self._name = _TIMES.get(full_name, full_name.replace("/msg/", "/"))
        self._is_time = full_name in _TIMES
        found = store.get_msgdef(full_name)
        self._class: Callable[..., Message] = found.cls
        kinds = {name: _kind(desc) for name, desc in found.fields if name != _HIDDEN}
        self._fills = {name: _filler(kind, store) for name, kind in kinds.items()}
        self._empty = {name: _emptiness(kind, store) for name, kind in kinds.items()}
        checks = ((name, _checker(kind, store)) for name, kind in kinds.items())
        self._checks = tuple((name, check) for name, check in checks if check is not None)

    def make(self, values: object) -> Message:
        """A message of fields' values, by name; of a time or duration seconds will do."""
        if type(values) is self._class:
            return values
        if self._is_time and isinstance(values, (int, float)):
            values = _seconds(values)
        if not isinstance(values, Mapping):
            raise RosMessageError(f"not a {self._name}: {quoted(values)}")
        filled = {}
        for field, empty in self._empty.items():
            filled[field] = self._filled(field, values[field]) if field in values else empty()
        if not values.keys() <= filled.keys():
            unknown = next(iter(values.keys() - filled.keys()))
            raise RosMessageError(
                f"a {self._name} has no field {quoted(unknown)}; it has: {', '.join(filled)}"
            )
        return self._class(**filled)

    def check(self, message: Message) -> None:
        """See that arrays have the numbers that the fields have; the library only copies them."""
        if type(message) is not self._class:
            raise RosMessageError(f"not a {self._name}: {quoted(message)}")
        fault = self.fault(message)
        if fault:
            raise RosMessageError(f"{self._name}.{fault}")

    @property
    def has_arrays(self) -> bool:
        """Whether there is anything to check."""
        return bool(self._checks)

    def fault(self, message: Message) -> str:
        """The same as text, empty when nothing is wrong."""
        for field, check in self._checks:
            fault = check(getattr(message, field))
            if fault:
                return f"{field}: {fault}"
        return ""

    def _filled(self, field: str, value: object) -> object:
        try:
            return self._fills[field](value)
        except RosMessageError as cause:
            raise RosMessageError(f"{self._name}.{field}: {cause}") from cause
        except (TypeError, ValueError, OverflowError) as cause:
            raise RosMessageError(f"{self._name}.{field}: {quoted(value)}: {cause}") from cause


def _seconds(value: float) -> dict[str, int]:
    if not abs(value) < float("inf"):
        raise RosMessageError(f"a time must be finite, got {value}")
    seconds, rest = divmod(round(value * NANOSECONDS), NANOSECONDS)
    return {"sec": seconds, "nanosec": rest}


def _kind(desc: FieldDesc) -> _FieldKind:
    """What the library says of a field, in our words."""
    numbered: Any = desc
    is_array = numbered[0] not in (_BASE, _NAMED)
    item, length = numbered[1] if is_array else (numbered, None)
    is_message = item[0] == _NAMED
    name = item[1] if is_message else item[1][0]
    return _FieldKind(name, is_message, is_array, length if numbered[0] == _ARRAY else None)


def _filler(kind: _FieldKind, store: Typestore) -> Fill:
    """What makes a field's value of what is given."""
    if kind.is_array:
        if kind.name in DTYPES:
            return _numbers(kind.name, kind.length)
        fill = _filler(kind._replace(is_array=False), store)
        return lambda values: _items(values, fill, kind.length)
    return MessageMaker(kind.name, store).make if kind.is_message else _scalar(kind.name)


def _scalar(kind: str) -> Fill:
    if kind == "string":
        return _text
    if kind == "bool":
        return _truth
    if kind in LEAST_AND_MOST:
        return lambda value: _integer(value, kind)
    return _number


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise RosMessageError(f"must be text, got {type(value).__name__}")
    return value


def _truth(value: object) -> bool:
    if value not in (0, 1):
        raise RosMessageError(f"must be True or False, got {quoted(value)}")
    return bool(value)


def _integer(value: object, kind: str) -> int:
    number = operator.index(value)  # type: ignore[arg-type]  # what is no integer is refused
    least, most = LEAST_AND_MOST[kind]
    if not least <= number <= most:
        raise RosMessageError(f"a {kind} is {least} to {most}, got {quoted(number)}")
    return number


def _number(value: object) -> float:
    return float(value)  # type: ignore[arg-type]  # what is no number is refused


def _numbers(kind: str, fixed: int | None) -> Fill:
    dtype = DTYPES[kind]

    def fill(values: object) -> object:
        if isinstance(values, (bytes, bytearray)):
            values = np.frombuffer(values, np.uint8)
        given = np.asarray(values)
        if given.ndim != 1 or (fixed is not None and len(given) != fixed):
            wanted = "any length" if fixed is None else str(fixed)
            raise RosMessageError(f"must have shape ({wanted},), got {given.shape}")
        with np.errstate(invalid="ignore"):
            array = given.astype(dtype)  # a copy, whatever was given
        if kind in LEAST_AND_MOST and given.dtype != dtype and not np.array_equal(given, array):
            raise RosMessageError(f"must have integers that fit {kind}, got {quoted(values)}")
        return array

    return fill


def _items(values: object, fill: Fill, fixed: int | None) -> list[object]:
    if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
        raise RosMessageError(f"must be a list, got {type(values).__name__}")
    items = [fill(value) for value in values]
    if fixed is not None and len(items) != fixed:
        raise RosMessageError(f"must have {fixed} items, got {len(items)}")
    return items


def _emptiness(kind: _FieldKind, store: Typestore) -> Callable[[], object]:
    """What makes the value of a field that is not given."""
    if kind.is_array:
        count = kind.length or 0
        if kind.name in DTYPES:
            return lambda: np.zeros(count, DTYPES[kind.name])
        empty = _emptiness(kind._replace(is_array=False), store)
        return lambda: [empty() for _ in range(count)]
    if kind.is_message:
        maker = MessageMaker(kind.name, store)
        return lambda: maker.make({})
    return _EMPTY.get(kind.name, int)


def _checker(kind: _FieldKind, store: Typestore) -> Callable[[Any], str] | None:
    """What finds a fault in a field's value that the library would not; None where it would."""
    if kind.is_message:
        maker = MessageMaker(kind.name, store)
        if not maker.has_arrays:
            return None
        if kind.is_array:
            return lambda values: next(filter(None, map(maker.fault, values)), "")
        return maker.fault
    is_checked = kind.is_array and kind.name in DTYPES
    return _dtype_check(DTYPES[kind.name]) if is_checked else None


def _dtype_check(dtype: np.dtype[Any]) -> Callable[[Any], str]:
    def check(value: Any) -> str:
        if getattr(value, "dtype", None) == dtype and value.ndim == 1:
            return ""
        return f"must be an array of {dtype}, got {quoted(value)}; make the message with make()"

    return check
