"""Reading all blocks of a map, and choosing cells of them at random."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from baxter_kin.validation import Indices
from planner.atlas.blocks import Block, Blocks, BlockTask
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import UNDECIDED, Codes
from planner.atlas.workers import opened_for_work
from planner.errors import AtlasError

Flags: TypeAlias = NDArray[np.bool_]

PIECE = 50
"""Cells of one task."""


class Survey(NamedTuple):
    """A block in numbers: cells next to the boundary, others, and undecided; or what is wrong."""

    at_boundary: int = 0
    elsewhere: int = 0
    undecided: int = 0
    damage: str = ""


class CellTask(NamedTuple):
    """Cells to check of a block, of those at the boundary or of the others.

    Attributes:
        block: where they are.
        is_boundary: which of them.
        first: in the order that the seed shuffles them to.
        last: the same, behind the last.
        seed: of the order.
    """

    block: BlockTask
    is_boundary: bool
    first: int
    last: int
    seed: int


def survey_block(task: BlockTask) -> Survey:
    """Read a block, its checksums with it."""
    found = opened_for_work(task.path, task.identity)
    try:
        cells = found.read_block(task.block)
    except AtlasError as cause:
        return Survey(damage=str(cause))
    if cells is None:
        return Survey(damage=f"block {task.block} of the map has cells that are not computed")
    edge = int(are_at_boundary(found, task.block, cells.margins).sum())
    return Survey(edge, cells.margins.size - edge, int((cells.margins == UNDECIDED).sum()))


class Surveys:
    """Those of all blocks, in a few bytes each.

    Attributes:
        damaged: reasons, by block.
        undecided: cells.
    """

    def __init__(self, blocks: Blocks) -> None:
        self._blocks = blocks
        self._sizes = np.zeros((2, len(blocks)), np.int32)  # elsewhere, at the boundary
        self.damaged: dict[Block, str] = {}
        self.undecided = 0

    @property
    def cells(self) -> int:
        """How many were read."""
        return int(self._sizes.sum(dtype=np.int64))

    def add(self, block: Block, survey: Survey) -> None:
        """Count one block."""
        self._sizes[:, self._blocks.index(block)] = survey.elsewhere, survey.at_boundary
        self.undecided += survey.undecided
        if survey.damage:
            self.damaged[block] = survey.damage

    def tasks(self, found: ReachMap, cells: int, seed: int) -> list[CellTask]:
        """Half of the cells at the boundary, half elsewhere, each cell as likely as the others."""
        rng, left, tasks = np.random.default_rng(seed), cells, list[CellTask]()
        for is_boundary in (True, False):
            ends = np.cumsum(self._sizes[int(is_boundary)], dtype=np.int64)
            wanted = min(cells // 2 if is_boundary else left, int(ends[-1]))
            left -= wanted
            chosen = rng.choice(int(ends[-1]), wanted, replace=False, shuffle=False)
            where, numbers = np.unique(np.searchsorted(ends, chosen, "right"), return_counts=True)
            tasks += self._pieces(found, is_boundary, where, numbers, seed=seed)
        return tasks

    def _pieces(
        self, found: ReachMap, is_boundary: bool, where: Indices, numbers: Indices, *, seed: int
    ) -> Iterator[CellTask]:
        path, identity = str(found.path.resolve()), found.identity
        for at, number in zip(where.tolist(), numbers.tolist(), strict=True):
            block = BlockTask(path, self._blocks[at], identity)
            for first in range(0, number, PIECE):
                last = min(first + PIECE, number)
                yield CellTask(block, is_boundary, first, last, seed)


def are_at_boundary(found: ReachMap, block: Block, margins: Codes) -> Flags:
    """Which cells have a neighbour in the block, in position or roll, of the other status."""
    part = found.positions.block_slices(block[1:])
    rolls = len(found.rotations.rolls)
    is_reachable = np.reshape(margins >= 0, (*(p.stop - p.start for p in part), -1, rolls))
    edge = np.zeros_like(is_reachable)
    for axis in range(3):
        step = np.diff(is_reachable, axis=axis)
        lower, upper = (np.moveaxis(edge, axis, 0)[cut] for cut in (slice(-1), slice(1, None)))
        lower |= np.moveaxis(step, axis, 0)
        upper |= np.moveaxis(step, axis, 0)
    for turn in (-1, 1):
        edge |= is_reachable != np.roll(is_reachable, turn, axis=4)
    return edge.reshape(margins.shape)
