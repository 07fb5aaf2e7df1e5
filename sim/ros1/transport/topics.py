"""Publishing a topic, and subscribing to one."""

from __future__ import annotations

import asyncio
import logging
import struct
import time
from collections import deque
from collections.abc import Awaitable, Callable, Iterable
from dataclasses import dataclass, field
from itertools import islice
from typing import TypeAlias

from baxter_kin.display import OneLine, listing
from baxter_kin.fields import NotCopied
from sim.errors import RosConnectionError, RosError, RosMessageError, RosUnreachableError
from sim.ros1.transport import xmlrpc
from sim.ros1.transport.addresses import Address
from sim.ros1.transport.event_loop import EventLoop
from sim.ros1.transport.streams import (
    CONNECT_S,
    MAX_FRAME,
    Fields,
    ProtocolError,
    Refusal,
    Stream,
    check_sum,
    connect,
    exchange_headers,
    framed,
    framed_header,
    serve,
)
from sim.ros1_messages import Message, MessageType

SEND_BUFFER = 65_536
"""Bytes that the system keeps for a slow subscriber: few, or it would read messages of seconds
ago."""

MAX_PUBLISHERS = 100
"""Maximum number of publishers of one topic that are connected to."""

RETRY_S = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
"""Waiting times before the next attempts to reach a publisher; the last one is repeated."""

GONE_AFTER = 3
"""Failed attempts, 1.9 s in all, after which a publisher that was connected counts as gone."""

_HEAD = struct.Struct("<II")

_LOG = logging.getLogger(__name__)


class Outbox:
    """Messages for one subscriber; when it is slow, newer messages replace older ones."""

    def __init__(self, stream: Stream, queue: int, loop: EventLoop) -> None:
        """Store where to send.

        Args:
            stream: the connection.
            queue: maximum number of waiting messages.
            loop: of the connection.
        """
        self._stream = stream
        self._waiting: deque[bytes] = deque(maxlen=queue)
        self._loop = loop
        self._is_blocked = False

    def send(self, data: bytes) -> None:
        """Send a message now, or when the subscriber has taken those before."""
        if self._is_blocked:
            if len(self._waiting) == self._waiting.maxlen:
                self._loop.count("dropped")
            self._waiting.append(data)
            return
        self._stream.send(data)
        if self._stream.is_sending:
            self._is_blocked = True
            self._loop.spawn(self._send_waiting())

    async def _send_waiting(self) -> None:
        try:
            await self._stream.writer.drain()
            while self._waiting:
                self._stream.send(self._waiting.popleft())
                await self._stream.writer.drain()
            self._is_blocked = False
        except ConnectionError:  # noticed by the coroutine that reads
            self._waiting.clear()


class Publication(NotCopied, OneLine):
    """A topic that this node publishes.

    Attributes:
        name: of the topic.
        type: of its messages.
        latch: whether later subscribers get the last message.
        readers: connections of the subscribers, with the names of their nodes.
    """

    def __init__(
        self, name: str, kind: MessageType, *, node: str, loop: EventLoop, latch: bool, queue: int
    ) -> None:
        """A topic without subscribers.

        Args:
            name: its full name.
            kind: type of its messages.
            node: our name, for subscribers.
            loop: of the connections.
            latch: whether to keep the last message for later subscribers.
            queue: maximum number of messages that wait for a slow subscriber.
        """
        self.name = name
        self.type = kind
        self.latch = latch
        self.readers: dict[Stream, str] = {}
        self._node = node
        self._loop = loop
        self._queue = queue
        self._outboxes: dict[Stream, Outbox] = {}
        self._latched: bytes | None = None
        self._sequence = 0

    @property
    def connections(self) -> tuple[tuple[Stream, str], ...]:
        """The connection and name of every subscriber."""
        return tuple(self.readers.items())

    def publish(self, message: Message) -> None:
        """Send a message to all subscribers, without waiting; any thread may call this.

        The sequence number of a header is filled in.
        """
        if self.readers or self.latch:
            self._loop.call(self._send, self.type.serialise(message))

    async def accept(self, stream: Stream, fields: Fields) -> None:
        """Serve a subscriber whose connection header has arrived, until it disconnects."""
        check_sum(fields, name=self.name, kind=self.type.name, md5=self.type.md5)
        stream.limit_send_buffer(SEND_BUFFER)
        stream.send(framed_header(self._fields()))
        outbox = Outbox(stream, self._queue, self._loop)
        if self._latched is not None:
            outbox.send(self._latched)
        self._outboxes[stream] = outbox
        self.readers[stream] = fields.get("callerid", "unknown")
        try:
            if await stream.reader.read(1):
                raise ProtocolError("a subscriber sent a message")
        finally:
            del self._outboxes[stream], self.readers[stream]

    def close(self) -> None:
        """Disconnect the subscribers."""
        for stream in self.readers:
            stream.abort()

    def _send(self, content: bytes) -> None:
        self._sequence += 1
        data = framed(content)
        if self.type.has_header:
            data = _HEAD.pack(len(content), self._sequence % 2**32) + content[4:]
        if self.latch:
            self._latched = data
        for outbox in self._outboxes.values():
            outbox.send(data)

    def _fields(self) -> dict[str, str]:
        return {
            "callerid": self._node,
            "topic": self.name,
            "type": self.type.name,
            "md5sum": self.type.md5,
            "latching": "1" if self.latch else "0",
            "message_definition": self.type.definition,
        }

    def _facts(self) -> tuple[str, ...]:
        return self.name, self.type.name, listing(tuple(self.readers.values()), "reader")


@dataclass(frozen=True, slots=True)
class Received:
    """A message that arrived.

    Attributes:
        message: the message.
        sender: name of the node that sent it.
        topic: name of the topic.
        time_s: when it arrived, by `time.monotonic`.
    """

    message: Message
    sender: str
    topic: str
    time_s: float


Callback: TypeAlias = Callable[[Received], None]


@dataclass(slots=True, eq=False)
class _Publisher:
    """A publisher that a subscription connects to, or tries to.

    Attributes:
        uri: of its XML-RPC server.
        name: of its node, once known.
        failures: number of failed attempts since it last sent something.
        was_connected: whether it was connected before.
        stream: the connection, while it is open.
    """

    uri: str
    name: str
    failures: int = 0
    was_connected: bool = False
    stream: Stream | None = field(default=None)


class Subscription(NotCopied, OneLine):
    """Connects to every publisher of a topic, and again when a connection breaks.

    Attributes:
        name: of the topic.
        type: of its messages.
    """

    def __init__(
        self,
        name: str,
        kind: MessageType,
        callback: Callback,
        *,
        node: str,
        loop: EventLoop,
        name_of: Callable[[str], Awaitable[str]],
    ) -> None:
        """A topic without publishers.

        Args:
            name: its full name.
            kind: type of its messages.
            callback: called with every message, in the loop's thread.
            node: our name, for publishers.
            loop: of the connections.
            name_of: gives the name of the node with an XML-RPC server, or an empty one.
        """
        self.name = name
        self.type = kind
        self._callback = callback
        self._node = node
        self._loop = loop
        self._name_of = name_of
        self._wanted: frozenset[str] = frozenset()
        self._publishers: dict[str, _Publisher] = {}

    @property
    def writers(self) -> tuple[str, ...]:
        """The names of the publishers that are connected."""
        publishers = tuple(self._publishers.values())
        return tuple(each.name for each in publishers if each.stream is not None)

    @property
    def publisher_uris(self) -> frozenset[str]:
        """The XML-RPC servers of all publishers that the master knows, connected or not."""
        return self._wanted

    @property
    def connections(self) -> tuple[tuple[Stream, str], ...]:
        """The connection and XML-RPC server of every publisher that is connected."""
        publishers = tuple(self._publishers.values())
        return tuple((each.stream, each.uri) for each in publishers if each.stream is not None)

    def update(self, uris: Iterable[str]) -> None:
        """Connect to the publishers with these XML-RPC servers.

        Publishers that are not among them any more stay connected as long as they like: a master
        that was restarted knows nobody.
        """
        self._wanted = frozenset(islice(uris, MAX_PUBLISHERS))
        for uri in self._wanted - self._publishers.keys():
            publisher = _Publisher(uri, f"a publisher of {self.name}")
            self._publishers[uri] = publisher
            self._loop.spawn(self._follow(publisher))

    def close(self) -> None:
        """Disconnect from all publishers."""
        self._wanted = frozenset()
        for stream, _ in self.connections:
            stream.abort()

    async def _follow(self, publisher: _Publisher) -> None:
        """Receive from a publisher for as long as it is wanted."""
        while publisher.uri in self._wanted:
            try:
                stream = await self._connect(publisher)
            except RosError as error:
                await self._report(publisher, error)
            else:
                await self._receive(publisher, stream)
            if publisher.uri in self._wanted:
                await asyncio.sleep(RETRY_S[min(publisher.failures, len(RETRY_S) - 1)])
        del self._publishers[publisher.uri]

    async def _connect(self, publisher: _Publisher) -> Stream:
        protocols = [["TCPROS"]]
        found = await xmlrpc.call(
            publisher.uri, "requestTopic", self._node, self.name, protocols, node=publisher.name,
            timeout_s=CONNECT_S,
        )  # fmt: skip
        try:
            _, host, port = found
            address = Address(str(host), int(port))
        except (TypeError, ValueError):
            raise RosConnectionError(
                f"{publisher.name} does not offer {self.name} by TCPROS",
                host=publisher.uri,
                node=publisher.name,
            ) from None
        stream = await connect(address, node=publisher.name)
        try:
            answer = await exchange_headers(stream, self._fields(), address)
            check_sum(answer, name=self.name, kind=self.type.name, md5=self.type.md5)
        except BaseException as error:
            stream.abort()
            if isinstance(error, RosError):
                self._loop.count("refused" if isinstance(error, Refusal) else "malformed")
            raise
        publisher.name = stream.peer = answer.get("callerid", publisher.name)
        return stream

    async def _report(self, publisher: _Publisher, error: RosError) -> None:
        """Log a failure once; a publisher that has ended is first waited for."""
        publisher.failures += 1
        if publisher.failures == 1:
            publisher.name = await self._name_of(publisher.uri) or publisher.name
        is_gone = isinstance(error, RosUnreachableError)
        patience = (GONE_AFTER if publisher.was_connected else len(RETRY_S)) if is_gone else 0
        if publisher.failures != patience + 2:  # not the first, which does not know the name yet
            return
        if is_gone and publisher.was_connected:
            text = "%s: %s is gone without having unregistered, as if killed; waiting for it"
            _LOG.warning(text, self.name, publisher.name)
        else:
            _LOG.warning("%s: %s", self.name, error)

    async def _receive(self, publisher: _Publisher, stream: Stream) -> None:
        if publisher.was_connected:
            self._loop.count("reconnects")
        publisher.was_connected = True
        publisher.stream = stream
        try:
            await serve(stream, lambda _: self._deliver_all(publisher, stream), self._loop)
        finally:
            publisher.stream = None

    async def _deliver_all(self, publisher: _Publisher, stream: Stream) -> None:
        while stream.is_open:
            data = await stream.read_frame(MAX_FRAME)
            arrived_s = time.monotonic()
            publisher.failures = 0
            try:
                message = self.type.deserialise(data)
            except RosMessageError as error:
                raise ProtocolError(str(error)) from error
            try:
                self._callback(Received(message, publisher.name, self.name, arrived_s))
            except Exception:  # the messages that follow must not be lost
                self._loop.count("faults")
                _LOG.exception("%s: the callback failed", self.name)

    def _fields(self) -> dict[str, str]:
        return {
            "callerid": self._node,
            "topic": self.name,
            "type": self.type.name,
            "md5sum": self.type.md5,
            "message_definition": self.type.definition,
            "tcp_nodelay": "1",
        }

    def _facts(self) -> tuple[str, ...]:
        return self.name, self.type.name, listing(self.writers, "writer")
