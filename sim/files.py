"""Files of recordings; whatever fails in reading or writing them is a `RecordingError`."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import IO, NamedTuple

from baxter_kin import files
from baxter_kin.display import OneLine, phrase, shown_path
from baxter_kin.errors import FileError
from baxter_kin.fields import NotCopied
from baxter_kin.files import PathLike, open_to_read, open_to_write
from sim.errors import RecordingError

MAX_LINE_BYTES = 64 * 2**20
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


class Output(NotCopied, OneLine):
    """A file that is written piece by piece; once writing has failed, it raises every time."""

    def __init__(self, path: PathLike) -> None:
        """Open the file, replacing an older one."""
        self._path = checked_path(path)
        self._failure: str | None = None
        with self._explained():
            self._stream = open_to_write(self._path)

    @property
    def is_closed(self) -> bool:
        """Whether it was closed, or has failed."""
        return self._stream.closed

    @contextmanager
    def writing(self) -> Iterator[IO[bytes]]:
        """The file, for writing a piece of it inside the block."""
        if self._failure is not None:
            raise RecordingError(self._failure)
        try:
            with self._explained():
                yield self._stream
        except RecordingError as error:
            self._failure = str(error)
            with suppress(OSError):
                self._stream.close()
            raise

    def close(self) -> None:
        """Close the file; closing it twice is allowed."""
        with self._explained():
            self._stream.close()

    def _facts(self) -> tuple[str, ...]:
        return phrase(self._path), "closed" if self.is_closed else "open"

    def _explained(self) -> AbstractContextManager[None]:
        return explained(f"cannot write {shown_path(self._path)}")


class LineFile(NotCopied, OneLine):
    """A text file that is written line by line, each passed to the operating system at once.

    A process that is killed therefore loses no line, and at most its last one is half written. A
    power failure may lose more.
    """

    def __init__(self, path: PathLike) -> None:
        """Open the file, replacing an older one."""
        self._output = Output(path)

    def __enter__(self) -> LineFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, line: str) -> None:
        """Write one line, given without its end."""
        with self._output.writing() as stream:
            stream.write(line.encode() + b"\n")
            stream.flush()

    def close(self) -> None:
        """Close the file; closing it twice is allowed."""
        self._output.close()

    def _facts(self) -> tuple[str, ...]:
        return self._output._facts()


def checked_path(path: object) -> Path:
    """The argument as a `Path`."""
    plain = os.fspath(path) if isinstance(path, os.PathLike) else path
    if not isinstance(plain, str):
        raise RecordingError(f"a path must be text or a Path, got {type(path).__name__}")
    return Path(plain)


@contextmanager
def explained(what: str) -> Iterator[None]:
    """Turn system errors into a `RecordingError` whose message begins with `what`."""
    try:
        yield
    except RecordingError:
        raise
    except FileError as cause:
        raise RecordingError(f"{what}: {cause.reason}") from cause
    except (OSError, ValueError) as cause:  # ValueError: a closed file
        reason = getattr(cause, "strerror", None) or str(cause)
        raise RecordingError(f"{what}: {reason}") from cause


def read_lines(path: PathLike) -> Iterator[Line]:
    """The lines of a text file, UTF-8, one after the other; a line ends with LF or CR LF."""
    file = checked_path(path)
    with opened(file) as stream:
        number = 0
        while content := _next_line(stream, file, number := number + 1):
            is_complete = content.endswith(b"\n")
            try:
                text = content.decode("utf-8-sig" if number == 1 else "utf-8")
            except UnicodeDecodeError:
                if is_complete:
                    raise RecordingError(
                        f"{shown_path(file)} is no text: line {number} is not UTF-8"
                    ) from None
                text = ""
            yield Line(number, text.rstrip("\r\n"), is_complete)


@contextmanager
def opened(path: PathLike) -> Iterator[IO[bytes]]:
    """A file, opened for reading without waiting for another process to write it."""
    file = checked_path(path)
    with explained(f"cannot read {shown_path(file)}"), open_to_read(file) as stream:
        yield stream


def replace_file(path: PathLike, content: bytes) -> None:
    """Write a whole file or nothing, replacing an older one."""
    file = checked_path(path)
    with explained(f"cannot write {shown_path(file)}"):
        files.replace_file(file, content)


def _next_line(stream: IO[bytes], file: Path, number: int) -> bytes:
    content = stream.readline(MAX_LINE_BYTES)
    if len(content) == MAX_LINE_BYTES:
        raise RecordingError(
            f"{shown_path(file)}: line {number} is longer than {MAX_LINE_BYTES >> 20} MB"
        )
    return content
