"""What a node asks the master, and what it has registered there.

The calls are those of the ROS wiki's "Master API" and "Parameter server API".
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable
from enum import Enum
from typing import Any, TypeAlias

from baxter_kin.display import OneLine, count
from baxter_kin.fields import NotCopied
from sim.errors import RosConnectionError, RosError
from sim.ros1.transport import xmlrpc
from sim.ros1.transport.event_loop import EventLoop
from sim.ros1.transport.services import ServiceServer
from sim.ros1.transport.topics import Publication, Subscription

CHECK_S = 2.0
"""Time between two checks that the master still knows the node."""

MASTER_S = 3.0
"""Time limit for an answer of the master."""

_LOG = logging.getLogger(__name__)

Endpoint: TypeAlias = Publication | Subscription | ServiceServer
"""What can be registered."""


class Role(str, Enum):
    """What a node is to a topic or service; part of the names of the master's methods."""

    PUBLISHER = "Publisher"
    SUBSCRIBER = "Subscriber"
    SERVICE = "Service"

    @staticmethod
    def of(endpoint: Endpoint) -> Role:
        """The role that an endpoint gives its node."""
        if isinstance(endpoint, Publication):
            return Role.PUBLISHER
        return Role.SUBSCRIBER if isinstance(endpoint, Subscription) else Role.SERVICE


class MasterClient(OneLine):
    """Calls the master in the name of a node.

    A call raises `RosError` when it is refused, and `RosConnectionError` when the master cannot be
    reached.

    Attributes:
        uri: of the master.
    """

    def __init__(self, uri: str, node: str) -> None:
        self.uri = uri
        self._node = node

    async def call(self, method: str, *args: Any) -> Any:
        """The value of the master's answer."""
        return await xmlrpc.call(
            self.uri, method, self._node, *args, node="the master", timeout_s=MASTER_S
        )

    async def node_uri(self, name: str) -> str:
        """The XML-RPC server of a node."""
        return str(await self.call("lookupNode", name))

    async def system(self) -> tuple[dict[str, tuple[str, ...]], ...]:
        """Publishers and subscribers by topic, and providers by service."""
        return tuple(
            {str(name): tuple(map(str, nodes)) for name, nodes in part}
            for part in await self.call("getSystemState")
        )

    async def node_at(self, uri: str) -> str:
        """The name of the node with that XML-RPC server; empty when it is not known."""
        try:
            parts = await self.system()
            for name in sorted(
                {each for part in parts for nodes in part.values() for each in nodes}
            ):
                if await self.node_uri(name) == uri:
                    return name
        except RosError:
            pass
        return ""

    def _facts(self) -> tuple[str, ...]:
        return (self.uri,)


class Registration(NotCopied, OneLine):
    """Registers endpoints at the master, and again when the master has forgotten them.

    Once the node runs, a master that cannot be reached is no error: connections stay as they are,
    and what is added meanwhile is registered when the master is back.

    Attributes:
        endpoints: what is registered, or is to be; one topic may have several subscriptions.
    """

    def __init__(
        self,
        master: MasterClient,
        node: str,
        loop: EventLoop,
        *,
        uri: str,
        service_uri: str,
        on_taken: Callable[[str], None],
    ) -> None:
        """Nothing is registered yet.

        Args:
            master: where to register.
            node: our name.
            loop: in which to check the registration.
            uri: of our XML-RPC server.
            service_uri: where clients of services connect.
            on_taken: called with the reason when another node has taken our name.
        """
        self.endpoints: list[Endpoint] = []
        self._master = master
        self._node = node
        self._loop = loop
        self._uri = uri
        self._service_uri = service_uri
        self._on_taken = on_taken
        self._turn = asyncio.Lock()  # of calls of the master that change something
        self._is_known = True

    def of(self, role: Role) -> tuple[Any, ...]:
        """The endpoints with a role."""
        return tuple(each for each in self.endpoints if Role.of(each) is role)

    def subscriptions_of(self, topic: str) -> tuple[Subscription, ...]:
        """The subscriptions to a topic."""
        return tuple(each for each in self.of(Role.SUBSCRIBER) if each.name == topic)

    async def add(self, endpoint: Endpoint) -> None:
        """Register an endpoint now, or when the master is back."""
        self.endpoints.append(endpoint)
        async with self._turn:
            try:
                await self._register(endpoint)
            except RosConnectionError as error:
                self._lose(error)
            except RosError:
                self.endpoints.remove(endpoint)
                raise

    async def remove(self, endpoint: Endpoint) -> None:
        """Disconnect an endpoint, and unregister it unless there is another of its name."""
        if endpoint not in self.endpoints:
            return
        self.endpoints.remove(endpoint)
        endpoint.close()
        async with self._turn:
            if not any(each.name == endpoint.name for each in self.of(Role.of(endpoint))):
                await self._unregister(endpoint)

    async def close(self) -> None:
        """Unregister everything, or stop when the master cannot be reached."""
        async with self._turn:
            while self.endpoints and await self._unregister(self.endpoints[-1]):
                self.endpoints.pop()
            self.endpoints.clear()

    async def keep(self) -> None:
        """Check every `CHECK_S` that the master knows us; register everything if it does not."""
        while True:
            await asyncio.sleep(CHECK_S)
            try:
                uri = await self._master.node_uri(self._node)
            except RosConnectionError as error:
                self._lose(error)
                continue
            except RosError:
                uri = ""
            if uri and uri != self._uri:
                self._on_taken(f"another node has taken the name {self._node}: {uri}")
            elif not (uri and self._is_known):
                await self._register_all()

    def _lose(self, error: RosError) -> None:
        if self._is_known:
            _LOG.warning("%s; trying again every %g s", error, CHECK_S)
        self._is_known = False

    async def _register_all(self) -> None:
        async with self._turn:
            if not self.endpoints:
                return
            try:
                for endpoint in tuple(self.endpoints):
                    await self._register(endpoint)
            except RosError as error:
                self._lose(error)
                return
            self._is_known = True
        self._loop.count("registrations")
        _LOG.warning("registered %s again at %s", self._node, self._master.uri)

    async def _register(self, endpoint: Endpoint) -> None:
        if isinstance(endpoint, ServiceServer):
            args = endpoint.name, self._service_uri, self._uri
            await self._master.call("registerService", *args)
            return
        method = f"register{Role.of(endpoint).value}"
        found = await self._master.call(method, endpoint.name, endpoint.type.name, self._uri)
        if isinstance(endpoint, Subscription):
            self.connect(endpoint.name, map(str, found))

    def connect(self, topic: str, uris: Iterable[str]) -> None:
        """Connect the subscriptions to a topic with its publishers."""
        found = tuple(uris)
        for subscription in self.subscriptions_of(topic):
            subscription.update(found)

    async def _unregister(self, endpoint: Endpoint) -> bool:
        """Whether the master was reached."""
        role = Role.of(endpoint)
        uri = self._service_uri if role is Role.SERVICE else self._uri
        try:
            await self._master.call(f"unregister{role.value}", endpoint.name, uri)
        except RosConnectionError:
            return False
        except RosError:  # it does not know it any more
            pass
        return True

    def _facts(self) -> tuple[str, ...]:
        return self._node, count(len(self.endpoints), "endpoint")
