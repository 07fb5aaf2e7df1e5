"""Checks a reach map by other code: Pinocchio on the whole robot's model, and a solver of its own.

Nothing of the search that made the map is used here: no closed form, no proof, no joint chain of
ours. Of randomly chosen cells, half of them next to the boundary between reachable and unreachable,

- every witness has to reach its pose, inside the limits of the URDF and as far from them as its
  margin says;
- a solver that does not know the witness (`PoseFinder`) looks for a configuration. It must reach no
  cell that is said to be proven unreachable. The share of the reachable cells that it reaches is
  its power: what a check by it is worth. A pose that is reached in spite of a proof would be like
  those that are reached next to the limits only, so that the power there is reported, too.

All blocks are read, and their checksums with them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from baxter_kin.display import OneLine, shown_path
from baxter_kin.parallel import Engine, LocalPool
from baxter_kin.validation import FloatArray, whole_scalar
from planner.atlas.block_map import STATUSES, Block, Blocks
from planner.atlas.building import MapSource
from planner.atlas.checking.pose_finder import PoseFinder
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import (
    RAD_PER_MARGIN,
    RAD_PER_STEP,
    UNDECIDED,
    UNREACHABLE,
    Codes,
    Flags,
)
from planner.errors import AtlasError

CELLS, MAX_CELLS = 20_000, 10**7

NEAR_LIMITS_RAD = 0.02
"""Witnesses with a smaller margin are near the limits."""

MAX_CELLS_A_TASK = 50

_ROUNDING_RAD = 1e-12


@dataclass(frozen=True, slots=True, repr=False)
class MapCheck(OneLine):
    """The outcome of a check.

    Attributes:
        cells: how many were checked.
        witnesses: how many of them have one.
        proofs: how many are said to be proven unreachable.
        proofs_at_boundary: how many of these are next to the boundary.
        wrong_witnesses: cells whose witness does not reach them, is outside the limits or has
            another margin.
        false_proofs: cells that are said to be unreachable, and were reached.
        undecided_share: of all cells that are computed.
        undecided_reached: of the undecided that were checked, how many were reached.
        power: share of the cells with a witness that the solver reached; None without such cells.
        power_at_boundary: the same of those next to the boundary.
        power_near_limits: the same of those with a margin below `NEAR_LIMITS_RAD`.
        damaged: of blocks that cannot be read, the reasons.
        damaged_blocks: which these are.
        missing: how many blocks are not computed.
    """

    cells: int
    witnesses: int
    proofs: int
    proofs_at_boundary: int
    wrong_witnesses: tuple[str, ...]
    false_proofs: tuple[str, ...]
    undecided_share: float
    undecided_reached: int
    power: float | None
    power_at_boundary: float | None
    power_near_limits: float | None
    damaged: tuple[str, ...]
    damaged_blocks: tuple[Block, ...]
    missing: int

    @property
    def is_valid(self) -> bool:
        """Whether nothing is wrong."""
        return not (self.wrong_witnesses or self.false_proofs or self.damaged)

    def _facts(self) -> tuple[str, ...]:
        return (
            f"{self.cells} cells",
            f"{len(self.wrong_witnesses)} wrong witnesses",
            f"{len(self.false_proofs)} false proofs",
            "no power" if self.power is None else f"power {self.power:.4f}",
        )


def check_map(
    found: ReachMap,
    *,
    cells: int = CELLS,
    seed: int = 0,
    engine: Engine | None = None,
    on_block: Callable[[], object] = lambda: None,
    on_cells: Callable[[int], object] = lambda _: None,
) -> MapCheck:
    """Check randomly chosen cells of a map, and all checksums.

    Args:
        found: the map.
        cells: number of cells to check.
        seed: of the random choice.
        engine: runs the work; all cores of this machine by default.
        on_block: called after each block that was read.
        on_cells: called with the number of cells that were checked since its last call.
    """
    whole_scalar(cells, "cells", AtlasError, least=1, most=MAX_CELLS)
    engine = LocalPool() if engine is None else engine
    computed, source = found.computed_blocks(), MapSource.of(found)
    if not computed:
        raise AtlasError(f"nothing of the map at {shown_path(found.path)} is computed; build it")
    survey, outcome = Survey(computed), Outcome(Counter(), [], [])
    for block, counts in engine.run(partial(survey_block, source), computed):
        survey.add(block, counts)
        on_block()
    for task, part in engine.run(partial(check_cells, source), survey.tasks(cells, seed)):
        outcome.add(part)
        on_cells(task.last - task.first)
    damaged = sorted(survey.damaged)
    return MapCheck(
        cells=outcome.cells(),
        witnesses=outcome.cells(status="reachable"),
        proofs=outcome.cells(status="unreachable"),
        proofs_at_boundary=outcome.cells(status="unreachable", is_boundary=True),
        wrong_witnesses=tuple(sorted(outcome.wrong_witnesses)),
        false_proofs=tuple(sorted(outcome.false_proofs)),
        undecided_share=survey.undecided / max(survey.cells, 1),
        undecided_reached=outcome.cells(status="undecided", is_reached=True),
        power=outcome.power(),
        power_at_boundary=outcome.power(is_boundary=True),
        power_near_limits=outcome.power(is_near_limits=True),
        damaged=tuple(survey.damaged[block] for block in damaged),
        damaged_blocks=tuple(damaged),
        missing=len(found.blocks) - len(computed),
    )


# Choosing cells ----------------------------------------------------------------------------------


class BlockCounts(NamedTuple):
    """Cells of a block next to the boundary, others, and undecided ones; or what is wrong."""

    at_boundary: int = 0
    elsewhere: int = 0
    undecided: int = 0
    damage: str = ""


class CellTask(NamedTuple):
    """Cells of a block to check, of those at the boundary or of the others.

    Attributes:
        block: where they are.
        is_boundary: which of them.
        first: first one, in the order that the seed shuffles them to.
        last: the one after the last.
        seed: of the order.
    """

    block: Block
    is_boundary: bool
    first: int
    last: int
    seed: int


def survey_block(source: MapSource, block: Block) -> BlockCounts:
    """Read a block, and its checksums with it."""
    found, _ = _opened(source)
    try:
        cells = found.read_block(block)
    except AtlasError as cause:
        return BlockCounts(damage=str(cause))
    if cells is None:
        return BlockCounts(damage=f"block {block} of the map has cells that are not computed")
    edge = int(_are_at_boundary(found, block, cells.margins).sum())
    undecided = int((cells.margins == UNDECIDED).sum())
    return BlockCounts(edge, cells.margins.size - edge, undecided)


class Survey:
    """The counts of all blocks, in a few bytes each.

    Attributes:
        damaged: reasons, by block.
        undecided: number of cells.
    """

    def __init__(self, blocks: Blocks) -> None:
        self._blocks = blocks
        self._sizes = np.zeros((2, len(blocks)), np.int32)  # elsewhere, at the boundary
        self.damaged: dict[Block, str] = {}
        self.undecided = 0

    @property
    def cells(self) -> int:
        """Number of cells that were read."""
        return int(self._sizes.sum(dtype=np.int64))

    def add(self, block: Block, counts: BlockCounts) -> None:
        """Count one block."""
        self._sizes[:, self._blocks.index(block)] = counts.elsewhere, counts.at_boundary
        self.undecided += counts.undecided
        if counts.damage:
            self.damaged[block] = counts.damage

    def tasks(self, cells: int, seed: int) -> list[CellTask]:
        """Half of the cells at the boundary, half elsewhere, each cell as likely as the others."""
        rng, left, tasks = np.random.default_rng(seed), cells, list[CellTask]()
        for is_boundary in (True, False):
            ends = np.cumsum(self._sizes[int(is_boundary)], dtype=np.int64)
            wanted = min(cells // 2 if is_boundary else left, int(ends[-1]))
            left -= wanted
            chosen = rng.choice(int(ends[-1]), wanted, replace=False, shuffle=False)
            where, numbers = np.unique(np.searchsorted(ends, chosen, "right"), return_counts=True)
            for at, number in zip(where.tolist(), numbers.tolist(), strict=True):
                for first in range(0, number, MAX_CELLS_A_TASK):
                    last = min(first + MAX_CELLS_A_TASK, number)
                    tasks.append(CellTask(self._blocks[at], is_boundary, first, last, seed))
        return tasks


def _are_at_boundary(found: ReachMap, block: Block, margins: Codes) -> Flags:
    """Which cells have a neighbour in the block, in position or roll, of the other status."""
    sizes = (piece.stop - piece.start for piece in found.grid.slices(block))
    is_reachable = np.reshape(margins >= 0, (*sizes, -1, len(found.rotations.rolls)))
    edge = np.zeros_like(is_reachable)
    for axis in range(3):
        step = np.diff(is_reachable, axis=axis)
        lower, upper = (np.moveaxis(edge, axis, 0)[cut] for cut in (slice(-1), slice(1, None)))
        lower |= np.moveaxis(step, axis, 0)
        upper |= np.moveaxis(step, axis, 0)
    for turn in (-1, 1):
        edge |= is_reachable != np.roll(is_reachable, turn, axis=4)
    return edge.reshape(margins.shape)


# Checking cells ----------------------------------------------------------------------------------


class Judged(NamedTuple):
    """What is said of a cell, and what the solver found.

    Attributes:
        status: "reachable", "unreachable" or "undecided".
        is_near_limits: whether its witness is near the limits.
        is_boundary: whether it is next to the boundary.
        is_reached: whether the solver reached it.
    """

    status: str
    is_near_limits: bool
    is_boundary: bool
    is_reached: bool


class Outcome(NamedTuple):
    """The outcome for some cells.

    Attributes:
        number: how many cells were judged alike.
        wrong_witnesses: names of cells.
        false_proofs: names of cells.
    """

    number: Counter[Judged]
    wrong_witnesses: list[str]
    false_proofs: list[str]

    def add(self, other: Outcome) -> None:
        """Add the outcome for other cells."""
        self.number.update(other.number)
        self.wrong_witnesses.extend(other.wrong_witnesses)
        self.false_proofs.extend(other.false_proofs)

    def cells(self, **values: object) -> int:
        """Number of cells for which attributes of `Judged` have these values."""
        return sum(
            number
            for judged, number in self.number.items()
            if all(getattr(judged, name) == value for name, value in values.items())
        )

    def power(self, **values: object) -> float | None:
        """Of such cells with a witness, the share that the solver reached; None without any."""
        witnesses = self.cells(status="reachable", **values)
        reached = self.cells(status="reachable", is_reached=True, **values)
        return reached / witnesses if witnesses else None


def check_cells(source: MapSource, task: CellTask) -> Outcome:
    """Check cells of a block."""
    found, finders = _opened(source)
    block, cells = task.block, found.read_block(task.block)
    if cells is None:
        raise AtlasError(f"block {block} of the map was removed while it was checked")
    wanted = _are_at_boundary(found, block, cells.margins) == task.is_boundary
    rng = np.random.default_rng((task.seed, *block, task.is_boundary))
    chosen = rng.permutation(np.flatnonzero(wanted))[task.first : task.last]
    grid, Rs, finder = found.positions, found.rotations.matrices, finders[block[0]]
    points = grid.step_m * (np.array(grid.first) + found.grid.indices(block))
    outcome = Outcome(Counter(), [], [])
    for at, rotation in zip(*np.divmod(chosen, len(Rs)), strict=True):
        T, code = pin.SE3(Rs[rotation], points[at]), int(cells.margins[at, rotation])
        q: FloatArray = np.multiply(cells.witnesses[at, :, rotation], RAD_PER_STEP)
        is_near = 0 <= code * RAD_PER_MARGIN < NEAR_LIMITS_RAD
        is_reached, status = finder.find(T) is not None, STATUSES.get(code, "reachable")
        outcome.number[Judged(status, is_near, task.is_boundary, is_reached)] += 1
        name = f"block {block}, position {at}, rotation {rotation}"
        if code >= 0 and not _is_right(finder, code, T=T, q=q):
            outcome.wrong_witnesses.append(name)
        if code == UNREACHABLE and is_reached:
            outcome.false_proofs.append(name)
    return outcome


def _is_right(finder: PoseFinder, code: int, *, T: pin.SE3, q: FloatArray) -> bool:
    """Whether a witness reaches its pose and has the margin that is stored, rounded down."""
    margin_rad = finder.margin_rad(q)
    above_rad = margin_rad - code * RAD_PER_MARGIN
    return finder.holds(T, q) and -_ROUNDING_RAD <= above_rad < RAD_PER_MARGIN + _ROUNDING_RAD


@lru_cache(maxsize=1)
def _opened(source: MapSource) -> tuple[ReachMap, tuple[PoseFinder, ...]]:
    """What a worker keeps between its tasks."""
    found = source.open()
    assert isinstance(found, ReachMap)
    return found, tuple(PoseFinder(found.robot, side) for side in found.arms)
