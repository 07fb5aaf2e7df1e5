"""Pacing: makes a simulation wait for real time, at the speed that is asked for, or while paused.

Each snapshot is due so long after the one before it as simulated time says, divided by the speed; a
new speed counts from the last snapshot on, so nothing jumps.
"""

from __future__ import annotations

import threading
import time

PAUSE_S = 0.1
"""When more time than this passes before an event, somebody was planning. The clock stands still
meanwhile, so that nothing rushes."""

LATEST_S = 1.0
"""A snapshot that is less late, as on a busy machine, is caught up with, so that the clock does not
drift; one that is later comes after a pause too."""

SPEEDS = (0.1, 4.0)
"""The slowest and the fastest, of real time."""

_LOOKS_S = 0.5
"""How often who is paused looks up, as not every system wakes a waiting thread for Ctrl-C."""


class Pacing:
    """When snapshots are due. The program waits; pauses and speeds may come from other threads."""

    def __init__(self) -> None:
        """Real time, nothing shown yet."""
        self._changed = threading.Condition()
        self._is_paused = False
        self._speed = 1.0
        self._simulated_s: float | None = None
        self._due_s = self._last_s = 0.0

    @property
    def is_paused(self) -> bool:
        """Whether the next snapshot waits until somebody ends the pause."""
        return self._is_paused

    @property
    def speed(self) -> float:
        """How fast simulated time passes, of real time."""
        return self._speed

    def pause(self, is_paused: bool) -> None:
        """Begin or end a pause."""
        with self._changed:
            self._is_paused = is_paused
            self._changed.notify_all()

    def change_speed(self, speed: float) -> None:
        """Let simulated time pass so fast, from the last snapshot on."""
        with self._changed:
            self._speed = speed
            self._changed.notify_all()

    def begin(self) -> None:
        """A simulation begins: its first snapshot is due at once."""
        self._simulated_s = None

    def stand_still(self) -> None:
        """Take the time since the last snapshot off the clock, if somebody was planning."""
        now = time.perf_counter()
        if now - self._last_s > PAUSE_S:
            self._due_s += now - self._last_s
        self._last_s = now

    def wait_for(self, simulated_s: float) -> None:
        """Wait until a snapshot of that time is due; a later one comes next."""
        with self._changed:
            while (seconds := self._until(simulated_s)) > 0.0:
                self._sleep(min(seconds, _LOOKS_S))
            now = time.perf_counter()
            due_s = self._next_due_s(simulated_s)
            is_long_past = due_s is None or now - due_s > LATEST_S
            self._due_s = now if due_s is None or is_long_past else due_s
            self._simulated_s, self._last_s = simulated_s, now

    def _until(self, simulated_s: float) -> float:
        """How long to wait as things are now, s."""
        if self._is_paused:
            self._simulated_s = None  # afterwards the next one is due at once
            return _LOOKS_S
        due_s = self._next_due_s(simulated_s)
        return 0.0 if due_s is None else due_s - time.perf_counter()

    def _next_due_s(self, simulated_s: float) -> float | None:
        """When it is due, in real time; None for at once."""
        if self._simulated_s is None:
            return None
        return self._due_s + (simulated_s - self._simulated_s) / self._speed

    def _sleep(self, seconds: float) -> None:
        self._changed.wait(seconds)
