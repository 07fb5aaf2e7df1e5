"""A service that this node offers."""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable, Mapping

from baxter_kin.display import OneLine
from baxter_kin.fields import NotCopied
from sim.errors import RosMessageError, ServiceRefused
from sim.ros1.transport.network.connection import Connection
from sim.ros1.transport.network.counts import Tally
from sim.ros1.transport.network.framing import LONGEST_FRAME, ProtocolError, framed, framed_header
from sim.ros1.transport.tcpros.handshake import check_sum
from sim.ros1_fields import Message
from sim.ros1_messages import ServiceType

MOST_WAITING = 16
"""Requests of one client that wait for their answers; who sends more does not wait for any."""

YES, NO = b"\x01", b"\x00"

_LOG = logging.getLogger(__name__)


class ServiceServer(NotCopied, OneLine):
    """Answers requests one after the other, in a thread of its own.

    Attributes:
        name: the service's name.
        type: its type.
    """

    def __init__(
        self,
        name: str,
        kind: ServiceType,
        handler: Callable[[Message], Message],
        *,
        node: str,
        tally: Tally,
    ) -> None:
        """A service without clients.

        Args:
            name: its name, in full.
            kind: its type.
            handler: gives the response to a request; a `ServiceRefused` it raises is the answer.
            node: our name, told to clients.
            tally: counts what goes wrong.
        """
        self.name = name
        self.type = kind
        self._handler = handler
        self._node = node
        self._tally = tally
        self._lock = threading.Lock()  # of what follows
        self._clients: dict[Connection, int] = {}
        self._requests: queue.SimpleQueue[tuple[Connection, bool, bytes] | None]
        self._requests = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name=f"service {name}", daemon=True)
        self._thread.start()

    def accept(self, connection: Connection, fields: Mapping[str, str]) -> None:
        """Take on a client that has said who it is, in the loop's thread."""
        check_sum(fields, what=self.name, kind=self.type.name, md5=self.type.md5)
        connection.send(framed_header(self._fields()))
        if fields.get("probe") == "1":
            connection.close_after_sending()
            return
        stays = fields.get("persistent", "").lower() in ("1", "true")
        connection.allow(LONGEST_FRAME)
        connection.on_frame = lambda data: self._take(connection, stays, data)
        forget = connection.on_close

        def on_close() -> None:
            with self._lock:
                self._clients.pop(connection, None)
            forget()

        self._clients[connection] = 0
        connection.on_close = on_close

    def close(self) -> None:
        """Send the clients away, in the loop's thread; what is being answered is not."""
        self._requests.put(None)
        for client in tuple(self._clients):
            client.close()

    def _take(self, connection: Connection, stays: bool, data: bytes) -> None:
        with self._lock:
            if self._clients[connection] >= MOST_WAITING:
                raise ProtocolError(f"{MOST_WAITING} requests wait for their answers")
            self._clients[connection] += 1
        self._requests.put((connection, stays, data))

    def _run(self) -> None:
        while (request := self._requests.get()) is not None:
            connection, stays, data = request
            connection.send(self._answer(connection, data))
            with self._lock:
                if connection in self._clients:
                    self._clients[connection] -= 1
            if not stays:
                connection.close_after_sending()

    def _answer(self, connection: Connection, data: bytes) -> bytes:
        try:
            request = self.type.request.deserialise(data)
        except RosMessageError as error:
            self._tally.add("malformed")
            _LOG.warning("%s: a malformed request of %s: %s", self.name, connection.peer, error)
            return NO + framed(str(error).encode())
        try:
            return YES + framed(self.type.response.serialise(self._handler(request)))
        except ServiceRefused as error:
            return NO + framed(str(error).encode())
        except Exception as error:  # a fault in one answer must not end the service
            self._tally.add("faults")
            _LOG.exception("%s: the handler failed", self.name)
            return NO + framed(f"{type(error).__name__}: {error}".encode())

    def _fields(self) -> dict[str, str]:
        return {
            "callerid": self._node,
            "service": self.name,
            "type": self.type.name,
            "request_type": self.type.request.name,
            "response_type": self.type.response.name,
            "md5sum": self.type.md5,
        }

    def _facts(self) -> tuple[str, ...]:
        return self.name, self.type.name
