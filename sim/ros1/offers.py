"""What a node gives to those who publish, listen and serve: handles that end with `close`."""

from __future__ import annotations

from collections.abc import Callable

from baxter_kin.display import OneLine, listing
from baxter_kin.fields import NotCopied
from sim.ros1.transport.tcpros.publication import Publication
from sim.ros1.transport.tcpros.service_server import ServiceServer
from sim.ros1.transport.tcpros.subscription import Subscription
from sim.ros1_fields import Message
from sim.ros1_messages import MessageType, ServiceType


class Publisher(NotCopied, OneLine):
    """A topic that is published, until it is closed.

    Attributes:
        topic: its name.
        type: makes its messages.
    """

    def __init__(self, publication: Publication, end: Callable[[], None]) -> None:
        self.topic = publication.topic
        self.type: MessageType = publication.type
        self._publication = publication
        self._end = end

    @property
    def readers(self) -> tuple[str, ...]:
        """The names of the nodes that are connected."""
        return self._publication.readers

    def publish(self, message: Message) -> None:
        """Send a message to all readers. Nobody is waited for: a slow reader gets the newest.

        A header's sequence number is filled in. Any thread may call it.
        """
        self._publication.publish(message)

    def send(self, **values: object) -> None:
        """Make a message and publish it; it is not made when nobody listens.

        Args:
            **values: by field, as for `MessageType.make`.
        """
        if self._publication.readers or self._publication.latch:
            self._publication.publish(self.type.make(**values))

    def close(self) -> None:
        """Unregister it and send the readers away; twice is no trouble."""
        self._end()

    def _facts(self) -> tuple[str, ...]:
        return self.topic, self.type.name, listing(self.readers, "reader")


class Subscriber(NotCopied, OneLine):
    """A topic that is listened to, until it is closed.

    Attributes:
        topic: its name.
        type: its messages' type.
    """

    def __init__(self, subscription: Subscription, end: Callable[[], None]) -> None:
        self.topic = subscription.topic
        self.type: MessageType = subscription.type
        self._subscription = subscription
        self._end = end

    @property
    def writers(self) -> tuple[str, ...]:
        """The names of the publishers that are connected."""
        return self._subscription.writers

    def close(self) -> None:
        """Unregister it and leave the publishers; twice is no trouble."""
        self._end()

    def _facts(self) -> tuple[str, ...]:
        return self.topic, self.type.name, listing(self.writers, "writer")


class Service(NotCopied, OneLine):
    """A service that is offered, until it is closed.

    Attributes:
        name: its name.
        type: makes its responses.
    """

    def __init__(self, server: ServiceServer, end: Callable[[], None]) -> None:
        self.name = server.name
        self.type: ServiceType = server.type
        self._end = end

    def close(self) -> None:
        """Unregister it and send the clients away; twice is no trouble."""
        self._end()

    def _facts(self) -> tuple[str, ...]:
        return self.name, self.type.name
