"""What the sub-commands share: exit status, messages, reports, progress."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from baxter_kin.command_line import UsageError, file_to_write, flag, option
from baxter_kin.errors import PoseError, UnknownNameError
from baxter_kin.files import replace_file
from baxter_kin.files.json_text import Json, as_lines
from planner.errors import AtlasError

NAME = "planner.atlas"

EXIT_DONE, EXIT_FAILED = 0, 1

EXIT_STATUS = (
    "Exit status: 0 done; {also}1 the map or what computes it failed, in one sentence on stderr; "
    "2 wrong usage; 130 Ctrl-C."
)
"""End of the help texts."""


@contextmanager
def asked_for() -> Iterator[None]:
    """Turn errors inside the block into a `UsageError`: they are due to what was asked for."""
    try:
        yield
    except (AtlasError, PoseError, UnknownNameError) as cause:
        raise UsageError(str(cause)) from cause


def map_argument() -> Any:
    """The field of a map's folder."""
    return option(type=Path, metavar="PATH", help="the map's folder")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportOptions:
    """What is written and printed about the work."""

    json: Path | None = option(
        "--json", type=file_to_write, metavar="FILE", help="write a report", group="output"
    )
    is_quiet: bool = flag(
        "-q", "--quiet", help="no progress, and nothing but errors", group="output"
    )

    def say(self, text: str) -> None:
        """Print a result, unless nothing is to be printed."""
        if not self.is_quiet:
            say(text)

    def write(self, report: dict[str, Json]) -> None:
        """Write a report as JSON, if a file is given."""
        write_report(self.json, report)


def say(text: str) -> None:
    """Print a result."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def complain(text: str) -> None:
    """Print an error as one sentence on stderr, where nothing else goes but progress."""
    sys.stderr.write(f"{NAME}: {' '.join(text.split())}\n")
    sys.stderr.flush()


def write_report(path: Path | None, report: dict[str, Json]) -> None:
    """Write a report as JSON, if a file is given."""
    if path is not None:
        replace_file(path, as_lines(report).encode() + b"\n")


def shown_bytes(size: float) -> str:
    """A size in the unit that fits, to three digits."""
    for least, unit in ((1e12, "TB"), (1e9, "GB"), (1e6, "MB")):
        if size >= least:
            return f"{size / least:.3g} {unit}"
    return f"{size / 1e3:.3g} kB"


def shown_share(number: int, total: int) -> str:
    """A number and its share of a total, to three digits."""
    return f"{number:,} ({number / total:.3%})" if total else f"{number:,}"
