"""Cells of a map around a pose, nearest first: where to begin a search, and what they rule out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from baxter_kin.validation import FloatArray, Indices
from planner.atlas.block_map import Block
from planner.atlas.questions.nearest.measure import Keep, PoseMeasure
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import NOT_COMPUTED, UNREACHABLE, Codes

ON_GRID = 1e-6
"""A pose so close to a cell's, m and rad, is that of the cell."""


class NearerCells(NamedTuple):
    """What a map has nearer to a pose than some distance, the kept part as in the pose.

    Attributes:
        proven: how many cells are proven unreachable.
        unknown: how many are undecided or not computed.
        reachable: how many have a witness.
    """

    proven: int
    unknown: int
    reachable: int


class _Part(NamedTuple):
    """Cells of one block: distances and codes, shape (n, r), and whose they are."""

    block: Block
    distances: FloatArray
    codes: Codes
    rotations: Indices
    points: Indices


class CellsAround:
    """The cells of one arm, seen from a pose."""

    def __init__(
        self, atlas: ReachMap, side: str, T_base_tip: pin.SE3, measure: PoseMeasure
    ) -> None:
        self._atlas, self._arm, self._measure = atlas, atlas.arms.index(side), measure
        self._p = T_base_tip.translation
        traces = np.einsum("nij,ij->n", atlas.rotations.matrices, T_base_tip.rotation)
        self._angles = np.arccos((0.5 * (traces - 1.0)).clip(-1.0, 1.0))
        apart = atlas.rotations.matrices - T_base_tip.rotation
        self._chord = float(np.linalg.norm(apart, axis=(1, 2)).min()) / math.sqrt(2.0)
        self._point = atlas.positions.nearest(self._p)

    @property
    def is_on_grid(self) -> bool:
        """Whether the map has cells with the kept part of the pose."""
        if self._measure.keep is Keep.ORIENTATION:
            return self._chord <= ON_GRID
        if self._measure.keep is Keep.NOTHING:
            return True
        if self._point is None:
            return False
        grid = self._atlas.positions
        at = grid.step_m * (np.array(grid.first) + np.array(self._point))
        return bool(np.linalg.norm(at - self._p) <= ON_GRID)

    def starts(self, count: int) -> list[FloatArray]:
        """Witnesses of the nearest cells that have one, nearest first, shape (7,) each, rad.

        Where the map has no cell with the kept part of the pose, those with the nearest to it.
        """
        best: list[tuple[float, FloatArray]] = []
        for nearest, block in self._blocks():
            farthest = best[-1][0] if len(best) == count else np.inf
            if nearest >= farthest:
                break
            part = self._part(block)
            if part is None:
                continue
            for row, column in self._nearest_of(part, count):
                distance = float(part.distances[row, column])
                if distance < farthest:
                    best.append((distance, self._q(part, row, column)))
            best.sort(key=lambda each: each[0])
            del best[count:]
        return [q for _, q in best]

    def nearer(self, distance: float) -> NearerCells:
        """What cells nearer than a distance say."""
        proven = unknown = reachable = 0
        for nearest, block in self._blocks():
            if nearest >= distance or not self.is_on_grid:
                break
            part = self._part(block, is_read=False)
            if part is None:
                continue
            codes = part.codes[part.distances < distance]
            proven += int((codes == UNREACHABLE).sum())
            reachable += int((codes >= 0).sum())
            unknown += int(((codes < 0) & (codes != UNREACHABLE)).sum())
        return NearerCells(proven, unknown, reachable)

    def _nearest_of(self, part: _Part, count: int) -> Iterator[tuple[int, int]]:
        flat = np.where(part.codes >= 0, part.distances, np.inf).ravel()
        chosen = np.argsort(flat, kind="stable")[:count]
        for at in chosen[np.isfinite(flat[chosen])].tolist():
            yield divmod(at, part.codes.shape[1])

    def _blocks(self) -> list[tuple[float, Block]]:
        """Blocks with cells that count, and a bound on their distances, nearest first."""
        grid, found = self._atlas.positions, list[tuple[float, Block]]()
        for block in self._atlas.blocks:
            slices = grid.block_slices(block[1:])
            if block[0] != self._arm or not self._counts(slices):
                continue
            low = grid.step_m * (np.array(grid.first) + [s.start for s in slices])
            high = grid.step_m * (np.array(grid.first) + [s.stop - 1 for s in slices])
            offset = np.array(np.linalg.norm(self._p - self._p.clip(low, high)))
            found.append((float(self._measure.distance(offset, np.zeros(()))), block))
        return sorted(found)

    def _counts(self, slices: tuple[slice, ...]) -> bool:
        """Whether a block has the point that is kept, where one is."""
        if self._measure.keep is not Keep.POSITION:
            return True
        point = self._point
        return point is not None and all(
            s.start <= i < s.stop for s, i in zip(slices, point, strict=True)
        )

    def _part(self, block: Block, *, is_read: bool = True) -> _Part | None:
        """The cells of a block that count; None when it is not computed and must be."""
        grid, slices = self._atlas.positions, self._atlas.positions.block_slices(block[1:])
        codes = self._atlas.margins(self._atlas.arms[self._arm], slices)
        if is_read and (codes == NOT_COMPUTED).any():
            return None
        codes = codes.reshape(-1, len(self._angles))
        points, rotations = np.arange(len(codes)), np.arange(len(self._angles))
        if self._measure.keep is Keep.ORIENTATION:
            rotations = rotations[[int(self._angles.argmin())]]
        if self._measure.keep is Keep.POSITION and self._point is not None:
            local = [i - s.start for i, s in zip(self._point, slices, strict=True)]
            sizes = [s.stop - s.start for s in slices]
            points = np.array([np.ravel_multi_index(local, sizes)])
        offsets = np.linalg.norm(grid.points(slices).reshape(-1, 3)[points] - self._p, axis=1)
        distances = self._measure.distance(offsets[:, None], self._angles[None, rotations])
        return _Part(block, distances, codes[np.ix_(points, rotations)], rotations, points)

    def _q(self, part: _Part, row: int, column: int) -> FloatArray:
        slices = self._atlas.positions.block_slices(part.block[1:])
        sizes = [s.stop - s.start for s in slices]
        local = np.unravel_index(int(part.points[row]), sizes)
        position = tuple(int(i) + s.start for i, s in zip(local, slices, strict=True))
        side, rotation = self._atlas.arms[self._arm], int(part.rotations[column])
        q = self._atlas.cell(side, position, rotation).q
        return np.zeros(7) if q is None else np.asarray(q)
