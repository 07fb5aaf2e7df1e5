"""Proofs by all joint limits that an arm cannot reach a pose.

Once s0 and w0 are chosen, the other joints follow in closed form, one after the other (letters and
`Linkage` as in `baxter_kin.ik.linkage`; v = W - S). Seen along u, r and n = u x r,

```
v = (upper_m + fore_m cos e1 - b sin e1,  elbow_offset_m + fore_m sin e1 + b cos e1,
     wrist_offset_m sin w0)             with b = wrist_offset_m cos w0
```

- |v| gives `cos(e1 - phi)`, and so e1 up to a sign;
- u lies in the vertical plane of s0, and u . v gives s1 up to a sign;
- the components of v across u in that plane, and out of it, give e0;
- t, seen along f, f's swing and n, gives w1, and w0 once more: both have to agree;
- the tool's x axis gives w2.

A cell is a range of s0 and one of w0. Every step is evaluated at the middle of the cell with a
bound on how far it can be off anywhere in the cell and for every pose within a radius: vectors by
how far they move, angles by the arc sine of that over their length. A cell is dismissed where a
joint has to be outside its limits or the two angles of w0 cannot agree; the others are split. When
none is left, the pose is out of reach. `ShoulderSweep` proves most such poses in less time.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from baxter_kin.arrays import Vector
from baxter_kin.ik.linkage import Linkage
from baxter_kin.ik.shoulder_sweep import MARGIN_M, MARGIN_RAD
from baxter_kin.ik.uncertain import Flags, UncertainAngle, UncertainVector

FIRST_CELLS = 24, 16
"""Of s0 and of w0."""

SPLIT, LEVELS, MOST_SURVIVORS = 4, 8, 1000
"""Cells are split in four both ways, down to 8 urad, unless more than 1,000 of them remain."""

MANY_SURVIVORS = 20_000
"""So many prove six of eight poses 1 to 3 mm out of reach that 1,000 do not, in up to a second."""

_E1_SIGN, _S1_SIGN = np.array([[[1.0], [1.0], [-1.0], [-1.0]], [[1.0], [-1.0], [1.0], [-1.0]]])


class PoseSweep:
    """The sweep for one arm."""

    def __init__(self, linkage: Linkage) -> None:
        """Look up what every cell needs."""
        self._arm = linkage
        low, high = np.array(linkage.q_min), np.array(linkage.q_max)
        self._low, self._middle, self._half = low, 0.5 * (low + high), 0.5 * (high - low)
        self._margin_m = MARGIN_M + linkage.deviation.wrist_m
        self._margin_rad = MARGIN_RAD + linkage.deviation.axis

    def excludes(
        self, target: Vector, radius_m: float, most_survivors: int = MOST_SURVIVORS
    ) -> bool:
        """Whether no pose of that orientation so near to a target is within reach.

        Args:
            target: one of `Linkage.targets`, finite, shape (4, 4).
            radius_m: how far from its position, m.
            most_survivors: how many cells may remain; more of them prove more, and take longer.
        """
        half = self._half[[0, 4]] / FIRST_CELLS
        starts = (
            self._low[j] + half[i] * (2.0 * np.arange(FIRST_CELLS[i]) + 1.0)
            for i, j in enumerate((0, 4))
        )
        s0, w0 = (grid.ravel() for grid in np.meshgrid(*starts))
        offsets = (2.0 * np.arange(SPLIT) + 1.0) / SPLIT - 1.0
        for _ in range(LEVELS):
            survives = self._survivors(
                target, radius_m, UncertainAngle(s0, half[0]), UncertainAngle(w0, half[1])
            )
            s0, w0 = s0[survives], w0[survives]
            if s0.size == 0 or s0.size > most_survivors:
                return bool(s0.size == 0)
            s0 = np.repeat((s0[:, None] + half[0] * offsets).ravel(), SPLIT)
            w0 = np.tile(w0[:, None] + half[1] * offsets, SPLIT).ravel()
            half = half / SPLIT
        return False

    def _survivors(
        self, target: Vector, radius_m: float, s0: UncertainAngle, w0: UncertainAngle
    ) -> Flags:
        """Which cells may hold a solution, shape (n,); on the way arrays of shape (4, n)."""
        wobble_m, cos, sin = radius_m + self._margin_m, np.cos(s0.middle), np.sin(s0.middle)
        x, y, up = target[:3, 3].tolist()
        radially = x * cos + y * sin - self._arm.shoulder_offset_m
        sideways, slack_m = y * cos - x * sin, wobble_m + s0.slack * math.hypot(x, y)
        d = np.sqrt(radially * radially + sideways * sideways + up * up)
        e1, is_possible = self._elbow(d, wobble_m + s0.slack * self._arm.shoulder_offset_m, w0)
        along, across = self._forearm(e1, w0)
        s1, is_seen = _shoulder(UncertainVector(radially, np.full_like(d, up), slack_m), along)
        swing = -np.sin(s1.middle) * radially - np.cos(s1.middle) * up
        slack_m = slack_m + np.hypot(radially, up) * s1.slack
        beside = UncertainVector(swing, np.broadcast_to(sideways, swing.shape), slack_m)
        e0 = beside.angle.less(across.angle)
        misfit = np.abs(beside.length - across.length)
        fits: Flags = np.asarray(misfit <= beside.slack + across.slack)
        survives = is_possible & is_seen & fits & self._allows(3, e1) & self._allows(1, s1)
        survives = survives & self._allows(2, e0)
        off = self._margin_rad + s0.slack + s1.slack + e0.slack + e1.slack + w0.slack
        seen = _Seen(s0.middle, s1.middle, e0.middle, e1.middle, w0.middle)
        ahead, sinking, aside = seen.of(target[:3, 2])
        w1 = UncertainVector(ahead, sinking, off).angle
        survives = survives & (np.abs(aside) <= off) & self._allows(5, w1)
        ahead, sinking, aside = seen.of(target[:3, 0])
        bent = np.cos(w1.middle) * sinking - np.sin(w1.middle) * ahead
        survives = survives & self._allows(6, UncertainVector(bent, aside, off + w1.slack).angle)
        is_left: Flags = np.logical_or.reduce(survives, 0)
        return is_left

    def _elbow(
        self, d: Vector, slack_m: Vector, w0: UncertainAngle
    ) -> tuple[UncertainAngle, Flags]:
        """e1 for |v|, either way, and where there is one."""
        arm, offset = self._arm, self._arm.wrist_offset_m * np.cos(w0.middle)
        amplitude = UncertainVector(
            arm.upper_m * arm.fore_m + arm.elbow_offset_m * offset,
            arm.elbow_offset_m * arm.fore_m - arm.upper_m * offset,
            arm.wrist_offset_m * arm.upper_span_m * w0.slack,
        )
        squares = arm.upper_span_m**2 + arm.fore_span_m**2
        least = 0.5 * ((d - slack_m).clip(min=0.0) ** 2 - squares)
        most = 0.5 * ((d + slack_m) ** 2 - squares)
        turn, is_possible = amplitude.arc_cosine(least, most)
        phi = amplitude.angle
        return UncertainAngle(
            phi.middle + _E1_SIGN * turn.middle, phi.slack + turn.slack
        ), is_possible

    def _forearm(
        self, e1: UncertainAngle, w0: UncertainAngle
    ) -> tuple[UncertainAngle, UncertainVector]:
        """How far W - S goes along u, and across it along r and n."""
        arm, cos, sin = self._arm, np.cos(e1.middle), np.sin(e1.middle)
        offset = arm.wrist_offset_m * np.cos(w0.middle)
        slack_m = np.hypot(arm.fore_m, offset) * e1.slack + arm.wrist_offset_m * w0.slack
        along = arm.upper_m + arm.fore_m * cos - offset * sin
        down = arm.elbow_offset_m + arm.fore_m * sin + offset * cos
        aside = np.broadcast_to(arm.wrist_offset_m * np.sin(w0.middle), down.shape)
        return UncertainAngle(along, slack_m), UncertainVector(down, aside, slack_m)

    def _allows(self, joint: int, angle: UncertainAngle) -> Flags:
        """Where a joint may be inside its limits."""
        return angle.is_within(self._middle[joint], self._half[joint])


class _Seen(NamedTuple):
    """Joint angles at the middles of cells, from where directions are seen."""

    s0: Vector
    s1: Vector
    e0: Vector
    e1: Vector
    w0: Vector

    def of(self, direction: Vector) -> tuple[Vector, Vector, Vector]:
        """A direction seen from the first axis: along f, k, and f x k, each (4, n)."""
        x, y, up = direction.tolist()
        radially = x * np.cos(self.s0) + y * np.sin(self.s0)
        sideways = y * np.cos(self.s0) - x * np.sin(self.s0)
        along, swing = _rotated(radially, -up, self.s1)
        down, aside = _rotated(swing, sideways, self.e0)
        ahead, swing = _rotated(along, down, self.e1)
        sinking, aside = _rotated(swing, aside, self.w0)
        return ahead, sinking, aside


def _shoulder(v: UncertainVector, along: UncertainAngle) -> tuple[UncertainAngle, Flags]:
    """s1 that gives v, radially and up, its component along u, either way, and where it can."""
    least, most = along.middle - along.slack, along.middle + along.slack
    turn, is_possible = v.arc_cosine(least, most)
    gamma = v.angle
    return UncertainAngle(
        _S1_SIGN * turn.middle - gamma.middle, turn.slack + gamma.slack
    ), is_possible


def _rotated(a: Vector, b: Vector, angle: Vector) -> tuple[Vector, Vector]:
    """Components along axes that are turned by an angle from the first to the second."""
    cos, sin = np.cos(angle), np.sin(angle)
    return cos * a + sin * b, cos * b - sin * a
