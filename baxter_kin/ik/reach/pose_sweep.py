"""Proofs by all joint limits that a pose is out of an arm's reach.

For given s0 and w0, the other joints follow in closed form, one after the other (letters and
`Linkage` as in `baxter_kin.ik.reach.linkage`; v = W - S). Along u, r and n = u x r,

```
v = (upper_m + fore_m cos e1 - b sin e1,  elbow_offset_m + fore_m sin e1 + b cos e1,
     wrist_offset_m sin w0)             with b = wrist_offset_m cos w0
```

- |v| gives `cos(e1 - phi)`, and so e1 up to a sign;
- u lies in the vertical plane of s0, and u . v gives s1 up to a sign;
- the components of v across u in that plane, and out of it, give e0;
- t, seen along f, f's swing and n, gives w1, and w0 again: both values must agree;
- the tool's x axis gives w2.

A cell is a range of s0, one of w0, and the two signs. Every step is evaluated at the middle of the
cell with a bound on its error anywhere in the cell and for every pose within a radius: for vectors
the distance that they move, for angles the arc sine of that over their length. A cell is excluded
if a joint must be outside its limits or the two values of w0 cannot agree; the others are split. If
none is left, the pose is out of reach. `ShoulderSweep` proves most such poses in less time.

The closed form is that of the linkage. For an arm that deviates from it, the target is moved to the
hand of the linkage at the same angles (`NearbyDeviation`): at first, that is known up to the whole
deviation; once the joints are known better, so is the deviation, and the cell is evaluated again.

The assumptions are that a solution is inside the joint limits, that the cells cover these, and that
the linkage has the arm's own angles. So every step holds for each solution in a cell, and so do the
resulting joint angles, the deviation there, and both in the parts of the cell.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from baxter_kin.ik.reach.deviation import HandDeviation, NearbyDeviation
from baxter_kin.ik.reach.linkage import Linkage
from baxter_kin.ik.reach.shoulder_sweep import (
    MARGIN_RAD,
    SWEEP_MARGIN_M,
    Flags,
    UncertainAngle,
    UncertainVector,
)
from baxter_kin.validation import FloatArray

FIRST_CELLS, SPLIT = (24, 16), 4
"""Initial numbers of ranges of s0 and of w0, and the number into which each is split."""

_OFFSETS = (2.0 * np.arange(SPLIT) + 1.0) / SPLIT - 1.0
_SIGNS = np.array([1.0, -1.0])

LEVELS, MAX_SURVIVORS = 8, 1000
"""Cells are split seven times, down to 8 urad, unless more than 1,000 of them remain."""

MAX_SURVIVORS_IF_THOROUGH = 20_000
"""This many prove six of eight poses 1 to 3 mm out of reach that 1,000 leave open, in up to half a
second."""

PASSES = 2
"""Number of times that a cell is evaluated again with the deviation near its angles. A third time
proved nothing more for an arm with deviations of 0.5 mm and 1 mrad at every joint."""

HOPELESS = 5
"""Cells are not evaluated again if more than this multiple of the allowed number remains, since
hardly ever few enough would be left, or more than `MAX_SURVIVORS_IF_THOROUGH`, which would take
200 MB."""


class PoseCells(NamedTuple):
    """n cells: two angles at their middles, rad, and the signs of two others.

    Attributes:
        s0: shape (n,).
        w0: shape (n,).
        e1_sign: the direction in which the elbow bends, shape (n,).
        s1_sign: the side to which the upper arm turns, shape (n,).
        half: half the widths of every cell, in s0 and in w0.
        deviation: of the arm from the linkage, at every solution in a cell.
    """

    s0: FloatArray
    w0: FloatArray
    e1_sign: FloatArray
    s1_sign: FloatArray
    half: tuple[float, float]
    deviation: HandDeviation

    @classmethod
    def of(cls, linkage: Linkage, deviation: HandDeviation) -> PoseCells:
        """The cells that cover all angles inside the limits, with both signs."""
        low, high = np.array(linkage.q_min)[[0, 4]], np.array(linkage.q_max)[[0, 4]]
        half = 0.5 * (high - low) / FIRST_CELLS
        middles = (
            low[i] + half[i] * (2.0 * np.arange(FIRST_CELLS[i]) + 1.0) for i in range(len(half))
        )
        grids = np.meshgrid(*middles, _SIGNS, _SIGNS)
        s0, w0, e1_sign, s1_sign = (grid.ravel() for grid in grids)
        return cls(s0, w0, e1_sign, s1_sign, (float(half[0]), float(half[1])), deviation)

    def part(self, which: Flags) -> PoseCells:
        """Some of the cells."""
        s0, w0, e1_sign, s1_sign = (values[which] for values in self[:4])
        return PoseCells(s0, w0, e1_sign, s1_sign, self.half, self.deviation.part(which))

    def split(self) -> PoseCells:
        """The cells, each split into `SPLIT` ranges of s0 and of w0."""
        half_s0, half_w0 = self.half
        count = SPLIT * SPLIT
        return PoseCells(
            (self.s0[:, None] + half_s0 * np.repeat(_OFFSETS, SPLIT)).ravel(),
            (self.w0[:, None] + half_w0 * np.tile(_OFFSETS, SPLIT)).ravel(),
            np.repeat(self.e1_sign, count),
            np.repeat(self.s1_sign, count),
            (half_s0 / SPLIT, half_w0 / SPLIT),
            self.deviation.repeated(count),
        )


class PoseSweep:
    """The sweep over s0 and w0 for one arm."""

    def __init__(self, linkage: Linkage) -> None:
        self._arm, self._deviation = linkage, NearbyDeviation(linkage)
        low, high = np.array(linkage.q_min), np.array(linkage.q_max)
        self._middle, self._half = 0.5 * (low + high), 0.5 * (high - low)
        whole = linkage.deviation
        deviates = whole.wrist_m > SWEEP_MARGIN_M or whole.axis > MARGIN_RAD
        self._passes = PASSES if deviates else 0

    def excludes(
        self,
        target: FloatArray,
        radius_m: float,
        max_survivors: int = MAX_SURVIVORS,
        *,
        any_roll: bool = False,
    ) -> bool:
        """Whether all poses within a distance of a target, in its orientation, are out of reach.

        Args:
            target: one of `Linkage.targets`, finite, shape (4, 4).
            radius_m: the distance, m.
            max_survivors: number of cells that may remain; more prove more, but take longer.
            any_roll: whether the tool may be turned about its z axis by any angle: the limits of w2
                are then ignored.
        """
        cells = PoseCells.of(self._arm, self._deviation.anywhere)
        for _ in range(LEVELS):
            cells = self._survivors(target, radius_m, cells, any_roll, max_survivors)
            if cells.s0.size == 0 or cells.s0.size > max_survivors:
                return cells.s0.size == 0
            cells = cells.split()
        return False

    def _survivors(
        self, target: FloatArray, radius_m: float, cells: PoseCells, any_roll: bool, most: int
    ) -> PoseCells:
        """The cells that may contain a solution."""
        cells, angles = self._fitting(target, radius_m, cells, any_roll)
        for _ in range(self._passes):
            if not 0 < cells.s0.size <= min(HOPELESS * most, MAX_SURVIVORS_IF_THOROUGH):
                break
            near = self._deviation.near(*self._boxes(cells, angles))
            cells = cells._replace(deviation=cells.deviation.or_tighter(near))
            cells, angles = self._fitting(target, radius_m, cells, any_roll)
        return cells

    def _boxes(
        self, cells: PoseCells, angles: list[UncertainAngle]
    ) -> tuple[FloatArray, FloatArray]:
        """Boxes of s1, e0, e1, w0 and w1: middles and half widths, shape (5, n).

        Args:
            cells: the cells.
            angles: s1, e0, e1 and w1; if one is hardly known, its limits are used.
        """
        s1, e0, e1, w1 = angles
        w0 = UncertainAngle(cells.w0, np.full_like(cells.w0, cells.half[1]))
        q, slack = (np.stack(rows) for rows in zip(s1, e0, e1, w0, w1, strict=True))
        middle, half = self._middle[1:6, None], self._half[1:6, None]
        return np.where(slack > half, middle, q), np.minimum(slack, half)

    def _fitting(
        self, target: FloatArray, radius_m: float, cells: PoseCells, any_roll: bool
    ) -> tuple[PoseCells, list[UncertainAngle]]:
        """The cells in which all joints may be inside their limits, with s1, e0, e1 and w1."""
        cells, angles = self._reaching(target[:3, 3], radius_m, cells)
        which, w1 = self._holds_hand(target, cells, any_roll, *angles)
        return cells.part(which), [angle.part(which) for angle in (*angles, w1)]

    def _reaching(
        self, wrist: FloatArray, radius_m: float, cells: PoseCells
    ) -> tuple[PoseCells, list[UncertainAngle]]:
        """The cells in which s1, e0 and e1 may move the wrist to its target, and these angles."""
        half_s0, shoulder_m = cells.half[0], self._arm.shoulder_offset_m
        x, y, z = wrist.tolist()
        cos, sin = np.cos(cells.s0), np.sin(cells.s0)
        ahead_m, aside_m, above_m = cells.deviation.wrist
        radially = x * cos + y * sin - shoulder_m - ahead_m
        sideways = y * cos - x * sin - aside_m
        up = np.broadcast_to(z - above_m, cos.shape)
        wobble_m = np.broadcast_to(
            radius_m + (SWEEP_MARGIN_M + cells.deviation.slack[0]), cos.shape
        )
        d = np.sqrt(radially * radially + sideways * sideways + up * up)
        d_slack = wobble_m + half_s0 * np.hypot(shoulder_m + ahead_m, aside_m)
        e1, is_possible = self._elbow(d, d_slack, cells)
        which = is_possible & self._allows(3, e1)
        cells, e1 = cells.part(which), e1.part(which)
        radially, sideways, up = radially[which], sideways[which], up[which]
        along, across = self._forearm(e1, cells)
        slack_m = wobble_m[which] + half_s0 * math.hypot(x, y)
        s1, is_seen = _shoulder(UncertainVector(radially, up, slack_m), along, cells.s1_sign)
        swing = -np.sin(s1.middle) * radially - np.cos(s1.middle) * up
        beside = UncertainVector(swing, sideways, slack_m + np.hypot(radially, up) * s1.slack)
        e0 = beside.angle.minus(across.angle)
        misfit = np.abs(beside.length - across.length)
        which = is_seen & (misfit <= beside.slack + across.slack)
        which = which & self._allows(1, s1) & self._allows(2, e0)
        return cells.part(which), [angle.part(which) for angle in (s1, e0, e1)]

    def _holds_hand(
        self, target: FloatArray, cells: PoseCells, any_roll: bool, *angles: UncertainAngle
    ) -> tuple[Flags, UncertainAngle]:
        """Whether w1 and w2, or w1 alone for any roll, may turn the hand to its target, and w1.

        Args:
            target: one of `Linkage.targets`.
            cells: the cells.
            any_roll: as for `excludes`.
            angles: s1, e0 and e1 at the middles of the cells.
        """
        s1, e0, e1 = angles
        off = MARGIN_RAD + cells.deviation.slack[1]
        off = off + sum(cells.half) + s1.slack + e0.slack + e1.slack
        seen = _View(cells.s0, s1.middle, e0.middle, e1.middle, cells.w0)
        ahead, sinking, aside = seen.of(target[:3, 2], cells.deviation.R)
        w1 = UncertainVector(ahead, sinking, off).angle
        fits: Flags = (np.abs(aside) <= off) & self._allows(5, w1)
        if any_roll:
            return fits, w1
        ahead, sinking, aside = seen.of(target[:3, 0], cells.deviation.R)
        bent = np.cos(w1.middle) * sinking - np.sin(w1.middle) * ahead
        w2 = UncertainVector(bent, aside, off + w1.slack).angle
        return np.asarray(fits & self._allows(6, w2)), w1

    def _elbow(
        self, d: FloatArray, slack_m: FloatArray, cells: PoseCells
    ) -> tuple[UncertainAngle, Flags]:
        """e1 for |v|, and whether there is one."""
        arm, offset = self._arm, self._arm.wrist_offset_m * np.cos(cells.w0)
        amplitude = UncertainVector(
            arm.upper_m * arm.fore_m + arm.elbow_offset_m * offset,
            arm.elbow_offset_m * arm.fore_m - arm.upper_m * offset,
            np.full_like(d, arm.wrist_offset_m * arm.upper_span_m * cells.half[1]),
        )
        squares = arm.upper_span_m**2 + arm.fore_span_m**2
        least = 0.5 * ((d - slack_m).clip(min=0.0) ** 2 - squares)
        most = 0.5 * ((d + slack_m) ** 2 - squares)
        turn, is_possible = amplitude.arc_cosine(least, most)
        phi = amplitude.angle
        middle = phi.middle + cells.e1_sign * turn.middle
        return UncertainAngle(middle, phi.slack + turn.slack), is_possible

    def _forearm(
        self, e1: UncertainAngle, cells: PoseCells
    ) -> tuple[UncertainAngle, UncertainVector]:
        """The component of W - S along u, and those across it along r and n."""
        arm, cos, sin = self._arm, np.cos(e1.middle), np.sin(e1.middle)
        offset = arm.wrist_offset_m * np.cos(cells.w0)
        slack_m = np.hypot(arm.fore_m, offset) * e1.slack + arm.wrist_offset_m * cells.half[1]
        along = arm.upper_m + arm.fore_m * cos - offset * sin
        down = arm.elbow_offset_m + arm.fore_m * sin + offset * cos
        aside = arm.wrist_offset_m * np.sin(cells.w0)
        return UncertainAngle(along, slack_m), UncertainVector(down, aside, slack_m)

    def _allows(self, joint: int, angle: UncertainAngle) -> Flags:
        """Whether a joint may be inside its limits."""
        return angle.is_within(self._middle[joint], self._half[joint])


class _View(NamedTuple):
    """Joint angles at the middles of cells, which define the axes f, k and f x k."""

    s0: FloatArray
    s1: FloatArray
    e0: FloatArray
    e1: FloatArray
    w0: FloatArray

    def of(self, direction: FloatArray, R: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The components of a direction along f, k, and f x k, each (n,).

        Args:
            direction: of the arm, seen from the first axis, shape (3,).
            R: the rotation from the arm to the linkage, as in `HandDeviation`.
        """
        x, y, up = direction.tolist()
        radially = x * np.cos(self.s0) + y * np.sin(self.s0)
        sideways = y * np.cos(self.s0) - x * np.sin(self.s0)
        radially, sideways, up = (row[0] * radially + row[1] * sideways + row[2] * up for row in R)
        along, swing = _rotated(radially, -up, self.s1)
        down, aside = _rotated(swing, sideways, self.e0)
        ahead, swing = _rotated(along, down, self.e1)
        sinking, aside = _rotated(swing, aside, self.w0)
        return ahead, sinking, aside


def _shoulder(
    v: UncertainVector, along: UncertainAngle, sign: FloatArray
) -> tuple[UncertainAngle, Flags]:
    """s1 for which v, radially and up, has its component along u, and whether there is one."""
    least, most = along.middle - along.slack, along.middle + along.slack
    turn, is_possible = v.arc_cosine(least, most)
    gamma = v.angle
    middle = sign * turn.middle - gamma.middle
    return UncertainAngle(middle, turn.slack + gamma.slack), is_possible


def _rotated(a: FloatArray, b: FloatArray, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Components along two axes that are turned by an angle from the first to the second."""
    cos, sin = np.cos(angle), np.sin(angle)
    return cos * a + sin * b, cos * b - sin * a
