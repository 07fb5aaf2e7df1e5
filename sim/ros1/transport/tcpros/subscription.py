"""A topic that this node listens to, and its writers."""

from __future__ import annotations

import logging
import socket
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import islice
from typing import TypeAlias

from baxter_kin.display import OneLine, listing
from baxter_kin.fields import NotCopied
from sim.errors import RosConnectionError, RosError, RosMessageError, RosUnreachableError
from sim.ros1.transport.network.addresses import Place, connect
from sim.ros1.transport.network.connection import Connection
from sim.ros1.transport.network.counts import Tally
from sim.ros1.transport.network.framing import LONGEST_FRAME, FrameReader, ProtocolError
from sim.ros1.transport.network.loop import Loop
from sim.ros1.transport.tcpros.handshake import HANDSHAKE_S, Answer, Refusal, check_sum, greet_peer
from sim.ros1.transport.xmlrpc.client import ask
from sim.ros1_fields import Message
from sim.ros1_messages import MessageType

CONNECT_S = 3.0

MOST_PUBLISHERS = 100
"""Of one topic; what is told beyond is nobody's."""

RETRY_S = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
"""How long to wait before the next attempt to reach a publisher; the last goes for all further."""

GONE_AFTER = 3
"""Further attempts, 1.9 s in all, before one that was connected counts as gone for good."""

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Received:
    """A message that came.

    Attributes:
        message: what was sent.
        sender: the name of the node that sent it.
        topic: on which topic.
        time_s: when it arrived, by `time.monotonic`.
    """

    message: Message
    sender: str
    topic: str
    time_s: float


Callback: TypeAlias = Callable[[Received], None]


@dataclass(slots=True, eq=False)
class _Link:
    """The way to one publisher.

    Attributes:
        uri: its XML-RPC server.
        name: who it is.
        attempts: how often it could not be reached since it last sent something.
        was_connected: whether it was reached before.
        connection: open, or None while it is not.
    """

    uri: str
    name: str
    attempts: int = 0
    was_connected: bool = False
    connection: Connection | None = field(default=None)


class Subscription(NotCopied, OneLine):
    """Connects to every publisher of a topic, and again when a connection breaks.

    Attributes:
        topic: its name.
        type: its messages' type.
    """

    def __init__(
        self,
        topic: str,
        kind: MessageType,
        callback: Callback,
        *,
        node: str,
        loop: Loop,
        tally: Tally,
        name_of: Callable[[str], str],
    ) -> None:
        """A topic without publishers.

        Args:
            topic: its name, in full.
            kind: its messages' type.
            callback: told of every message, in the loop's thread.
            node: our name, told to publishers.
            loop: the thread that waits for them.
            tally: counts what goes wrong.
            name_of: the name of the node with an XML-RPC server; may ask the master.
        """
        self.topic = topic
        self.type = kind
        self._callback = callback
        self._node = node
        self._loop = loop
        self._tally = tally
        self._name_of = name_of
        self._lock = threading.Lock()  # of what follows
        self._wanted: frozenset[str] = frozenset()
        self._links: dict[str, _Link] = {}
        self._is_closed = False

    @property
    def writers(self) -> tuple[str, ...]:
        """The names of the nodes that are connected."""
        return tuple(link.name for link in self._connected())

    @property
    def connections(self) -> tuple[tuple[Connection, str], ...]:
        """Every publisher's connection, and its XML-RPC server."""
        return tuple((link.connection, link.uri) for link in self._connected() if link.connection)

    def update(self, uris: Iterable[str]) -> None:
        """Connect to these publishers, given by their XML-RPC servers.

        One that is not among them is not sought again, but kept as long as it keeps the connection:
        a master that was restarted knows nobody.
        """
        first = tuple(islice(uris, MOST_PUBLISHERS))
        with self._lock:
            self._wanted = frozenset(first)
            added = [uri for uri in self._wanted if uri not in self._links and not self._is_closed]
            links = [_Link(uri, f"a publisher of {self.topic}") for uri in added]
            self._links.update(zip(added, links, strict=True))
        for link in links:
            self._seek(link)

    def close(self) -> None:
        """Listen no more, in the loop's thread."""
        with self._lock:
            self._is_closed = True
            links = tuple(self._links.values())
        for link in links:
            if link.connection is not None:
                link.connection.close()

    def _connected(self) -> tuple[_Link, ...]:
        with self._lock:
            links = tuple(self._links.values())
        return tuple(link for link in links if link.connection is not None)

    def _seek(self, link: _Link) -> None:
        """In a thread of its own: a name may take seconds to resolve, or a host to answer."""
        name = f"seeking a publisher of {self.topic}"
        threading.Thread(target=self._reach, args=(link,), name=name, daemon=True).start()

    def _reach(self, link: _Link) -> None:
        try:
            sock, answer = self._shake_hands(link)
        except RosError as error:
            self._note(link, error)
            self._loop.call(lambda: self._retry(link))
            return
        if not self._loop.call(lambda: self._adopt(link, sock, answer)):
            sock.close()

    def _note(self, link: _Link, error: RosError) -> None:
        """Say once what is wrong; who is not there any more may have ended, and is waited for."""
        link.attempts += 1
        if link.attempts == 1:
            link.name = self._name_of(link.uri) or link.name
        is_gone = isinstance(error, RosUnreachableError)
        patience = (GONE_AFTER if link.was_connected else len(RETRY_S)) if is_gone else 0
        if link.attempts != patience + 2:  # not at once: now it is known who it is
            return
        if is_gone and link.was_connected:
            text = "%s: %s is gone without having unregistered, as if killed; it is waited for"
            _LOG.warning(text, self.topic, link.name)
        else:
            _LOG.warning("%s: %s", self.topic, error)

    def _shake_hands(self, link: _Link) -> tuple[socket.socket, Answer]:
        wish = [["TCPROS"]]
        found = ask(
            link.uri, "requestTopic", self._node, self.topic, wish, node=link.name,
            timeout_s=CONNECT_S,
        )  # fmt: skip
        try:
            _, host, port = found
            place = Place(str(host), int(port))
        except (TypeError, ValueError):
            raise RosConnectionError(
                f"{link.name} does not offer {self.topic} by TCPROS", host=link.uri, node=link.name
            ) from None
        sock = connect(place, node=link.name, timeout_s=CONNECT_S)
        try:
            sock.settimeout(HANDSHAKE_S)
            answer = greet_peer(sock, self._fields(), place=place, node=link.name)
            check_sum(answer, what=self.topic, kind=self.type.name, md5=self.type.md5)
        except RosError as error:
            sock.close()
            self._tally.add("refused" if isinstance(error, Refusal) else "malformed")
            raise
        return sock, answer

    def _adopt(self, link: _Link, sock: socket.socket, answer: Answer) -> None:
        link.name = answer.get("callerid", link.name)
        if self._is_closed:
            sock.close()
            return
        if link.was_connected:
            self._tally.add("reconnects")
        reader = FrameReader(LONGEST_FRAME)
        connection = Connection(sock, self._loop, self._tally, peer=link.name, reader=reader)
        connection.on_frame = lambda data: self._deliver(link, data)
        connection.on_close = lambda: self._lost(link)
        link.was_connected = True
        link.connection = connection
        connection.start()

    def _deliver(self, link: _Link, data: bytes) -> None:
        arrived_s = time.monotonic()
        link.attempts = 0
        try:
            message = self.type.deserialise(data)
        except RosMessageError as error:
            raise ProtocolError(str(error)) from error
        try:
            self._callback(Received(message, link.name, self.topic, arrived_s))
        except Exception:  # a fault of one callback must not lose the messages that follow
            self._tally.add("faults")
            _LOG.exception("%s: the callback failed", self.topic)

    def _lost(self, link: _Link) -> None:
        link.connection = None
        self._retry(link)

    def _retry(self, link: _Link) -> None:
        with self._lock:
            is_wanted = link.uri in self._wanted and not self._is_closed
            if not is_wanted:
                self._links.pop(link.uri, None)
                return
        wait_s = RETRY_S[min(link.attempts, len(RETRY_S) - 1)]
        self._loop.later(wait_s, lambda: self._seek_again(link))

    def _seek_again(self, link: _Link) -> None:
        with self._lock:
            if link.uri not in self._wanted or self._is_closed:
                self._links.pop(link.uri, None)
                return
        self._seek(link)

    def _fields(self) -> Answer:
        return {
            "callerid": self._node,
            "topic": self.topic,
            "type": self.type.name,
            "md5sum": self.type.md5,
            "message_definition": self.type.definition,
            "tcp_nodelay": "1",
        }

    def _facts(self) -> tuple[str, ...]:
        return self.topic, self.type.name, listing(self.writers, "writer")
