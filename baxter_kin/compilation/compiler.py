"""C compilers: those on PATH, and the one that the Python package `ziglang` holds.

A compiler can be broken in three ways: it fails, it succeeds and writes rubbish, or it hangs. The
first shows by itself; what a compiler has written is tried by whoever asked for it. Whether it
hangs is found out with one line of C, which takes a working one a fraction of a second.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from baxter_kin.compilation.limited_process import run_within

COMPILERS = ("cc", "gcc", "clang")
"""Names on PATH, in the order in which they are tried."""

ZIG = (sys.executable, "-m", "ziglang", "cc", "-mcpu=baseline", "-g0")
"""Clang as the package `ziglang` brings it. By itself it would compile for this processor only."""

FLAGS = ("-O2", "-fPIC", "-shared", "-ffp-contract=off")
"""Nothing tied to one processor, for home folders are shared between machines; strict IEEE."""

ANSWER_S = 10.0
"""How long a compiler on PATH may take for one line; it takes 0.05 s."""

TIMEOUT_S = 180.0
"""How long one may take for an arm: `cc` takes 1 to 4 s, `ziglang` 10 to 17 s. Also for the first
line that `ziglang` compiles, since it compiles its own library with it, which once took 9 s."""

_ONE_LINE = "double twice(double x) { return 2.0 * x; }\n"


@dataclass(frozen=True, slots=True)
class Compiler:
    """A C compiler, which may be broken.

    Attributes:
        command: how it is called.
        file: by whose change another version is known.
        answer_s: how long it may take for one line.
    """

    command: tuple[str, ...]
    file: Path
    answer_s: float

    def __str__(self) -> str:
        return "the package ziglang" if self.command == ZIG else self.command[0]

    @property
    def version_key(self) -> str:
        """Another one when it is another program or version, the same for all names of it.

        Raises:
            OSError: when it is gone.
        """
        status = self.file.stat()
        parts = os.path.realpath(self.file), status.st_mtime_ns, status.st_size
        return hashlib.sha256(repr(parts).encode()).hexdigest()[:32]

    def compile(self, source: str, folder: Path) -> Path:
        """Make a library of C in a folder, which must be this user's own.

        Raises:
            OSError: when the compiler cannot be called.
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
    """What looks like a C compiler here, in the order to try."""
    names = filter(None, map(shutil.which, COMPILERS))
    on_path = [Compiler((path,), Path(path), ANSWER_S) for path in map(os.path.abspath, names)]
    package = find_spec("ziglang")
    if package is None or package.origin is None:
        return tuple(on_path)
    return (*on_path, Compiler(ZIG, Path(package.origin), TIMEOUT_S))
