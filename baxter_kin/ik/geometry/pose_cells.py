"""Cells of s0 and w0 that `baxter_kin.ik.geometry.pose_sweep` searches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from baxter_kin.ik.geometry.linkage import Linkage
from baxter_kin.ik.geometry.nearby_deviation import Apart
from baxter_kin.ik.geometry.uncertain import Flags
from baxter_kin.validation import FloatArray

FIRST_CELLS, SPLIT = (24, 16), 4
"""How many of s0 and of w0 there are at first; and in how many each is split, both ways."""

_OFFSETS = (2.0 * np.arange(SPLIT) + 1.0) / SPLIT - 1.0
_SIGNS = np.array([1.0, -1.0])


class PoseCells(NamedTuple):
    """n cells; what two angles are in their middles, in rad, and the signs of two others.

    Attributes:
        s0: shape (n,).
        w0: shape (n,).
        e1_sign: which way the elbow bends, shape (n,).
        s1_sign: to which side the upper arm turns, shape (n,).
        half: half the widths of every cell, in s0 and in w0.
        apart: the arm against the linkage, wherever in a cell there is a solution.
    """

    s0: FloatArray
    w0: FloatArray
    e1_sign: FloatArray
    s1_sign: FloatArray
    half: tuple[float, float]
    apart: Apart

    @classmethod
    def of(cls, linkage: Linkage, apart: Apart) -> PoseCells:
        """Those that hold all angles inside the limits, with both signs."""
        low, high = np.array(linkage.q_min)[[0, 4]], np.array(linkage.q_max)[[0, 4]]
        half = 0.5 * (high - low) / FIRST_CELLS
        middles = (
            low[i] + half[i] * (2.0 * np.arange(FIRST_CELLS[i]) + 1.0) for i in range(len(half))
        )
        grids = np.meshgrid(*middles, _SIGNS, _SIGNS)
        s0, w0, e1_sign, s1_sign = (grid.ravel() for grid in grids)
        return cls(s0, w0, e1_sign, s1_sign, (float(half[0]), float(half[1])), apart)

    def part(self, which: Flags) -> PoseCells:
        """Some of them."""
        s0, w0, e1_sign, s1_sign = (values[which] for values in self[:4])
        return PoseCells(s0, w0, e1_sign, s1_sign, self.half, self.apart.part(which))

    def split(self) -> PoseCells:
        """Each in `SPLIT` both ways."""
        half_s0, half_w0 = self.half
        count = SPLIT * SPLIT
        return PoseCells(
            (self.s0[:, None] + half_s0 * np.repeat(_OFFSETS, SPLIT)).ravel(),
            (self.w0[:, None] + half_w0 * np.tile(_OFFSETS, SPLIT)).ravel(),
            np.repeat(self.e1_sign, count),
            np.repeat(self.s1_sign, count),
            (half_s0 / SPLIT, half_w0 / SPLIT),
            self.apart.repeated(count),
        )
