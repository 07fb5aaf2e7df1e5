"""C compilers: those on PATH, and the one that the Python package `ziglang` contains.

A compiler can be broken in three ways: it fails, it writes a library that does not work, or it
hangs. A failure has an exit status; the caller tests the library. A hanging compiler is detected
with one line of C, which a working one compiles in a fraction of a second.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

COMPILERS = ("cc", "gcc", "clang")
"""Names on PATH, in the order of preference."""

ZIG = (sys.executable, "-m", "ziglang", "cc", "-mcpu=baseline", "-g0")
"""Clang of the package `ziglang`; without `-mcpu` it would compile for this processor only."""

FLAGS = ("-O2", "-fPIC", "-shared", "-ffp-contract=off")
"""Code for any processor, since home folders are shared between machines; strict IEEE."""

ANSWER_S = 10.0
"""Time limit of a compiler on PATH for one line; it takes 0.05 s."""

TIMEOUT_S = 180.0
"""Time limit for the kernels of an arm: `cc` takes 1 to 4 s, `ziglang` 10 to 17 s. Also for the
first line with `ziglang`, which compiles its own library as well, in 9 s at most so far."""

_ONE_LINE = "double twice(double x) { return 2.0 * x; }\n"


@dataclass(frozen=True, slots=True)
class Compiler:
    """A C compiler, which may be broken.

    Attributes:
        command: the program and its first arguments.
        answer_s: time limit for one line of C.
    """

    command: tuple[str, ...]
    answer_s: float = ANSWER_S

    def __str__(self) -> str:
        return "the package ziglang" if self.command == ZIG else self.command[0]

    def compile(self, source: str, folder: Path) -> Path:
        """Compile C to a library in a folder that belongs to this user.

        A broken compiler raises as in `run_within`.
        """
        self._run(_ONE_LINE, folder / "line", self.answer_s)
        return self._run(source, folder / "kernel", TIMEOUT_S)

    def _run(self, source: str, stem: Path, within_s: float) -> Path:
        written, library = stem.with_suffix(".c"), stem.with_suffix(".so")
        written.write_text(source, "ascii")
        command = [*self.command, *FLAGS, str(written), "-o", str(library), "-lm"]
        run_within(within_s, command, stem.parent)
        return library


def compilers() -> tuple[Compiler, ...]:
    """The C compilers of this machine in the order of preference; they may be broken."""
    on_path = [os.path.abspath(path) for path in map(shutil.which, COMPILERS) if path]
    programs = {os.path.realpath(path): path for path in reversed(on_path)}  # the first names
    found = [Compiler((path,)) for path in on_path if path in programs.values()]
    return (*found, Compiler(ZIG, TIMEOUT_S)) if find_spec("ziglang") else tuple(found)


def run_within(
    within_s: float,
    command: Sequence[str],
    folder: Path,
    environment: Mapping[str, str] | None = None,
) -> None:
    """Run a program, ignore its output, and wait for it to succeed.

    The program runs in a process group of its own, so that its child processes end with it.

    Args:
        within_s: time limit.
        command: the program and its arguments.
        folder: the working directory. Others must not be able to write to it: Python, for one,
            imports from there.
        environment: environment variables; those of this process by default.

    Raises:
        OSError: when the program cannot be started.
        subprocess.SubprocessError: when it fails, or takes longer than `within_s`.
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
    except BaseException:  # KeyboardInterrupt too: the terminal does not signal that group
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        raise
    if status != 0:
        raise subprocess.CalledProcessError(status, command)
