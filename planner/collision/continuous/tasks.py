"""What is left to be proven of a motion: pairs of shapes, each over an interval of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baxter_kin.validation import FloatArray, Indices


@dataclass(frozen=True, slots=True, eq=False)
class Tasks:
    """Pairs to be proven, each over an interval; pairs of one interval lie together.

    Attributes:
        starts_s: of the intervals, shape (m,).
        ends_s: of the intervals, shape (m,).
        interval: which one, for each task, shape (k,), increasing.
        pair: which pair, for each task, shape (k,).
    """

    starts_s: FloatArray
    ends_s: FloatArray
    interval: Indices
    pair: Indices

    @classmethod
    def of(cls, starts_s: FloatArray, ends_s: FloatArray, pairs: Indices) -> Tasks:
        """Every pair of some over every interval."""
        count = len(starts_s)
        interval = np.repeat(np.arange(count), len(pairs))
        return cls(starts_s, ends_s, interval, np.tile(pairs, count))

    @property
    def middles_s(self) -> FloatArray:
        """Middles of the intervals, shape (m,)."""
        return (self.starts_s + self.ends_s) / 2

    def only(self, chosen: NDArray[np.bool_]) -> Tasks:
        """Some of them."""
        return Tasks(self.starts_s, self.ends_s, self.interval[chosen], self.pair[chosen])

    def halved(self) -> Tasks:
        """The same over both halves of their intervals."""
        kept, interval = np.unique(self.interval, return_inverse=True)
        starts, middles, ends = (x[kept] for x in (self.starts_s, self.middles_s, self.ends_s))
        return Tasks(
            np.concatenate([starts, middles]),
            np.concatenate([middles, ends]),
            np.concatenate([interval, interval + len(kept)]),
            np.concatenate([self.pair, self.pair]),
        )
