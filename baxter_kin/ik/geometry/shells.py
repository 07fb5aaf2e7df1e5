"""How far from its shoulder an arm can put its wrist, and its tip in any orientation.

Letters and `Linkage` as in `baxter_kin.ik.geometry.linkage`. |W - S| lies between the lengths that
upper arm and forearm span straight and fully bent, and the tip is at most a hand farther, for S
anywhere on its arc about the s0 axis. Beyond that, for one angle of s0 after the other,
`PositionSweep`.
"""

from __future__ import annotations

import numpy as np

from baxter_kin.ik.geometry.linkage import FAR_M, Linkage
from baxter_kin.ik.geometry.position_sweep import PositionSweep
from baxter_kin.ik.geometry.shoulder_sweep import SWEEP_MARGIN_M
from baxter_kin.validation import FloatArray


class Shells:
    """The lengths of one arm, and what they leave out; excesses are lower bounds.

    Attributes:
        span_m: from S to W with the arm straight, the deviation from the linkage included.
        fold_m: the same fully bent, less the deviation.
        radius_m: from S to the tip with the arm straight, the deviation included.
        tip_reach_m: from E to the tip with forearm and hand straight, the deviation included.
    """

    def __init__(self, linkage: Linkage) -> None:
        self._arm, deviation = linkage, linkage.deviation
        self._span_m = linkage.wrist_distance_m(0.0)
        self._fold_m = linkage.wrist_distance_m(linkage.max_bend)
        self._radius_m = linkage.upper_span_m + linkage.tip_distance_m(0.0)
        self._position_sweep = PositionSweep(linkage)
        self.span_m = self._span_m + deviation.wrist_m
        self.fold_m = self._fold_m - deviation.wrist_m
        self.radius_m = self._radius_m + deviation.tip_m
        self.tip_reach_m = self._position_sweep.tip_reach_m + deviation.tip_m
        self._wrist_margin_m = SWEEP_MARGIN_M + deviation.wrist_m
        self._tip_margin_m = SWEEP_MARGIN_M + deviation.tip_m
        low, high = linkage.q_min[0], linkage.q_max[0]
        self._s0_middle, self._s0_half = 0.5 * (low + high), 0.5 * (high - low)

    def wrist_excess_m(self, wrists: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How far wrists, (m, 3), lie beyond the span, and how far inside the fold, (m,) each."""
        near, far = self._distances(wrists)
        return near - self._span_m - self._wrist_margin_m, self._fold_m - far - self._wrist_margin_m

    def tip_excess_m(self, point: FloatArray) -> float:
        """How far a tip, (3,), lies beyond the straight arm."""
        nearest_m = float(self._distances(point[None])[0][0])
        return nearest_m - self._radius_m - self._tip_margin_m

    def elbow_excess_m(self, point: FloatArray) -> float:
        """How far a tip, (3,), lies beyond forearm and hand from where s0 and s1 let E go."""
        return self._position_sweep.excess_m(point) - self._tip_margin_m

    def _distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The least and the greatest distance of points, (m, 3), to S over all angles of s0.

        The distance grows with the angle between `radial` and the point's azimuth, up to half a
        turn, so that each extreme lies at an end of the range or where that angle is 0 or pi.
        """
        (x, y, z), offset = points.T.clip(-FAR_M, FAR_M), self._arm.shoulder_offset_m
        radius = np.hypot(x, y)
        turn = np.arctan2(y, x) - self._s0_middle
        off = np.abs(np.arctan2(np.sin(turn), np.cos(turn)))
        least, most = (off - self._s0_half).clip(min=0.0), (off + self._s0_half).clip(max=np.pi)

        def distance(angle: FloatArray) -> FloatArray:
            radially, sideways = radius * np.cos(angle) - offset, radius * np.sin(angle)
            length: FloatArray = np.hypot(np.hypot(radially, sideways), z)
            return length

        return distance(least), distance(most)
