"""A lower bound on the distance from a point to where an arm's tip can be, in any orientation.

Letters and `Linkage` as in `baxter_kin.ik.geometry.linkage`; v is the point seen from S. For one
angle of s0, the elbow lies on the sphere of radius |E - S| about S, within `elbow_angle` of the arc
that s1 lets u sweep in the vertical plane of s0. The tip is at most `tip_distance_m(0)` from the
elbow. So v is out of reach by its distance from that part of the sphere less that length. Turning
s0 by an angle moves v, seen from the arm, by no more than the angle times the point's distance from
the s0
axis: evaluated at the middles of cells, less that slack, the distance holds for all angles.
"""

from __future__ import annotations

import math

import numpy as np

from baxter_kin.ik.geometry.linkage import Linkage
from baxter_kin.validation import FloatArray

CELLS, SPLIT, LEVELS = 32, 8, 3
"""The s0 range starts as 32 cells; those that could still hold the least distance are split in
eight, down to 1.7 mrad."""


class PositionSweep:
    """The sweep for one arm."""

    def __init__(self, linkage: Linkage) -> None:
        self._arm = linkage
        self._upper = linkage.upper_span_m
        self.tip_reach_m = linkage.tip_distance_m(0.0)
        self._s1_middle = 0.5 * (linkage.q_min[1] + linkage.q_max[1])
        self._s1_half = 0.5 * (linkage.q_max[1] - linkage.q_min[1])
        self._offsets = (2.0 * np.arange(SPLIT) + 1.0) / SPLIT - 1.0

    def excess_m(self, point: FloatArray) -> float:
        """A lower bound on how far the tip stays from a point; negative when nothing is proved.

        Args:
            point: seen from the first axis, shape (3,), m; finite.
        """
        low, high = self._arm.q_min[0], self._arm.q_max[0]
        half = (high - low) / (2 * CELLS)
        s0 = np.linspace(low + half, high - half, CELLS)
        radius, settled = math.hypot(point[0], point[1]), math.inf
        for _ in range(LEVELS):
            excess = self._excess_at(s0, point)
            bounds = excess - radius * half
            is_open = bounds < excess.min()
            if not is_open.any():
                break
            settled = min(settled, float(bounds[~is_open].min(initial=math.inf)))
            s0 = (s0[is_open, None] + half * self._offsets).ravel()
            half /= SPLIT
        return min(settled, float(bounds.min()))

    def _excess_at(self, s0: FloatArray, point: FloatArray) -> FloatArray:
        """The bound at single angles of s0, shape (n,)."""
        x, y, z = point.tolist()
        radially = x * np.cos(s0) + y * np.sin(s0) - self._arm.shoulder_offset_m
        sideways = y * np.cos(s0) - x * np.sin(s0)
        in_plane = np.hypot(radially, z)
        distance = np.hypot(in_plane, sideways)
        turn = -np.arctan2(z, radially) - self._s1_middle
        past = np.abs(np.remainder(turn + math.pi, 2.0 * math.pi) - math.pi) - self._s1_half
        along = in_plane * np.cos(np.maximum(past, 0.0))
        angle = np.arctan2(np.sqrt(np.maximum(distance**2 - along**2, 0.0)), along)
        off = np.maximum(angle - self._arm.elbow_angle, 0.0)
        to_elbow = np.hypot(distance - self._upper * np.cos(off), self._upper * np.sin(off))
        excess: FloatArray = to_elbow - self.tip_reach_m
        return excess
