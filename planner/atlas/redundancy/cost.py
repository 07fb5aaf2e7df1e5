"""The cost of a redundancy map before it is built, by a measured sample as in `planner.atlas.cost`.

The unit of work is a position and direction with at least one reachable rotation among the chosen
ones, and its size is the number of these.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baxter_kin.validation import Indices, positive_scalar
from planner.atlas.blocks import Block
from planner.atlas.cost import MEASURED_S, OVERHEAD, Cost, Sample
from planner.atlas.map_files import stored_bytes
from planner.atlas.reach_map import ReachMap
from planner.atlas.redundancy.freedom import Freedom
from planner.atlas.redundancy.measures import in_steps
from planner.atlas.redundancy.subset import Subset
from planner.atlas.redundancy.worker import Worker, by_block, others_of, reach_cells
from planner.errors import AtlasError

MAX_DRAWN = 4000
"""Directions that are drawn to be measured."""


def estimate(
    reach_map: ReachMap,
    subset: Subset | None = None,
    *,
    q_others: ArrayLike | None = None,
    missing: Collection[Block] | None = None,
    measure_s: float = MEASURED_S,
    seed: int = 0,
) -> Cost:
    """Measure a random sample of a redundancy map on one core, and extrapolate.

    Args:
        reach_map: the reach map that it is made from.
        subset: poses of that map; all by default.
        q_others: as for `build_redundancy_map`.
        missing: blocks to be computed; all by default.
        measure_s: duration of the measurement, s; a few directions are measured in any case.
        seed: seed of the random sample.
    """
    positive_scalar(measure_s, "measure_s", AtlasError)
    subset = Subset.of(reach_map) if subset is None else subset
    subset.check(reach_map)
    rng, others = np.random.default_rng(seed), others_of(reach_map.robot, q_others)
    workers = [Worker(reach_map, side, others) for side in subset.arms]
    at = [_positions(subset, arm, missing) for arm in range(len(workers))]
    reachable, units = _drawn(reach_map, subset, at, workers, rng)
    rows: list[list[int]] = []
    for work in _work(reach_map, subset, workers, units[:1], rows):
        work()  # what is computed once is no cost of a pose
    rows.clear()
    work_left = _work(reach_map, subset, workers, units, rows)
    sample = Sample.timed(reachable, work_left, measure_s, np.inf)
    return Cost(
        sum(map(len, at)) * len(subset.rotations),
        OVERHEAD * sample.total_s,
        OVERHEAD * sample.error_s,
        _bytes_each(rows) * reachable,
        sample.size,
        reachable,
        "reachable pose",
    )


def _work(
    reach_map: ReachMap,
    subset: Subset,
    workers: list[Worker],
    units: Indices,
    rows: list[list[int]],
) -> Iterator[Callable[[], int]]:
    """For each unit a call that computes it, adds its measures to `rows` and returns its size.

    The reach map is read before the call, because a build reads it once for a whole block.
    """
    chosen = np.array(subset.rotations)
    for arm, *position, direction in units.tolist():
        at, worker = np.array(position), workers[arm]
        _, margins, witnesses = next(reach_cells(reach_map, subset.arms[arm], at[None]))
        mine = chosen[chosen // len(worker.rotations.rolls) == direction]
        freedoms = partial(worker.freedoms, at, margins[0], witnesses[0], mine)

        def compute(freedoms: Callable[[], Iterator[tuple[int, Freedom]]] = freedoms) -> int:
            found = [in_steps(freedom) for _, freedom in freedoms()]
            rows.extend(found)
            return len(found)

        yield compute


def _bytes_each(rows: list[list[int]]) -> float:
    """The size of one more pose on disk."""
    if len(rows) < 2:
        return 0.0
    table = np.array(rows, np.int32).T.copy()
    return (stored_bytes([table]) - stored_bytes([table[:, :1].copy()])) / (len(rows) - 1)


def _positions(subset: Subset, arm: int, missing: Collection[Block] | None) -> Indices:
    """Indices in the reach map's grid of one arm's positions to be computed, shape (n, 3)."""
    if missing is None:
        return subset.positions().reshape(-1, 3)
    mine = [block for block in missing if block[0] == arm]
    parts = [subset.positions(subset.block_slices(block[1:])).reshape(-1, 3) for block in mine]
    return np.concatenate([np.zeros((0, 3), np.intp), *parts])


def _drawn(
    reach_map: ReachMap,
    subset: Subset,
    at: list[Indices],
    workers: list[Worker],
    rng: np.random.Generator,
) -> tuple[int, Indices]:
    """Number of reachable poses, and random units: arm, position and direction, shape (n, 5).

    Units with the smallest random keys are kept, so all are equally likely.
    """
    chosen = np.array(subset.rotations)
    reachable, keys, units = 0, np.zeros(0), np.zeros((0, 5), np.intp)
    for arm, (side, worker) in enumerate(zip(subset.arms, workers, strict=True)):
        rolls = len(worker.rotations.rolls)
        for counts, where in _counted(reach_map, side, at[arm], chosen, rolls):
            found = where[counts > 0]
            reachable += int(counts.sum())
            units = np.concatenate([units, np.insert(found, 0, arm, axis=1)])
            keys = np.concatenate([keys, rng.random(len(found))])
            kept = np.argsort(keys)[:MAX_DRAWN]
            keys, units = keys[kept], units[kept]
    return reachable, units


def _counted(
    reach_map: ReachMap, side: str, at: Indices, chosen: Indices, rolls: int
) -> Iterator[tuple[NDArray[np.intp], Indices]]:
    """For each position and direction, the number of reachable chosen rolls; block by block."""
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
