"""Who publishes, listens and serves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from sim.errors import RosError

ANY_TYPE = "*"


class Change(NamedTuple):
    """What nodes are to be told after a registration.

    Attributes:
        topic: whose publishers are others now; empty when none are.
        ended: XML-RPC servers of nodes whose name another node has taken, by that name.
    """

    topic: str
    ended: dict[str, str]


class Directory:
    """Nodes by name, and their topics and services."""

    def __init__(self) -> None:
        self._uris: dict[str, str] = {}
        self._publishers: dict[str, dict[str, str]] = {}
        self._subscribers: dict[str, dict[str, str]] = {}
        self._services: dict[str, tuple[str, str]] = {}
        self._types: dict[str, str] = {}

    def add_publisher(self, node: str, topic: str, kind: str, uri: str) -> Change:
        """Note that a node publishes a topic."""
        ended = self._meet(node, uri)
        self._publishers.setdefault(topic, {})[node] = uri
        if kind != ANY_TYPE:
            self._types[topic] = kind
        return Change(topic, ended)

    def add_subscriber(self, node: str, topic: str, kind: str, uri: str) -> Change:
        """Note that a node listens to a topic."""
        ended = self._meet(node, uri)
        self._subscribers.setdefault(topic, {})[node] = uri
        self._types.setdefault(topic, kind)
        return Change("", ended)

    def add_service(self, node: str, service: str, service_uri: str, uri: str) -> Change:
        """Note that a node serves; it takes the service over from another one."""
        ended = self._meet(node, uri)
        self._services[service] = (node, service_uri)
        return Change("", ended)

    def remove_publisher(self, node: str, topic: str, uri: str) -> bool:
        """Whether it was one."""
        return self._remove(self._publishers, node, topic, uri)

    def remove_subscriber(self, node: str, topic: str, uri: str) -> bool:
        """Whether it was one."""
        return self._remove(self._subscribers, node, topic, uri)

    def remove_service(self, node: str, service: str, service_uri: str) -> bool:
        """Whether it was its."""
        if self._services.get(service) != (node, service_uri):
            return False
        del self._services[service]
        self._forget_if_idle(node)
        return True

    def publishers_of(self, topic: str) -> list[str]:
        """Their XML-RPC servers."""
        return list(self._publishers.get(topic, {}).values())

    def subscribers_of(self, topic: str) -> list[str]:
        """Their XML-RPC servers."""
        return list(self._subscribers.get(topic, {}).values())

    def node_uri(self, node: str) -> str:
        """A node's XML-RPC server."""
        if node not in self._uris:
            raise RosError(f"unknown node [{node}]")
        return self._uris[node]

    def service_uri(self, service: str) -> str:
        """Where a service is."""
        if service not in self._services:
            raise RosError("no provider")
        return self._services[service][1]

    def types(self) -> list[list[str]]:
        """Of all topics that were ever named."""
        return [[topic, kind] for topic, kind in self._types.items()]

    def published(self, below: str) -> list[list[str]]:
        """Topics with a publisher and their types, those below a namespace."""
        start = below if below.endswith("/") else f"{below}/"
        return [
            [topic, self._types.get(topic, ANY_TYPE)]
            for topic in self._publishers
            if topic.startswith(start)
        ]

    def state(self) -> list[list[list[Any]]]:
        """Publishers and subscribers by topic, providers by service."""
        return [
            [[topic, list(nodes)] for topic, nodes in self._publishers.items()],
            [[topic, list(nodes)] for topic, nodes in self._subscribers.items()],
            [[service, [node]] for service, (node, _) in self._services.items()],
        ]

    def _meet(self, node: str, uri: str) -> dict[str, str]:
        """Know a node by that server; who had its name before loses what it had."""
        before = self._uris.get(node, uri)
        self._uris[node] = uri
        if before == uri:
            return {}
        for nodes in (*self._publishers.values(), *self._subscribers.values()):
            nodes.pop(node, None)
        for service in [name for name, (owner, _) in self._services.items() if owner == node]:
            del self._services[service]
        self._drop_empty()
        return {node: before}

    def _remove(self, all_of: dict[str, dict[str, str]], node: str, topic: str, uri: str) -> bool:
        if all_of.get(topic, {}).get(node) != uri:
            return False
        del all_of[topic][node]
        self._drop_empty()
        self._forget_if_idle(node)
        return True

    def _drop_empty(self) -> None:
        for all_of in (self._publishers, self._subscribers):
            for topic in [topic for topic, nodes in all_of.items() if not nodes]:
                del all_of[topic]

    def _forget_if_idle(self, node: str) -> None:
        if node not in self._busy():
            self._uris.pop(node, None)

    def _busy(self) -> Iterator[str]:
        for all_of in (self._publishers, self._subscribers):
            for nodes in all_of.values():
                yield from nodes
        yield from (node for node, _ in self._services.values())
