"""JointTube: where joints may be at every time, as an interval of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from baxter_kin.display import OneLine, count, seconds
from baxter_kin.fields import Frozen
from baxter_kin.validation import FloatArray


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class JointTube(Frozen, OneLine):
    """Bounds of n joints at m + 1 instants, each monotone from one instant to the next.

    So what two neighbouring instants allow together holds all that is allowed in between.

    Attributes:
        times_s: of the instants, shape (m + 1,), increasing.
        lowest: shape (m + 1, n), rad.
        highest: shape (m + 1, n), rad, nowhere below.
    """

    times_s: FloatArray
    lowest: FloatArray
    highest: FloatArray

    @property
    def cells(self) -> int:
        """How many intervals there are between neighbouring instants, m."""
        return len(self.times_s) - 1

    @property
    def widths(self) -> FloatArray:
        """How far apart the bounds of each joint are at each instant, shape (m + 1, n), rad."""
        return self.highest - self.lowest

    def hull(self, first: int, last: int) -> tuple[FloatArray, FloatArray]:
        """What the joints may reach between two instants by their numbers, two of shape (n,)."""
        some = slice(first, last + 1)
        lowest: FloatArray = self.lowest[some].min(axis=0)
        highest: FloatArray = self.highest[some].max(axis=0)
        return lowest, highest

    def between(self, start_s: float, end_s: float) -> JointTube:
        """The cells that share an instant with a time from `start_s` to `end_s`; at least one."""
        first = int(np.searchsorted(self.times_s, start_s, side="right")) - 1
        last = int(np.searchsorted(self.times_s, end_s, side="left"))
        first = min(max(first, 0), self.cells - 1)
        some = slice(first, min(max(last, first + 1), self.cells) + 1)
        return JointTube(self.times_s[some], self.lowest[some], self.highest[some])

    def widened(self, by_rad: FloatArray) -> JointTube:
        """Each joint as much farther either way, shape (n,), rad."""
        return JointTube(self.times_s, self.lowest - by_rad, self.highest + by_rad)

    def instant_at(self, first: int, last: int, q: FloatArray) -> int | None:
        """The first of some instants at which the joints may be at `q`, shape (n,), rad, if any."""
        some = slice(first, last + 1)
        is_inside = (self.lowest[some] <= q) & (q <= self.highest[some])
        found = np.flatnonzero(is_inside.all(axis=1))
        return first + int(found[0]) if len(found) else None

    def _facts(self) -> tuple[str, ...]:
        width = float(self.widths.max(initial=0.0))
        length_s = float(self.times_s[-1] - self.times_s[0])
        return count(self.cells, "cell"), seconds(length_s), f"up to {width:.3g} rad wide"
