"""What a redundancy map will cost, before it is built: processor time by a measured sample.

Which poses are reachable the reach map knows. The work is done direction by direction; strata are
directions with as many reachable rolls among the chosen ones. What is measured next is one of the
stratum to which the estimate owes most of its uncertainty, by how much costs spread there as far as
that is known beforehand, as in `planner.atlas.cost`: in proportion to the number of rolls. (Of 254
directions with 1, 2, 4, 8 and 12 rolls the standard deviations were 5.7, 10.5, 19, 37 and 53 ms, of
means of 17, 26, 44, 79 and 114 ms.)
"""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baxter_kin.display import OneLine, count
from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray, Indices, positive_scalar
from planner.atlas.blocks import Block
from planner.atlas.cost import LEAST, MEASURED_S, OVERHEAD, shown_time
from planner.atlas.map_files import stored_bytes
from planner.atlas.reach_map import ReachMap
from planner.atlas.redundancy.measures import in_steps
from planner.atlas.redundancy.subset import Subset
from planner.atlas.redundancy.worker import Worker, by_block, others_of, reach_cells
from planner.errors import AtlasError

DRAWN = 2000
"""Directions of each stratum that are drawn to be measured."""


@dataclass(frozen=True, slots=True, repr=False)
class RedundancyCost(OneLine):
    """What is missing of a map, and what it will take.

    Attributes:
        cells: how many are to be computed.
        reachable: how many of them have a witness.
        core_s: processor time on this machine.
        core_error_s: one standard error of it.
        size_bytes: on disk.
        measured: how many reachable ones were measured to know it.
    """

    cells: int
    reachable: int
    core_s: float
    core_error_s: float
    size_bytes: float
    measured: int

    @property
    def core_hours(self) -> float:
        """Processor time on this machine."""
        return self.core_s / 3600.0

    def _facts(self) -> tuple[str, ...]:
        return (
            f"{self.cells:,} cells, {self.reachable:,} of them reachable",
            f"{shown_time(self.core_s)} +- {shown_time(self.core_error_s)} of one core",
            f"{self.size_bytes / 1e6:.3g} MB",
            f"{count(self.measured, 'pose')} measured",
        )


def estimate(
    reach_map: ReachMap,
    subset: Subset | None = None,
    *,
    q_others: ArrayLike | None = None,
    missing: Collection[Block] | None = None,
    measure_s: float = MEASURED_S,
    seed: int = 0,
) -> RedundancyCost:
    """Measure a stratified random sample of a map on one core, and extrapolate.

    Args:
        reach_map: on which it stands.
        subset: which of its poses; all when not given.
        q_others: as for `build_redundancy_map`.
        missing: blocks that are to be computed; all when not given.
        measure_s: how long to measure; each stratum gets `LEAST` measurements, even if this takes
            longer.
        seed: what is drawn.
    """
    positive_scalar(measure_s, "measure_s", AtlasError)
    subset = Subset.of(reach_map) if subset is None else subset
    subset.check(reach_map)
    rng, cells, strata = np.random.default_rng(seed), 0, []
    for index, side in enumerate(subset.arms):
        at = _positions(subset, index, missing)
        cells += len(at) * len(subset.rotations)
        strata += _strata(reach_map, side, subset, at, others=q_others, rng=rng)
    _measure(strata, measure_s)
    rows = [row for stratum in strata for row in stratum.found]
    reachable = sum(stratum.size * stratum.rolls for stratum in strata)
    return RedundancyCost(
        cells,
        reachable,
        OVERHEAD * sum(stratum.total_s for stratum in strata),
        OVERHEAD * math.hypot(*(stratum.error_s for stratum in strata)),
        _bytes_each(rows) * reachable,
        len(rows),
    )


def _bytes_each(rows: list[list[int]]) -> float:
    """What one more pose takes on disk."""
    if len(rows) < 2:
        return 0.0
    table = np.array(rows, np.int32).T.copy()
    return (stored_bytes([table]) - stored_bytes([table[:, :1].copy()])) / (len(rows) - 1)


@dataclass(slots=True, eq=False)
class _Stratum:
    """Directions with so many reachable rolls, at any position.

    Attributes:
        worker: of the arm.
        reach_map: the map.
        side: of the arm.
        chosen: indices of the subset's rotations.
        rolls: how many reachable ones each direction has.
        size: how many directions there are.
        left: of those that were drawn and are not measured, position and direction, shape (n, 4).
        times_s: of each that was measured.
        found: freedoms in steps, of all poses measured.
    """

    worker: Worker
    reach_map: ReachMap
    side: str
    chosen: Indices
    rolls: int
    size: int
    left: Indices
    times_s: list[float] = field(default_factory=list)
    found: list[list[int]] = field(default_factory=list)

    def measure(self) -> None:
        """Compute the next direction."""
        (*position, direction), self.left = self.left[0], self.left[1:]
        at, rolls = np.array(position), len(self.worker.rotations.rolls)
        _, margins, witnesses = next(reach_cells(self.reach_map, self.side, at[None]))
        chosen = self.chosen[self.chosen // rolls == direction]
        begun = time.process_time()
        freedoms = list(self.worker.freedoms(at, margins[0], witnesses[0], chosen))
        self.times_s.append(time.process_time() - begun)
        self.found += [in_steps(each) for _, each in freedoms]

    @property
    def gain(self) -> float:
        """How much one more measurement lessens the uncertainty, as far as known beforehand."""
        number = len(self.times_s)
        return self.size * self.rolls / math.sqrt(number * (number + 1.0))

    @property
    def total_s(self) -> float:
        """Of all of them."""
        return self.size * float(np.mean(self.times_s)) if self.times_s else 0.0

    @property
    def error_s(self) -> float:
        """One standard error of that; none when all were measured."""
        if len(self.times_s) < 2 or len(self.times_s) == self.size:
            return 0.0
        return self.size * float(np.std(self.times_s, ddof=1)) / math.sqrt(len(self.times_s))


def _measure(strata: Sequence[_Stratum], measure_s: float) -> None:
    if strata:
        evolve(strata[0], times_s=[], found=[]).measure()  # what is done once for all is no cost
    begun = time.monotonic()
    for stratum in [each for each in strata for _ in range(LEAST)]:
        if len(stratum.left):
            stratum.measure()
    while time.monotonic() - begun < measure_s:
        left = [stratum for stratum in strata if len(stratum.left)]
        if not left:
            return
        max(left, key=lambda stratum: stratum.gain).measure()


def _positions(subset: Subset, arm: int, missing: Collection[Block] | None) -> Indices:
    """Indices in the reach map's grid of one arm's positions that are to be computed, (n, 3)."""
    if missing is None:
        return subset.positions().reshape(-1, 3)
    mine = [block for block in missing if block[0] == arm]
    parts = [subset.positions(subset.block_slices(block[1:])).reshape(-1, 3) for block in mine]
    return np.concatenate([np.zeros((0, 3), np.intp), *parts])


def _strata(
    reach_map: ReachMap,
    side: str,
    subset: Subset,
    at: Indices,
    *,
    others: ArrayLike | None,
    rng: np.random.Generator,
) -> list[_Stratum]:
    worker = Worker(reach_map, side, others_of(reach_map.robot, others))
    chosen, rolls = np.array(subset.rotations), len(worker.rotations.rolls)
    sizes, drawn = np.zeros(rolls + 1, int), dict[int, tuple[FloatArray, Indices]]()
    for counts, where in _counted(reach_map, side, at, chosen, rolls):
        sizes += np.bincount(counts, minlength=rolls + 1)
        keys = rng.random(len(counts))
        for number in np.unique(counts[counts > 0]).tolist():
            _keep_least(drawn, number, keys[counts == number], where[counts == number])
    return [
        _Stratum(worker, reach_map, side, chosen, number, int(sizes[number]), left)
        for number, (_, left) in sorted(drawn.items())
    ]


def _counted(
    reach_map: ReachMap, side: str, at: Indices, chosen: Indices, rolls: int
) -> Iterator[tuple[NDArray[np.intp], Indices]]:
    """Of each position and direction, how many chosen rolls are reachable; block by block."""
    directions = np.unique(chosen // rolls)
    first = np.searchsorted(chosen // rolls, directions)
    for block, rows in by_block(reach_map, at):
        part = reach_map.positions.block_slices(block)
        margins = reach_map.margins(side, part)
        inside = tuple((at[rows] - [piece.start for piece in part]).T)
        counts = np.add.reduceat(margins[inside][:, chosen] >= 0, first, axis=1, dtype=np.intp)
        where = np.column_stack(
            [np.repeat(at[rows], len(directions), axis=0), np.tile(directions, len(rows))]
        )
        yield counts.ravel(), where


def _keep_least(
    drawn: dict[int, tuple[FloatArray, Indices]], number: int, keys: FloatArray, where: Indices
) -> None:
    """Keep those with the least random keys: any of all that came is kept as likely as another."""
    if number in drawn:
        keys = np.concatenate([drawn[number][0], keys])
        where = np.concatenate([drawn[number][1], where])
    kept = np.argsort(keys)[:DRAWN]
    drawn[number] = keys[kept], where[kept]
