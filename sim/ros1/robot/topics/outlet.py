"""Outlets: topics that are told at every tick, cheaply.

Each topic has one message, which is filled anew while somebody listens; stamps are shared. Nothing
is computed for a topic that nobody reads.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from baxter_kin.display import OneLine, count
from sim.ros1.definitions import message_type
from sim.ros1.node import Node, Publisher
from sim.ros1_messages import Message

Fill = Callable[[Message], object]
"""Writes what is so now into a topic's message."""

NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class _Outlet:
    """A topic that is told at every tick.

    Attributes:
        publisher: where.
        message: what, filled anew each time.
        fill: fills it.
    """

    publisher: Publisher
    message: Message
    fill: Fill


class Outlets(OneLine):
    """All topics that are told at every tick."""

    def __init__(self, node: Node) -> None:
        """None yet.

        Args:
            node: who tells them.
        """
        self._node = node
        self._outlets: list[_Outlet] = []
        self._stamp = message_type("std_msgs/Header").make(stamp=0.0).stamp

    def add(self, topic: str, type_name: str, fill: Fill, **fixed: Any) -> None:
        """Tell one more topic.

        Args:
            topic: its name.
            type_name: its type.
            fill: writes what is so now.
            **fixed: fields that never change.
        """
        message = message_type(type_name).make(**fixed)
        if hasattr(message, "header"):
            message.header.stamp = self._stamp
        if hasattr(message, "timestamp"):
            message.timestamp = self._stamp
        self._outlets.append(_Outlet(self._node.advertise(topic, type_name), message, fill))

    def tell(self) -> None:
        """Tell all that somebody listens to, as of now."""
        self._stamp.sec, self._stamp.nanosec = divmod(time.time_ns(), NS)
        for outlet in self._outlets:
            if outlet.publisher.readers:
                outlet.fill(outlet.message)
                outlet.publisher.publish(outlet.message)

    def _facts(self) -> tuple[str, ...]:
        return (count(len(self._outlets), "topic"),)
