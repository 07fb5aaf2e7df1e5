"""Files: one way to open them and to put them in place, for all that the toolkit reads and writes.

What is written replaces a regular file or makes a new one. Anything else is refused and left as it
is: folders, devices, pipes, sockets, and what lies in `/proc`, which is where `/dev/stdout` leads.
A link stays a link, and the file that it leads to is written. A file that is replaced keeps its
permissions, and its owner and group where the system allows that; a new one gets what the umask
leaves. Whatever fails is a `FileError`, from which every layer makes its own.
"""

from __future__ import annotations

import errno
import os
import secrets
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TypeAlias

from baxter_kin.errors import FileError

PathLike: TypeAlias = "str | os.PathLike[str]"

PROCESSES = Path("/proc")
"""Names below this stand for processes and for what they have open, not for files."""

MOST_LINKS = 40
"""How many links one after the other Linux follows before it calls them a loop."""

_KINDS: tuple[tuple[Callable[[int], bool], str], ...] = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


@dataclass(frozen=True, slots=True)
class Destination:
    """Where it goes what is written to a path.

    Attributes:
        path: the file itself, all links followed.
        status: what the system knows of that file; None when it is still to be made.
    """

    path: Path
    status: os.stat_result | None

    @classmethod
    def of(cls, path: PathLike) -> Destination:
        """Follow a path; nothing is opened or changed."""
        with _explained("write", path):
            place = _checked_path(path)
            try:
                status = os.stat(place)
            except FileNotFoundError:
                return cls(_followed(place), None)
            _check_regular(status)
            return cls(_followed(place), status)

    @property
    def identity(self) -> tuple[int, int] | Path:
        """Equal for two names of one file, whether these are links or hard links."""
        return self.path if self.status is None else (self.status.st_dev, self.status.st_ino)


def replace_file(path: PathLike, content: bytes) -> None:
    """Write a file at once or not at all; nobody sees half of it."""
    destination = Destination.of(path)
    with _explained("write", path):
        if destination.status is not None and not os.access(destination.path, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        beside = destination.path.with_name(f".{secrets.token_hex(8)}.part")
        descriptor = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        try:
            with open(descriptor, "wb") as stream:
                _keep_permissions(descriptor, destination.status)
                stream.write(content)
                stream.flush()
                os.fsync(descriptor)
            os.replace(beside, destination.path)
        except BaseException:
            with suppress(OSError):
                beside.unlink()
            raise


def open_to_write(path: PathLike) -> IO[bytes]:
    """A file to be written from its beginning, piece by piece; what it held is gone at once."""
    destination = Destination.of(path)
    with _explained("write", path):
        return _opened(destination.path, os.O_WRONLY | os.O_CREAT, "wb")


def open_to_read(path: PathLike) -> IO[bytes]:
    """A regular file to be read; no other process is waited for."""
    with _explained("read", path):
        return _opened(_checked_path(path), os.O_RDONLY, "rb")


def _opened(path: Path, flags: int, mode: str) -> IO[bytes]:
    """The file, once it is known to be regular; only then is it emptied to be written."""
    descriptor = os.open(path, flags | os.O_NONBLOCK, 0o666)
    try:
        _check_regular(os.fstat(descriptor))
        if mode == "wb":
            os.ftruncate(descriptor, 0)
        return open(descriptor, mode)
    except BaseException:
        os.close(descriptor)
        raise


def _checked_path(path: PathLike) -> Path:
    if not isinstance(path, (str, os.PathLike)):
        raise TypeError(f"a path must be text or a Path, got {type(path).__name__}")
    return Path(path)


def _check_regular(status: os.stat_result) -> None:
    if not stat.S_ISREG(status.st_mode):
        kind = next((name for is_kind, name in _KINDS if is_kind(status.st_mode)), "something else")
        raise ValueError(f"it is {kind}, no regular file")


def _followed(path: Path) -> Path:
    """The place that a path leads to, whether something is there or not."""
    for _ in range(MOST_LINKS + 1):
        place = Path(os.path.realpath(path.parent), path.name)
        if PROCESSES in place.parents:
            raise ValueError("it leads to /proc, where names stand for processes, not for files")
        if not place.is_symlink():
            return place
        path = place.parent / os.readlink(place)
    raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))


def _keep_permissions(descriptor: int, status: os.stat_result | None) -> None:
    if status is not None:
        with suppress(PermissionError):
            os.fchown(descriptor, status.st_uid, status.st_gid)
        os.fchmod(descriptor, status.st_mode & 0o777)


@contextmanager
def _explained(action: str, path: object) -> Iterator[None]:
    """Make a `FileError` of what goes wrong."""
    try:
        yield
    except (OSError, TypeError, ValueError) as cause:  # of the last two, paths that are none
        raise FileError(action, path, _reason(cause)) from cause


def _reason(cause: Exception) -> str:
    if isinstance(cause, OSError) and cause.errno == errno.ELOOP:
        return "its symbolic links form a loop, or are more than the system follows"
    return getattr(cause, "strerror", None) or str(cause)
