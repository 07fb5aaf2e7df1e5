"""What a node asks the master (ROS wiki, "Master API" and "Parameter server API")."""

from __future__ import annotations

from typing import Any

from sim.errors import RosError
from sim.ros1.transport.xmlrpc.client import ask

MASTER_S = 3.0
"""How long the master may take to answer."""


class MasterClient:
    """Calls of the master in a node's name.

    Every one raises `RosError` when it is refused, and `RosConnectionError` when the master cannot
    be reached.

    Attributes:
        uri: where the master is.
    """

    def __init__(self, uri: str, node: str) -> None:
        self.uri = uri
        self._node = node

    def call(self, method: str, *args: Any) -> Any:
        """The value that the master answers."""
        return ask(self.uri, method, self._node, *args, node="the master", timeout_s=MASTER_S)

    def node_uri(self, name: str) -> str:
        """A node's XML-RPC server."""
        return str(self.call("lookupNode", name))

    def service_uri(self, name: str) -> str:
        """Where a service is."""
        return str(self.call("lookupService", name))

    def system(self) -> tuple[dict[str, tuple[str, ...]], ...]:
        """Publishers and subscribers by topic, and providers by service."""
        return tuple(
            {str(name): tuple(map(str, nodes)) for name, nodes in part}
            for part in self.call("getSystemState")
        )

    def node_at(self, uri: str) -> str:
        """The name of the node with that XML-RPC server; empty when it cannot be found out."""
        try:
            names = {name for part in self.system() for nodes in part.values() for name in nodes}
            return next((name for name in sorted(names) if self.node_uri(name) == uri), "")
        except RosError:
            return ""
