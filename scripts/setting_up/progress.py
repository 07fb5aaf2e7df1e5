"""Commands that take long, watched: what they are at, and for how long."""

from __future__ import annotations

import queue
import re
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import TextIO

EVERY_S = 5.0
"""How often a line is printed while a command runs, where no terminal is."""

TICK_S = 0.5
"""How often the line of a terminal is rewritten."""

WIDTH = 78

MOST_KEPT = 2000
"""Lines of a command's output that are kept."""

LAST_WORDS_S = 1.0
"""How long the rest of the output of a command that has ended is waited for. What it left behind in
the background may keep the pipe open for longer."""


class Progress:
    """What is under way.

    On a terminal one line, which is rewritten and in the end removed; elsewhere a line every few
    seconds.
    """

    def __init__(self, doing: str) -> None:
        self.doing = doing
        self._is_terminal = sys.stdout.isatty()
        self._began_s = self._told_s = time.monotonic()

    def tick(self) -> None:
        """Tell it, when it is time to."""
        now_s = time.monotonic()
        line = f"{now_s - self._began_s:4.0f} s  {self.doing}"
        if self._is_terminal:
            shown = line if len(line) <= WIDTH else f"{line[: WIDTH - 3]}..."
            print(f"\r\033[K{shown}", end="", flush=True)
        elif now_s - self._told_s >= EVERY_S:
            print(line, flush=True)
            self._told_s = now_s

    def end(self) -> None:
        """Leave the terminal's line empty."""
        if self._is_terminal:
            print("\r\033[K", end="", flush=True)


def watched(
    command: Sequence[str],
    doing: str,
    folder: Path,
    *,
    read: Callable[[str], str | None] = lambda _: None,
    within_s: float = float("inf"),
) -> tuple[int, list[str]]:
    """Run a command to its end, and tell meanwhile what it is at.

    Args:
        command: what to run.
        doing: what to say as long as `read` has found nothing.
        folder: where.
        read: what a line of output says about what the command is at; None for nothing new.
        within_s: when to kill it.

    Returns:
        Its status, and the last lines of its output.
    """
    progress = Progress(doing)
    lines: queue.Queue[str] = queue.Queue()
    kept: list[str] = []
    ends_s = time.monotonic() + within_s
    process = subprocess.Popen(
        command,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
        errors="replace",
    )
    reading = threading.Thread(target=_pass_on, args=(process.stdout, lines), daemon=True)
    reading.start()
    try:
        while process.poll() is None:
            for line in _next(lines):
                kept.append(line)
                progress.doing = read(line) or progress.doing
            if time.monotonic() > ends_s:
                process.kill()
            progress.tick()
    finally:  # also after Ctrl-C
        process.kill()
        process.wait()
        progress.end()
    reading.join(LAST_WORDS_S)
    return process.returncode, [*kept, *_next(lines)][-MOST_KEPT:]


def _pass_on(stream: TextIO, lines: queue.Queue[str]) -> None:
    with stream:
        for line in stream:
            lines.put(line.rstrip("\n"))


def _next(lines: queue.Queue[str]) -> list[str]:
    """The lines that are there; if there are none, what comes within a tick."""
    found = []
    try:
        found.append(lines.get(timeout=TICK_S))
        while True:
            found.append(lines.get_nowait())
    except queue.Empty:
        return found


_FILE = re.compile(r"(Downloading|Using cached) (?:\S*/)?([\w.]+?)-(\d[\w.+!]*)\S* \(([^)]*)\)")
_COLLECTING = re.compile(r"Collecting ([\w.-]+)")
_INSTALLING = re.compile(r"Installing collected packages: (.*)")


def read_pip(line: str) -> str | None:
    """What pip is at."""
    line = line.strip()
    file = _FILE.match(line)
    if file is not None:
        how = "downloading" if file[1] == "Downloading" else "from pip's cache:"
        return f"{how} {file[2].replace('_', '-')} {file[3]} ({file[4]})"
    collecting = _COLLECTING.match(line)
    if collecting is not None:
        return f"looking for {collecting[1]}"
    installing = _INSTALLING.match(line)
    if installing is not None:
        return f"unpacking {len(installing[1].split(','))} packages"
    if line.startswith(("Building", "Preparing", "Getting requirements", "Installing build")):
        return "preparing what has to be built"
    return None
