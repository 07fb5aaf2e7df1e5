"""A socket that listens on one address and hands over whoever connects."""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable

from baxter_kin.display import OneLine
from baxter_kin.fields import NotCopied
from sim.ros1.transport.network.addresses import Place, listening
from sim.ros1.transport.network.connection import Connection, Reader
from sim.ros1.transport.network.counts import Tally
from sim.ros1.transport.network.loop import READ, Loop

MOST_CONNECTIONS = 1000
"""At a time; a node that talks to all others of a large system has some hundred."""

_LOG = logging.getLogger(__name__)


class Listener(NotCopied, OneLine):
    """Accepts connections until it is closed.

    Attributes:
        place: where it listens.
    """

    def __init__(
        self,
        place: Place,
        loop: Loop,
        tally: Tally,
        *,
        greet: Callable[[Connection], None],
        make_reader: Callable[[], Reader],
    ) -> None:
        """Listen.

        Args:
            place: address and port; port 0 takes a free one.
            loop: the thread that waits for it.
            tally: counts what goes wrong.
            greet: called with every connection before it is read, in the loop's thread.
            make_reader: makes what cuts a connection's bytes.
        """
        self._sock = listening(*place)
        self.place = Place(place.host, self._sock.getsockname()[1])
        self._loop = loop
        self._tally = tally
        self._greet = greet
        self._make_reader = make_reader
        self._connections: set[Connection] = set()
        loop.call(lambda: loop.watch(self._sock, READ, self._accept))

    @property
    def connections(self) -> tuple[Connection, ...]:
        """Those that are open."""
        return tuple(self._connections)

    def close(self) -> None:
        """Listen no more and close all connections, in the loop's thread."""
        if self._sock.fileno() >= 0:
            self._loop.forget(self._sock)
            self._sock.close()
        for connection in self.connections:
            connection.close()

    def _accept(self, _: int) -> None:
        try:
            sock, (address, port) = self._sock.accept()
        except OSError:  # gone again before it was accepted, or too many files are open
            return
        if len(self._connections) >= MOST_CONNECTIONS:
            self._tally.add("refused")
            _LOG.warning("refused %s:%d: %d connections are open", address, port, MOST_CONNECTIONS)
            sock.close()
            return
        connection = self._connection(sock, f"{address}:{port}")
        self._connections.add(connection)
        connection.on_close = lambda: self._connections.discard(connection)
        self._greet(connection)
        connection.start()

    def _connection(self, sock: socket.socket, peer: str) -> Connection:
        return Connection(sock, self._loop, self._tally, peer=peer, reader=self._make_reader())

    def _facts(self) -> tuple[str, ...]:
        return str(self.place), f"{len(self._connections)} connected"
