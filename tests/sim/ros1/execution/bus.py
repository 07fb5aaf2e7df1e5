"""A network in memory, with the interface of `sim.ros1.node.Node`, for tests without sockets."""

from __future__ import annotations

import threading
from collections import defaultdict
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

from sim.errors import RosError
from sim.ros1.definitions import message_type
from tests.sim.ros1.execution.clock import VirtualTime


@dataclass(frozen=True)
class Heard:
    message: Any
    sender: str
    topic: str
    time_s: float


class Bus:
    """Topics and parameters of a network, whose messages arrive at once.

    Attributes:
        clock: gives their times of arrival.
    """

    def __init__(self, clock: VirtualTime) -> None:
        self.clock = clock
        self.parameters: dict[str, Any] = {}
        self.publishers: dict[str, list[BusPublisher]] = defaultdict(list)
        self.subscribers: dict[str, list[BusSubscriber]] = defaultdict(list)
        self.lock = threading.RLock()

    def registered(self, name: str) -> list[str]:
        """The topics that a node has advertised or subscribed to."""
        ends: list[Any] = [*self.publishers.values(), *self.subscribers.values()]
        return [end.topic for each in ends for end in each if end.node.name == name]


class BusNode:
    """A node of it."""

    master_uri = "http://bus:11311/"

    def __init__(self, name: str, bus: Bus) -> None:
        self.name, self.bus = name, bus
        self.uri = f"http://bus{name}/"
        self.reason_for_end: str | None = None
        self._ends: list[BusPublisher | BusSubscriber] = []

    def __enter__(self) -> BusNode:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        for end in list(self._ends):
            end.close()

    def advertise(self, topic: str, kind: str, latch: bool = False, **__: int) -> BusPublisher:
        if self.name in self.publishers_of(topic):
            raise RosError(f"{self.name} publishes {topic} already")
        publisher = BusPublisher(self, topic, kind, latch)
        self._add(publisher, self.bus.publishers)
        return publisher

    def subscribe(self, topic: str, _: str, hear: Callable[[Any], None]) -> BusSubscriber:
        end = BusSubscriber(self, topic, hear)
        self._add(end, self.bus.subscribers)
        for publisher in list(self.bus.publishers[topic]):
            if publisher.latched is not None:
                end.deliver(publisher.latched, publisher.node.name)
        return end

    def together(self) -> AbstractContextManager[None]:
        return nullcontext()

    def _add(self, end: Any, ends: dict[str, list[Any]]) -> None:
        with self.bus.lock:
            ends[end.topic].append(end)
            end.among = ends[end.topic]
        self._ends.append(end)

    def parameter(self, name: str, default: Any = None) -> Any:
        return self.bus.parameters.get(name, default)

    def set_parameter(self, name: str, value: Any) -> None:
        self.bus.parameters[name] = value

    def publishers_of(self, topic: str) -> tuple[str, ...]:
        return tuple(dict.fromkeys(end.node.name for end in self.bus.publishers[topic]))

    def subscribers_of(self, topic: str) -> tuple[str, ...]:
        return tuple(dict.fromkeys(end.node.name for end in self.bus.subscribers[topic]))


class BusPublisher:
    def __init__(self, node: BusNode, topic: str, kind: str, latch: bool) -> None:
        self.node, self.topic, self._kind, self._latch = node, topic, message_type(kind), latch
        self.latched: Any = None
        self.is_connected = True
        self.among: list[BusPublisher] = []

    @property
    def readers(self) -> tuple[str, ...]:
        return self.node.subscribers_of(self.topic)

    def send(self, **values: Any) -> None:
        self.publish(self._kind.make(**values))

    def publish(self, message: Any) -> None:
        if self._latch:
            self.latched = message
        for end in list(self.node.bus.subscribers[self.topic]):
            end.deliver(message, self.node.name)

    def close(self) -> None:
        with self.node.bus.lock:
            if self in self.among:
                self.among.remove(self)


class BusSubscriber:
    def __init__(self, node: BusNode, topic: str, hear: Callable[[Any], None]) -> None:
        self.node, self.topic, self._hear = node, topic, hear
        self.among: list[BusSubscriber] = []

    @property
    def writers(self) -> tuple[str, ...]:
        ends = self.node.bus.publishers[self.topic]
        return tuple(dict.fromkeys(end.node.name for end in ends if end.is_connected))

    @property
    def publisher_uris(self) -> frozenset[str]:
        return frozenset(end.node.uri for end in self.node.bus.publishers[self.topic])

    def deliver(self, message: Any, sender: str) -> None:
        self._hear(Heard(message, sender, self.topic, self.node.bus.clock.now_s))

    def close(self) -> None:
        with self.node.bus.lock:
            if self in self.among:
                self.among.remove(self)
