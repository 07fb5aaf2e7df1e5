"""How far a command is: a bar on a terminal, elsewhere a line now and then."""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

import numpy as np

from baxter_kin import Baxter
from planner.atlas.blocks import Block
from planner.atlas.commands.reports import complain
from planner.atlas.cost import Cost, shown_time
from planner.atlas.positions import PositionGrid
from planner.atlas.shells import Shells

Advance: TypeAlias = Callable[[float, str], None]
"""Told how much more is done, and what to say beside."""

LINE_EVERY_S = 60.0
"""Where there is no terminal, as in the log of a batch system."""

PRIOR_SHARE = 0.05
"""Of the work: weight of what was expected in the estimate of what is left."""

BLOCK_S = 0.005
"""What a block costs beside its searches: files, and the way to a worker."""


class BlockCosts:
    """What each block of a map will take, by what was measured of shells around the shoulders."""

    def __init__(
        self, robot: Baxter, positions: PositionGrid, arms: tuple[str, ...], cost: Cost
    ) -> None:
        self._positions, self._shell_s = positions, np.array(cost.shell_s)
        self._shells = [Shells(robot.arm(side)) for side in arms]

    def expected_s(self, block: Block) -> float:
        """Processor time of one block."""
        points = self._positions.points(self._positions.block_slices(block[1:])).reshape(-1, 3)
        shells = self._shells[block[0]].of(points)
        return BLOCK_S + float(self._shell_s[block[0], shells].sum())


@contextmanager
def progress(
    title: str, total: float, *, expected_s: float | None = None, is_quiet: bool = False
) -> Iterator[Advance]:
    """Show how much of a total is done, with an estimate of the time that is left.

    Args:
        title: what is done.
        total: of what `Advance` is told, such as seconds that are expected or a number of blocks.
        expected_s: how long it should take; the estimate begins there.
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
    """What was expected counts like `PRIOR_SHARE` of the work, done at the expected speed."""

    def __init__(self, total: float, expected_s: float | None) -> None:
        self.total, self.done = total, 0.0
        self._prior = 0.0 if expected_s is None else PRIOR_SHARE * total
        self._prior_s = 0.0 if expected_s is None else PRIOR_SHARE * expected_s
        self._begun_s = time.monotonic()

    def told(self, more: float) -> str:
        """Count what is done, and say what is left."""
        self.done = min(self.done + more, self.total)
        seen = self.done + self._prior
        if seen <= 0.0:
            return "? left"
        per_unit_s = (time.monotonic() - self._begun_s + self._prior_s) / seen
        return f"{shown_time(round((self.total - self.done) * per_unit_s))} left"


@contextmanager
def _bar(title: str, left: _TimeLeft) -> Iterator[Advance]:
    from tqdm import tqdm  # noqa: PLC0415 - only when shown

    layout = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}{postfix}"
    with tqdm(desc=title, total=left.total, bar_format=layout, leave=False, file=sys.stderr) as bar:

        def advance(more: float, beside: str) -> None:
            bar.set_postfix_str(f"{left.told(more)}, {beside}", refresh=False)
            bar.update(left.done - bar.n)

        yield advance


class _Lines:
    """Writes a line once in `LINE_EVERY_S`."""

    def __init__(self, title: str, left: _TimeLeft) -> None:
        self._title, self._left, self._told_s = title, left, time.monotonic()

    def advance(self, more: float, beside: str) -> None:
        """Count it."""
        told = self._left.told(more)
        if time.monotonic() - self._told_s >= LINE_EVERY_S:
            self._told_s = time.monotonic()
            complain(f"{self._title} {self._left.done / self._left.total:.0%}, {told}, {beside}")
