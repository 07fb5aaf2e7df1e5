"""A topic that this node publishes, and its readers."""

from __future__ import annotations

import struct
import threading
from collections.abc import Mapping

from baxter_kin.display import OneLine, listing
from baxter_kin.fields import NotCopied
from sim.ros1.transport.network.connection import Connection
from sim.ros1.transport.network.framing import framed, framed_header
from sim.ros1.transport.tcpros.handshake import Refusal, check_sum
from sim.ros1_fields import Message
from sim.ros1_messages import MessageType

_HEAD = struct.Struct("<II")


class Publication(NotCopied, OneLine):
    """What is published is serialised once and sent to every reader, from the caller's thread.

    Attributes:
        topic: its name.
        type: its messages' type.
        latch: whether a reader that comes later gets the last message.
    """

    def __init__(
        self, topic: str, kind: MessageType, *, node: str, latch: bool, queue: int
    ) -> None:
        """A topic without readers.

        Args:
            topic: its name, in full.
            kind: its messages' type.
            node: our name, told to readers.
            latch: keep the last message for readers to come.
            queue: how many messages wait for a reader that is slow; newer ones replace older ones.
        """
        self.topic = topic
        self.type = kind
        self.latch = latch
        self._node = node
        self._queue = queue
        self._lock = threading.Lock()  # of what follows
        self._readers: dict[Connection, str] = {}
        self._latched: bytes | None = None
        self._number = 0

    @property
    def readers(self) -> tuple[str, ...]:
        """The names of the nodes that are connected."""
        return tuple(self._readers.values())

    @property
    def connections(self) -> tuple[tuple[Connection, str], ...]:
        """Every reader's connection, and its name."""
        return tuple(self._readers.items())

    def publish(self, message: Message) -> None:
        """Send a message to all readers; nobody is waited for.

        A message with a header gets the next number as its sequence number, as in ROS.
        """
        if not self._readers and not self.latch:
            return
        content = self.type.serialise(message)
        with self._lock:
            self._number += 1
            data = self._framed(content)
            if self.latch:
                self._latched = data
            readers = tuple(self._readers)
        for reader in readers:
            reader.send(data)

    def accept(self, connection: Connection, fields: Mapping[str, str]) -> None:
        """Take on a reader that has said who it is, in the loop's thread."""
        check_sum(fields, what=self.topic, kind=self.type.name, md5=self.type.md5)
        connection.keep(self._queue)
        connection.on_frame = _refuse_frame
        forget = connection.on_close

        def on_close() -> None:
            with self._lock:
                self._readers.pop(connection, None)
            forget()

        connection.on_close = on_close
        connection.send(framed_header(self._fields()))
        with self._lock:
            self._readers[connection] = fields.get("callerid", "unknown")
            if self._latched is not None:
                connection.send(self._latched)

    def close(self) -> None:
        """Send the readers away, in the loop's thread."""
        for reader in tuple(self._readers):
            reader.close()

    def _framed(self, content: bytes) -> bytes:
        if not self.type.has_header:
            return framed(content)
        return _HEAD.pack(len(content), self._number % 2**32) + content[4:]

    def _fields(self) -> dict[str, str]:
        return {
            "callerid": self._node,
            "topic": self.topic,
            "type": self.type.name,
            "md5sum": self.type.md5,
            "latching": "1" if self.latch else "0",
            "message_definition": self.type.definition,
        }

    def _facts(self) -> tuple[str, ...]:
        return self.topic, self.type.name, listing(self.readers, "reader")


def _refuse_frame(_: bytes) -> None:
    raise Refusal("a reader of a topic that sends")
