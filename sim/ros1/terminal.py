"""What the commands of ROS 1 share: how they speak, ask, end, and which files they write."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from baxter_kin.command_line import EXIT_INTERRUPTED, EXIT_TERMINATED, file_to_write, log_told
from baxter_kin.errors import BaxterError

if TYPE_CHECKING:  # --help needs none of them
    from baxter_kin import Baxter
    from sim import Observer
    from sim.ros1.execution.preflight import Finding
    from sim.ros1.execution.signals import Signals

EXIT_FAILED, EXIT_USAGE = 1, 2

EXIT_STATUS = "Exit status: {done}; 2 wrong usage; 130 Ctrl-C; 143 SIGTERM."
"""The end of every help text."""

TOLD = ("baxter_kin", "sim.ros1.execution")
"""Whose log is shown: what takes seconds is said before it begins."""

SIMULATED = "python -m sim.ros1.robot --own-master"
"""What starts a Baxter where there is none."""


class Terminal:
    """Where a command speaks: what it found on standard output, what is wrong on standard error.

    Attributes:
        name: the command's, put before complaints.
    """

    def __init__(self, name: str) -> None:
        self.name = name

    def say(self, text: str) -> None:
        """One line."""
        print(text, flush=True)

    def warn(self, text: str) -> None:
        """One line on standard error."""
        print(f"{self.name}: {' '.join(text.split())}", file=sys.stderr, flush=True)

    def complain(self, text: str, status: int = EXIT_FAILED) -> int:
        """Say why it ends; returns the exit status."""
        self.warn(text)
        return status

    def report(self, findings: Sequence[Finding]) -> int:
        """A line for each condition, those that do not hold on standard error; returns how many."""
        for finding in findings:
            if finding.is_ok:
                self.say(f"ok   {finding}")
            else:
                print(f"FAIL {' '.join(str(finding).split())}", file=sys.stderr, flush=True)
        return sum(not finding.is_ok for finding in findings)

    def not_ready(self, what: str, failures: int) -> int:
        """End because conditions that were reported do not hold; returns the exit status."""
        which = "a condition does" if failures == 1 else f"{failures} conditions do"
        return self.complain(f"{what}: {which} not hold, see FAIL above")

    def is_confirmed(self) -> bool:
        """Whether Enter was pressed; without anybody to press it, no."""
        print("Press Enter to move, Ctrl-C to leave it ", end="", flush=True)
        if sys.stdin is not None and sys.stdin.readline() != "":
            return True
        print(flush=True)
        return False

    def ended(self, work: Callable[[Signals], int]) -> int:
        """Do the work of a command; returns its exit status, whatever ends it."""
        from sim.errors import RosConnectionError  # noqa: PLC0415 - loads every library
        from sim.ros1.execution.signals import handled  # noqa: PLC0415

        with handled() as signals, log_told(self.say, self.warn, TOLD):
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
    """The exit status that the signal which came asks for, as shells have it."""
    from sim.ros1.execution.stops import StopCause  # noqa: PLC0415

    known = {StopCause.SIGINT: EXIT_INTERRUPTED, StopCause.SIGTERM: EXIT_TERMINATED}
    return otherwise if signals.came is None else known[signals.came]


def _master_hint(error: BaxterError) -> str:
    """What to do where the master was not reached; else empty."""
    if getattr(error, "node", "") != "the master":
        return ""
    uri = os.environ.get("ROS_MASTER_URI")
    is_now = "it is not set" if not uri else f"it is {uri}"
    return (
        f". ROS_MASTER_URI says where the master is, and {is_now}: for a real Baxter, export "
        f"ROS_MASTER_URI=http://<its name>.local:11311; for a simulated one, start {SIMULATED}"
    )


def _record_file(text: str) -> Path:
    """A file to record to, in the format of its suffix."""
    from sim.ros1.records import SUFFIXES  # noqa: PLC0415

    path = file_to_write(text)
    if path.suffix not in SUFFIXES:
        raise argparse.ArgumentTypeError(f"{text} must end in one of {', '.join(SUFFIXES)}")
    return path


def add_files(parser: argparse.ArgumentParser, recorded: str) -> None:
    """Add `--record` and `--csv`; `file_observers` makes what writes them."""
    group = parser.add_argument_group("output")
    group.add_argument(
        "--record",
        type=_record_file,
        metavar="FILE",
        action="append",
        default=[],
        help=f"write {recorded}: .jsonl (a log, complete even when killed), .mcap (for Foxglove), "
        ".bag (for ROS 1) or .npz (at the end); may be repeated",
    )
    group.add_argument(
        "--csv",
        type=file_to_write,
        metavar="FILE",
        help="write the measured joints as the RSDK's recorder does",
    )


def file_observers(options: argparse.Namespace, robot: Baxter, stack: ExitStack) -> list[Observer]:
    """What writes the files that were asked for; the stack finishes them.

    Raises:
        RecordingError: when a file cannot be written.
    """
    from sim.recording.rsdk_csv import CsvRecorder  # noqa: PLC0415
    from sim.ros1.records import record_to  # noqa: PLC0415

    observers: list[Observer] = [record_to(path, robot, stack) for path in options.record]
    if options.csv is not None:
        csv = CsvRecorder(options.csv, robot)
        stack.callback(csv.close)
        observers.append(csv)
    return observers
