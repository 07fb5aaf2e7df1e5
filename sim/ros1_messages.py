"""ROS 1 messages: made, serialised and read (the package `rosbags` enters here).

A `MessageType` has what a connection or a bag must say of it: name, md5 sum, full definition. Its
messages are plain objects of the library, with an attribute for each field; arrays of numbers are
NumPy arrays. A `MessageTypes` knows ROS 1's standard types and those that are added to them. They
are loaded when the first is asked for, in less than 0.1 s.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING

from baxter_kin.display import OneLine, quoted
from baxter_kin.distribution.extras import run_to_install_extra
from baxter_kin.validation import expect
from sim.errors import RosError, RosMessageError
from sim.ros1_fields import Message, MessageMaker

if TYPE_CHECKING:  # an extra
    from rosbags.typesys.store import Typestore

RULE = 80 * "="
"""What ROS puts between the parts of a full definition."""

PARTS = "---"
"""What ROS puts between a service's request and its response."""


_LACKING = {"tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms\n"}
"""A standard type that the library does not have."""


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
    def _maker(self) -> MessageMaker:
        return MessageMaker(self._full_name, self._store)

    @property
    def has_header(self) -> bool:
        """Whether its first field is a header."""
        return self.definition.startswith("std_msgs/Header header\n")

    def make(self, **values: object) -> Message:
        """A message with these values; what is not given is zero, false or empty.

        Args:
            **values: by field. An array is a list or an array, text a str, a message within it one
                or the mapping of its fields, a time or duration that or a number of seconds.
        """
        return self._maker.make(values)

    def serialise(self, message: Message) -> bytes:
        """The message as it is sent and stored."""
        self._maker.check(message)
        try:
            return bytes(self._store.serialize_ros1(message, self._full_name))
        except (struct.error, AttributeError, TypeError, ValueError) as cause:
            raise RosMessageError(f"cannot serialise a {self.name}: {cause}") from cause

    def deserialise(self, data: bytes | memoryview) -> Message:
        """The message that was sent or stored; its arrays are read-only."""
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
    """ROS 1's standard types, and others by their definitions."""

    def __init__(
        self, messages: Mapping[str, str] | None = None, services: Mapping[str, str] | None = None
    ) -> None:
        """Add types to the standard ones.

        Args:
            messages: lines of constants and fields, by the type's name.
            services: the same of a request, `PARTS`, and those of its response.
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
        """The messages that were added, those of services among them."""
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
    unsigned = time_fields[1][1]  # the library reads seconds as ROS 2 does, signed
    store.fielddefs["builtin_interfaces/msg/Time"] = ([], [("sec", unsigned), time_fields[1]])
    added = {}
    for name, text in (_LACKING | dict(definitions)).items():
        added.update(get_types_from_msg(text, _full_name(name)))
    store.register(added)
    return store


def _hashed_text(part: MessageType) -> str:
    """What the sum is taken over: of a field that is a message, its sum stands for its type."""
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
    """The library writes "sensor_msgs/msg/JointState"."""
    return name.replace("/", "/msg/")


def _listed(names: Mapping[str, str]) -> str:
    return f"; added are: {', '.join(names)}" if names else ""
