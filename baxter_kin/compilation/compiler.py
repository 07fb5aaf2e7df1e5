"""C compilers: those on PATH, and the one that the Python package `ziglang` contains.

A compiler can be broken in three ways: it fails, it succeeds and writes rubbish, or it hangs. The
first shows by itself; the caller tests the output. A hanging compiler is detected with one line of
C, which takes a working one a fraction of a second.
"""

from __future__ import annotations

import hashlib
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
"""Clang of the package `ziglang`. By default it would compile for this processor only."""

FLAGS = ("-O2", "-fPIC", "-shared", "-ffp-contract=off")
"""Nothing tied to one processor, for home folders are shared between machines; strict IEEE."""

ANSWER_S = 10.0
"""Time limit of a compiler on PATH for one line; it takes 0.05 s."""

TIMEOUT_S = 180.0
"""Time limit for an arm: `cc` takes 1 to 4 s, `ziglang` 10 to 17 s. Also for the first line that
`ziglang` compiles, since it compiles its own library with it, which once took 9 s."""

_ONE_LINE = "double twice(double x) { return 2.0 * x; }\n"


@dataclass(frozen=True, slots=True)
class Compiler:
    """A C compiler, which may be broken.

    Attributes:
        command: the program and its first arguments.
        file: changes with the version.
        answer_s: time limit for one line.
    """

    command: tuple[str, ...]
    file: Path
    answer_s: float

    def __str__(self) -> str:
        return "the package ziglang" if self.command == ZIG else self.command[0]

    @property
    def version_key(self) -> str:
        """Differs between programs and versions; the same for all names of one program."""
        status = self.file.stat()
        parts = os.path.realpath(self.file), status.st_mtime_ns, status.st_size
        return hashlib.sha256(repr(parts).encode()).hexdigest()[:32]

    def compile(self, source: str, folder: Path) -> Path:
        """Compile C to a library in a folder, which must be this user's own.

        Raises:
            OSError: when the compiler cannot be started.
            subprocess.CalledProcessError: when it fails.
            subprocess.TimeoutExpired: when it hangs.
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
    """C compilers of this machine, which may be broken, in the order of preference."""
    names = filter(None, map(shutil.which, COMPILERS))
    on_path = [Compiler((path,), Path(path), ANSWER_S) for path in map(os.path.abspath, names)]
    package = find_spec("ziglang")
    if package is None or package.origin is None:
        return tuple(on_path)
    return (*on_path, Compiler(ZIG, Path(package.origin), TIMEOUT_S))


def run_within(
    within_s: float,
    command: Sequence[str],
    folder: Path,
    environment: Mapping[str, str] | None = None,
) -> None:
    """Run a program, ignore its output, and wait for it to succeed.

    It runs in a process group of its own, so that the processes that it has started end with it. A
    process that leaves that group, as a daemon does, is not ended.

    Args:
        within_s: time limit.
        command: the program and its arguments.
        folder: the working directory. Others must not be able to write to it: Python, for one,
            imports from there.
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
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        raise
    if status != 0:
        raise subprocess.CalledProcessError(status, command)
