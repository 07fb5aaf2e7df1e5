"""Who watches the live view, and what each browser has yet to be told.

A live view that is watched slowly, or by nobody, must neither wait nor grow. So messages are kept
by what they speak of, the newest for each property of each node: a mailbox is never larger than the
scene, and reading it in order always gives the present scene.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Hashable, Iterable
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


class Audience:
    """The scene, and a mailbox for everyone who watches it."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._scene = Mailbox(keeps_deletions=False)
        self._mailboxes: dict[Hashable, Mailbox] = {}

    def __len__(self) -> int:
        with self._changed:
            return len(self._mailboxes)

    def publish(self, letters: Iterable[Letter]) -> None:
        """Change the scene, and tell everyone who watches. All letters arrive together."""
        with self._changed:
            for letter in letters:
                self._scene.put(letter)
                for mailbox in self._mailboxes.values():
                    mailbox.put(letter)

    def join(self, member: Hashable) -> None:
        """Start to watch: the whole scene is in the mailbox."""
        mailbox = Mailbox(keeps_deletions=True)
        with self._changed:
            for letter in self._scene.letters():
                mailbox.put(letter)
            self._mailboxes[member] = mailbox
            self._changed.notify_all()

    def leave(self, member: Hashable) -> None:
        """Watch no longer."""
        with self._changed:
            self._mailboxes.pop(member, None)

    def mail_for(self, member: Hashable) -> list[Letter]:
        """Take what a member has yet to be told; nothing for one who has left."""
        with self._changed:
            mailbox = self._mailboxes.get(member)
            return mailbox.take_all() if mailbox is not None else []

    def wait(self, timeout_s: float) -> bool:
        """Wait until somebody watches, at most so long. Returns whether somebody does."""
        with self._changed:
            return self._changed.wait_for(lambda: bool(self._mailboxes), timeout_s)
