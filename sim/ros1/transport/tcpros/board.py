"""What a node publishes, listens to and serves, and the port where others come for it."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import TYPE_CHECKING

from baxter_kin.display import OneLine, count
from baxter_kin.fields import NotCopied
from sim.ros1.transport.network.addresses import Home, Place
from sim.ros1.transport.network.framing import (
    LONGEST_HEADER,
    FrameReader,
    ProtocolError,
    framed_header,
    parse_header,
)
from sim.ros1.transport.network.listener import Listener
from sim.ros1.transport.tcpros.handshake import HANDSHAKE_S, Refusal

if TYPE_CHECKING:
    from sim.ros1.transport.network.connection import Connection
    from sim.ros1.transport.network.counts import Tally
    from sim.ros1.transport.network.loop import Loop
    from sim.ros1.transport.tcpros.publication import Publication
    from sim.ros1.transport.tcpros.service_server import ServiceServer
    from sim.ros1.transport.tcpros.subscription import Subscription

_LOG = logging.getLogger(__name__)


class Board(NotCopied, OneLine):
    """The topics and services of a node; readers and clients are led to theirs.

    Attributes:
        place: where readers and clients connect, by the name that is told to them.
        publications: by topic.
        subscriptions: by topic; several may be of one.
        services: by name.
    """

    def __init__(self, home: Home, loop: Loop, tally: Tally) -> None:
        """An empty one that listens at a free port."""
        self._tally = tally
        self.publications: dict[str, Publication] = {}
        self.subscriptions: dict[str, tuple[Subscription, ...]] = {}
        self.services: dict[str, ServiceServer] = {}
        self._listener = Listener(
            Place(home.address, 0),
            loop,
            tally,
            greet=self._greet,
            make_reader=lambda: FrameReader(LONGEST_HEADER),
        )
        self.place = Place(home.name, self._listener.place.port)

    @property
    def connections(self) -> tuple[Connection, ...]:
        """Those that others have opened: readers, clients, and who has not said yet."""
        return self._listener.connections

    def close(self) -> None:
        """Send everybody away, in the loop's thread."""
        self._listener.close()
        for publication in tuple(self.publications.values()):
            publication.close()
        for subscriptions in tuple(self.subscriptions.values()):
            for subscription in subscriptions:
                subscription.close()
        for service in tuple(self.services.values()):
            service.close()

    def _greet(self, connection: Connection) -> None:
        connection.expect_within(HANDSHAKE_S)
        connection.on_frame = lambda content: self._lead(connection, content)

    def _lead(self, connection: Connection, content: bytes) -> None:
        fields = parse_header(content)
        connection.expect_within(None)
        connection.peer = f"{fields.get('callerid', 'somebody')} at {connection.peer}"
        try:
            self._offer(fields).accept(connection, fields)
        except Refusal as refusal:
            self._tally.add("refused")
            _LOG.warning("refused %s: %s", connection.peer, refusal)
            connection.on_frame = lambda _: None
            connection.send(framed_header({"error": str(refusal)}))
            connection.close_after_sending()

    def _offer(self, fields: Mapping[str, str]) -> Publication | ServiceServer:
        topic, service = fields.get("topic"), fields.get("service")
        if topic is not None and topic in self.publications:
            return self.publications[topic]
        if service is not None and service in self.services:
            return self.services[service]
        if topic is None and service is None:
            raise ProtocolError("a header without topic and service")
        wanted = f"topic {topic}" if topic is not None else f"service {service}"
        raise Refusal(f"{wanted} is not offered here")

    def _facts(self) -> tuple[str, ...]:
        return (
            count(len(self.publications), "publication"),
            count(len(self.subscriptions), "subscription"),
            count(len(self.services), "service"),
        )
