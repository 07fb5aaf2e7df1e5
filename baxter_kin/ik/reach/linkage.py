"""The arm as three bent links: the few lengths and angles that determine its reach.

Baxter's joints come in pairs: one bends, the next rolls about the link just bent (the offsets are
those of the DH table in R. L. Williams II, "Baxter Humanoid Robot Kinematics", Ohio University,
2017, section 3). A stage (axis, offset) bends within its plane, then rolls about its new axis:

```
stage(axis, offset; bend, roll):  axis'   = cos(bend) axis + sin(bend) offset
                                  swing   = cos(bend) offset - sin(bend) axis
                                  offset' = cos(roll) swing + sin(roll) axis' x swing

radial  = (cos s0, sin s0, 0)  about the first axis, which is z,   down = (0, 0, -1)
(u, r)  = stage(radial, down; s1, e0)        upper arm
(f, k)  = stage(u, r; e1, w0)                forearm
(t, .)  = stage(f, k; w1, w2)                hand: t is the last axis

shoulder  S = shoulder_offset radial                          on the axis of s1
elbow     E = S + upper_m u + elbow_offset_m r                on the axis of e1
wrist     W = E + fore_m f + wrist_offset_m k                 on the axes of w1 and w2
```

The pose determines the last axis, and so W and t. Every length is one of the arm's
Denavit-Hartenberg parameters. In a calibrated arm the parameters that are missing here are not
exactly zero, and neighbouring axes are not exactly at right angles: the linkage is then an
approximation of the arm, and has bounds on its deviation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from baxter_kin.errors import DescriptionError
from baxter_kin.kinematics.arm import Arm
from baxter_kin.kinematics.dh_parameters import DHParameters
from baxter_kin.kinematics.symbolic import QUARTERS
from baxter_kin.validation import FloatArray

Lengths: TypeAlias = tuple[float, float, float, float, float]
"""Offset of the shoulder, upper arm, its offset, forearm, its offset, m."""

ROUNDING = 1e-12
"""Of positions (m) and unit vectors, in addition to the deviation."""

FAR_M = 1e150
"""Coordinates are clipped to this magnitude, so that their squares and sums stay finite."""

_MIN_RAD = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Deviation:
    """Bounds on the distance between arm and linkage, for all joint angles.

    Attributes:
        wrist_m: distance between the wrists, m.
        axis: distance between the ends of unit vectors along the last axes.
        tip_m: distance between the tips, m.
    """

    wrist_m: float
    axis: float
    tip_m: float

    @classmethod
    def of(cls, dh: DHParameters, lengths: Lengths, hand_m: float) -> Deviation:
        """The bounds as sums over the links.

        Replacing one link of the arm by that of the linkage moves all following links by the
        difference of their lengths, and turns them about an axis through the end of the link by the
        difference of their twists: a point at a distance r from there moves by at most the chord,
        2 sin(angle / 2) r. The linkage results from six such replacements.
        """
        _, upper, elbow, fore, wrist = lengths
        fore_span = math.hypot(fore, wrist)
        reach = math.hypot(upper, elbow) + fore_span
        to_wrist = np.array([reach, reach, fore_span, fore_span, 0.0, 0.0])
        chords = 2.0 * np.abs(np.sin(0.5 * (dh.alpha_rad - 0.5 * np.pi)))
        missing = np.abs(np.concatenate([dh.a_m[1::2], dh.d_m[0::2]]))
        wrist_m, axis = float(missing.sum() + chords @ to_wrist), float(chords.sum())
        return cls(wrist_m, axis, wrist_m + axis * hand_m)


@dataclass(frozen=True, slots=True, eq=False)
class Linkage:
    """Lengths (m) and limits (rad) of one arm; letters as in the module's formulas.

    Attributes:
        T_base_first: the frame of the first axis: z along it, origin at the height of S, x along
            `radial` at s0 = 0.
        T_last_tip: the tip seen from the frame of the last axis: z along it, origin W.
        shoulder_offset_m: from the first axis to S.
        upper_m: along the upper arm, from S to the elbow's height.
        elbow_offset_m: from the upper arm's axis to E.
        fore_m: along the forearm, from E to the wrist's height.
        wrist_offset_m: from the forearm's axis to W.
        hand_m: from W to the tip.
        q_offset: the linkage's angles minus the arm's joint angles, shape (7,).
        q_min: lower limits of the linkage's angles, seven; those of the arm, or wider ones where
            the bounds would not hold otherwise.
        q_max: upper limits, likewise.
        dh: the geometry of the arm.
        deviation: bounds on the distance from the arm.
    """

    T_base_first: pin.SE3
    T_last_tip: pin.SE3
    shoulder_offset_m: float
    upper_m: float
    elbow_offset_m: float
    fore_m: float
    wrist_offset_m: float
    hand_m: float
    q_offset: FloatArray
    q_min: tuple[float, ...]
    q_max: tuple[float, ...]
    dh: DHParameters
    deviation: Deviation

    @classmethod
    def of(cls, arm: Arm) -> Linkage:
        """The linkage of an arm."""
        dh = DHParameters.of(arm)
        a, d = dh.a_m.tolist(), dh.d_m.tolist()
        lengths = -a[0], d[1], -a[2], d[3], -a[4]
        offsets = np.concatenate([[0.0], dh.theta_rad - 0.5 * np.pi * np.array(QUARTERS), [0.0]])
        hand_m = float(np.linalg.norm(dh.T_last_tip.translation))
        low, high = _widened(arm.limits.q_min + offsets, arm.limits.q_max + offsets, lengths)
        linkage = cls(
            dh.T_base_first * pin.SE3(np.diag([-1.0, -1.0, 1.0]), np.zeros(3)),
            dh.T_last_tip,
            *lengths,
            hand_m,
            offsets,
            tuple(low.tolist()),
            tuple(high.tolist()),
            dh,
            Deviation.of(dh, lengths, hand_m),
        )
        _check_limits(linkage, arm)
        _check_kinematics(linkage, arm)
        return linkage

    def targets(self, Ts: FloatArray) -> FloatArray:
        """The frame of the last axis for poses, seen from the first axis.

        Args:
            Ts: the tip seen from base, shape (m, 4, 4).

        Returns:
            Shape (m, 4, 4): the origin is W, z is t.
        """
        near = Ts.clip(-FAR_M, FAR_M)
        seen = self.T_base_first.inverse().homogeneous @ near
        targets: FloatArray = seen @ self.T_last_tip.inverse().homogeneous
        return targets

    def wrist_and_axis(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """W (m) and t, both shape (3,), seen from the first axis.

        Args:
            q: the arm's joint angles, shape (7,), rad.
        """
        s0, s1, e0, e1, w0, w1, w2 = (q + self.q_offset).tolist()
        radial = np.array([math.cos(s0), math.sin(s0), 0.0])
        u, r = _stage(radial, np.array([0.0, 0.0, -1.0]), s1, e0)
        f, k = _stage(u, r, e1, w0)
        t, _ = _stage(f, k, w1, w2)
        elbow = self.shoulder_offset_m * radial + self.upper_m * u + self.elbow_offset_m * r
        return elbow + self.fore_m * f + self.wrist_offset_m * k, t

    @property
    def upper_span_m(self) -> float:
        """|E - S|."""
        return math.hypot(self.upper_m, self.elbow_offset_m)

    @property
    def fore_span_m(self) -> float:
        """|W - E|."""
        return math.hypot(self.fore_m, self.wrist_offset_m)

    @property
    def elbow_angle(self) -> float:
        """The angle between u and S -> E."""
        return math.atan2(self.elbow_offset_m, self.upper_m)

    @property
    def wrist_angle(self) -> float:
        """The angle between f and E -> W."""
        return math.atan2(self.wrist_offset_m, self.fore_m)

    @property
    def max_bend(self) -> float:
        """The largest angle between S -> E and E -> W: e1 at its upper limit, over all w0.

        The angle between E -> W and f is `wrist_angle`, in a direction that depends on w0; that
        between f and S -> E is `|e1 - elbow_angle|`.
        """
        return self.q_max[3] - self.elbow_angle + self.wrist_angle

    @property
    def max_overbend(self) -> float:
        """The largest such angle with e1 below `elbow_angle`: the elbow bent the other way."""
        return self.elbow_angle - self.q_min[3] + self.wrist_angle

    @property
    def max_wrist_turn(self) -> float:
        """The largest angle between E -> W and t, over w1."""
        return max(self.q_max[5] - self.wrist_angle, self.wrist_angle - self.q_min[5])

    @property
    def min_swing_m(self) -> float:
        """The smallest distance of W from the line through S along u, over e1 and w0.

        It is at least `r . (W - S) = elbow_offset_m + fore_m sin(e1) + wrist_offset_m k . r`.
        """
        lowest_sine = min(math.sin(self.q_min[3]), math.sin(self.q_max[3]))
        return self.elbow_offset_m + self.fore_m * lowest_sine - self.wrist_offset_m

    def wrist_distance_m(self, bend: float) -> float:
        """|W - S| when S -> E and E -> W enclose the angle `bend` (law of cosines)."""
        upper, fore = self.upper_span_m, self.fore_span_m
        return math.sqrt(upper**2 + fore**2 + 2.0 * upper * fore * math.cos(bend))

    def tip_distance_m(self, turn: float) -> float:
        """|tip - E| when E -> W and t enclose the angle `turn` (law of cosines)."""
        fore, hand = self.fore_span_m, self.hand_m
        return math.sqrt(fore**2 + hand**2 + 2.0 * fore * hand * math.cos(turn))


def _stage(
    axis: FloatArray, offset: FloatArray, bend: float, roll: float
) -> tuple[FloatArray, FloatArray]:
    bent = math.cos(bend) * axis + math.sin(bend) * offset
    swing = math.cos(bend) * offset - math.sin(bend) * axis
    return bent, math.cos(roll) * swing + math.sin(roll) * np.cross(bent, swing)


def _widened(low: FloatArray, high: FloatArray, lengths: Lengths) -> tuple[FloatArray, FloatArray]:
    """Limits that contain the given ones and meet the assumptions of the proofs.

    The elbow can be overbent, and bent by more than that; the wrist can be turned both ways; the
    shoulder turns by at most a whole turn. Proofs for wider limits hold for narrower ones.
    """
    _, upper, elbow, fore, wrist = lengths
    elbow_angle, wrist_angle = math.atan2(elbow, upper), math.atan2(wrist, fore)
    low, high = low.copy(), high.copy()
    low[3] = min(low[3], elbow_angle - 2.0 * wrist_angle - _MIN_RAD)
    high[3] = max(high[3], 2.0 * elbow_angle - low[3] + _MIN_RAD)
    low[5], high[5] = min(low[5], wrist_angle - _MIN_RAD), max(high[5], wrist_angle + _MIN_RAD)
    for joint in (0, 1):
        if high[joint] - low[joint] > 2.0 * math.pi:
            low[joint], high[joint] = -math.pi, math.pi
    return low, high


def _check_kinematics(linkage: Linkage, arm: Arm) -> None:
    """Compare the linkage with Pinocchio at three configurations in general position."""
    low, high = arm.limits.q_min, arm.limits.q_max
    for ratio in (0.19, 0.53, 0.83):
        q = low + ratio * (high - low)
        wrist, axis = linkage.wrist_and_axis(q)
        seen = linkage.targets(arm.T_base_tip(q).homogeneous[None])[0]
        apart_m = float(np.linalg.norm(wrist - seen[:3, 3]))
        turned = float(np.linalg.norm(axis - seen[:3, 2]))
        slack = linkage.deviation
        if not (apart_m <= slack.wrist_m + ROUNDING and turned <= slack.axis + ROUNDING):
            raise DescriptionError(
                f"the {arm.side} arm of this model is not built like Baxter's: at q = {q.tolist()} "
                f"its wrist is {apart_m:.3g} m, and its last axis {turned:.3g}, off Baxter's"
            )


def _check_limits(linkage: Linkage, arm: Arm) -> None:
    """Check the assumptions of the closed forms of `ShoulderSweep` and `ReachBound`."""
    low, high = linkage.q_min, linkage.q_max
    sound = {
        "e1": (
            low[3] < linkage.elbow_angle - 2.0 * linkage.wrist_angle
            and linkage.elbow_angle < high[3] < math.pi - 2.0 * linkage.wrist_angle
            and linkage.max_overbend < min(linkage.max_bend, 0.5 * math.pi)
            and linkage.min_swing_m > 0.0
        ),
        "w1": low[5] < linkage.wrist_angle < high[5] and linkage.max_wrist_turn < math.pi,
    }
    for joint, holds in sound.items():
        if not holds:
            raise DescriptionError(
                f"the limits of {arm.side}_{joint} or the lengths next to it are not Baxter's; "
                "proofs that a pose is out of reach do not apply to them"
            )
