"""Ctrl-C that cannot get lost.

Compiled libraries may swallow the exception that Ctrl-C raises. So it is also remembered, and the
demo asks at every tick.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Interrupt:
    """Remembers that Ctrl-C was pressed."""

    def __init__(self) -> None:
        """Not pressed yet."""
        self.is_requested = False

    def check(self) -> None:
        """Raise KeyboardInterrupt if Ctrl-C was pressed and is not being handled yet."""
        if self.is_requested:
            raise KeyboardInterrupt

    def _handle(self, _signal: int, _frame: FrameType | None) -> None:
        self.is_requested = True
        raise KeyboardInterrupt


@contextmanager
def interruptible() -> Iterator[Interrupt]:
    """An `Interrupt` that listens to Ctrl-C; the former handler comes back afterwards."""
    interrupt = Interrupt()
    if threading.current_thread() is not threading.main_thread():
        yield interrupt  # only the main thread gets signals
        return
    former = signal.signal(signal.SIGINT, interrupt._handle)
    try:
        yield interrupt
    finally:
        signal.signal(signal.SIGINT, former)
