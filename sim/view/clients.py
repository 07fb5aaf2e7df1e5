"""Who watches the live view, and what each has yet to be told. Safe across threads."""

from __future__ import annotations

import threading
from collections.abc import Hashable, Iterable

from sim.view.messages import Letter, Mailbox


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
