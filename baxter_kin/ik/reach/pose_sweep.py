"""Proofs by all joint limits that an arm cannot reach a pose.

Once s0 and w0 are chosen, the other joints follow in closed form, one after the other (letters and
`Linkage` as in `baxter_kin.ik.reach.linkage`; v = W - S). Seen along u, r and n = u x r,

```
v = (upper_m + fore_m cos e1 - b sin e1,  elbow_offset_m + fore_m sin e1 + b cos e1,
     wrist_offset_m sin w0)             with b = wrist_offset_m cos w0
```

- |v| gives `cos(e1 - phi)`, and so e1 up to a sign;
- u lies in the vertical plane of s0, and u . v gives s1 up to a sign;
- the components of v across u in that plane, and out of it, give e0;
- t, seen along f, f's swing and n, gives w1, and w0 once more: both have to agree;
- the tool's x axis gives w2.

A cell is a range of s0, one of w0, and the two signs. Every step is evaluated at the middle of the
cell with a bound on how far it can be off anywhere in the cell and for every pose within a radius:
vectors by how far they move, angles by the arc sine of that over their length. A cell is dismissed
where a joint has to be outside its limits or the two angles of w0 cannot agree; the others are
split. When none is left, the pose is out of reach. `ShoulderSweep` proves most such poses in less
time.

The closed form is the linkage's. For an arm that deviates from it, the target is moved to where the
linkage has its hand at the same angles (`NearbyDeviation`): at first that is known up to the whole
deviation; once the joints are known better, so is the deviation, and the cell is evaluated again.

Assumed is that a solution is inside the joint limits, that the cells cover them, and that the
linkage has the arm's own angles. So every step holds of each solution in a cell: so do the joint
angles that come of it, the deviation there, and both in the parts of the cell.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from baxter_kin.ik.reach.deviation import Apart, NearbyDeviation
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


LEVELS, MAX_SURVIVORS = 8, 1000
"""Cells are split seven times, down to 8 urad, unless more than 1,000 of them remain."""

MAX_SURVIVORS_IF_THOROUGH = 20_000
"""So many prove six of eight poses 1 to 3 mm out of reach that 1,000 do not, in up to half a
second."""

PASSES = 2
"""Number of times that a cell is evaluated again with the deviation near its angles. One more
proved nothing more for an arm that is off by 0.5 mm and 1 mrad at every joint."""

HOPELESS = 5
"""Nor are they where so many times more remain than may, as hardly ever would few enough be left,
or more than `MAX_SURVIVORS_IF_THOROUGH`: those would take 200 MB."""


class PoseSweep:
    """The sweep for one arm."""

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
        most_survivors: int = MAX_SURVIVORS,
        *,
        any_roll: bool = False,
    ) -> bool:
        """Whether no pose of that orientation so near to a target is within reach.

        Args:
            target: one of `Linkage.targets`, finite, shape (4, 4).
            radius_m: how far from its position, m.
            most_survivors: how many cells may remain; more of them prove more, and take longer.
            any_roll: whether that is asked for the tool turned about its z axis by any angle: the
                limits of w2 do not count then.
        """
        cells = PoseCells.of(self._arm, self._deviation.anywhere)
        for _ in range(LEVELS):
            cells = self._survivors(target, radius_m, cells, any_roll, most_survivors)
            if cells.s0.size == 0 or cells.s0.size > most_survivors:
                return cells.s0.size == 0
            cells = cells.split()
        return False

    def _survivors(
        self, target: FloatArray, radius_m: float, cells: PoseCells, any_roll: bool, most: int
    ) -> PoseCells:
        """The cells that may hold a solution."""
        cells, angles = self._fitting(target, radius_m, cells, any_roll)
        for _ in range(self._passes):
            if not 0 < cells.s0.size <= min(HOPELESS * most, MAX_SURVIVORS_IF_THOROUGH):
                break
            near = self._deviation.near(*self._boxes(cells, angles))
            cells = cells._replace(apart=cells.apart.or_nearer(near))
            cells, angles = self._fitting(target, radius_m, cells, any_roll)
        return cells

    def _boxes(
        self, cells: PoseCells, angles: list[UncertainAngle]
    ) -> tuple[FloatArray, FloatArray]:
        """Where s1, e0, e1, w0 and w1 may be: middles and slacks, shape (5, n).

        Args:
            cells: which.
            angles: s1, e0, e1 and w1; where one is hardly known, its limits are better.
        """
        s1, e0, e1, w1 = angles
        w0 = UncertainAngle(cells.w0, np.full_like(cells.w0, cells.half[1]))
        q, slack = (np.stack(rows) for rows in zip(s1, e0, e1, w0, w1, strict=True))
        middle, half = self._middle[1:6, None], self._half[1:6, None]
        return np.where(slack > half, middle, q), np.minimum(slack, half)

    def _fitting(
        self, target: FloatArray, radius_m: float, cells: PoseCells, any_roll: bool
    ) -> tuple[PoseCells, list[UncertainAngle]]:
        """The cells in which all joints may be inside their limits, and s1, e0, e1 and w1 there."""
        cells, angles = self._reaching(target[:3, 3], radius_m, cells)
        which, w1 = self._holds_hand(target, cells, any_roll, *angles)
        return cells.part(which), [angle.part(which) for angle in (*angles, w1)]

    def _reaching(
        self, wrist: FloatArray, radius_m: float, cells: PoseCells
    ) -> tuple[PoseCells, list[UncertainAngle]]:
        """The cells in which s1, e0 and e1 may bring the wrist there, and what they are."""
        half_s0, shoulder_m = cells.half[0], self._arm.shoulder_offset_m
        x, y, z = wrist.tolist()
        cos, sin = np.cos(cells.s0), np.sin(cells.s0)
        ahead_m, aside_m, above_m = cells.apart.wrist
        radially = x * cos + y * sin - shoulder_m - ahead_m
        sideways = y * cos - x * sin - aside_m
        up = np.broadcast_to(z - above_m, cos.shape)
        wobble_m = np.broadcast_to(radius_m + (SWEEP_MARGIN_M + cells.apart.slack[0]), cos.shape)
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
        e0 = beside.angle.less(across.angle)
        misfit = np.abs(beside.length - across.length)
        which = is_seen & (misfit <= beside.slack + across.slack)
        which = which & self._allows(1, s1) & self._allows(2, e0)
        return cells.part(which), [angle.part(which) for angle in (s1, e0, e1)]

    def _holds_hand(
        self, target: FloatArray, cells: PoseCells, any_roll: bool, *angles: UncertainAngle
    ) -> tuple[Flags, UncertainAngle]:
        """Where w1 and w2, or w1 alone for any roll, may turn the hand as the target asks for.

        Args:
            target: one of `Linkage.targets`.
            cells: which.
            any_roll: as for `excludes`.
            angles: s1, e0 and e1 at the middles of the cells.

        Returns:
            That, and w1.
        """
        s1, e0, e1 = angles
        off = MARGIN_RAD + cells.apart.slack[1]
        off = off + sum(cells.half) + s1.slack + e0.slack + e1.slack
        seen = _Seen(cells.s0, s1.middle, e0.middle, e1.middle, cells.w0)
        ahead, sinking, aside = seen.of(target[:3, 2], cells.apart.R)
        w1 = UncertainVector(ahead, sinking, off).angle
        fits: Flags = (np.abs(aside) <= off) & self._allows(5, w1)
        if any_roll:
            return fits, w1
        ahead, sinking, aside = seen.of(target[:3, 0], cells.apart.R)
        bent = np.cos(w1.middle) * sinking - np.sin(w1.middle) * ahead
        w2 = UncertainVector(bent, aside, off + w1.slack).angle
        return np.asarray(fits & self._allows(6, w2)), w1

    def _elbow(
        self, d: FloatArray, slack_m: FloatArray, cells: PoseCells
    ) -> tuple[UncertainAngle, Flags]:
        """e1 for |v|, and where there is one."""
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
        """How far W - S goes along u, and across it along r and n."""
        arm, cos, sin = self._arm, np.cos(e1.middle), np.sin(e1.middle)
        offset = arm.wrist_offset_m * np.cos(cells.w0)
        slack_m = np.hypot(arm.fore_m, offset) * e1.slack + arm.wrist_offset_m * cells.half[1]
        along = arm.upper_m + arm.fore_m * cos - offset * sin
        down = arm.elbow_offset_m + arm.fore_m * sin + offset * cos
        aside = arm.wrist_offset_m * np.sin(cells.w0)
        return UncertainAngle(along, slack_m), UncertainVector(down, aside, slack_m)

    def _allows(self, joint: int, angle: UncertainAngle) -> Flags:
        """Where a joint may be inside its limits."""
        return angle.is_within(self._middle[joint], self._half[joint])


class _Seen(NamedTuple):
    """Joint angles at the middles of cells, from where directions are seen."""

    s0: FloatArray
    s1: FloatArray
    e0: FloatArray
    e1: FloatArray
    w0: FloatArray

    def of(self, direction: FloatArray, R: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """A direction seen from the first axis: along f, k, and f x k, each (n,).

        Args:
            direction: the arm's, shape (3,).
            R: what turns it into the linkage's, as in `Apart`.
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
    """s1 that gives v, radially and up, its component along u, and where it can."""
    least, most = along.middle - along.slack, along.middle + along.slack
    turn, is_possible = v.arc_cosine(least, most)
    gamma = v.angle
    middle = sign * turn.middle - gamma.middle
    return UncertainAngle(middle, turn.slack + gamma.slack), is_possible


def _rotated(a: FloatArray, b: FloatArray, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Components along axes that are turned by an angle from the first to the second."""
    cos, sin = np.cos(angle), np.sin(angle)
    return cos * a + sin * b, cos * b - sin * a
