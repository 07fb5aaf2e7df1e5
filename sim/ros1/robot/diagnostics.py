"""Diagnostics: what is wrong with messages, all counted and reported at most once a second."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable

MIN_PERIOD_S = 1.0
"""Between two reports on one topic and sender."""

MAX_KNOWN = 1000
"""Number of topics and senders that are remembered, as senders may have any names."""


class Diagnostics:
    """Invalid messages so far.

    Attributes:
        counts: how many, by topic.
    """

    def __init__(self, report: Callable[[str], object]) -> None:
        """Begin without any; `report` is called with each line of text."""
        self.counts: Counter[str] = Counter()
        self._report = report
        self._reported_s: dict[tuple[str, str], float] = {}
        self._unreported: Counter[tuple[str, str]] = Counter()

    def add(self, topic: str, sender: str, text: str, time_s: float) -> None:
        """Count an invalid message, and report it unless the last report was just before.

        Args:
            topic: the topic of the message.
            sender: the node that sent it.
            text: what is wrong.
            time_s: now.
        """
        self.counts[topic] += 1
        key = topic, sender
        if time_s - self._reported_s.get(key, -math.inf) < MIN_PERIOD_S:
            self._unreported[key] += 1
            return
        if len(self._reported_s) >= MAX_KNOWN:
            self._reported_s.clear()
            self._unreported.clear()
        self._reported_s[key] = time_s
        more = self._unreported.pop(key, 0)
        since = f" ({more} more since the last time)" if more else ""
        self._report(f"{topic} from {sender or 'nobody'}: {text}{since}")
