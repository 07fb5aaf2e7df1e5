"""The pick-and-place demo: `python -m baxter_kin.demo`.

The composition root: it may import every layer, and no module imports it. Exit status: 0 all picked
and placed; 1 a pick or place failed; 2 wrong usage; 130 stopped by Ctrl-C.

Compiled libraries may swallow the exception that Ctrl-C raises, and CasADi reports it as an error.
So it is deferred while they run: the demo checks for it after every plan and at every tick.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType

from baxter_kin.command_line import EXIT_INTERRUPTED, parse
from baxter_kin.errors import MissingLibraryError
from sim.demo.options import DemoOptions

__all__ = ["EXIT_INTERRUPTED", "Interrupt", "interruptible", "main"]

EXIT_FAILED = 1


def main(argv: Sequence[str] | None = None) -> int:
    """Run the demo with those arguments, or the command line's; returns the exit status."""
    try:
        with interruptible() as interrupt:
            options = parse(DemoOptions, argv)
            with interrupt.deferred():  # some libraries crash when interrupted while loading
                import baxter_kin.kinematics.pinocchio_loading  # noqa: F401, PLC0415 - may be missing
                from sim.demo.run import run_demo  # noqa: PLC0415 - loads every library
            return run_demo(options, interrupt)
    except MissingLibraryError as error:
        print(f"baxter-demo: {error}", file=sys.stderr)
        return EXIT_FAILED
    except KeyboardInterrupt:
        print("stopped by Ctrl-C", file=sys.stderr)
        return EXIT_INTERRUPTED


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
