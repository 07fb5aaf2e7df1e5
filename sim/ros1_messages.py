"""ROS 1 messages: made, serialised and deserialised with the package `rosbags`.

A `MessageType` has what a connection or a bag states of it: name, md5 sum, full definition. Its
messages are plain objects of that package, with an attribute for each field; arrays of numbers are
NumPy arrays. A `MessageTypes` has ROS 1's standard types and those that are added to them. They
are loaded when the first one is requested, in less than 0.1 s.
"""

from __future__ import annotations

import hashlib
import operator
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from baxter_kin.display import OneLine, quoted
from baxter_kin.distribution.extras import run_to_install_extra
from baxter_kin.validation import expect
from sim.errors import RosError, RosMessageError

if TYPE_CHECKING:  # an extra
    from rosbags.interfaces.typing import FieldDesc
    from rosbags.typesys.store import Typestore

Message: TypeAlias = Any
"""A message, made by a `MessageType`; `rosbags` creates its class while the program runs."""

RULE = 80 * "="
"""Separates the parts of a full definition."""

PARTS = "---"
"""Separates the request of a service from its response."""

NANOSECONDS = 1_000_000_000

INTEGERS = {
    f"{sign}int{bits}": (0, 2**bits - 1) if sign else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    for sign in ("u", "")
    for bits in (8, 16, 32, 64)
}
INTEGERS |= {"char": INTEGERS["uint8"], "byte": INTEGERS["int8"]}
"""Smallest and largest value of each kind of integer, by ROS 1's name."""

DTYPES = {name: np.dtype(name) for name in INTEGERS if "int" in name}
DTYPES |= {"char": np.dtype("uint8"), "byte": np.dtype("uint8")}
DTYPES |= {"float32": np.dtype("float32"), "float64": np.dtype("float64"), "bool": np.dtype("bool")}

_BASE, _NAME, _ARRAY = 1, 2, 3
"""Kinds of fields in `rosbags`: one value, one message, an array of fixed length; the fourth is an
array of any length."""

_TIMES = {"builtin_interfaces/msg/Time": "time", "builtin_interfaces/msg/Duration": "duration"}
"""ROS 1's names of times, by those of `rosbags`."""

_PLACEHOLDER = "structure_needs_at_least_one_member"
"""The field that `rosbags` gives to a message without fields."""

_LACKING = {"tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms\n"}
"""A standard type that `rosbags` does not have."""


class MessageType(OneLine):
    """A type of message.

    Attributes:
        name: such as "sensor_msgs/JointState".
        definition: its constants and fields, and below them those of the types it is made of, as
            connection headers and bags have them.
        md5: the sum by which ROS compares types.
    """

    def __init__(self, name: str, store: Typestore) -> None:
        """The type of that name in a store; `MessageTypes` makes them."""
        self.name = name
        self._store = store
        self._full_name = _full_name(name)
        self.definition, self.md5 = store.generate_msgdef(self._full_name)

    @cached_property
    def _maker(self) -> _Nested:
        return _Nested(self._full_name, self._store)

    @property
    def has_header(self) -> bool:
        """Whether its first field is a header."""
        return self.definition.startswith("std_msgs/Header header\n")

    def make(self, **values: object) -> Message:
        """A message with these values; what is not given is zero, false or empty.

        Args:
            **values: by field. A nested message may be given as a mapping of its fields, a time or
                duration also in seconds.
        """
        return self._maker.convert(values)

    def serialise(self, message: Message) -> bytes:
        """The bytes of a message, as they are sent and stored."""
        self._maker.check(message)
        try:
            return bytes(self._store.serialize_ros1(message, self._full_name))
        except (struct.error, AttributeError, TypeError, ValueError) as cause:
            raise RosMessageError(f"cannot serialise a {self.name}: {cause}") from cause

    def deserialise(self, data: bytes | memoryview) -> Message:
        """The message with these bytes; its arrays are read-only."""
        from rosbags.serde import SerdeError  # noqa: PLC0415 - an extra

        try:
            return self._store.deserialize_ros1(data, self._full_name)
        except SerdeError as cause:
            raise RosMessageError(
                f"{len(data)} bytes are no {self.name}: {quoted(str(cause))}"
            ) from cause

    def _facts(self) -> tuple[str, ...]:
        return self.name, self.md5


class ServiceType(OneLine):
    """A type of service.

    Attributes:
        name: such as "gazebo_msgs/SpawnModel".
        request: what is asked.
        response: what is answered.
        md5: the sum by which ROS compares types, over both texts.
    """

    def __init__(self, name: str, request: MessageType, response: MessageType) -> None:
        self.name = name
        self.request = request
        self.response = response
        texts = "".join(_hashed_text(part) for part in (request, response))
        self.md5 = _md5(texts)

    def _facts(self) -> tuple[str, ...]:
        return self.name, self.md5


class MessageTypes(OneLine):
    """ROS 1's standard message types, and others given by their definitions."""

    def __init__(
        self, messages: Mapping[str, str] | None = None, services: Mapping[str, str] | None = None
    ) -> None:
        """Add types to the standard ones.

        Args:
            messages: definitions by name: lines of constants and fields.
            services: definitions by name: those of the request, `PARTS`, those of the response.
        """
        self._added_messages = dict(messages or {})
        self._added_services = dict(services or {})
        self._messages: dict[str, MessageType] = {}
        self._services: dict[str, ServiceType] = {}

    def message(self, name: str) -> MessageType:
        """The type of a message."""
        expect(name, str, "name", RosMessageError)
        if name not in self._messages:
            if name.count("/") != 1 or _full_name(name) not in self._store.fielddefs:
                raise RosMessageError(
                    f"unknown message type {quoted(name)}; known are ROS 1's standard types such as"
                    f" sensor_msgs/JointState{_listed(self._added_messages)}"
                )
            self._messages[name] = MessageType(name, self._store)
        return self._messages[name]

    def service(self, name: str) -> ServiceType:
        """The type of a service."""
        expect(name, str, "name", RosMessageError)
        if name not in self._services:
            if name not in self._added_services:
                raise RosMessageError(
                    f"unknown service type {quoted(name)}{_listed(self._added_services)}"
                )
            parts = (self.message(f"{name}{part}") for part in ("Request", "Response"))
            self._services[name] = ServiceType(name, *parts)
        return self._services[name]

    def names(self) -> tuple[str, ...]:
        """The names of the added message types, including those of services."""
        return tuple(name for name, _ in self._definitions())

    @cached_property
    def _store(self) -> Typestore:
        return _load_store(dict(self._definitions()))

    def _definitions(self) -> Iterator[tuple[str, str]]:
        yield from self._added_messages.items()
        for name, text in self._added_services.items():
            request, _, response = text.partition(f"{PARTS}\n")
            yield f"{name}Request", request
            yield f"{name}Response", response

    def _facts(self) -> tuple[str, ...]:
        return (f"{len(self.names())} added",)


def _load_store(definitions: Mapping[str, str]) -> Typestore:
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415
    except ImportError:
        raise RosError(
            f"ROS 1 messages need the package rosbags; {run_to_install_extra('ros1')}"
        ) from None
    store = get_typestore(Stores.ROS1_NOETIC)
    time_fields = store.fielddefs["builtin_interfaces/msg/Time"][1]
    unsigned = time_fields[1][1]  # `rosbags` reads seconds as ROS 2 does, signed
    store.fielddefs["builtin_interfaces/msg/Time"] = ([], [("sec", unsigned), time_fields[1]])
    added = {}
    for name, text in (_LACKING | dict(definitions)).items():
        added.update(get_types_from_msg(text, _full_name(name)))
    store.register(added)
    return store


def _hashed_text(part: MessageType) -> str:
    """The text that is hashed: the type of a field that is a message is replaced by its sum."""
    lines = []
    for line in part.definition.partition(RULE)[0].splitlines():
        type_name, _, rest = line.partition(" ")
        if "/" in type_name:
            inner = _full_name(type_name.partition("[")[0])
            type_name = part._store.generate_msgdef(inner)[1]
        lines.append(f"{type_name} {rest}")
    return "\n".join(lines)


def _md5(text: str) -> str:
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()


def _full_name(name: str) -> str:
    """The name in `rosbags`, such as "sensor_msgs/msg/JointState"."""
    return name.replace("/", "/msg/")


def _listed(names: Mapping[str, str]) -> str:
    return f"; added are: {', '.join(names)}" if names else ""


class _Numbers:
    """A field that is an array of numbers."""

    has_numbers = True
    """Whether there are arrays, which `rosbags` does not check when it serialises."""

    def __init__(self, kind: str, length: int | None) -> None:
        self._kind = kind
        self._dtype = DTYPES[kind]
        self._length = length

    def default(self) -> Any:
        """The value if none is given."""
        return np.zeros(self._length or 0, self._dtype)

    def convert(self, values: object) -> Any:
        """A new array of the field's type."""
        if isinstance(values, (bytes, bytearray)):
            values = np.frombuffer(values, np.uint8)
        given = np.asarray(values)
        if given.ndim != 1 or self._length not in (None, len(given)):
            wanted = "any length" if self._length is None else str(self._length)
            raise RosMessageError(f"must have shape ({wanted},), got {given.shape}")
        with np.errstate(invalid="ignore"):
            array = given.astype(self._dtype)
        is_exact = self._kind not in INTEGERS or given.dtype == self._dtype
        if not is_exact and not np.array_equal(given, array):
            raise RosMessageError(f"must have integers that fit {self._kind}, got {quoted(values)}")
        return array

    def check(self, value: Any) -> None:
        """Refuse what `rosbags` would copy as if it were such an array."""
        if getattr(value, "dtype", None) != self._dtype or value.ndim != 1:
            raise RosMessageError(
                f"must be an array of {self._dtype}, got {quoted(value)}; make the message with"
                " make()"
            )


class _Value:
    """A field that is a text, a bool or a number."""

    has_numbers = False

    def __init__(self, kind: str) -> None:
        self._kind = kind
        self.default = {"string": str, "bool": bool, "float32": float, "float64": float}.get(
            kind, int
        )

    def convert(self, value: Any) -> Any:
        """The value as Python's type."""
        if self._kind == "string":
            if isinstance(value, str):
                return value
            raise RosMessageError(f"must be text, got {type(value).__name__}")
        if self._kind in INTEGERS:
            number, (smallest, largest) = operator.index(value), INTEGERS[self._kind]
            if smallest <= number <= largest:
                return number
            limits = f"{smallest} to {largest}"
            raise RosMessageError(f"a {self._kind} is {limits}, got {quoted(number)}")
        if self._kind == "bool" and value not in (0, 1):
            raise RosMessageError(f"must be True or False, got {quoted(value)}")
        return self.default(value)

    def check(self, value: object) -> None:
        """Leave the check to `rosbags`."""


class _Items:
    """A field that is a list of texts or messages."""

    def __init__(self, item: _Field, length: int | None) -> None:
        self.has_numbers: bool = item.has_numbers
        self._item = item
        self._length = length

    def default(self) -> list[object]:
        """The value if none is given."""
        return [self._item.default() for _ in range(self._length or 0)]

    def convert(self, values: object) -> list[object]:
        """A new list of converted items."""
        if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
            raise RosMessageError(f"must be a list, got {type(values).__name__}")
        items = [self._item.convert(value) for value in values]
        if self._length not in (None, len(items)):
            raise RosMessageError(f"must have {self._length} items, got {len(items)}")
        return items

    def check(self, values: Any) -> None:
        """Check every item."""
        for value in values:
            self._item.check(value)


class _Nested:
    """A message, or a field that is one."""

    def __init__(self, full_name: str, store: Typestore) -> None:
        definition = store.get_msgdef(full_name)
        self.name = _TIMES.get(full_name, full_name.replace("/msg/", "/"))
        self._is_time = full_name in _TIMES
        self._class: Callable[..., Message] = definition.cls
        self._fields = {
            name: _field(desc, store) for name, desc in definition.fields if name != _PLACEHOLDER
        }
        self._checked = {n: field for n, field in self._fields.items() if field.has_numbers}
        self.has_numbers: bool = bool(self._checked)

    def default(self) -> Message:
        """A message of zeros, empty texts and empty arrays."""
        return self.convert({})

    def convert(self, values: object) -> Message:
        """The message with these values by field, or a message of this type itself."""
        if type(values) is self._class:
            return values
        if self._is_time and isinstance(values, (int, float)):
            values = _seconds(values)
        if not isinstance(values, Mapping):
            raise RosMessageError(f"not a {self.name}: {quoted(values)}")
        if not values.keys() <= self._fields.keys():
            unknown = next(iter(values.keys() - self._fields.keys()))
            fields = ", ".join(self._fields)
            raise RosMessageError(f"a {self.name} has no field {quoted(unknown)}; it has: {fields}")
        converted = {
            name: self._convert(name, field, values[name]) if name in values else field.default()
            for name, field in self._fields.items()
        }
        return self._class(**converted)

    def check(self, message: Message) -> None:
        """Refuse messages of another type, or with arrays of another type."""
        if type(message) is not self._class:
            raise RosMessageError(f"not a {self.name}: {quoted(message)}")
        name = ""
        try:
            for name, field in self._checked.items():
                field.check(getattr(message, name))
        except RosMessageError as cause:
            raise RosMessageError(f"{self.name}.{name}: {cause}") from cause

    def _convert(self, name: str, field: _Field, value: object) -> object:
        try:
            return field.convert(value)
        except RosMessageError as cause:
            raise RosMessageError(f"{self.name}.{name}: {cause}") from cause
        except (TypeError, ValueError, OverflowError) as cause:
            raise RosMessageError(f"{self.name}.{name}: {quoted(value)}: {cause}") from cause


_Field: TypeAlias = _Numbers | _Value | _Items | _Nested


def _field(desc: FieldDesc, store: Typestore) -> _Field:
    """The field that `rosbags` describes."""
    numbered: Any = desc
    if numbered[0] == _NAME:
        return _Nested(numbered[1], store)
    if numbered[0] == _BASE:
        return _Value(numbered[1][0])
    item, size = numbered[1]
    length = size if numbered[0] == _ARRAY else None
    if item[0] == _BASE and item[1][0] in DTYPES:
        return _Numbers(item[1][0], length)
    return _Items(_field(item, store), length)


def _seconds(value: float) -> dict[str, int]:
    if not abs(value) < float("inf"):
        raise RosMessageError(f"a time must be finite, got {value}")
    seconds, rest = divmod(round(value * NANOSECONDS), NANOSECONDS)
    return {"sec": seconds, "nanosec": rest}
