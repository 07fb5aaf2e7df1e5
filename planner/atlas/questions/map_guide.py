"""MapGuide: what a map's cells suggest for poses between them; no proof.

A pose is judged by the cell of the nearest position and, there, the nearest rotation: its margin
counts. If that cell has no witness but one of the 26 positions around it has one at the same
rotation, the pose may be reachable, and its margin counts as zero. If none has, the pose is
dismissed. The map does not cover poses outside its positions, in blocks that are not computed, or
farther from every rotation of the map than these are from each other.
"""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from baxter_kin.validation import FloatArray, Indices
from planner.atlas.reach_map import ReachMap
from planner.atlas.reach_search import NOT_COMPUTED, RAD_PER_MARGIN

DISMISSED = -1.0
"""Stands for the margin of a pose without a reachable cell near it."""

MIN_COVER_RAD = math.radians(5.0)
"""Minimum angle from a rotation of the map within which poses are covered."""

ROWS = 512
"""Number of rotations compared at a time, which bounds the memory."""


class MapGuide:
    """Estimates of margins for many poses at once.

    Attributes:
        cover_rad: angle from a rotation of the map within which poses are covered.
    """

    def __init__(self, atlas: ReachMap) -> None:
        self._atlas = atlas
        self._matrices = atlas.rotations.matrices.reshape(-1, 9)
        self.cover_rad = max(_spacing_rad(self._matrices), MIN_COVER_RAD)

    def margins_rad(self, side: str, Ts: FloatArray) -> FloatArray:
        """Estimated margins of poses, shape (m,).

        Args:
            side: of the arm.
            Ts: the tip seen from base, shape (m, 4, 4).

        Returns:
            Margins to joint limits, rad; `DISMISSED`; or NaN where the map does not cover the pose.
        """
        grid = self._atlas.positions
        index: Indices = np.rint(Ts[:, :3, 3] / grid.step_m).astype(np.intp) - np.array(grid.first)
        is_inside = ((index >= 0) & (index < grid.shape)).all(axis=1)
        rotation, angle_rad = self._nearest_rotations(Ts[:, :3, :3])
        is_covered = is_inside & (angle_rad <= self.cover_rad)
        margins = np.full(len(Ts), np.nan)
        if is_covered.any():
            margins[is_covered] = self._margins_at(side, index[is_covered], rotation[is_covered])
        return margins

    def _margins_at(self, side: str, index: Indices, rotation: Indices) -> FloatArray:
        """By indices of positions, shape (m, 3), and of rotations, shape (m,)."""
        low = (index.min(axis=0) - 1).clip(0)
        high = np.minimum(index.max(axis=0) + 2, self._atlas.positions.shape)
        part = tuple(slice(a, b) for a, b in zip(low.tolist(), high.tolist(), strict=True))
        used, column = np.unique(rotation, return_inverse=True)
        codes = self._atlas.margins(side, part)[..., used]
        nearest = codes[(*(index - low).T, column)]
        may_be = np.zeros(len(index), bool)
        for step in product((-1, 0, 1), repeat=3):
            neighbour = (index + step).clip(low, high - 1) - low
            may_be |= codes[(*neighbour.T, column)] >= 0
        margins = np.where(nearest >= 0, nearest * RAD_PER_MARGIN, np.where(may_be, 0.0, DISMISSED))
        margins[nearest == NOT_COMPUTED] = np.nan
        return margins

    def _nearest_rotations(self, Rs: FloatArray) -> tuple[Indices, FloatArray]:
        """Index of the map's nearest rotation for each of some, shape (m, 3, 3), and its angle."""
        different, which = np.unique(Rs.reshape(-1, 9).round(9), axis=0, return_inverse=True)
        nearest, traces = np.zeros(len(different), np.intp), np.zeros(len(different))
        for first in range(0, len(different), ROWS):
            part = slice(first, first + ROWS)
            products = different[part] @ self._matrices.T
            nearest[part], traces[part] = products.argmax(axis=1), products.max(axis=1)
        return nearest[which.ravel()], _angles(traces)[which.ravel()]


def _spacing_rad(matrices: FloatArray) -> float:
    """The largest angle from a rotation to its nearest neighbour, among up to `ROWS`; or zero."""
    if len(matrices) == 1:
        return 0.0
    chosen = np.arange(0, len(matrices), -(-len(matrices) // ROWS))
    traces = matrices[chosen] @ matrices.T
    traces[np.arange(len(chosen)), chosen] = -1.0
    return float(_angles(traces.max(axis=1)).max())


def _angles(traces: FloatArray) -> FloatArray:
    """Angles of rotations with these traces, rad."""
    angles: FloatArray = np.arccos((0.5 * (traces - 1.0)).clip(-1.0, 1.0))
    return angles
