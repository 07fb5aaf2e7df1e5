"""State of a ROS master: registrations of topics and services, and parameters."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from sim.errors import RosError

ANY_TYPE = "*"
"""Wildcard type, registered by clients that accept any."""


class Change(NamedTuple):
    """Changes of which nodes are notified after a registration.

    Attributes:
        topic: whose publishers have changed, or an empty name.
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
        """Add a publisher of a topic."""
        ended = self._set_uri(node, uri)
        self._publishers.setdefault(topic, {})[node] = uri
        if kind != ANY_TYPE or topic not in self._types:
            self._types[topic] = kind
        return Change(topic, ended)

    def add_subscriber(self, node: str, topic: str, kind: str, uri: str) -> Change:
        """Add a subscriber to a topic."""
        ended = self._set_uri(node, uri)
        self._subscribers.setdefault(topic, {})[node] = uri
        if kind != ANY_TYPE:
            self._types.setdefault(topic, kind)
        return Change("", ended)

    def add_service(self, node: str, service: str, service_uri: str, uri: str) -> Change:
        """Add a service, which the node takes over if another one had it."""
        ended = self._set_uri(node, uri)
        former, _ = self._services.get(service, (node, ""))
        self._services[service] = (node, service_uri)
        self._forget_if_idle(former)
        return Change("", ended)

    def remove_publisher(self, node: str, topic: str, uri: str) -> bool:
        """Remove a publisher; returns whether it was registered."""
        return self._remove(self._publishers, node, topic, uri)

    def remove_subscriber(self, node: str, topic: str, uri: str) -> bool:
        """Remove a subscriber; returns whether it was registered."""
        return self._remove(self._subscribers, node, topic, uri)

    def remove_service(self, node: str, service: str, service_uri: str) -> bool:
        """Remove a service; returns whether the node had it."""
        if self._services.get(service) != (node, service_uri):
            return False
        del self._services[service]
        self._forget_if_idle(node)
        return True

    def publishers_of(self, topic: str) -> list[str]:
        """The XML-RPC servers of a topic's publishers."""
        return list(self._publishers.get(topic, {}).values())

    def subscribers_of(self, topic: str) -> list[str]:
        """The XML-RPC servers of a topic's subscribers."""
        return list(self._subscribers.get(topic, {}).values())

    def node_uri(self, node: str) -> str:
        """The XML-RPC server of a node."""
        if node not in self._uris:
            raise RosError(f"unknown node [{node}]")
        return self._uris[node]

    def service_uri(self, service: str) -> str:
        """Where clients of a service connect."""
        if service not in self._services:
            raise RosError("no provider")
        return self._services[service][1]

    def types(self) -> list[list[str]]:
        """Topic and type of every topic that was ever registered."""
        return [[topic, kind] for topic, kind in self._types.items()]

    def published(self, below: str) -> list[list[str]]:
        """Topic and type of every topic below a namespace that has a publisher."""
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

    def _set_uri(self, node: str, uri: str) -> dict[str, str]:
        """Set the server of a node; an earlier node of its name loses everything."""
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


class Parameters:
    """A tree of values with names such as "/rethink/software_version"."""

    def __init__(self) -> None:
        self._root: dict[str, Any] = {}

    def set(self, name: str, value: Any) -> None:
        """Set a value; a mapping replaces everything below the name."""
        keys = _keys(name)
        if not keys:
            if not isinstance(value, dict):
                raise RosError("cannot set / to anything but a mapping")
            self._root = value
            return
        level = self._root
        for key in keys[:-1]:
            if not isinstance(level.get(key), dict):
                level[key] = {}
            level = level[key]
        level[keys[-1]] = value

    def get(self, name: str) -> Any:
        """The value, or the mapping of everything below the name."""
        found: Any = self._root
        for key in _keys(name):
            if not isinstance(found, dict) or key not in found:
                raise RosError(f"Parameter [{name}] is not set")
            found = found[key]
        return found

    def has(self, name: str) -> bool:
        """Whether there is a value."""
        try:
            self.get(name)
        except RosError:
            return False
        return True

    def delete(self, name: str) -> None:
        """Remove a value and everything below it."""
        self.get(name)
        *above, last = _keys(name) or [""]
        if not last:
            raise RosError("cannot delete the root of the parameter tree")
        level = self._root
        for key in above:
            level = level[key]
        del level[last]

    def search(self, name: str, namespace: str) -> str:
        """The full name of the first parameter of that name, from a namespace upwards."""
        if name.startswith("/"):
            self.get(name)
            return name
        first = name.split("/", maxsplit=1)[0]
        levels = _keys(namespace)
        while True:
            if self.has("/".join([*levels, first])):
                return "/" + "/".join([*levels, name])
            if not levels:
                raise RosError(f"Cannot find parameter [{name}] in an upwards search")
            levels.pop()

    def names(self) -> list[str]:
        """The full names of all values that are not mappings."""
        return list(_leaves("", self._root))


def _keys(name: str) -> list[str]:
    return [key for key in name.split("/") if key]


def _leaves(prefix: str, level: dict[str, Any]) -> Iterator[str]:
    for key, value in level.items():
        if isinstance(value, dict) and value:
            yield from _leaves(f"{prefix}/{key}", value)
        else:
            yield f"{prefix}/{key}"
