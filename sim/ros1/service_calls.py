"""What a node asks of services: that they answer, and that they are there."""

from __future__ import annotations

import threading
import time

from sim.errors import RosConnectionError, RosError
from sim.ros1.definitions import service_type
from sim.ros1.transport.names import full_name
from sim.ros1.transport.network.addresses import Place, place_of
from sim.ros1.transport.presence import Presence
from sim.ros1.transport.tcpros.service_client import call_service, probe_service
from sim.ros1.transport.xmlrpc.master_client import MasterClient
from sim.ros1_fields import Message

CALL_S = 5.0
"""How long a service may take to answer, unless said otherwise."""

POLL_S = 0.05
"""How often a service that is waited for is looked for."""


class ServiceCalls:
    """The part of a node that calls services.

    Attributes:
        name: the node's, to which private names belong.
    """

    name: str
    _master: MasterClient
    _presence: Presence
    _ended: threading.Event

    def call(
        self, service: str, type_name: str, request: Message, *, timeout_s: float = CALL_S
    ) -> Message:
        """The response of a service of any node.

        Args:
            service: its name.
            type_name: such as "gazebo_msgs/SpawnModel".
            request: made by the type's request.
            timeout_s: how long the service may take.
        """
        name = full_name(service, self.name)
        kind = service_type(type_name)
        content = kind.request.serialise(request)
        place = self._find_service(name)
        return call_service(place, name, kind, content, node=self.name, timeout_s=timeout_s)

    def wait_for_service(self, service: str, timeout_s: float) -> bool:
        """Wait until a service can be reached; False when the time is over."""
        name = full_name(service, self.name)
        end = time.monotonic() + timeout_s
        while not self._is_served(name, max(POLL_S, end - time.monotonic())):
            if time.monotonic() + POLL_S > end or self._ended.wait(POLL_S):
                return False
        return True

    def _is_served(self, name: str, timeout_s: float) -> bool:
        try:
            probe_service(self._find_service(name), name, node=self.name, timeout_s=timeout_s)
        except RosConnectionError:
            return False
        return True

    def _find_service(self, name: str) -> Place:
        if self._presence.loop.is_here:
            raise RosError("a callback cannot wait for a service: call it in another thread")
        try:
            return place_of(self._master.service_uri(name))
        except RosConnectionError:
            raise
        except RosError as cause:
            raise RosConnectionError(
                f"nobody offers the service {name}", node=name, remedy="see that its node runs"
            ) from cause
