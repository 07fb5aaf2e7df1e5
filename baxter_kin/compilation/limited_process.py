"""Programs called with a time limit, which leave no process behind when it is reached."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path


def run_within(
    within_s: float,
    command: Sequence[str],
    folder: Path,
    environment: Mapping[str, str] | None = None,
) -> None:
    """Call a program, hear nothing of what it says, and wait for it to succeed.

    It runs in a process group of its own, so that what it has started ends with it. A process that
    leaves that group, as a daemon does, is not ended.

    Args:
        within_s: how long it may take.
        command: the program and its arguments.
        folder: where it runs. One that others may write to could lend it their files: Python, for
            one, imports from there.
        environment: its variables; those of this process by default.

    Raises:
        OSError: when it cannot be started.
        subprocess.CalledProcessError: when it fails.
        subprocess.TimeoutExpired: when it takes longer.
    """
    process = subprocess.Popen(
        command,
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        status = process.wait(within_s)
    except BaseException:  # Ctrl-C as well: the terminal does not reach that group
        _end(process)
        raise
    if status != 0:
        raise subprocess.CalledProcessError(status, command)


def _end(process: subprocess.Popen[bytes]) -> None:
    """Kill it with all that it has started."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
