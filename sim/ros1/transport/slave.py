"""What a node answers to the master, to other nodes and to rosnode (ROS wiki, "Slave API")."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

from sim.errors import RosError
from sim.ros1.transport.tcpros.board import Board
from sim.ros1.transport.xmlrpc.server import Method

OK = 1


class Slave:
    """The methods of a node's XML-RPC server."""

    def __init__(self, board: Board, master_uri: str, shut_down: Callable[[str], None]) -> None:
        """Answer for a node.

        Args:
            board: what it publishes, listens to and serves.
            master_uri: its master.
            shut_down: called with a reason when the node is to end.
        """
        self._board = board
        self._master_uri = master_uri
        self._shut_down = shut_down

    def methods(self) -> dict[str, Method]:
        """By their names on the wire."""
        return {
            "getBusInfo": self._bus_info,
            "getBusStats": self._bus_stats,
            "getMasterUri": lambda _caller: (OK, "master", self._master_uri),
            "getPid": lambda _caller: (OK, "", os.getpid()),
            "getPublications": self._publications,
            "getSubscriptions": self._subscriptions,
            "paramUpdate": lambda _caller, _key, _value: (OK, "not subscribed", 0),
            "publisherUpdate": self._publisher_update,
            "requestTopic": self._request_topic,
            "shutdown": self._shutdown,
        }

    def _request_topic(self, _caller: str, topic: str, protocols: Any) -> tuple[int, str, Any]:
        if topic not in self._board.publications:
            raise RosError(f"not a publisher of {topic}")
        if not any(wish and wish[0] == "TCPROS" for wish in protocols):
            return 0, "only TCPROS is spoken here", []
        host, port = self._board.place
        return OK, f"ready on {host}:{port}", ["TCPROS", host, port]

    def _publisher_update(self, _caller: str, topic: str, uris: Any) -> tuple[int, str, int]:
        uris = [str(uri) for uri in uris]
        for subscription in self._board.subscriptions.get(topic, ()):
            subscription.update(uris)
        return OK, "", 0

    def _shutdown(self, caller: str, reason: str = "") -> tuple[int, str, int]:
        self._shut_down(f"{caller} shut this node down{f': {reason}' if reason else ''}")
        return OK, "shutdown", 0

    def _publications(self, _caller: str) -> tuple[int, str, Any]:
        found = self._board.publications.values()
        return OK, "publications", [[each.topic, each.type.name] for each in found]

    def _subscriptions(self, _caller: str) -> tuple[int, str, Any]:
        found = self._board.subscriptions.values()
        return OK, "subscriptions", [[each[0].topic, each[0].type.name] for each in found]

    def _bus_info(self, _caller: str) -> tuple[int, str, Any]:
        rows: list[list[Any]] = []
        for publication in tuple(self._board.publications.values()):
            for connection, reader in publication.connections:
                rows.append([reader, "o", publication.topic, connection.is_open])
        for subscriptions in tuple(self._board.subscriptions.values()):
            for subscription in subscriptions:
                for connection, uri in subscription.connections:
                    rows.append([uri, "i", subscription.topic, connection.is_open])
        numbered = [
            [number, peer, way, "TCPROS", topic, is_open]
            for number, (peer, way, topic, is_open) in enumerate(rows, 1)
        ]
        return OK, "bus info", numbered

    def _bus_stats(self, _caller: str) -> tuple[int, str, Any]:
        """Bytes by connection; how many messages they were is not counted."""
        sent = [
            [each.topic, 0, [[n, c.traffic[1], 0, c.is_open] for n, (c, _) in _numbered(each)]]
            for each in tuple(self._board.publications.values())
        ]
        received = [
            [each.topic, [[n, c.traffic[0], 0, -1, c.is_open] for n, (c, _) in _numbered(each)]]
            for subscriptions in tuple(self._board.subscriptions.values())
            for each in subscriptions
        ]
        return OK, "", [sent, received, []]


def _numbered(topic: Any) -> Any:
    return enumerate(topic.connections, 1)
