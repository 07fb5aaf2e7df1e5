"""How recordings reach the disk and come back; whatever fails there is a `RecordingError`."""

from __future__ import annotations

import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import IO, NamedTuple, TypeAlias

from sim.errors import RecordingError

PathLike: TypeAlias = "str | os.PathLike[str]"

LONGEST_LINE_BYTES = 64 * 2**20
"""A mesh of 200,000 triangles takes 20 MB as text; a longer line belongs to something else."""


class Line(NamedTuple):
    """A line of a text file.

    Attributes:
        number: counted from 1.
        text: without its line end.
        is_complete: whether it has a line end; only the last one may have none.
    """

    number: int
    text: str
    is_complete: bool


class LineFile:
    """A text file while it is being written; every line is handed to the system at once.

    A process that is killed therefore loses no line, and at most its last one is half written. What
    a power failure takes is the system's matter.
    """

    def __init__(self, path: PathLike) -> None:
        """Open the file, in place of an older one.

        Raises:
            RecordingError: when it cannot be opened.
        """
        self._path = checked_path(path)
        with self._explained():
            self._stream = open(self._path, "wb")  # noqa: SIM115 - closed by close()

    def __enter__(self) -> LineFile:
        """The open file."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    def write(self, line: str) -> None:
        """Write one line, given without its end.

        Raises:
            RecordingError: when it cannot be written; the file is closed then.
        """
        try:
            self._stream.write(line.encode() + b"\n")
            self._stream.flush()
        except (OSError, ValueError):
            with self._explained():
                with suppress(OSError):
                    self._stream.close()
                raise

    def close(self) -> None:
        """Close the file; twice is no trouble.

        Raises:
            RecordingError: when what is left cannot be written.
        """
        with self._explained():
            self._stream.close()

    def _explained(self) -> AbstractContextManager[None]:
        return explained(f"cannot write {self._path}")


def checked_path(path: object) -> Path:
    """A path.

    Raises:
        RecordingError: when it is neither text nor a Path.
    """
    plain = os.fspath(path) if isinstance(path, os.PathLike) else path
    if not isinstance(plain, str):
        raise RecordingError(f"a path must be text or a Path, got {type(path).__name__}")
    return Path(plain)


@contextmanager
def explained(what: str) -> Iterator[None]:
    """Make a `RecordingError` of what the system complains about; its message begins with `what`.

    Raises:
        RecordingError: when the system complains.
    """
    try:
        yield
    except RecordingError:
        raise
    except (OSError, ValueError) as cause:  # ValueError: no path, or a closed file
        reason = getattr(cause, "strerror", None) or str(cause)
        raise RecordingError(f"{what}: {reason}") from cause


def read_lines(path: PathLike) -> Iterator[Line]:
    """The lines of a text file, UTF-8, one after the other; a line ends with LF or CR LF.

    Raises:
        RecordingError: when the file cannot be read, is no regular file, or holds no text.
    """
    file = checked_path(path)
    with opened(file) as stream:
        number = 0
        while content := _next_line(stream, file, number := number + 1):
            is_complete = content.endswith(b"\n")
            try:
                text = content.decode("utf-8-sig" if number == 1 else "utf-8")
            except UnicodeDecodeError:
                if is_complete:
                    raise RecordingError(f"{file} is no text: line {number} is not UTF-8") from None
                text = ""
            yield Line(number, text.rstrip("\r\n"), is_complete)


@contextmanager
def opened(path: PathLike) -> Iterator[IO[bytes]]:
    """A file, opened for reading without waiting for another process to write it.

    Raises:
        RecordingError: when it cannot be read, or is no regular file.
    """
    file = checked_path(path)
    with explained(f"cannot read {file}"):
        descriptor = os.open(file, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
        with os.fdopen(descriptor, "rb") as stream:
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                raise RecordingError(f"{file} is no regular file")
            yield stream


def replace_file(path: PathLike, content: bytes) -> None:
    """Write a file at once or not at all; an older one is replaced.

    Raises:
        RecordingError: when it cannot be written.
    """
    file = checked_path(path)
    with explained(f"cannot write {file}"):
        target = file.resolve()
        if target.exists() and not target.is_file():
            raise RecordingError(f"cannot write {file}: it exists and is no regular file")
        beside = target.with_name(f".{target.name}.{secrets.token_hex(8)}.part")
        try:
            beside.write_bytes(content)
            os.replace(beside, target)
        except BaseException:
            with suppress(OSError):
                beside.unlink(missing_ok=True)
            raise


def _next_line(stream: IO[bytes], file: Path, number: int) -> bytes:
    content = stream.readline(LONGEST_LINE_BYTES)
    if len(content) == LONGEST_LINE_BYTES:
        raise RecordingError(f"{file}: line {number} is longer than {LONGEST_LINE_BYTES >> 20} MB")
    return content
