"""Signals: Ctrl-C and SIGTERM end an execution in order; a second Ctrl-C at once.

A job that a shell starts with `&` ignores SIGINT, so the handlers are installed whatever was there.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from sim.ros1.execution.stops import StopCause

_CAUSES = {signal.SIGINT: StopCause.SIGINT, signal.SIGTERM: StopCause.SIGTERM}


class Signals:
    """What to do when a signal comes.

    Attributes:
        came: the first that came; None before that.
    """

    def __init__(self) -> None:
        self.came: StopCause | None = None
        self._stop: Callable[[StopCause], None] | None = None

    @contextmanager
    def stopping(self, stop: Callable[[StopCause], None]) -> Iterator[None]:
        """Within, the first signal asks for a stop instead of raising KeyboardInterrupt."""
        self._stop = stop
        try:
            yield
        finally:
            self._stop = None

    def handle(self, number: int, _frame: FrameType | None) -> None:
        """A signal has come."""
        is_first, self.came = self.came is None, self.came or _CAUSES[signal.Signals(number)]
        if self._stop is None or not is_first:
            raise KeyboardInterrupt
        self._stop(self.came)


@contextmanager
def handled() -> Iterator[Signals]:
    """Signals that are handled in the meantime; the former handlers come back afterwards."""
    signals = Signals()
    if threading.current_thread() is not threading.main_thread():
        yield signals  # only the main thread gets any
        return
    former = {number: signal.signal(number, signals.handle) for number in _CAUSES}
    try:
        yield signals
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
