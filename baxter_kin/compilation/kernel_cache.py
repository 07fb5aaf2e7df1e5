"""The folders in which compiled libraries are kept.

Libraries are machine code that runs with this user's rights. They are loaded only from a folder
that belongs to this user and that nobody else may write to: `baxter-kin` in `$XDG_CACHE_HOME` or
`~/.cache`, made with mode 0700, or else a temporary one of this process. A checksum in the name of
a library guards against damage: loading a truncated library would kill the interpreter.
"""

from __future__ import annotations

import atexit
import hashlib
import logging
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from baxter_kin.errors import FileError

MAX_LIBRARIES = 16
"""How many libraries are kept, the newest ones: those of both arms in four versions of model or
toolkit."""

ABANDONED_AFTER_S = 86_400.0
"""Age from which unfinished builds, left by a killed process, are removed."""

BUILD = "build-"
"""Prefix of the names of folders for builds."""

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class KernelCache:
    """A folder with libraries that belongs to this user alone.

    Attributes:
        folder: absolute.
        is_lasting: whether it outlives this process.
    """

    folder: Path
    is_lasting: bool

    @property
    def is_writable(self) -> bool:
        """Whether libraries can be added."""
        return os.access(self.folder, os.W_OK | os.X_OK)

    def library(self, key: str) -> Path | None:
        """The library of a kernel; None unless it is there and intact. A damaged one is removed."""
        for path in self.folder.glob(f"{key}-*.so"):
            with suppress(OSError):
                if path.name == _name(key, path.read_bytes()):
                    return path
                path.unlink()
        return None

    def keep(self, key: str, built: Path) -> Path:
        """Move a library that was built inside the folder into place, and remove the oldest."""
        library = self.folder / _name(key, built.read_bytes())
        built.chmod(0o600)
        os.replace(built, library)
        with suppress(OSError):  # as when another process removes the same
            self._remove_oldest(library)
        return library

    def _remove_oldest(self, newest: Path) -> None:
        others = [path for path in self.folder.glob("*.so") if path != newest]
        others.sort(key=lambda path: path.lstat().st_mtime_ns, reverse=True)
        for path in others[MAX_LIBRARIES - 1 :]:
            path.unlink()
        for build in self.folder.glob(f"{BUILD}*"):
            if build.lstat().st_mtime < time.time() - ABANDONED_AFTER_S:
                shutil.rmtree(build, ignore_errors=True)


def kernel_caches() -> Iterator[KernelCache]:
    """Caches in the order in which they are searched; the first writable one takes new libraries.

    The first is the user's folder, if it belongs to this user alone; the second belongs to this
    process and is made when it is first needed.
    """
    try:
        user = KernelCache(_private(user_folder()), is_lasting=True)
    except FileError as cause:
        reason = str(cause)
    else:
        yield user
        reason = f"cannot write to {user.folder}"
    if not temporary_folder.cache_info().currsize:
        log.warning("%s; compiled kernels are kept for this process only", reason)
    yield KernelCache(_private(temporary_folder()), is_lasting=False)


def user_folder() -> Path:
    """The user's cache folder.

    A relative `XDG_CACHE_HOME` is ignored, as the XDG Base Directory Specification requires. An
    empty `HOME` is refused with a `FileError`.
    """
    cache = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(cache):
        return Path(cache, "baxter-kin")
    home = os.path.expanduser("~")
    if not os.path.isabs(home) or not os.environ.get("HOME", home):
        raise FileError("use", "~/.cache/baxter-kin", "HOME is no absolute path")
    return Path(home, ".cache", "baxter-kin")


@lru_cache(maxsize=1)
def temporary_folder() -> Path:
    """A folder that is removed when this process ends."""
    folder = Path(tempfile.mkdtemp(prefix="baxter-kin-"))
    atexit.register(_remove, folder, os.getpid())
    return folder


def _remove(folder: Path, owner: int) -> None:
    """Remove a folder at the end of the process that made it, but not of its forks."""
    if os.getpid() == owner:
        shutil.rmtree(folder, ignore_errors=True)


def _private(folder: Path) -> Path:
    """A folder that belongs to this user and that nobody else may write to; made if missing.

    Any other folder is refused with a `FileError`. Root makes none in the home of another user,
    who could not use it.
    """
    try:
        above = next(path for path in folder.parents if path.exists())
        if not folder.exists() and os.geteuid() == 0 != above.stat().st_uid:
            raise FileError("use", folder, f"{above} belongs to another user, not to root")
        folder.parent.mkdir(0o700, parents=True, exist_ok=True)
        with suppress(FileExistsError):
            folder.mkdir(0o700)
        status = folder.lstat()
    except OSError as cause:
        raise FileError("use", folder, cause.strerror or str(cause)) from cause
    is_own = stat.S_ISDIR(status.st_mode) and status.st_uid == os.geteuid()
    if not is_own or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        reason = "it must be a folder of this user that nobody else may write to (chmod go-w)"
        raise FileError("use", folder, reason)
    return folder


def _name(key: str, content: bytes) -> str:
    """The file name of a library; a library under the name of another kernel counts as damaged."""
    return f"{key}-{digest(key.encode() + content)}.so"


def digest(content: bytes) -> str:
    """The first half of a SHA-256, 32 hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()[:32]
