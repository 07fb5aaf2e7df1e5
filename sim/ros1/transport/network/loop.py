"""One thread that waits for sockets and moments, and calls whom they concern."""

from __future__ import annotations

import heapq
import logging
import selectors
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from itertools import count
from typing import TypeAlias

from baxter_kin.display import OneLine
from baxter_kin.fields import NotCopied
from sim.ros1.transport.network.counts import Tally

READ = selectors.EVENT_READ
WRITE = selectors.EVENT_WRITE

CLOSING_S = 2.0
"""How long a loop that is closed may take to finish what it does."""

FEW_TIMERS = 64
"""So many are kept even when they are cancelled."""

Ready: TypeAlias = Callable[[int], None]
"""Told which of `READ` and `WRITE` a socket is ready for."""

_LOG = logging.getLogger(__name__)


class Timer:
    """A call that is due at some moment, until it is cancelled."""

    def __init__(self, function: Callable[[], None]) -> None:
        self._function: Callable[[], None] | None = function

    @property
    def is_cancelled(self) -> bool:
        """Whether it will not be called."""
        return self._function is None

    def cancel(self) -> None:
        """Do not call; when it has been called already, this changes nothing."""
        self._function = None

    def __call__(self) -> None:
        """Do it, unless it was cancelled."""
        if self._function is not None:
            self._function()


class Loop(NotCopied, OneLine):
    """A thread with a selector.

    Any thread may use `call`, `later` and `close`; the rest is for the loop's own.
    """

    def __init__(self, name: str, tally: Tally) -> None:
        self._name = name
        self._tally = tally
        self._selector = selectors.DefaultSelector()
        self._lock = threading.Lock()  # of the calls, and of whether the thread has ended
        self._calls: deque[Callable[[], None]] = deque()
        self._has_ended = False
        self._timers: list[tuple[float, int, Timer]] = []
        self._most_timers = FEW_TIMERS
        self._numbers = count()
        self._is_closing = False
        self._wake, self._woken = socket.socketpair()
        self._wake.setblocking(False)
        self._woken.setblocking(False)
        self._selector.register(self._woken, READ, self._drain)
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def is_here(self) -> bool:
        """Whether the caller is this thread."""
        return threading.get_ident() == self._thread.ident

    def call(self, function: Callable[[], None]) -> bool:
        """Call a function soon; False if the loop has ended, so that it will not be called."""
        with self._lock:
            if self._has_ended:
                return False
            self._calls.append(function)
        if not self.is_here:
            with suppress(OSError):  # full, so the thread is awake, or closed since
                self._wake.send(b"\0")
        return True

    def later(self, delay_s: float, function: Callable[[], None]) -> Timer:
        """Call it after a time, unless the timer is cancelled before."""
        timer = Timer(function)
        due = time.monotonic() + delay_s
        self.call(lambda: self._keep(due, timer))
        return timer

    def watch(self, sock: socket.socket, events: int, ready: Ready) -> None:
        """Tell when a socket is ready; for one that is watched, change for what."""
        if sock.fileno() in self._selector.get_map():
            self._selector.modify(sock, events, ready)
        else:
            self._selector.register(sock, events, ready)

    def forget(self, sock: socket.socket) -> None:
        """Watch it no more; it must not be closed yet."""
        with suppress(KeyError, ValueError):
            self._selector.unregister(sock)

    def close(self) -> None:
        """End the thread after the calls that are waiting; sockets stay with their owners."""
        self._is_closing = True
        self.call(lambda: None)
        if not self.is_here:
            self._thread.join(CLOSING_S)

    def _keep(self, due: float, timer: Timer) -> None:
        if len(self._timers) >= self._most_timers:
            self._timers = [each for each in self._timers if not each[2].is_cancelled]
            heapq.heapify(self._timers)
            self._most_timers = max(FEW_TIMERS, 2 * len(self._timers))
        heapq.heappush(self._timers, (due, next(self._numbers), timer))

    def _run(self) -> None:
        while not self._ends():
            for key, events in self._selector.select(self._wait_s()):
                self._guarded(lambda key=key, events=events: key.data(events))  # type: ignore[misc]
            while self._timers and self._timers[0][0] <= time.monotonic():
                self._guarded(heapq.heappop(self._timers)[2])
            while self._calls:
                self._guarded(self._calls.popleft())
        self._selector.close()
        self._wake.close()
        self._woken.close()

    def _ends(self) -> bool:
        with self._lock:
            self._has_ended = self._is_closing and not self._calls
        return self._has_ended

    def _wait_s(self) -> float | None:
        if self._calls or self._is_closing:
            return 0.0
        return max(0.0, self._timers[0][0] - time.monotonic()) if self._timers else None

    def _guarded(self, function: Callable[[], object]) -> None:
        """One fault, as in a user's callback, must not end what serves everybody."""
        try:
            function()
        except Exception:
            self._tally.add("faults")
            _LOG.exception("%s: a callback failed", self._name)

    def _drain(self, _: int) -> None:
        with suppress(OSError):
            while len(self._woken.recv(4096)) == 4096:
                pass

    def _facts(self) -> tuple[str, ...]:
        return self._name, "running" if self._thread.is_alive() else "ended"
