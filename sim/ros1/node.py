"""A node of ROS 1: topics, services and parameters, without any of ROS's own software."""

from __future__ import annotations

import atexit
import logging
import threading
import time
from collections.abc import Callable, Coroutine
from contextlib import AbstractContextManager
from typing import Any, TypeVar

from baxter_kin.display import OneLine, listing
from baxter_kin.fields import NotCopied
from baxter_kin.validation import expect
from sim.errors import RosConnectionError, RosError, RosMessageError
from sim.ros1.definitions import message_type, service_type
from sim.ros1.transport.addresses import Address, full_name, node_name, parse_uri
from sim.ros1.transport.event_loop import Counts
from sim.ros1.transport.node_server import NodeServer
from sim.ros1.transport.registration import Endpoint, Role
from sim.ros1.transport.services import ServiceServer, call_service, probe_service
from sim.ros1.transport.topics import Callback, Publication, Received, Subscription
from sim.ros1_messages import Message, MessageType, ServiceType

__all__ = ["Node", "Publisher", "Received", "Service", "Subscriber"]

LOG_TOPIC = "/rosout"
LOG_QUEUE = 100

CALL_S = 5.0
"""Default time limit for a response of a service."""

POLL_S = 0.05
"""Time between two attempts to reach a service."""

_PYTHON_LEVELS = logging.DEBUG, logging.INFO, logging.WARNING, logging.ERROR, logging.CRITICAL
LEVELS = dict(zip(_PYTHON_LEVELS, (1, 2, 4, 8, 16), strict=True))
"""The levels of rosgraph_msgs/Log by Python's levels."""

_MISSING = object()
"""Stands for a default that was not given."""

T = TypeVar("T")


class Publisher(NotCopied, OneLine):
    """A topic that a node publishes, until it is closed.

    Attributes:
        topic: its full name.
        type: makes its messages.
    """

    def __init__(self, publication: Publication, close: Callable[[], None]) -> None:
        self.topic = publication.name
        self.type: MessageType = publication.type
        self._publication = publication
        self._close = close

    @property
    def readers(self) -> tuple[str, ...]:
        """The names of the nodes that subscribe."""
        return tuple(self._publication.readers.values())

    def publish(self, message: Message) -> None:
        """Send a message to all subscribers, without waiting; any thread may call this.

        The sequence number of a header is filled in. A slow subscriber gets the newest messages.
        """
        self._publication.publish(message)

    def send(self, **values: object) -> None:
        """Make a message and publish it; nothing is made when nobody subscribes.

        Args:
            **values: by field, as for `MessageType.make`.
        """
        if self._publication.readers or self._publication.latch:
            self._publication.publish(self.type.make(**values))

    def close(self) -> None:
        """Unregister the topic and disconnect its subscribers; closing twice is harmless."""
        self._close()

    def _facts(self) -> tuple[str, ...]:
        return self.topic, self.type.name, listing(self.readers, "reader")


class Subscriber(NotCopied, OneLine):
    """A topic that a node subscribes to, until it is closed.

    Attributes:
        topic: its full name.
        type: of its messages.
    """

    def __init__(self, subscription: Subscription, close: Callable[[], None]) -> None:
        self.topic = subscription.name
        self.type: MessageType = subscription.type
        self._subscription = subscription
        self._close = close

    @property
    def writers(self) -> tuple[str, ...]:
        """The names of the publishers that are connected."""
        return self._subscription.writers

    @property
    def publisher_uris(self) -> frozenset[str]:
        """The XML-RPC servers of all publishers that the master knows, connected or not."""
        return self._subscription.publisher_uris

    def close(self) -> None:
        """Unregister the subscription and disconnect; closing twice is harmless."""
        self._close()

    def _facts(self) -> tuple[str, ...]:
        return self.topic, self.type.name, listing(self.writers, "writer")


class Service(NotCopied, OneLine):
    """A service that a node offers, until it is closed.

    Attributes:
        name: its full name.
        type: makes its responses.
    """

    def __init__(self, server: ServiceServer, close: Callable[[], None]) -> None:
        self.name = server.name
        self.type: ServiceType = server.type
        self._close = close

    def close(self) -> None:
        """Unregister the service and disconnect its clients; closing twice is harmless."""
        self._close()

    def _facts(self) -> tuple[str, ...]:
        return self.name, self.type.name


class Node(NotCopied, OneLine):
    """A node, from its registration at the master until it is closed; a context manager.

    Names are global, such as "/robot/state", relative to /, or private, such as "~rate". Types are
    those of `sim.ros1.definitions`. Any thread may call any method; callbacks run in the node's own
    thread and must not call a method that waits for an answer. Methods that ask the master or a
    service raise `RosConnectionError` when it cannot be reached.

    Attributes:
        name: its full name, such as "/baxter_kin".
        uri: of its XML-RPC server.
        master_uri: of its master.
    """

    def __init__(
        self,
        name: str,
        *,
        master_uri: str | None = None,
        host: str | None = None,
        takes_over: bool = True,
    ) -> None:
        """Register a node.

        Args:
            name: such as "/baxter_kin".
            master_uri: instead of ROS_MASTER_URI.
            host: name or address of this computer, instead of ROS_HOSTNAME and ROS_IP. The node
                listens on that address only.
            takes_over: whether the master shuts down a running node of the same name, as ROS does;
                otherwise this one is refused.

        Raises:
            RosMessageError: when a name or an address is malformed.
            RosConnectionError: when the master cannot be reached, or the node cannot listen there.
            RosError: when the package `rosbags` is missing, or the name is that of another running
                node and is not taken over.
        """
        self.name = node_name(name)
        message_type("std_msgs/Empty")  # fails when the package is missing
        self._ended = threading.Event()
        self._reason: str | None = None
        self._server = NodeServer(
            self.name, master_uri, host, self._shut_down, takes_over=takes_over
        )
        self._master = self._server.master
        self.uri = self._server.uri
        self.master_uri = self._master.uri
        try:
            self._log = self.advertise(LOG_TOPIC, "rosgraph_msgs/Log", queue=LOG_QUEUE)
        except RosError:
            self._server.close()
            raise
        atexit.register(self.close)

    def __enter__(self) -> Node:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Unregister everything and end; closing twice is harmless."""
        atexit.unregister(self.close)
        if self._server.loop.is_current:
            self._close_in_thread()
            return
        self._server.close()
        self._ended.set()

    @property
    def reason_for_end(self) -> str | None:
        """Why others ended the node, such as one that took its name; None if nobody has."""
        return self._reason

    def wait_closed(self, timeout_s: float | None = None) -> bool:
        """Wait until the node is closed, by us or by others; False when the time is over."""
        return self._ended.wait(timeout_s)

    @property
    def counts(self) -> Counts:
        """What went wrong on the network so far."""
        return self._server.loop.counts

    def advertise(
        self, topic: str, type_name: str, *, latch: bool = False, queue: int = 1
    ) -> Publisher:
        """Publish a topic.

        Args:
            topic: its name.
            type_name: such as "sensor_msgs/JointState".
            latch: whether later subscribers get the last message.
            queue: maximum number of messages that wait for a slow subscriber; newer ones replace
                older ones.

        Raises:
            RosMessageError: when the name is malformed or the type is not known.
            RosError: when this node publishes it already, or the master refuses.
        """
        name = self._unused(topic, Role.PUBLISHER, "publishes", "publisher")
        if expect(queue, int, "queue", RosMessageError) < 1:
            raise RosMessageError(f"queue must be 1 or more, got {queue}")
        publication = Publication(
            name,
            message_type(type_name),
            node=self.name,
            loop=self._server.loop,
            latch=latch,
            queue=queue,
        )
        return Publisher(publication, self._register(publication))

    def together(self) -> AbstractContextManager[None]:
        """Send all messages that the block publishes right after each other.

        At its end the caller waits until they are sent, for a few milliseconds at most.
        """
        return self._server.loop.together()

    def subscribe(self, topic: str, type_name: str, callback: Callback) -> Subscriber:
        """Subscribe to a topic, from all its publishers.

        Args:
            topic: its name.
            type_name: such as "sensor_msgs/JointState".
            callback: called with every message, in the node's thread; it should be short.

        Raises:
            RosMessageError: when the name is malformed or the type is not known.
            RosError: when the master refuses.
        """
        subscription = Subscription(
            full_name(topic, self.name),
            message_type(type_name),
            callback,
            node=self.name,
            loop=self._server.loop,
            name_of=self._master.node_at,
        )
        return Subscriber(subscription, self._register(subscription))

    def serve(self, name: str, type_name: str, handler: Callable[[Message], Message]) -> Service:
        """Offer a service.

        Args:
            name: its name.
            type_name: such as "gazebo_msgs/SpawnModel".
            handler: returns the response to a request, in a thread of its own, one request after
                the other; the text of a `ServiceRefused` that it raises is sent to the client.

        Raises:
            RosMessageError: when the name is malformed or the type is not known.
            RosError: when this node serves it already, or the master refuses.
        """
        full = self._unused(name, Role.SERVICE, "serves", "service")
        kind = service_type(type_name)
        server = ServiceServer(full, kind, handler, node=self.name, loop=self._server.loop)
        return Service(server, self._register(server))

    def call(
        self, service: str, type_name: str, request: Message, *, timeout_s: float = CALL_S
    ) -> Message:
        """The response of a service of any node.

        Args:
            service: its name.
            type_name: such as "gazebo_msgs/SpawnModel".
            request: made by the type's request.
            timeout_s: time limit.
        """
        name = full_name(service, self.name)
        kind = service_type(type_name)
        content = kind.request.serialise(request)

        async def response() -> Message:
            address = await self._find_service(name)
            return await call_service(
                address, name, kind, content, node=self.name, timeout_s=timeout_s
            )

        return self._run(response())

    def wait_for_service(self, service: str, timeout_s: float) -> bool:
        """Wait until a service can be reached; False when the time is over."""
        name = full_name(service, self.name)
        end = time.monotonic() + timeout_s
        while not self._run(self._is_served(name, max(POLL_S, end - time.monotonic()))):
            if time.monotonic() + POLL_S > end or self._ended.wait(POLL_S):
                return False
        return True

    def parameter(self, name: str, default: Any = _MISSING) -> Any:
        """A parameter's value: a bool, number, text, list, or a mapping of those below it.

        Args:
            name: its name.
            default: returned when the parameter is not set.
        """
        try:
            return self._ask("getParam", full_name(name, self.name))
        except RosConnectionError:
            raise
        except RosError:
            if default is _MISSING:
                raise
            return default

    def set_parameter(self, name: str, value: Any) -> None:
        """Set a parameter for all nodes."""
        self._ask("setParam", full_name(name, self.name), value)

    def delete_parameter(self, name: str) -> None:
        """Remove a parameter, and those below it."""
        self._ask("deleteParam", full_name(name, self.name))

    def has_parameter(self, name: str) -> bool:
        """Whether a parameter is set."""
        return bool(self._ask("hasParam", full_name(name, self.name)))

    def parameter_names(self) -> tuple[str, ...]:
        """All parameters that are set."""
        return tuple(map(str, self._ask("getParamNames")))

    def publishers_of(self, topic: str) -> tuple[str, ...]:
        """The names of the nodes that the master has as publishers of a topic."""
        return self._run(self._master.system())[0].get(full_name(topic, self.name), ())

    def subscribers_of(self, topic: str) -> tuple[str, ...]:
        """The names of the nodes that the master has as subscribers of a topic."""
        return self._run(self._master.system())[1].get(full_name(topic, self.name), ())

    def providers_of(self, service: str) -> tuple[str, ...]:
        """The name of the node that the master has for a service; empty when there is none."""
        return self._run(self._master.system())[2].get(full_name(service, self.name), ())

    def nodes(self) -> tuple[str, ...]:
        """The names of all nodes that the master knows."""
        state = self._run(self._master.system())
        return tuple(sorted({name for part in state for names in part.values() for name in names}))

    def topics(self) -> dict[str, str]:
        """The types of all topics that somebody publishes or subscribes to, by topic."""
        return {str(name): str(kind) for name, kind in self._ask("getTopicTypes")}

    def log(self, text: str, level: int = logging.INFO) -> None:
        """Write a line to /rosout.

        Args:
            text: the line.
            level: one of Python's, such as `logging.WARNING`.

        Raises:
            RosMessageError: when the level is not one of them.
        """
        if level not in LEVELS:
            raise RosMessageError(f"not a level of the package logging: {level!r}")
        header = {"stamp": time.time()}
        self._log.send(header=header, level=LEVELS[level], name=self.name, msg=text)

    def _run(self, coroutine: Coroutine[Any, Any, T]) -> T:
        return self._server.loop.run(coroutine)

    def _ask(self, method: str, *args: Any) -> Any:
        return self._run(self._master.call(method, *args))

    def _unused(self, name: str, role: Role, does: str, what: str) -> str:
        """The full name of a topic or service that this node does not offer yet."""
        full = full_name(name, self.name)
        if any(each.name == full for each in self._server.registration.of(role)):
            raise RosError(f"{self.name} {does} {full} already; close the other {what} first")
        return full

    def _register(self, endpoint: Endpoint) -> Callable[[], None]:
        """Register an endpoint; returns the function that undoes that."""
        registration, loop = self._server.registration, self._server.loop
        self._run(registration.add(endpoint))

        def close() -> None:
            if loop.is_current:
                loop.spawn(registration.remove(endpoint))
            elif not self._ended.is_set():
                self._run(registration.remove(endpoint))

        return close

    async def _is_served(self, name: str, timeout_s: float) -> bool:
        try:
            address = await self._find_service(name)
            await probe_service(address, name, node=self.name, timeout_s=timeout_s)
        except RosConnectionError:
            return False
        return True

    async def _find_service(self, name: str) -> Address:
        try:
            return parse_uri(str(await self._master.call("lookupService", name)))
        except RosConnectionError:
            raise
        except RosError as cause:
            raise RosConnectionError(
                f"nobody offers the service {name}", node=name, remedy="see that its node runs"
            ) from cause

    def _shut_down(self, reason: str) -> None:
        if self._reason is None:
            self._reason = reason
            logging.getLogger(__name__).warning("%s: %s", self.name, reason)
            self._close_in_thread()

    def _close_in_thread(self) -> None:
        """Close from the loop's own thread, which cannot wait for itself."""
        threading.Thread(target=self.close, name=f"end of {self.name}", daemon=True).start()

    def _facts(self) -> tuple[str, ...]:
        return self.name, self.uri, "closed" if self._ended.is_set() else ""
