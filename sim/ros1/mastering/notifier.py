"""Telling nodes what changed, without waiting for those that do not answer."""

from __future__ import annotations

import logging
import threading
from typing import Any

from sim.errors import RosError
from sim.ros1.transport.xmlrpc.client import ask

ANSWER_S = 3.0
"""How long a node may take."""

_LOG = logging.getLogger(__name__)


class Notifier:
    """Calls nodes, each in the order of its news; of news that replace others only the last."""

    def __init__(self, name: str) -> None:
        """Call in the name of a master."""
        self._name = name
        self._lock = threading.Lock()
        self._waiting: dict[str, dict[tuple[str, ...], tuple[Any, ...]]] = {}

    def publishers_changed(self, node_uri: str, topic: str, publishers: list[str]) -> None:
        """Tell a subscriber who publishes its topic."""
        self._tell(node_uri, ("publisherUpdate", topic), (topic, publishers))

    def parameter_changed(self, node_uri: str, name: str, value: Any) -> None:
        """Tell a node the value of a parameter."""
        self._tell(node_uri, ("paramUpdate", name), (name, value))

    def end(self, node_uri: str, reason: str) -> None:
        """Tell a node to end."""
        self._tell(node_uri, ("shutdown",), (reason,))

    def _tell(self, node_uri: str, key: tuple[str, ...], args: tuple[Any, ...]) -> None:
        with self._lock:
            is_running = node_uri in self._waiting
            news = self._waiting.setdefault(node_uri, {})
            news.pop(key, None)
            news[key] = args
        if not is_running:
            threading.Thread(
                target=self._run, args=(node_uri,), name=f"news to {node_uri}", daemon=True
            ).start()

    def _run(self, node_uri: str) -> None:
        while True:
            with self._lock:
                news = self._waiting[node_uri]
                if not news:
                    del self._waiting[node_uri]
                    return
                key = next(iter(news))
                args = news.pop(key)
            try:
                ask(node_uri, key[0], self._name, *args, node=node_uri, timeout_s=ANSWER_S)
            except RosError as error:
                _LOG.debug("%s", error)  # it may have ended without a word
