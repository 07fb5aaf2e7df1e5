"""The common part of the commands for ROS 1: messages, confirmation, ending, files."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

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
    from sim.ros1.execution.preflight import Finding
    from sim.ros1.execution.signals import Signals

EXIT_FAILED, EXIT_USAGE = 1, 2

EXIT_STATUS = "Exit status: {done}; 2 wrong usage; 130 Ctrl-C; 143 SIGTERM."
"""The end of every help text."""

LOGGED = ("baxter_kin", "sim.ros1.execution")
"""Packages whose log is shown: they announce what takes seconds."""

SIMULATED = "python -m sim.ros1.robot --own-master"
"""The command that starts a simulated Baxter."""


class Terminal:
    """The messages of a command: results on standard output, errors on standard error.

    Attributes:
        name: of the command, which starts error messages.
    """

    def __init__(self, name: str) -> None:
        self.name = name

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

    def report(self, findings: Sequence[Finding]) -> int:
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

    def ended(self, work: Callable[[Signals], int]) -> int:
        """Run the work of a command; returns its exit status, whatever ends it."""
        from sim.errors import RosConnectionError  # noqa: PLC0415 - loads every library
        from sim.ros1.execution.signals import handled  # noqa: PLC0415

        with handled() as signals, log_shown(self.say, self.warn, LOGGED):
            try:
                return work(signals)
            except RosConnectionError as error:
                return self.complain(f"{error}{_master_hint(error)}")
            except BaxterError as error:
                return self.complain(str(error))
            except KeyboardInterrupt:
                status = signal_status(signals)
                by = "SIGTERM" if status == EXIT_TERMINATED else "Ctrl-C"
                print(f"stopped by {by}", file=sys.stderr, flush=True)
                return status


def signal_status(signals: Signals, otherwise: int = EXIT_INTERRUPTED) -> int:
    """The exit status for the signal that has come, as shells have it."""
    from sim.ros1.execution.stops import StopCause  # noqa: PLC0415

    known = {StopCause.SIGINT: EXIT_INTERRUPTED, StopCause.SIGTERM: EXIT_TERMINATED}
    return otherwise if signals.came is None else known[signals.came]


def _master_hint(error: BaxterError) -> str:
    """Advice where the master was not reached; else empty."""
    if getattr(error, "node", "") != "the master":
        return ""
    uri = os.environ.get("ROS_MASTER_URI")
    is_now = "it is not set" if not uri else f"it is {uri}"
    return (
        f". ROS_MASTER_URI says where the master is, and {is_now}: for a real Baxter, export "
        f"ROS_MASTER_URI=http://<its name>.local:11311; for a simulated one, start {SIMULATED}"
    )


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
