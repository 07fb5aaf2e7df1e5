"""Shells around the shoulder, where a search costs about the same at all positions of one."""

from __future__ import annotations

import numpy as np

from baxter_kin.ik.reach.linkage import Linkage
from baxter_kin.kinematics.arm import Arm
from baxter_kin.validation import FloatArray, Indices

SHELLS = 6
"""Of the same thickness, up to the straight arm's length; what is beyond them is one more."""


class Shells:
    """Those of one arm, the innermost first."""

    def __init__(self, arm: Arm) -> None:
        linkage = Linkage.of(arm)
        self._p_base_shoulder: FloatArray = linkage.T_base_first.translation
        outer_m = linkage.upper_span_m + linkage.tip_distance_m(0.0) + linkage.shoulder_offset_m
        self._thickness_m = outer_m / SHELLS

    def of(self, points: FloatArray) -> Indices:
        """Which shell each position lies in, 0 to `SHELLS`.

        Args:
            points: in base, shape (n, 3), m.
        """
        away = np.linalg.norm(points - self._p_base_shoulder, axis=1)
        found: Indices = np.minimum(away / self._thickness_m, SHELLS).astype(int)
        return found
