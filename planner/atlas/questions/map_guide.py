"""What a map says of poses between its cells: a guide, not an answer.

A pose is judged by the cell of the nearest position and, there, the nearest rotation: its margin
counts. Where that cell has no witness but one of the 26 positions around it has (at the same
rotation), the pose may be reachable, and its margin counts as zero. Where none has, the pose is
dismissed: no proof, the map is too coarse for one. Of poses beyond the grid's positions, in blocks
that are not computed, or turned farther from every rotation of the map than these are apart, it
says nothing.
"""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from baxter_kin.validation import FloatArray, Indices
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import NOT_COMPUTED, RAD_PER_MARGIN

DISMISSED = -1.0
"""In the place of a margin: no cell near the pose has a witness."""

LEAST_COVER_RAD = math.radians(5.0)
"""How far a pose may be turned from the rotation of a map that has one alone."""

ROWS = 512
"""Rotations compared with each other at a time."""


class MapGuide:
    """A map, asked for many poses at once."""

    def __init__(self, atlas: ReachMap) -> None:
        self._atlas = atlas
        self._matrices = atlas.rotations.matrices
        self.cover_rad = max(_spacing_rad(self._matrices), LEAST_COVER_RAD)

    def margins_rad(self, side: str, Ts: FloatArray) -> FloatArray:
        """What it says of poses, shape (m,).

        Args:
            side: of the arm.
            Ts: the tip seen from base, shape (m, 4, 4).

        Returns:
            Margins to joint limits, rad; `DISMISSED`; or NaN where the map says nothing.
        """
        grid = self._atlas.positions
        at: Indices = np.rint(Ts[:, :3, 3] / grid.step_m).astype(np.intp) - np.array(grid.first)
        is_inside = ((at >= 0) & (at < grid.shape)).all(axis=1)
        rotation, off_rad = self._nearest_rotations(Ts[:, :3, :3])
        is_known = is_inside & (off_rad <= self.cover_rad)
        margins = np.full(len(Ts), np.nan)
        if is_known.any():
            margins[is_known] = self._judged(side, at[is_known], rotation[is_known])
        return margins

    def _judged(self, side: str, at: Indices, rotation: Indices) -> FloatArray:
        """By indices of positions, shape (m, 3), and of rotations, shape (m,)."""
        shape = np.array(self._atlas.positions.shape)
        low = (at.min(axis=0) - 1).clip(0)
        high = np.minimum(at.max(axis=0) + 2, shape)
        part = tuple(slice(a, b) for a, b in zip(low.tolist(), high.tolist(), strict=True))
        used, column = np.unique(rotation, return_inverse=True)
        codes = self._atlas.margins(side, part)[..., used]
        nearest = codes[(*(at - low).T, column)]
        may_be = np.zeros(len(at), bool)
        for step in product((-1, 0, 1), repeat=3):
            around = (at + step).clip(low, high - 1) - low
            may_be |= codes[(*around.T, column)] >= 0
        margins = np.where(nearest >= 0, nearest * RAD_PER_MARGIN, np.where(may_be, 0.0, DISMISSED))
        margins[nearest == NOT_COMPUTED] = np.nan
        return margins

    def _nearest_rotations(self, Rs: FloatArray) -> tuple[Indices, FloatArray]:
        """The nearest rotation of the map for each of some, shape (m, 3, 3), and its angle, rad."""
        different, which = np.unique(Rs.reshape(-1, 9).round(9), axis=0, return_inverse=True)
        nearest, cosine = np.zeros(len(different), np.intp), np.zeros(len(different))
        for first in range(0, len(different), ROWS):
            part = slice(first, first + ROWS)
            traces = different[part] @ self._matrices.reshape(-1, 9).T
            nearest[part] = traces.argmax(axis=1)
            cosine[part] = 0.5 * (traces.max(axis=1) - 1.0)
        return nearest[which.ravel()], np.arccos(cosine.clip(-1.0, 1.0))[which.ravel()]


def _spacing_rad(matrices: FloatArray) -> float:
    """The largest angle from a rotation to its nearest neighbour, of up to `ROWS`; or zero."""
    flat = matrices.reshape(-1, 9)
    if len(flat) == 1:
        return 0.0
    chosen = np.arange(0, len(flat), -(-len(flat) // ROWS))
    traces = flat[chosen] @ flat.T
    traces[np.arange(len(chosen)), chosen] = -1.0
    cosine = (0.5 * (traces.max(axis=1) - 1.0)).clip(-1.0, 1.0)
    return float(np.arccos(cosine).max())
