"""The servers of a node: where the master calls it, and where other nodes connect."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from typing import Any

from baxter_kin.display import OneLine
from baxter_kin.fields import NotCopied
from sim.errors import RosError
from sim.ros1.transport import xmlrpc
from sim.ros1.transport.addresses import Address, LocalHost, find_local_host, master_uri, parse_uri
from sim.ros1.transport.event_loop import EventLoop
from sim.ros1.transport.registration import MasterClient, Registration, Role
from sim.ros1.transport.services import ServiceServer
from sim.ros1.transport.streams import (
    HANDSHAKE_S,
    MAX_HEADER,
    Fields,
    ProtocolError,
    Refusal,
    Server,
    Stream,
    framed_header,
    parse_header,
    within,
)
from sim.ros1.transport.topics import Publication

ALIVE_S = 1.0
"""Time in which a node of the same name that is running answers."""

OK = xmlrpc.SUCCESS

_LOG = logging.getLogger(__name__)


class NodeServer(NotCopied, OneLine):
    """The network side of a node, in an event loop of its own.

    Attributes:
        name: full name of the node.
        loop: of all its connections.
        master: calls the master.
        registration: the topics and services of the node.
        uri: of its XML-RPC server.
    """

    def __init__(
        self,
        name: str,
        given_uri: str | None,
        host: str | None,
        shut_down: Callable[[str], None],
        *,
        takes_over: bool = True,
    ) -> None:
        """Listen, and make sure that the master answers; nothing is registered yet.

        Args:
            name: full name of the node.
            given_uri: of the master, instead of ROS_MASTER_URI.
            host: name or address of this computer, instead of ROS_HOSTNAME and ROS_IP.
            shut_down: called with a reason when the node is to end.
            takes_over: whether the master ends a running node of that name, as ROS does; otherwise
                this one is refused.
        """
        self.name = name
        self.master = MasterClient(master_uri(given_uri), name)
        local = find_local_host(self.master.uri, host)
        self._shut_down = shut_down
        self.loop = EventLoop(f"node {name}")
        try:
            self.loop.run(self._start(local, takes_over))
        except BaseException:
            self.loop.close()
            raise

    async def _start(self, local: LocalHost, takes_over: bool) -> None:
        self._peers = Server(self.loop, self._welcome)
        await self._peers.start(Address(local.address, 0))
        self._address = Address(local.name, self._peers.address.port)
        calls = Server(self.loop, xmlrpc.XmlRpcHandler(self._methods()).serve)
        await calls.start(Address(local.address, 0))
        self.uri = f"http://{local.name}:{calls.address.port}/"
        self.registration = Registration(
            self.master,
            self.name,
            self.loop,
            uri=self.uri,
            service_uri=f"rosrpc://{self._address}",
            on_taken=self._shut_down,
        )
        await self.master.call("getPid")  # fails while nothing is registered
        if not takes_over:
            await self._refuse_running_node()
        self.loop.spawn(self.registration.keep())

    @property
    def peers(self) -> frozenset[Stream]:
        """The connections that other nodes have opened to topics and services."""
        return frozenset(self._peers.streams)

    def close(self) -> None:
        """Unregister everything, close all connections, end the thread."""
        try:
            self.loop.run(self.registration.close())
        except RosError:  # closed already
            return
        self.loop.close()

    async def _refuse_running_node(self) -> None:
        """One that was killed is still registered, but does not answer: its name is taken over."""
        try:
            uri = await self.master.node_uri(self.name)
            process = await xmlrpc.call(uri, "getPid", self.name, node=self.name, timeout_s=ALIVE_S)
        except RosError:
            return
        raise RosError(
            f"{self.name} runs already, as process {process} at {parse_uri(uri)}; end it first, or"
            " wait until it has ended"
        )

    async def _welcome(self, stream: Stream) -> None:
        """Serve a subscriber, or a client of a service."""
        fields = parse_header(await within(HANDSHAKE_S, stream.read_frame(MAX_HEADER)))
        stream.peer = f"{fields.get('callerid', 'a node')} at {stream.peer}"
        try:
            await self._endpoint(fields).accept(stream, fields)
        except Refusal as refusal:
            self.loop.count("refused")
            _LOG.warning("refused %s: %s", stream.peer, refusal)
            stream.send(framed_header({"error": str(refusal)}))
            await stream.finish()

    def _endpoint(self, fields: Fields) -> Publication | ServiceServer:
        for role, key in ((Role.PUBLISHER, "topic"), (Role.SERVICE, "service")):
            if key in fields:
                for endpoint in self.registration.of(role):
                    if endpoint.name == fields[key]:
                        return endpoint  # type: ignore[no-any-return]
                raise Refusal(f"{key} {fields[key]} is not offered here")
        raise ProtocolError("a header without topic and service")

    def _methods(self) -> dict[str, xmlrpc.Method]:
        """What the master, other nodes and rosnode call (ROS wiki, "Slave API")."""
        return {
            "getBusInfo": self._bus_info,
            "getBusStats": self._bus_stats,
            "getMasterUri": lambda _caller: (OK, "master", self.master.uri),
            "getPid": lambda _caller: (OK, "", os.getpid()),
            "getPublications": lambda _caller: (OK, "", self._topics(Role.PUBLISHER)),
            "getSubscriptions": lambda _caller: (OK, "", self._topics(Role.SUBSCRIBER)),
            "paramUpdate": lambda _caller, _key, _value: (OK, "not subscribed", 0),
            "publisherUpdate": self._publisher_update,
            "requestTopic": self._request_topic,
            "shutdown": self._shutdown,
        }

    def _request_topic(self, _caller: str, topic: str, protocols: Any) -> tuple[int, str, Any]:
        if not any(each.name == topic for each in self.registration.of(Role.PUBLISHER)):
            raise RosError(f"not a publisher of {topic}")
        if not any(wish and wish[0] == "TCPROS" for wish in protocols):
            return 0, "only TCPROS is supported", []
        host, port = self._address
        return OK, f"ready on {host}:{port}", ["TCPROS", host, port]

    def _publisher_update(self, _caller: str, topic: str, uris: Any) -> tuple[int, str, int]:
        self.registration.connect(topic, map(str, uris))
        return OK, "", 0

    def _shutdown(self, caller: str, reason: str = "") -> tuple[int, str, int]:
        self._shut_down(f"{caller} shut this node down{f': {reason}' if reason else ''}")
        return OK, "shutdown", 0

    def _topics(self, role: Role) -> list[list[str]]:
        types = {each.name: each.type.name for each in self.registration.of(role)}
        return [[topic, kind] for topic, kind in types.items()]

    def _bus_info(self, _caller: str) -> tuple[int, str, Any]:
        rows = [
            [peer, direction, "TCPROS", each.name, stream.is_open]
            for role, direction in ((Role.PUBLISHER, "o"), (Role.SUBSCRIBER, "i"))
            for each in self.registration.of(role)
            for stream, peer in each.connections
        ]
        return OK, "bus info", [[number, *row] for number, row in enumerate(rows, 1)]

    def _bus_stats(self, _caller: str) -> tuple[int, str, Any]:
        """Bytes by connection; the number of messages is not counted."""
        sent = [
            [each.name, 0, [[n, s.sent, 0, s.is_open] for n, (s, _) in _numbered(each)]]
            for each in self.registration.of(Role.PUBLISHER)
        ]
        received = [
            [each.name, [[n, s.received, 0, -1, s.is_open] for n, (s, _) in _numbered(each)]]
            for each in self.registration.of(Role.SUBSCRIBER)
        ]
        return OK, "", [sent, received, []]

    def _facts(self) -> tuple[str, ...]:
        return self.name, self.uri


def _numbered(endpoint: Any) -> Any:
    return enumerate(endpoint.connections, 1)
