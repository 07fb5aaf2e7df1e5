"""What the sub-commands share: exit status, messages, reports, progress."""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from baxter_kin.command_line import UsageError, file_to_write, flag, option
from baxter_kin.errors import PoseError, UnknownNameError
from baxter_kin.files import replace_file
from baxter_kin.json_text import Json, as_lines
from planner.atlas.cost import shown_time
from planner.errors import AtlasError

NAME = "planner.atlas"

EXIT_DONE, EXIT_FAILED = 0, 1

EXIT_STATUS = (
    "Exit status: 0 done; {also}1 the map or what computes it failed, in one sentence on stderr; "
    "2 wrong usage; 130 Ctrl-C."
)
"""End of the help texts."""

Advance: TypeAlias = Callable[[float, str], None]
"""Called with how much more is done, and a text to show beside it."""

LINE_EVERY_S = 60.0
"""Where there is no terminal, as in the log of a batch system."""

PRIOR_SHARE = 0.05
"""Weight of the expected speed in the estimate of the remaining time, as a share of the work."""


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


def say(text: str) -> None:
    """Print a result."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def complain(text: str) -> None:
    """Print an error as one sentence on stderr, where nothing else goes but progress."""
    sys.stderr.write(f"{NAME}: {' '.join(text.split())}\n")
    sys.stderr.flush()


def write_report(path: Path | None, report: dict[str, Json]) -> None:
    """Write a report as JSON, where a file is given."""
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


@contextmanager
def progress(
    title: str, total: float, *, expected_s: float | None = None, is_quiet: bool = False
) -> Iterator[Advance]:
    """Show how much of a total is done, with an estimate of the remaining time.

    Args:
        title: what is done.
        total: in the unit of `Advance`, such as expected seconds or a number of blocks.
        expected_s: how long it should take; the estimate starts there.
        is_quiet: whether to show nothing.
    """
    if is_quiet:
        yield quietly
        return
    left = _TimeLeft(total, expected_s)
    if sys.stderr.isatty() and importlib.util.find_spec("tqdm") is not None:
        with _bar(title, left) as advance:
            yield advance
    else:
        yield _Lines(title, left).advance


def quietly(more: float, beside: str) -> None:
    """An `Advance` that shows nothing."""
    del more, beside


class _TimeLeft:
    """An estimate in which the expected speed weighs like `PRIOR_SHARE` of the work."""

    def __init__(self, total: float, expected_s: float | None) -> None:
        self.total, self.done = total, 0.0
        self._prior = 0.0 if expected_s is None else PRIOR_SHARE * total
        self._prior_s = 0.0 if expected_s is None else PRIOR_SHARE * expected_s
        self._start_s = time.monotonic()

    def after(self, more: float) -> str:
        """Add what is done; returns the remaining time as text."""
        self.done = min(self.done + more, self.total)
        weight = self.done + self._prior
        if weight <= 0.0:
            return "? left"
        per_unit_s = (time.monotonic() - self._start_s + self._prior_s) / weight
        return f"{shown_time(round((self.total - self.done) * per_unit_s))} left"


@contextmanager
def _bar(title: str, left: _TimeLeft) -> Iterator[Advance]:
    from tqdm import tqdm  # noqa: PLC0415 - only when shown

    layout = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}{postfix}"
    with tqdm(desc=title, total=left.total, bar_format=layout, leave=False, file=sys.stderr) as bar:

        def advance(more: float, beside: str) -> None:
            bar.set_postfix_str(f"{left.after(more)}, {beside}", refresh=False)
            bar.update(left.done - bar.n)

        yield advance


class _Lines:
    """Writes a line once in `LINE_EVERY_S`."""

    def __init__(self, title: str, left: _TimeLeft) -> None:
        self._title, self._left, self._shown_s = title, left, time.monotonic()

    def advance(self, more: float, beside: str) -> None:
        """Add what is done."""
        remaining = self._left.after(more)
        if time.monotonic() - self._shown_s >= LINE_EVERY_S:
            self._shown_s = time.monotonic()
            complain(
                f"{self._title} {self._left.done / self._left.total:.0%}, {remaining}, {beside}"
            )
