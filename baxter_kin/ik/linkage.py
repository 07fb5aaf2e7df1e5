"""The arm as three bent links: the few lengths and angles that decide where it can reach.

Baxter's joints come in pairs: one bends, the next rolls about the link just bent (the offsets are
those of the DH table in R. L. Williams II, "Baxter Humanoid Robot Kinematics", Ohio University,
2017, section 3). A stage (axis, offset) bends within its plane, then rolls about its new axis:

```
stage(axis, offset; bend, roll):  axis'   = cos(bend) axis + sin(bend) offset
                                  swing   = cos(bend) offset - sin(bend) axis
                                  offset' = cos(roll) swing + sin(roll) axis' x swing

radial  = (cos s0, sin s0, 0)  up to the mounting angle,   down = (0, 0, -1)
(u, r)  = stage(radial, down; s1, e0)        upper arm
(f, k)  = stage(u, r; e1, w0)                forearm
(t, .)  = stage(f, k; w1, w2)                hand: t is the tool's z axis

shoulder  S = centre + shoulder_offset radial                 origin of s1
elbow     E = S + upper_m u + elbow_offset_m r                origin of e1
wrist     W = E + fore_m f + wrist_offset_m k                 origin of w1
tip         = W + hand_m t
```

So the pose alone gives the wrist, `W = tip - hand_m t`. Every number is read from the model, and
the formulas are compared with Pinocchio when a linkage is built.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from baxter_kin.arrays import Vector
from baxter_kin.errors import DescriptionError
from baxter_kin.model import Arm

AGREEMENT_M = 1e-9
"""How far these formulas may be from Pinocchio's kinematics: the URDF's angles are rounded to 1e-11
rad, which no proof relies on."""


@dataclass(frozen=True, slots=True)
class Linkage:
    """Lengths (m), mounting and limits (rad) of one arm; letters as in the module's formulas.

    Attributes:
        centre_base: where the s0 axis passes at the height of S, in base.
        azimuth_zero: direction of `radial` at s0 = 0, about z of base, from x.
        shoulder_offset_m: from the s0 axis to S.
        upper_m: along the upper arm, from S to the elbow's height.
        elbow_offset_m: from the upper arm's axis to E.
        fore_m: along the forearm, from E to the wrist's height.
        wrist_offset_m: from the forearm's axis to W.
        hand_m: along the tool's z axis, from W to the tip.
        q_min: lower limits, seven.
        q_max: upper limits, seven.
    """

    centre_base: tuple[float, float, float]
    azimuth_zero: float
    shoulder_offset_m: float
    upper_m: float
    elbow_offset_m: float
    fore_m: float
    wrist_offset_m: float
    hand_m: float
    q_min: tuple[float, ...]
    q_max: tuple[float, ...]

    @classmethod
    def of(cls, arm: Arm) -> Linkage:
        """Read the numbers off the arm's model.

        Raises:
            DescriptionError: when the model is not built this way, or its limits are so wide that
                the bounds below do not hold.
        """
        model = arm.model
        s0, s1, e0, e1, w0, w1, w2 = (model.jointPlacements[i].translation for i in range(1, 8))
        tip = model.frames[model.getFrameId(arm.tip_frame)].placement.translation
        mount = model.jointPlacements[1].rotation
        linkage = cls(
            centre_base=(float(s0[0]), float(s0[1]), float(s0[2] + s1[2])),
            azimuth_zero=math.atan2(mount[1, 0], mount[0, 0]),
            shoulder_offset_m=float(s1[0]),
            upper_m=float(e0[0] + e1[2]),
            elbow_offset_m=float(e1[0]),
            fore_m=float(w0[0] + w1[2]),
            wrist_offset_m=float(w1[0]),
            hand_m=float(w2[0] + tip[2]),
            q_min=tuple(arm.limits.q_min.tolist()),
            q_max=tuple(arm.limits.q_max.tolist()),
        )
        _check_kinematics(linkage, arm)
        _check_limits(linkage, arm)
        return linkage

    def tip_and_axis(self, q: Vector) -> tuple[Vector, Vector]:
        """Position of the tip (m) and the tool's z axis, both shape (3,), in base.

        Args:
            q: shape (7,), rad.
        """
        azimuth = self.azimuth_zero + q[0]
        radial = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        u, r = _stage(radial, np.array([0.0, 0.0, -1.0]), q[1], q[2])
        f, k = _stage(u, r, q[3], q[4])
        t, _ = _stage(f, k, q[5], q[6])
        shoulder = np.array(self.centre_base) + self.shoulder_offset_m * radial
        elbow = shoulder + self.upper_m * u + self.elbow_offset_m * r
        wrist = elbow + self.fore_m * f + self.wrist_offset_m * k
        return wrist + self.hand_m * t, t

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
        """Between u and S -> E."""
        return math.atan2(self.elbow_offset_m, self.upper_m)

    @property
    def wrist_angle(self) -> float:
        """Between f and E -> W."""
        return math.atan2(self.wrist_offset_m, self.fore_m)

    @property
    def max_bend(self) -> float:
        """The largest angle between S -> E and E -> W: e1 at its upper limit, w0 at its worst.

        E -> W keeps `wrist_angle` to f, in a direction that w0 chooses; f and S -> E are
        `|e1 - elbow_angle|` apart.
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
        """The least distance of W from the line through S along u, over e1 and w0.

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


def _stage(axis: Vector, offset: Vector, bend: float, roll: float) -> tuple[Vector, Vector]:
    bent = math.cos(bend) * axis + math.sin(bend) * offset
    swing = math.cos(bend) * offset - math.sin(bend) * axis
    return bent, math.cos(roll) * swing + math.sin(roll) * np.cross(bent, swing)


def _check_kinematics(linkage: Linkage, arm: Arm) -> None:
    """Compare with Pinocchio at three configurations in general position."""
    low, high = arm.limits.q_min, arm.limits.q_max
    for ratio in (0.19, 0.53, 0.83):
        q = low + ratio * (high - low)
        p, t = linkage.tip_and_axis(q)
        T = arm.T_base_tip(q)
        error = max(np.abs(p - T.translation).max(), np.abs(t - T.rotation[:, 2]).max())
        if not error <= AGREEMENT_M:
            raise DescriptionError(
                f"the {arm.side} arm of this model is not built like Baxter's: at q = {q.tolist()} "
                f"its tip is {error:.3g} m (or rad) from where Baxter's links place it"
            )


def _check_limits(linkage: Linkage, arm: Arm) -> None:
    """What the closed forms of `ShoulderSweep` and `ReachBound` take for granted."""
    low, high = linkage.q_min, linkage.q_max
    sound = {
        "s0": high[0] - low[0] < 2.0 * math.pi,
        "s1": high[1] - low[1] < 2.0 * math.pi,
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
                "proofs that a pose is out of reach do not cover them"
            )
