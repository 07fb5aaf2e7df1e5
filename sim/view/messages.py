"""What a browser has yet to be told: the newest message for each property of each node.

A live view that is watched slowly, or by nobody, must neither wait nor grow. So messages are kept
by what they speak of, and a newer one takes the place of an older: a mailbox is never larger than
the scene, and reading it in order always gives the present scene.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TypeAlias

from sim.view.meshcat_commands import Command, packed

Message: TypeAlias = "str | bytes"
"""Bytes are a command of Meshcat; text is JSON for the page: a topic and its value."""

_DELETE = "delete"


@dataclass(frozen=True, slots=True)
class Letter:
    """One message and what it speaks of.

    Attributes:
        path: the node; empty for the page itself.
        topic: the property, or else the kind of command.
        message: what the browser gets.
    """

    path: str
    topic: str
    message: Message

    @classmethod
    def with_command(cls, command: Command) -> Letter:
        """A letter with a command of Meshcat."""
        topic = str(command.get("property", command["type"]))
        return cls(command["path"], topic, packed(command))

    @classmethod
    def for_page(cls, topic: str, value: object) -> Letter:
        """A letter to the page itself: a topic it knows, such as "caption", and a value of JSON."""
        return cls("", topic, json.dumps([topic, value]))


class Mailbox:
    """Letters in the order of their topics' first arrival. Not for several threads at once."""

    def __init__(self, *, keeps_deletions: bool) -> None:
        """Start empty.

        Args:
            keeps_deletions: whether the reader may know nodes that this mailbox has forgotten, and
                must be told that they are gone.
        """
        self._keeps_deletions = keeps_deletions
        self._letters: dict[tuple[str, str], Letter] = {}

    def __len__(self) -> int:
        return len(self._letters)

    def put(self, letter: Letter) -> None:
        """Add a letter in the place of an older one of its topic.

        A deletion forgets the node and all below it, and is itself the newest letter.
        """
        if letter.topic == _DELETE:
            self._forget(letter.path)
            if not self._keeps_deletions:
                return
        self._letters[letter.path, letter.topic] = letter

    def letters(self) -> list[Letter]:
        """All letters; they stay."""
        return list(self._letters.values())

    def take_all(self) -> list[Letter]:
        """All letters; the mailbox is empty afterwards."""
        letters = self.letters()
        self._letters.clear()
        return letters

    def _forget(self, path: str) -> None:
        below = f"{path}/"
        gone = [key for key in self._letters if key[0] == path or key[0].startswith(below)]
        for key in gone:
            del self._letters[key]
