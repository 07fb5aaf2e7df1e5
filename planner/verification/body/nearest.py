"""The least distance over dense samples, and a bound on it in between.

From one sample to a later one a pair's distance changes by no more than its travel: how far each
joint went times its lever arm, summed. So between two samples that were measured nothing is nearer
than half of (both distances less the travel). What cannot be nearer than the nearest found so far
is left out, the rest is halved, down to neighbouring samples (branch and bound; the bound is that
of conservative advancement: Mirtich 1996). The result is that of measuring every pair at every
sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from baxter_kin.validation import FloatArray, Indices
from planner.verification.body.distances import SolidDistances
from planner.verification.body.solid import ACCURACY_M

FARTHEST_M = 1.0
"""Distances beyond are not told apart."""

SLACK_M = 0.02
"""How much farther than the nearest a pair is measured, so that it need not be soon again."""

SAME_M = 1e-7
"""A pair that is nearer than the nearest by less is not looked for."""


@dataclass(frozen=True, slots=True)
class Nearest:
    """What was found.

    Attributes:
        least_m: the least distance at samples.
        sample: where.
        pair: which; -1 when there is none within `FARTHEST_M`.
        proven_m: what no pair comes nearer than, between samples either.
    """

    least_m: float
    sample: int
    pair: int
    proven_m: float


@dataclass(frozen=True, slots=True, eq=False)
class _Gaps:
    """Stretches of time of one pair each: between samples `a` and `b`, and the distances there."""

    pairs: Indices
    a: Indices
    b: Indices
    at_a: FloatArray
    at_b: FloatArray

    def of(self, kept: Indices) -> _Gaps:
        return _Gaps(self.pairs[kept], self.a[kept], self.b[kept], self.at_a[kept], self.at_b[kept])

    def halves(self, middle: Indices, at_middle: FloatArray) -> _Gaps:
        return _Gaps(
            np.concatenate([self.pairs, self.pairs]),
            np.concatenate([self.a, middle]),
            np.concatenate([middle, self.b]),
            np.concatenate([self.at_a, at_middle]),
            np.concatenate([at_middle, self.at_b]),
        )


class _NearestSearch:
    """One search over some pairs between two samples.

    Attributes:
        touching: the distance of each pair and sample that was found at most `touch_m` apart.
    """

    def __init__(
        self,
        distances: SolidDistances,
        pairs: list[int],
        first: int,
        last: int,
        *,
        ceiling_m: float = FARTHEST_M,
        touch_m: float = -np.inf,
        is_all: bool = False,
    ) -> None:
        """Prepare.

        Args:
            distances: what measures.
            pairs: numbers of the pairs.
            first: number of the first sample.
            last: of the last one.
            ceiling_m: distances beyond it are not told apart.
            touch_m: note what is no farther apart than this.
            is_all: note all that is, at every sample, instead of looking for the nearest.
        """
        self._distances, self._pairs = distances, np.array(pairs, dtype=np.intp)
        self._span, self._touch_m, self._is_all = (first, last), touch_m, is_all
        self._least = touch_m if is_all else ceiling_m
        self._at = (first, -1)
        self._proven = np.inf
        self.touching: dict[int, dict[int, float]] = {}

    def run(self) -> Nearest:
        """Search."""
        if not len(self._pairs):
            return Nearest(self._least, *self._at, self._least)
        gaps = self._whole()
        while len(gaps.pairs):
            gaps = self._step(gaps)
        proven = min(self._proven, self._least - SAME_M) - ACCURACY_M
        return Nearest(self._least, *self._at, proven)

    def _whole(self) -> _Gaps:
        first, last = self._span
        ends = [
            self._measured(
                self._pairs, np.full(len(self._pairs), end), np.full(len(self._pairs), np.inf)
            )
            for end in (first, last)
        ]
        count = len(self._pairs)
        return _Gaps(self._pairs, np.full(count, first), np.full(count, last), *ends)

    def _step(self, gaps: _Gaps) -> _Gaps:
        """Leave out what cannot matter and halve the rest."""
        travel = self._travel(gaps)
        bound = (gaps.at_a + gaps.at_b - travel) / 2
        is_open = (bound < self._least - SAME_M) | (self._is_all & (bound <= self._least))
        is_leaf = gaps.b - gaps.a <= 1
        self._proven = min(self._proven, float(bound[is_open & is_leaf].min(initial=np.inf)))
        order = np.flatnonzero(is_open & ~is_leaf)
        kept = gaps.of(order[np.argsort(bound[order])])
        middle = (kept.a + kept.b) // 2
        at_middle = self._measured(kept.pairs, middle, self._travel(kept) / 2)
        return kept.halves(middle, at_middle)

    def _travel(self, gaps: _Gaps) -> FloatArray:
        gone = self._distances.stretch.gone
        travel: FloatArray = ((gone[gaps.b] - gone[gaps.a]) * self._distances.arms[gaps.pairs]).sum(
            axis=1
        )
        return travel

    def _measured(self, pairs: Indices, samples: Indices, slack_m: FloatArray) -> FloatArray:
        """Lower bounds on distances; the distance itself of what is nearer than the nearest."""
        bounds = np.empty(len(pairs))
        for sample in np.unique(samples):
            here = samples == sample
            bounds[here] = self._distances.balls_apart(pairs[here], int(sample))
        slack = np.minimum(slack_m, SLACK_M)
        for i in np.flatnonzero(bounds < self._least + slack).tolist():
            covers = self._distances.covers_apart(int(pairs[i]), int(samples[i]))
            bounds[i] = max(bounds[i], covers)
        for i in np.argsort(bounds).tolist():
            if bounds[i] < self._least + slack[i]:
                bounds[i] = self._one(int(pairs[i]), int(samples[i]), float(slack[i]))
        return bounds

    def _one(self, pair: int, sample: int, slack_m: float) -> float:
        wanted = self._least + slack_m
        distance = self._distances.shapes_apart(pair, sample, wanted)
        if distance <= self._touch_m and distance < wanted:
            self.touching.setdefault(pair, {})[sample] = distance
        if not self._is_all and distance < self._least:
            self._least, self._at = distance, (sample, pair)
        return distance


def nearest(
    distances: SolidDistances, pairs: list[int], first: int, last: int, touch_m: float = -np.inf
) -> tuple[Nearest, dict[int, dict[int, float]]]:
    """The least distance of pairs from one sample to another, and the touching found on the way."""
    search = _NearestSearch(distances, pairs, first, last, touch_m=touch_m)
    return search.run(), search.touching


def is_farther(
    distances: SolidDistances, pairs: list[int], first: int, last: int, wanted_m: float
) -> Nearest:
    """The least distance, not told apart beyond what is wanted."""
    return _NearestSearch(distances, pairs, first, last, ceiling_m=wanted_m).run()


def all_touching(
    distances: SolidDistances, pairs: list[int], first: int, last: int, touch_m: float
) -> dict[int, dict[int, float]]:
    """Every sample of each pair that is at most so far apart, with the distance."""
    search = _NearestSearch(distances, pairs, first, last, touch_m=touch_m, is_all=True)
    search.run()
    return search.touching
