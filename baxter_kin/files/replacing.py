"""Opening and replacing files, for everything that the toolkit reads and writes.

Only regular files are written, existing or new; folders, devices, pipes and sockets are refused and
left as they are. Symbolic links are followed and stay. A replaced file keeps its permissions, and
its owner and group where the system allows it; a new one gets the permissions of the umask. Every
failure is a `FileError`, from which each layer makes its own.
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

MAX_LINKS = 40
"""Length of a chain of links that Linux follows before it reports a loop."""

_KINDS: tuple[tuple[Callable[[int], bool], str], ...] = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


@dataclass(frozen=True, slots=True)
class Destination:
    """The file that a path leads to.

    Attributes:
        path: the file itself, with all links followed.
        status: its `os.stat` result; None while the file does not exist.
    """

    path: Path
    status: os.stat_result | None

    @classmethod
    def of(cls, path: PathLike) -> Destination:
        """Follow a path without opening or changing anything."""
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
        """Equal for two names of one file, also if these are symbolic or hard links."""
        return self.path if self.status is None else (self.status.st_dev, self.status.st_ino)


def replace_file(path: PathLike, content: bytes) -> None:
    """Replace a file atomically: other processes see the old content or the new."""
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
    """Open a file for writing piece by piece; an existing one is truncated."""
    destination = Destination.of(path)
    with _explained("write", path):
        return _opened(destination.path, os.O_WRONLY | os.O_CREAT, "wb")


def open_to_read(path: PathLike) -> IO[bytes]:
    """Open a regular file for reading, without waiting for other processes."""
    with _explained("read", path):
        return _opened(_checked_path(path), os.O_RDONLY, "rb")


def _opened(path: Path, flags: int, mode: str) -> IO[bytes]:
    """Open a file, check that it is regular, and only then truncate it for writing."""
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
        raise ValueError(f"it is {kind}, not a regular file")


def _followed(path: Path) -> Path:
    """The path with all links followed; the file need not exist."""
    for _ in range(MAX_LINKS + 1):
        place = Path(os.path.realpath(path.parent), path.name)
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
    """Turn errors into a `FileError`."""
    try:
        yield
    except (OSError, TypeError, ValueError) as cause:  # the last two: invalid paths
        raise FileError(action, path, _reason(cause)) from cause


def _reason(cause: Exception) -> str:
    if isinstance(cause, OSError) and cause.errno == errno.ELOOP:
        return "its symbolic links form a loop, or there are more than the system follows"
    return getattr(cause, "strerror", None) or str(cause)
