"""ShownMap: all positions of a reach map, or every n-th along each axis of a large one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import count

import numpy as np

from baxter_kin.validation import FloatArray, Indices
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import NOT_COMPUTED, RAD_PER_STEP, Codes


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


def thinning(found: ReachMap, max_cells: int) -> int:
    """The smallest n for which every n-th position along each axis fits into a number of cells."""
    per_position, longest = len(found.arms) * len(found.rotations), max(found.positions.shape)
    return next(
        every
        for every in count(1)
        if every >= longest or per_position * math.prod(map(len, _axes(found, every))) <= max_cells
    )


def shown_part(found: ReachMap, every: int = 1) -> ShownMap:
    """Read the shown cells of a map, block by block; missing blocks are not computed.

    Args:
        found: the map.
        every: n, to show every n-th position along each axis, including those of base's axes.
    """
    grid, axes = found.positions, _axes(found, every)
    shape = (len(found.arms), *map(len, axes), len(found.rotations))
    codes = np.full(shape, NOT_COMPUTED, np.int16)
    order, witnesses = [np.zeros(0, np.intp)], [np.zeros((0, 7), np.int32)]
    numbers = np.arange(codes.size).reshape(shape)
    for block in found.computed_blocks():
        pieces = found.grid.slices(block)
        inside, place = [], [np.array([block[0]])]
        for axis, piece in zip(axes, pieces, strict=True):
            is_shown = (axis >= piece.start) & (axis < piece.stop)
            inside.append(axis[is_shown] - piece.start)
            place.append(np.flatnonzero(is_shown))
        cells = found.read_block(block) if all(map(len, inside)) else None
        if cells is None:
            continue
        sizes = [piece.stop - piece.start for piece in pieces]
        margins = cells.margins.reshape(*sizes, -1)[np.ix_(*inside)]
        steps = cells.witnesses.reshape(*sizes, 7, shape[4])[np.ix_(*inside)].swapaxes(3, 4)
        codes[np.ix_(*place)] = margins
        order.append(numbers[np.ix_(*place)][0][margins >= 0])
        witnesses.append(steps[margins >= 0])
    in_order = np.concatenate(witnesses)[np.argsort(np.concatenate(order))]
    low_m = grid.point([int(axis[0]) for axis in axes])
    q = RAD_PER_STEP * in_order.astype(np.float64)
    return ShownMap(every, low_m, every * grid.step_m, codes, q)


def _axes(found: ReachMap, every: int) -> list[Indices]:
    """Indices of the shown positions along x, y and z: multiples of the wider step."""
    grid = found.positions
    firsts = [-first % every for first in grid.first]
    return [
        np.arange(first if first < n else 0, n, every)
        for first, n in zip(firsts, grid.shape, strict=True)
    ]
