"""What a page shows of a reach map: all positions, or every n-th along each axis of a large one."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count

import numpy as np

from baxter_kin.validation import FloatArray, Indices
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import NOT_COMPUTED, RAD_PER_STEP, Codes, Steps

Slices = tuple[slice, ...]


@dataclass(frozen=True, slots=True, eq=False)
class ShownMap:
    """The part of a map that a page shows.

    Attributes:
        every: n, if every n-th position along each axis is shown.
        low_m: the lowest position in base, shape (3,), m.
        step_m: distance of neighbours.
        codes: margins in steps of `RAD_PER_MARGIN`, or codes, of the cells, shape (arms, nx, ny,
            nz, rotations).
        q: the witnesses of the reachable cells, in their order, shape (m, 7), rad.
    """

    every: int
    low_m: FloatArray
    step_m: float
    codes: Codes
    q: FloatArray

    @property
    def cells(self) -> Indices:
        """The reachable cells: indices into `codes`, shape (5, m)."""
        return np.array(np.nonzero(self.codes >= 0))

    def points(self, cells: Indices) -> FloatArray:
        """Positions in base of cells given as in `cells`, shape (m, 3), m."""
        points: FloatArray = self.low_m + self.step_m * cells[1:4].T
        return points


def thinning(found: ReachMap, most_cells: int) -> int:
    """The smallest n for which every n-th position along each axis fits into a number of cells."""
    arms, rotations = len(found.arms), len(found.rotations)
    cells = (
        (every, arms * rotations * math.prod(map(len, _axes(found, every)))) for every in count(1)
    )
    smallest = max(found.positions.shape)
    return next(every for every, n in cells if n <= most_cells or every >= smallest)


def shown_part(found: ReachMap, every: int = 1) -> ShownMap:
    """Read the shown cells of a map, block by block; missing blocks are not computed.

    Args:
        found: the map.
        every: n, to show every n-th position along each axis, including those of base's axes.
    """
    axes, rotations = _axes(found, every), len(found.rotations)
    shape = (len(found.arms), *map(len, axes))
    codes = np.full((*shape, rotations), NOT_COMPUTED, np.int16)
    witnesses = []
    for block, inside, kept in _parts(found, every):
        cells = found.read_block(block)
        if cells is None:
            continue
        sizes = tuple(s.stop - s.start for s in found.positions.block_slices(block[1:]))
        margins = cells.margins.reshape(*sizes, rotations)[inside]
        codes[block[0]][kept] = margins
        steps = cells.witnesses.reshape(*sizes, 7, rotations)[inside].swapaxes(3, 4)
        at = np.array(np.nonzero(margins >= 0))
        at[:3] += np.array([[piece.start] for piece in kept])
        witnesses.append((block[0], at, steps[margins >= 0]))
    low = [
        found.positions.step_m * (f + a[0])
        for f, a in zip(found.positions.first, axes, strict=True)
    ]
    q = _in_order(witnesses, codes.shape)
    return ShownMap(every, np.array(low), every * found.positions.step_m, codes, q)


def _axes(found: ReachMap, every: int) -> tuple[range, ...]:
    """Indices of the shown positions along x, y and z: multiples of the wider step."""
    grid = found.positions
    firsts = (-first % every for first in grid.first)
    return tuple(
        range(first if first < n else 0, n, every)
        for first, n in zip(firsts, grid.shape, strict=True)
    )


def _parts(
    found: ReachMap, every: int
) -> Iterator[tuple[tuple[int, int, int, int], Slices, Slices]]:
    """Blocks with shown positions: the block, and the slices of it and of the shown part."""
    axes = _axes(found, every)
    for block in found.blocks:
        inside, kept = [], []
        for axis, piece in zip(axes, found.positions.block_slices(block[1:]), strict=True):
            before = -(-max(piece.start - axis.start, 0) // every)
            first = axis.start + before * every
            inside.append(slice(first - piece.start, piece.stop - piece.start, every))
            kept.append(slice(before, before + len(range(first, piece.stop, every))))
        if all(piece.stop > piece.start for piece in kept):
            yield block, tuple(inside), tuple(kept)


def _in_order(witnesses: list[tuple[int, Indices, Steps]], shape: tuple[int, ...]) -> FloatArray:
    """Witnesses of all blocks, in the order of the cells of the whole."""
    if not witnesses:
        return np.zeros((0, 7))
    places = [
        np.ravel_multi_index((np.full(at.shape[1], arm), *at), shape) for arm, at, _ in witnesses
    ]
    order = np.argsort(np.concatenate(places))
    q: FloatArray = RAD_PER_STEP * np.concatenate([steps for _, _, steps in witnesses])[order]
    return q
