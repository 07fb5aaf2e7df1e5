"""What the commands have in common of what they say and write."""

from __future__ import annotations

import sys
from pathlib import Path

from baxter_kin.command_line import Options, file_to_write
from baxter_kin.files import replace_file
from baxter_kin.json_text import Json, as_lines

NAME = "planner.atlas"


def add_report_options(parser: Options) -> None:
    """Add `--json` and `--quiet`."""
    output = parser.add_argument_group("output")
    output.add_argument("--json", type=file_to_write, metavar="FILE", help="write a report")
    output.add_argument(
        "-q", "--quiet", action="store_true", help="no progress, and nothing but what is wrong"
    )


def say(text: str) -> None:
    """What was asked for, on stdout."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def complain(text: str) -> None:
    """One sentence of what is wrong, on stderr, where nothing else goes but progress."""
    sys.stderr.write(f"{NAME}: {' '.join(text.split())}\n")
    sys.stderr.flush()


def write_report(path: Path | None, report: dict[str, Json]) -> None:
    """Write what was asked for.

    Raises:
        FileError: when it cannot be written.
    """
    if path is not None:
        replace_file(path, as_lines(report).encode() + b"\n")


def shown_bytes(size: float) -> str:
    """In the unit that fits, to three digits."""
    for least, unit in ((1e12, "TB"), (1e9, "GB"), (1e6, "MB")):
        if size >= least:
            return f"{size / least:.3g} {unit}"
    return f"{size / 1e3:.3g} kB"


def shown_share(number: int, total: int) -> str:
    """A number and what share of a total it is, to three digits."""
    return f"{number:,} ({number / total:.3%})" if total else f"{number:,}"
