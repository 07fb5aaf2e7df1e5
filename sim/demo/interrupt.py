"""Ctrl-C that cannot get lost.

Compiled libraries may swallow the exception that Ctrl-C raises, and CasADi reports it as an error.
So it is deferred while they run: the demo checks for it after every plan and at every tick.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Interrupt:
    """Stores that Ctrl-C was pressed."""

    def __init__(self) -> None:
        self.is_requested = False
        self._is_deferred = False

    def check(self) -> None:
        """Raise KeyboardInterrupt if Ctrl-C was pressed."""
        if self.is_requested:
            raise KeyboardInterrupt

    @contextmanager
    def deferred(self) -> Iterator[None]:
        """Defer KeyboardInterrupt until the block exits."""
        self._is_deferred = True
        try:
            yield
        finally:
            self._is_deferred = False
            self.check()

    def _handle(self, _signal: int, _frame: FrameType | None) -> None:
        if self.is_requested:
            return  # clean-up after the first one must not be interrupted
        self.is_requested = True
        if not self._is_deferred:
            raise KeyboardInterrupt


@contextmanager
def interruptible() -> Iterator[Interrupt]:
    """Handle Ctrl-C by an `Interrupt` inside the block."""
    interrupt = Interrupt()
    if threading.current_thread() is not threading.main_thread():
        yield interrupt  # only the main thread gets signals
        return
    former = signal.signal(signal.SIGINT, interrupt._handle)
    try:
        yield interrupt
    finally:
        signal.signal(signal.SIGINT, former)
