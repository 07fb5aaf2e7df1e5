"""How far an arm and its linkage can be apart at the same joint angles.

The linkage (`baxter_kin.ik.geometry.linkage`) has the arm's lengths, but for those that are nearly
zero, and right angles where the arm's twists are nearly so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from baxter_kin.kinematics.dh_parameters import DHParameters

Lengths: TypeAlias = tuple[float, float, float, float, float]
"""Offset of the shoulder, upper arm, its offset, forearm, its offset, m."""


@dataclass(frozen=True, slots=True, eq=False)
class Deviation:
    """Bounds for all joint angles.

    Attributes:
        wrist_m: between the wrists, m.
        axis: between the ends of unit vectors along the last axes.
        tip_m: between the tips, m.
    """

    wrist_m: float
    axis: float
    tip_m: float

    @classmethod
    def of(cls, dh: DHParameters, lengths: Lengths, hand_m: float) -> Deviation:
        """The bounds, link by link.

        Exchanging one link of the arm for that of the linkage moves what follows it by the lengths
        that the link differs by, and turns it about an axis through the link's end by the
        difference of their twists: a point at a distance r from there moves by the chord,
        2 sin(angle / 2) r, at most. Both arms differ by all six exchanges at most, one after the
        other.
        """
        _, upper, elbow, fore, wrist = lengths
        fore_span = math.hypot(fore, wrist)
        reach = math.hypot(upper, elbow) + fore_span
        to_wrist = np.array([reach, reach, fore_span, fore_span, 0.0, 0.0])
        chords = 2.0 * np.abs(np.sin(0.5 * (dh.alpha_rad - 0.5 * np.pi)))
        missing = np.abs(np.concatenate([dh.a_m[1::2], dh.d_m[0::2]]))
        wrist_m, axis = float(missing.sum() + chords @ to_wrist), float(chords.sum())
        return cls(wrist_m, axis, wrist_m + axis * hand_m)
