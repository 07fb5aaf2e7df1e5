"""Builds maps block by block on any engine, and estimates what that costs."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from baxter_kin.display import OneLine, count, shown_path
from baxter_kin.distribution.software import kind_of_machine
from baxter_kin.parallel import Engine, LocalPool
from baxter_kin.validation import Indices, positive_scalar
from planner.atlas.block_map import (
    Block,
    BlockGrid,
    BlockMap,
    Blocks,
    MapDefinition,
    Rows,
    is_map,
    stored_bytes,
)
from planner.atlas.reach_search import UNDECIDED, UNREACHABLE
from planner.errors import AtlasError

MEASURED_S = 10.0
"""Default duration of the measurement of an estimate."""

MIN_BLOCKS = 10
"""Number of blocks that an estimate measures, however long that takes."""

MAX_KEPT_CELLS = 200_000
"""Number of measured cells that are kept to measure their size on disk."""

OVERHEAD = 1.03
"""Factor for the time that workers spend on reading the map and on writing files."""

_LOG = logging.getLogger(__name__)

_Map = TypeVar("_Map", bound=BlockMap)


# Building ----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class BlockReport:
    """The outcome of one block.

    Attributes:
        block: which.
        reachable: number of cells that are reachable.
        unreachable: number of cells that are proven unreachable.
        undecided: number of cells that are neither.
        time_s: processor time.
        machine: kind of machine and backend that computed it.
    """

    block: Block
    reachable: int
    unreachable: int
    undecided: int
    time_s: float
    machine: str

    @property
    def cells(self) -> int:
        """Number of cells."""
        return self.reachable + self.unreachable + self.undecided


class MapSource(NamedTuple):
    """Where workers find a map.

    Attributes:
        kind: class of the map.
        path: its folder.
        identity: of the map, so that no worker takes another one at that path for it.
        sources: paths of the maps that it is computed from.
    """

    kind: type[BlockMap]
    path: str
    identity: str
    sources: tuple[str, ...] = ()

    @classmethod
    def of(cls, found: BlockMap, *sources: Path) -> MapSource:
        """The source of a map that is open."""
        paths = tuple(str(path.resolve()) for path in sources)
        return cls(type(found), str(found.path.resolve()), found.identity, paths)

    def open(self) -> BlockMap:
        """Open the map; workers of a cluster live longer than maps.

        Raises:
            AtlasError: when it was replaced.
        """
        found = self.kind(self.path)
        if found.identity != self.identity:
            raise AtlasError(f"the map at {shown_path(found.path)} was replaced by another one")
        return found


def existing_map(
    kind: type[_Map], path: Path, definition: MapDefinition, max_cells: int
) -> _Map | None:
    """The map at a path, which must be the defined one; None if one can be created there.

    Raises:
        AtlasError: when it is another one, or has too many cells.
    """
    check_size(cells_of(definition), max_cells)
    if not is_map(path):
        return None
    found = kind(path)
    found.check_definition(definition)
    return found


def build(
    kind: type[_Map],
    path: Path,
    definition: MapDefinition,
    *,
    sources: tuple[Path, ...] = (),
    engine: Engine | None,
    max_cells: int,
    progress: Callable[[int, int, BlockReport], object] | None,
) -> _Map:
    """Compute the missing blocks of a map, which is created if there is none.

    Args:
        kind: class of the map.
        path: its folder.
        definition: what it is of.
        sources: paths of the maps that it is computed from.
        engine: runs the work; all cores of this machine by default.
        max_cells: maximum number of cells.
        progress: called for each block with the number of blocks that are done, that of all, and
            the block's report.
    """
    found = existing_map(kind, path, definition, max_cells)
    if found is None:
        found = kind.create_from(path, definition)
    found.remove_leftovers()
    engine = LocalPool() if engine is None else engine
    missing, total = found.missing_blocks(), len(found.blocks)
    done, task = total - len(missing), partial(compute_block, MapSource.of(found, *sources))
    for _, report in engine.run(task, missing):
        done += 1
        if found.note_machine(report.machine):
            _LOG.warning(
                "a block of %s was computed on another kind of machine (%s) than it was begun with "
                "(%s): it is as right, but its last bits may differ",
                *(found.path, report.machine, found.machine),
            )
        if progress is not None:
            progress(done, total, report)
    found.remove_leftovers()
    return found


def compute_block(source: MapSource, block: Block) -> BlockReport:
    """Compute one block of a map and store it, as workers do."""
    found, definition = _opened(source)
    begun = time.process_time()
    rows = definition.compute(block[0], found.grid.indices(block))
    found.write_rows(block, rows)
    codes = found.codes_of(rows)
    return BlockReport(
        block,
        int((codes >= 0).sum()),
        int((codes == UNREACHABLE).sum()),
        int((codes == UNDECIDED).sum()),
        time.process_time() - begun,
        kind_of_machine(definition.backend),
    )


@lru_cache(maxsize=1)
def _opened(source: MapSource) -> tuple[BlockMap, MapDefinition]:
    """What a worker keeps between the blocks of a map."""
    found = source.open()
    found.check_software()
    return found, found.definition(*source.sources)


def cells_of(definition: MapDefinition) -> int:
    """Number of cells of a map."""
    return math.prod(definition.grid.shape) * _cells_each(definition)


def check_size(cells: int, max_cells: int, option: str = "most_cells") -> None:
    """Refuse a map with too many cells.

    Args:
        cells: number of its cells.
        max_cells: maximum.
        option: what the message calls the maximum.
    """
    if cells > max_cells:
        raise AtlasError(
            f"the map would have {cells:.3g} cells, and at most {max_cells:.3g} are allowed; take "
            f"fewer positions, fewer rotations or one arm, or raise {option}"
        )


def _cells_each(definition: MapDefinition) -> int:
    """Number of cells of one position."""
    return next(iter(definition.layers.values())).inner["rotation"]


# Estimating --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, repr=False)
class Cost(OneLine):
    """The missing part of a map, and the estimated cost of computing it.

    Attributes:
        cells: number of cells to be computed.
        core_s: processor time on this machine.
        core_error_s: one standard error of it.
        size_bytes: size on disk.
        measured: number of positions that were measured.
        positions: number of positions to be computed, each arm's counted by itself.
    """

    cells: int
    core_s: float
    core_error_s: float
    size_bytes: float
    measured: int
    positions: int

    @property
    def core_hours(self) -> float:
        """Processor time on this machine."""
        return self.core_s / 3600.0

    def _facts(self) -> tuple[str, ...]:
        return (
            f"{self.cells:,} cells",
            f"{shown_time(self.core_s)} +- {shown_time(self.core_error_s)} of one core",
            f"{self.size_bytes / 1e6:.3g} MB",
            f"{self.measured:,} of {count(self.positions, 'position')} measured",
        )


def estimate(
    definition: MapDefinition,
    *,
    missing: Blocks | None = None,
    measure_s: float = MEASURED_S,
    max_positions: float = math.inf,
    seed: int = 0,
    clock: Callable[[], float] = time.process_time,
) -> Cost:
    """Measure some positions of random blocks on one core, and extrapolate.

    A block is drawn with a probability in proportion to its number of positions, with replacement,
    and some of its positions are computed. So the mean time of a position, times the number of
    positions, is free of bias, and its standard error follows from the spread among the blocks
    (Cochran, "Sampling Techniques", 1977, section 11.9).

    Args:
        definition: what the map is of.
        missing: blocks to be computed; all by default.
        measure_s: duration of the measurement; a few positions of `MIN_BLOCKS` blocks are measured
            in any case.
        max_positions: number of positions at which the measurement ends.
        seed: of the random choice.
        clock: processor time, s.
    """
    positive_scalar(measure_s, "measure_s", AtlasError)
    missing = definition.grid.blocks if missing is None else missing
    positions = definition.grid.positions_of(missing)
    if not positions:
        return Cost(0, 0.0, 0.0, 0.0, 0, 0)
    rng, times_s, measured = np.random.default_rng(seed), list[float](), 0
    kept, warm = list[tuple[Indices, Rows]](), set[int]()
    begun = clock()
    while (len(times_s) < MIN_BLOCKS or clock() - begun < measure_s) and (
        measured < min(positions, max_positions)
    ):
        arm, at = _drawn(definition.grid, missing, definition.sample, rng)
        if arm not in warm:
            definition.compute(arm, at[:1])  # what is computed once is no cost of a position
            warm.add(arm)
        started = clock()
        rows = definition.compute(arm, at)
        times_s.append((clock() - started) / len(at))
        measured += len(at)
        if sum(rows[0].size for _, rows in kept) < MAX_KEPT_CELLS:
            kept.append((np.insert(at, 0, arm, axis=1), rows))
    spread = float(np.std(times_s, ddof=1)) if len(times_s) > 1 else 0.0
    return Cost(
        positions * _cells_each(definition),
        OVERHEAD * positions * float(np.mean(times_s)),
        OVERHEAD * positions * spread / math.sqrt(len(times_s)),
        positions * _bytes_each(kept),
        measured,
        positions,
    )


def shown_time(seconds: float) -> str:
    """Seconds, minutes, hours or days, to three digits."""
    for size, unit in ((86_400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"


def _drawn(
    grid: BlockGrid, missing: Blocks, number: int, rng: np.random.Generator
) -> tuple[int, Indices]:
    """The arm and some positions of a random block."""
    largest = math.prod(min(grid.edge, size) for size in grid.shape[1:])
    while True:
        block = missing[int(rng.integers(len(missing)))]
        size = math.prod(piece.stop - piece.start for piece in grid.slices(block))
        if rng.random() * largest < size:
            break
    chosen = rng.permutation(size)[:number]
    return block[0], grid.indices(block)[chosen]


def _bytes_each(kept: list[tuple[Indices, Rows]]) -> float:
    """Size of one position on disk; positions that were drawn again count once."""
    positions, rows = zip(*kept, strict=True)
    _, first = np.unique(np.concatenate(positions), axis=0, return_index=True)
    layers = [np.concatenate(parts)[first] for parts in zip(*rows, strict=True)]
    return stored_bytes(layers) / len(first)
