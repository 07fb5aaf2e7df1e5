"""Who watches the live view, and what each browser has yet to be told.

A live view that is watched slowly, or by nobody, must neither wait nor grow. So messages are kept
by what they speak of, the newest for each property of each node: never more than the scene has, and
read in order they always give the present scene.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Hashable, Iterable
from dataclasses import dataclass
from typing import TypeAlias

from sim.view.meshcat_commands import Command, packed

Payload: TypeAlias = "str | bytes"
"""Bytes are a command of Meshcat; text is JSON for the page: a topic and its value."""

_DELETE = "delete"


@dataclass(frozen=True, slots=True)
class Message:
    """One message and what it speaks of.

    Attributes:
        path: the node; empty for the page itself.
        topic: the property, or else the kind of command.
        payload: what the browser gets.
    """

    path: str
    topic: str
    payload: Payload

    @classmethod
    def with_command(cls, command: Command) -> Message:
        """One with a command of Meshcat."""
        topic = str(command.get("property", command["type"]))
        return cls(command["path"], topic, packed(command))

    @classmethod
    def for_page(cls, topic: str, value: object) -> Message:
        """One to the page itself: a topic it knows, such as "caption", and a value of JSON."""
        return cls("", topic, json.dumps([topic, value]))


class LatestMessages:
    """Messages in the order of their topics' first arrival. Not for several threads at once."""

    def __init__(self, *, keeps_deletions: bool) -> None:
        """Start empty.

        Args:
            keeps_deletions: whether the reader may know nodes that are forgotten here, and
                must be told that they are gone.
        """
        self._keeps_deletions = keeps_deletions
        self._messages: dict[tuple[str, str], Message] = {}

    def __len__(self) -> int:
        return len(self._messages)

    def put(self, message: Message) -> None:
        """Add a message in the place of an older one of its topic.

        A deletion forgets the node and all below it, and is itself the newest message.
        """
        if message.topic == _DELETE:
            self._forget(message.path)
            if not self._keeps_deletions:
                return
        self._messages[message.path, message.topic] = message

    def messages(self) -> list[Message]:
        """All messages; they stay."""
        return list(self._messages.values())

    def take_all(self) -> list[Message]:
        """All messages; none is left afterwards."""
        messages = self.messages()
        self._messages.clear()
        return messages

    def _forget(self, path: str) -> None:
        below = f"{path}/"
        gone = [key for key in self._messages if key[0] == path or key[0].startswith(below)]
        for key in gone:
            del self._messages[key]


class Clients:
    """The scene, and the latest messages for every browser that shows it."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._scene = LatestMessages(keeps_deletions=False)
        self._latest: dict[Hashable, LatestMessages] = {}

    def __len__(self) -> int:
        with self._changed:
            return len(self._latest)

    def publish(self, messages: Iterable[Message]) -> None:
        """Change the scene, and tell everyone who watches. All messages arrive together."""
        with self._changed:
            for message in messages:
                self._scene.put(message)
                for latest in self._latest.values():
                    latest.put(message)

    def join(self, client: Hashable) -> None:
        """Start to watch: the whole scene is yet to be told."""
        latest = LatestMessages(keeps_deletions=True)
        with self._changed:
            for message in self._scene.messages():
                latest.put(message)
            self._latest[client] = latest
            self._changed.notify_all()

    def leave(self, client: Hashable) -> None:
        """Watch no longer."""
        with self._changed:
            self._latest.pop(client, None)

    def messages_for(self, client: Hashable) -> list[Message]:
        """Take what a client has yet to be told; nothing for one who has left."""
        with self._changed:
            latest = self._latest.get(client)
            return latest.take_all() if latest is not None else []

    def wait(self, timeout_s: float) -> bool:
        """Wait until somebody watches, at most so long. Returns whether somebody does."""
        with self._changed:
            return self._changed.wait_for(lambda: bool(self._latest), timeout_s)
