"""Pacing: makes a simulation wait for real time, at a chosen speed, or while it is paused.

The time between two due snapshots is their simulated time divided by the speed; a new speed counts
from the last snapshot on, so nothing jumps.
"""

from __future__ import annotations

import threading
import time

MIN_PAUSE_S = 0.1
"""When more time than this passes before an event, the program was planning. The clock stands still
meanwhile, so that nothing rushes."""

MAX_LATENESS_S = 1.0
"""A snapshot that is less late, as on a busy machine, is caught up with, so that the clock does not
drift; a later one follows a pause, too."""

SPEEDS = (0.1, 4.0)
"""Minimum and maximum speed, relative to real time."""

_MAX_SLEEP_S = 0.5
"""Maximum time without a check for Ctrl-C, for which not every system wakes a waiting thread."""


class Pacing:
    """Due times of snapshots. The program waits; other threads pause it and change the speed.

    Attributes:
        keeps_time: whether it waits at all; a program that runs in real time by itself does not.
    """

    def __init__(self, *, keeps_time: bool = True) -> None:
        """Begin at the speed of real time."""
        self.keeps_time = keeps_time
        self._changed = threading.Condition()
        self._is_paused = False
        self._speed = 1.0
        self._simulated_s: float | None = None
        self._due_s = self._last_s = 0.0

    @property
    def is_paused(self) -> bool:
        """Whether the next snapshot waits until the pause is ended."""
        return self._is_paused

    @property
    def speed(self) -> float:
        """Speed of simulated time, relative to real time."""
        return self._speed

    def pause(self, is_paused: bool) -> None:
        """Begin or end a pause."""
        with self._changed:
            self._is_paused = is_paused
            self._changed.notify_all()

    def change_speed(self, speed: float) -> None:
        """Change the speed, from the last snapshot on."""
        with self._changed:
            self._speed = speed
            self._changed.notify_all()

    def begin(self) -> None:
        """Begin a simulation, whose first snapshot is due at once."""
        self._simulated_s = None

    def stand_still(self) -> None:
        """Stop the clock since the last snapshot, if the program was planning."""
        now = time.perf_counter()
        if now - self._last_s > MIN_PAUSE_S:
            self._due_s += now - self._last_s
        self._last_s = now

    def wait_for(self, simulated_s: float) -> None:
        """Wait until the snapshot of a simulated time is due."""
        if not self.keeps_time:
            return
        with self._changed:
            while (seconds := self._until(simulated_s)) > 0.0:
                self._sleep(min(seconds, _MAX_SLEEP_S))
            now = time.perf_counter()
            due_s = self._next_due_s(simulated_s)
            is_long_past = due_s is None or now - due_s > MAX_LATENESS_S
            self._due_s = now if due_s is None or is_long_past else due_s
            self._simulated_s, self._last_s = simulated_s, now

    def _until(self, simulated_s: float) -> float:
        """Time left to wait at present, s."""
        if self._is_paused:
            self._simulated_s = None  # afterwards the next one is due at once
            return _MAX_SLEEP_S
        due_s = self._next_due_s(simulated_s)
        return 0.0 if due_s is None else due_s - time.perf_counter()

    def _next_due_s(self, simulated_s: float) -> float | None:
        """When it is due, in real time; None for at once."""
        if self._simulated_s is None:
            return None
        return self._due_s + (simulated_s - self._simulated_s) / self._speed

    def _sleep(self, seconds: float) -> None:
        self._changed.wait(seconds)
