"""A node of ROS 1: topics, services and parameters, without any of ROS's own software."""

from __future__ import annotations

import atexit
import logging
import threading
import time
from collections.abc import Callable

from baxter_kin.display import OneLine
from baxter_kin.fields import NotCopied
from baxter_kin.validation import expect
from sim.errors import RosError, RosMessageError
from sim.ros1.definitions import message_type, service_type
from sim.ros1.offers import Publisher, Service, Subscriber
from sim.ros1.questions import Questions
from sim.ros1.service_calls import ServiceCalls
from sim.ros1.transport.names import full_name, node_name
from sim.ros1.transport.network.counts import Counts
from sim.ros1.transport.presence import Presence
from sim.ros1.transport.registry import Entry, Role
from sim.ros1.transport.tcpros.publication import Publication
from sim.ros1.transport.tcpros.service_server import ServiceServer
from sim.ros1.transport.tcpros.subscription import Callback, Subscription
from sim.ros1_fields import Message

LOG_TOPIC = "/rosout"
LOG_QUEUE = 100

_PYTHONS = logging.DEBUG, logging.INFO, logging.WARNING, logging.ERROR, logging.CRITICAL
LEVELS = dict(zip(_PYTHONS, (1, 2, 4, 8, 16), strict=True))
"""What Python's levels are in rosgraph_msgs/Log."""


class Node(Questions, ServiceCalls, NotCopied, OneLine):
    """A node, from its registration at the master until it is closed. A context manager.

    Names are global, as "/robot/state", relative to /, or private, as "~rate". Types are those of
    `sim.ros1.definitions`. Any thread may call any method, but what waits for an answer must not be
    called by a callback.

    Attributes:
        name: in full, such as "/baxter_kin".
        uri: where its XML-RPC server is.
        master_uri: where its master is.
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
            host: this computer's name or address, instead of ROS_HOSTNAME and ROS_IP. The node
                listens on that address only.
            takes_over: whether a living node of the same name is shut down by the master, as ROS
                has it; else this one is refused.

        Raises:
            RosMessageError: when a name or an address is none.
            RosConnectionError: when the master cannot be reached, or it cannot listen there.
            RosError: when the package `rosbags` is missing, or the name is another living node's
                and it is not taken over.
        """
        self.name = node_name(name)
        message_type("std_msgs/Empty")  # says what is missing
        self._ended = threading.Event()
        self._reason: str | None = None
        self._presence = Presence(
            self.name, master_uri, host, self._shut_down, takes_over=takes_over
        )
        self._master = self._presence.master
        self.uri = self._presence.uri
        self.master_uri = self._master.uri
        try:
            self._log = self.advertise(LOG_TOPIC, "rosgraph_msgs/Log", queue=LOG_QUEUE)
        except RosError:
            self._presence.close()
            raise
        atexit.register(self.close)

    def __enter__(self) -> Node:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Unregister everything and end; twice is no trouble."""
        atexit.unregister(self.close)
        self._presence.close()
        self._ended.set()

    @property
    def reason_for_end(self) -> str | None:
        """Why others ended it, as a node that took its name; None while nobody has."""
        return self._reason

    def wait_closed(self, timeout_s: float | None = None) -> bool:
        """Wait until it is closed, by us or by others; False when the time is over."""
        return self._ended.wait(timeout_s)

    @property
    def counts(self) -> Counts:
        """What went wrong on the network so far."""
        return self._presence.tally.counts

    def advertise(
        self, topic: str, type_name: str, *, latch: bool = False, queue: int = 1
    ) -> Publisher:
        """Publish a topic.

        Args:
            topic: its name.
            type_name: such as "sensor_msgs/JointState".
            latch: send the last message to readers that come later.
            queue: how many messages wait for a reader that is slow; newer ones replace older ones.

        Raises:
            RosMessageError: when a name is none or the type is not known.
            RosError: when this node publishes it already, or the master refuses.
        """
        name = full_name(topic, self.name)
        board = self._presence.board
        if name in board.publications:
            raise RosError(f"{self.name} publishes {name} already; close the other publisher first")
        if expect(queue, int, "queue", RosMessageError) < 1:
            raise RosMessageError(f"queue must be 1 or more, got {queue}")
        kind = message_type(type_name)
        publication = Publication(name, kind, node=self.name, latch=latch, queue=queue)
        board.publications[name] = publication

        def forget() -> None:
            if board.publications.get(name) is publication:
                del board.publications[name]

        entry = Entry(Role.PUBLISHER, name, kind.name)
        return Publisher(publication, self._register(entry, forget, publication.close))

    def subscribe(self, topic: str, type_name: str, callback: Callback) -> Subscriber:
        """Listen to a topic, from all its publishers.

        Args:
            topic: its name.
            type_name: such as "sensor_msgs/JointState".
            callback: told of every message in the node's thread: it should be short.

        Raises:
            RosMessageError: when a name is none or the type is not known.
            RosError: when the master refuses.
        """
        name = full_name(topic, self.name)
        subscription = Subscription(
            name,
            message_type(type_name),
            callback,
            node=self.name,
            loop=self._presence.loop,
            tally=self._presence.tally,
            name_of=self._master.node_at,
        )
        all_of = self._presence.board.subscriptions
        all_of[name] = (*all_of.get(name, ()), subscription)

        def forget() -> None:
            left = tuple(each for each in all_of.get(name, ()) if each is not subscription)
            all_of[name] = left
            if not left:
                del all_of[name]

        entry = Entry(Role.SUBSCRIBER, name, type_name)
        return Subscriber(subscription, self._register(entry, forget, subscription.close))

    def serve(self, name: str, type_name: str, handler: Callable[[Message], Message]) -> Service:
        """Offer a service.

        Args:
            name: its name.
            type_name: such as "gazebo_msgs/SpawnModel".
            handler: gives the response to a request, in a thread of the service, one request after
                the other; a `ServiceRefused` that it raises is an answer too.

        Raises:
            RosMessageError: when a name is none or the type is not known.
            RosError: when this node serves it already, or the master refuses.
        """
        name = full_name(name, self.name)
        services = self._presence.board.services
        if name in services:
            raise RosError(f"{self.name} serves {name} already; close the other service first")
        kind = service_type(type_name)
        server = ServiceServer(name, kind, handler, node=self.name, tally=self._presence.tally)
        services[name] = server

        def forget() -> None:
            if services.get(name) is server:
                del services[name]

        entry = Entry(Role.SERVICE, name)
        return Service(server, self._register(entry, forget, server.close))

    def log(self, text: str, level: int = logging.INFO) -> None:
        """Say something on /rosout.

        Args:
            text: what to say.
            level: one of Python's, such as `logging.WARNING`.

        Raises:
            RosMessageError: when the level is not one of them.
        """
        if level not in LEVELS:
            raise RosMessageError(f"not a level of the package logging: {level!r}")
        header = {"stamp": time.time()}
        self._log.send(header=header, level=LEVELS[level], name=self.name, msg=text)

    def _register(
        self, entry: Entry, forget: Callable[[], None], leave: Callable[[], None]
    ) -> Callable[[], None]:
        """Register it; what is given undoes that, once."""
        registry, loop = self._presence.registry, self._presence.loop
        undone = threading.Lock()

        def end() -> None:
            if undone.acquire(blocking=False):
                forget()
                registry.remove(entry)
                loop.call(leave)

        try:
            registry.add(entry)
        except RosError:
            end()
            raise
        return end

    def _shut_down(self, reason: str) -> None:
        """In a thread of its own, for it waits for the one that calls this."""
        if self._reason is None:
            self._reason = reason
            logging.getLogger(__name__).warning("%s: %s", self.name, reason)
            threading.Thread(target=self.close, name=f"end of {self.name}", daemon=True).start()

    def _facts(self) -> tuple[str, ...]:
        return self.name, self.uri, "closed" if self._ended.is_set() else ""
