"""Controls: what a page may ask of the program that it watches, and nothing else.

A page sends text, JSON of a topic and a value: `["pause", true]` or `["speed", 0.5]`. All else is
ignored, whatever it is: it came from outside.
"""

from __future__ import annotations

import json
from typing import TypeGuard

from sim.view.live.clients import Clients, Message
from sim.view.live.pacing import SPEEDS, Pacing

LONGEST_MESSAGE = 100
"""Characters of a message that is read at all."""


class Controls:
    """Pause and speed of a live view; called in the server's thread."""

    def __init__(self, pacing: Pacing | None, clients: Clients) -> None:
        """Tell the pages what they may ask for.

        Args:
            pacing: what they change; None when the program keeps its own time, and cannot be held.
            clients: who is told.
        """
        self._pacing = pacing
        self._clients = clients
        self._is_running = True
        self._tell()

    def close(self) -> None:
        """Tell the pages that the program asks for nothing any more."""
        self._is_running = False
        self._tell()

    def hear(self, message: str | bytes) -> None:
        """Do what a page asks for, if it is one of these."""
        topic, value = _order(message)
        if self._pacing is None:
            return
        if topic == "pause" and isinstance(value, bool):
            self._pacing.pause(value)
        elif topic == "speed" and _is_speed(value):
            self._pacing.change_speed(float(value))
        else:
            return
        self._tell()

    def end_pause(self) -> None:
        """Nobody watches any more, so nobody could end a pause."""
        if self._pacing is not None and self._pacing.is_paused:
            self._pacing.pause(False)
            self._tell()

    def _tell(self) -> None:
        clock = None
        if self._pacing is not None:
            clock = {
                "paused": self._pacing.is_paused,
                "speed": self._pacing.speed,
                "running": self._is_running,
            }
        self._clients.publish([Message.for_page("clock", clock)])


def _order(message: str | bytes) -> tuple[object, object]:
    """The topic and value of a message; two times None when it has another form."""
    if not isinstance(message, str) or len(message) > LONGEST_MESSAGE:
        return None, None
    try:
        found = json.loads(message)
    except (ValueError, RecursionError):
        return None, None
    if not isinstance(found, list) or len(found) != 2:
        return None, None
    return found[0], found[1]


def _is_speed(value: object) -> TypeGuard[float]:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return SPEEDS[0] <= value <= SPEEDS[1]
