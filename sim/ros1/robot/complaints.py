"""Complaints: what is wrong with messages, said seldom and counted always."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable

from baxter_kin.display import OneLine, count

SELDOM_S = 1.0
"""The same complaint is not said again before so long."""

MOST_KNOWN = 1000
"""Topics and senders that are remembered; senders may be called as they please."""


class Complaints(OneLine):
    """What was wrong so far.

    Attributes:
        counts: how often, by topic.
    """

    def __init__(self, say: Callable[[str], object]) -> None:
        """Nothing yet.

        Args:
            say: told what is said.
        """
        self.counts: Counter[str] = Counter()
        self._say = say
        self._said_s: dict[tuple[str, str], float] = {}
        self._unsaid: Counter[tuple[str, str]] = Counter()

    def about(self, topic: str, sender: str, text: str, time_s: float) -> None:
        """Something of a sender is wrong.

        Args:
            topic: what it came by; of one topic and sender, one is said in `SELDOM_S`.
            sender: the node that sent it.
            text: what is wrong.
            time_s: now.
        """
        self.counts[topic] += 1
        key = topic, sender
        if time_s - self._said_s.get(key, -math.inf) < SELDOM_S:
            self._unsaid[key] += 1
            return
        if len(self._said_s) >= MOST_KNOWN:
            self._said_s.clear()
            self._unsaid.clear()
        self._said_s[key] = time_s
        more = self._unsaid.pop(key, 0)
        since = f" ({more} more since the last time)" if more else ""
        self._say(f"{topic} from {sender or 'nobody'}: {text}{since}")

    def _facts(self) -> tuple[str, ...]:
        return (count(self.counts.total(), "complaint"),)
