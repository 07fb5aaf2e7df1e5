"""Where compiled kernels are kept: the user's cache folder, or else one of this process alone.

What lies there is machine code that will run with this user's rights, so the user's folder
(`$XDG_CACHE_HOME` or `~/.cache`, folder `baxter-kin`) is taken only if nobody else can write to it
or put another in its place, and a library only if it belongs to this user. Nobody else can then
exchange a library between the look at its checksum and its loading. The checksum guards against
damage, not against people: loading a truncated library would kill the interpreter.
"""

from __future__ import annotations

import atexit
import hashlib
import logging
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from baxter_kin.compilation.ownership import make_own_folder, read_own_file
from baxter_kin.errors import FileError

MOST_LIBRARIES = 16
"""How many are kept, the newest ones: those of both arms in four versions of model or toolkit.
Of notes no more."""

ABANDONED_AFTER_S = 86_400.0
"""What a killed process left half built is removed after a day."""

_WORKPLACE = "build-"

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class KernelCache:
    """A folder of this user's own with libraries, each beside its checksum.

    Attributes:
        folder: reached without links.
        is_lasting: whether it outlives this process.
    """

    folder: Path
    is_lasting: bool

    @property
    def is_writable(self) -> bool:
        """Whether something may be added."""
        return os.access(self.folder, os.W_OK | os.X_OK)

    def library(self, key: str) -> Path | None:
        """The library of that name; None unless it is there, intact and this user's own."""
        library = self._library(key)
        try:
            content, checksum = (read_own_file(p) for p in (library, _checksum_file(library)))
        except OSError:
            return None
        except FileError as cause:
            log.warning("%s; compiling the kernel afresh", cause)
            return None
        return library if _checksum(content) == checksum else None

    def workplace(self) -> tempfile.TemporaryDirectory[str]:
        """A folder inside it to build in, for a `with` block."""
        return tempfile.TemporaryDirectory(
            prefix=_WORKPLACE, dir=self.folder, ignore_cleanup_errors=True
        )

    def keep(self, key: str, built: Path) -> Path:
        """Put a library in place that was built in a workplace, and remove the oldest.

        Raises:
            OSError: when that fails.
        """
        library, content = self._library(key), built.read_bytes()
        for target, what in ((_checksum_file(library), _checksum(content)), (library, content)):
            part = built.with_suffix(".part")
            _write_new(part, what)
            os.replace(part, target)
        with suppress(OSError):  # as when another process removes the same; it is done next time
            self._remove_oldest(library)
        return library

    def note(self, name: str, reason: str) -> None:
        """Leave a note for later processes.

        Raises:
            OSError: when that fails.
        """
        self._note(name).write_text(f"{reason}\n", "utf-8")

    def has_note(self, name: str) -> bool:
        """Whether a process has left it."""
        return self._note(name).exists()

    def _library(self, key: str) -> Path:
        return self.folder / f"{key}.so"

    def _note(self, name: str) -> Path:
        return self.folder / f"{name}.note"

    def _remove_oldest(self, newest: Path) -> None:
        for pattern in "*.so", "*.note":
            others = [path for path in self.folder.glob(pattern) if path != newest]
            others.sort(key=lambda path: path.lstat().st_mtime_ns, reverse=True)
            for path in others[MOST_LIBRARIES - 1 :]:
                path.unlink()
                _checksum_file(path).unlink(missing_ok=True)
        for workplace in self.folder.glob(f"{_WORKPLACE}*"):
            if workplace.lstat().st_mtime < time.time() - ABANDONED_AFTER_S:
                shutil.rmtree(workplace, ignore_errors=True)


def kernel_caches() -> Iterator[KernelCache]:
    """Where to look for a library, and where to keep it: in the last one asked for.

    The user's folder first, if it is theirs alone; else, or when more is asked for, the private
    one, which is made at that moment.

    Raises:
        OSError: when the private one cannot be made.
        FileError: when not even that would be private.
    """
    try:
        user = KernelCache(make_own_folder(user_folder()), is_lasting=True)
    except FileError as cause:
        reason = str(cause)
    else:
        yield user
        reason = f"cannot write to {user.folder}"
    yield KernelCache(_PRIVATE.opened(reason), is_lasting=False)


def user_folder() -> Path:
    """The user's cache folder, whoever else has a say in it.

    A relative `XDG_CACHE_HOME` is ignored, as the XDG Base Directory Specification wants it.

    Raises:
        FileError: when it is not known, as with an empty `HOME`.
    """
    cache = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(cache):
        return Path(cache, "baxter-kin")
    home = os.environ.get("HOME")
    if home is None:
        with suppress(RuntimeError):  # a user without an entry among the system's users
            home = str(Path.home())
    if home is None or not os.path.isabs(home):
        raise FileError("use", "~/.cache/baxter-kin", "HOME is no absolute path")
    return Path(home, ".cache", "baxter-kin")


class PrivateFolder:
    """A folder for this process alone, made when it is first needed, and removed at its end."""

    def __init__(self) -> None:
        self._folder: Path | None = None

    def opened(self, reason: str) -> Path:
        """The folder; the first time that it is needed, a warning says for which reason.

        Raises:
            OSError: when it cannot be made.
            FileError: when others could put another in its place.
        """
        if self._folder is None:
            self._folder = Path(os.path.realpath(tempfile.mkdtemp(prefix="baxter-kin-")))
            atexit.register(_remove, self._folder, os.getpid())
            log.warning("%s; compiled kernels are kept for this process only", reason)
        return make_own_folder(self._folder)  # again, when something has tidied it away


_PRIVATE = PrivateFolder()


def _remove(folder: Path, owner: int) -> None:
    """At the end of the process that made it, but not of its forks."""
    if os.getpid() == owner:
        shutil.rmtree(folder, ignore_errors=True)


def _write_new(path: Path, content: bytes) -> None:
    """A file that was not there and that this user alone may read and write."""
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with open(descriptor, "wb") as stream:
        stream.write(content)


def _checksum(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest().encode("ascii")


def _checksum_file(library: Path) -> Path:
    return library.with_suffix(".sha256")
