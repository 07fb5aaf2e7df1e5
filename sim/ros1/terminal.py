"""The common part of the commands for ROS 1: messages, confirmation, signals, files."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Protocol

from baxter_kin.command_line import (
    EXIT_INTERRUPTED,
    EXIT_TERMINATED,
    file_to_write,
    log_shown,
    option,
)
from baxter_kin.errors import BaxterError
from sim.recording.record_file import csv_recorder_of, record_option, recorder_of

if TYPE_CHECKING:  # --help needs none of them
    from baxter_kin import Baxter
    from sim import Observer

EXIT_FAILED, EXIT_USAGE = 1, 2

EXIT_STATUS = "Exit status: {done}; 2 wrong usage; 130 Ctrl-C; 143 SIGTERM."
"""The end of every help text."""

SIMULATED = "python -m sim.ros1.robot --own-master"
"""The command that starts a simulated Baxter."""

_STATUS = {signal.SIGINT: EXIT_INTERRUPTED, signal.SIGTERM: EXIT_TERMINATED}


class Signals:
    """Handlers of SIGINT and SIGTERM.

    A signal raises KeyboardInterrupt, except the first one inside `stopping`. The handlers are
    installed whatever was there, as a job that a shell starts with `&` ignores SIGINT.

    Attributes:
        received: the first signal; None before it.
    """

    def __init__(self, *, ignores_more: bool = False) -> None:
        """Handle signals; `ignores_more` ignores all after the first."""
        self.received: signal.Signals | None = None
        self._ignores_more = ignores_more
        self._stop: Callable[[str], object] | None = None

    @contextmanager
    def installed(self) -> Iterator[Signals]:
        """Install the handlers inside the block; the former ones are restored at its end."""
        if threading.current_thread() is not threading.main_thread():
            yield self  # only the main thread receives signals
            return
        former = {number: signal.signal(number, self._handle) for number in _STATUS}
        try:
            yield self
        finally:
            for number, handler in former.items():
                signal.signal(number, handler)

    @contextmanager
    def stopping(self, stop: Callable[[str], object]) -> Iterator[None]:
        """Inside the block the first signal calls `stop` with its name, such as "SIGINT"."""
        self._stop = stop
        try:
            yield
        finally:
            self._stop = None

    def status(self, otherwise: int = EXIT_INTERRUPTED) -> int:
        """The exit status for the signal that was received, as shells have it."""
        return otherwise if self.received is None else _STATUS[self.received]

    def _handle(self, number: int, _frame: FrameType | None) -> None:
        is_first = self.received is None
        self.received = self.received or signal.Signals(number)
        if is_first and self._stop is not None:
            self._stop(self.received.name)
        elif is_first or not self._ignores_more:
            raise KeyboardInterrupt


class _Finding(Protocol):
    """A condition, which `str` describes."""

    @property
    def is_ok(self) -> bool:
        """Whether it holds."""


class Terminal:
    """The messages of a command: results on standard output, errors on standard error.

    Attributes:
        name: of the command, which starts error messages.
    """

    def __init__(
        self,
        name: str,
        *,
        advice: str = f". ROS_MASTER_URI says where the master is, and {{is_now}}: for a real "
        f"Baxter, export ROS_MASTER_URI=http://<its name>.local:11311; for a simulated one, start "
        f"{SIMULATED}",
        logged: str = "sim.ros1.execution",
    ) -> None:
        """Describe a command.

        Args:
            name: of the command.
            advice: appended where the master was not reached.
            logged: the package whose log is shown, beside `baxter_kin`: it announces what takes
                seconds.
        """
        self.name, self._advice, self._logged = name, advice, ("baxter_kin", logged)

    def say(self, text: str) -> None:
        """Print one line."""
        print(text, flush=True)

    def warn(self, text: str) -> None:
        """Print one line on standard error."""
        print(f"{self.name}: {' '.join(text.split())}", file=sys.stderr, flush=True)

    def complain(self, text: str, status: int = EXIT_FAILED) -> int:
        """Print why the command ends; returns the exit status."""
        self.warn(text)
        return status

    def report(self, findings: Sequence[_Finding]) -> int:
        """Print a line for each condition; returns the number of those that do not hold.

        Those go to standard error.
        """
        for finding in findings:
            if finding.is_ok:
                self.say(f"ok   {finding}")
            else:
                print(f"FAIL {' '.join(str(finding).split())}", file=sys.stderr, flush=True)
        return sum(not finding.is_ok for finding in findings)

    def not_ready(self, what: str, failures: int) -> int:
        """Print that reported conditions do not hold; returns the exit status."""
        which = "a condition does" if failures == 1 else f"{failures} conditions do"
        return self.complain(f"{what}: {which} not hold, see FAIL above")

    def is_confirmed(self) -> bool:
        """Whether Enter is pressed; False where standard input is closed."""
        print("Press Enter to move, Ctrl-C to leave it ", end="", flush=True)
        if sys.stdin is not None and sys.stdin.readline() != "":
            return True
        print(flush=True)
        return False

    def ended(self, work: Callable[[Signals], int], *, ignores_more: bool = False) -> int:
        """Run the work of a command; returns its exit status, whatever ends it.

        Args:
            work: given the signals.
            ignores_more: whether signals after the first are ignored.
        """
        from sim.errors import RosConnectionError  # noqa: PLC0415 - loads every library

        signals = Signals(ignores_more=ignores_more)
        with signals.installed(), log_shown(self.say, self.warn, self._logged):
            try:
                return work(signals)
            except BaxterError as error:
                is_of_master = isinstance(error, RosConnectionError) and error.node == "the master"
                return self.complain(f"{error}{self._master_advice() if is_of_master else ''}")
            except KeyboardInterrupt:
                status = signals.status()
                by = "SIGTERM" if status == EXIT_TERMINATED else "Ctrl-C"
                print(f"stopped by {by}", file=sys.stderr, flush=True)
                return status

    def _master_advice(self) -> str:
        uri = os.environ.get("ROS_MASTER_URI")
        return self._advice.format(is_now=f"it is {uri}" if uri else "it is not set")


@dataclass(frozen=True, slots=True, kw_only=True)
class FileOptions:
    """Files that a command writes.

    Attributes:
        record: everything that happens, in the formats of the suffixes.
        csv: the measured joints.
    """

    record: tuple[Path, ...] = record_option("output", repeats=True)
    csv: Path | None = option(
        "--csv",
        type=file_to_write,
        metavar="FILE",
        group="output",
        help="write the measured joints as the RSDK's recorder does",
    )


def file_observers(files: FileOptions, robot: Baxter, stack: ExitStack) -> list[Observer]:
    """The observers that write the files; the stack finishes them."""
    observers: list[Observer] = [recorder_of(path, robot, stack) for path in files.record]
    if files.csv is not None:
        observers.append(csv_recorder_of(files.csv, robot, stack))
    return observers
