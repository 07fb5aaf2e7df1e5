"""Proofs that a pose is out of reach for every angle of the first joint.

For a given s0, the lengths leave at most four directions of the upper arm, in closed form (letters
and `Linkage` as in `baxter_kin.ik.reach.linkage`; v = W - S, d = |v|):

- The triangle S, E, W has three known sides. With m = v . (E - S) / |E - S| and
  q = sqrt(d^2 - m^2), the upper arm's projection is
  `u . v = m cos(elbow_angle) -/+ q sin(elbow_angle) cos(chi)`: minus for the bent elbow, plus for
  the elbow bent the other way, which takes e1 below `elbow_angle` and so the angle at E within
  `max_overbend` of straight; `q |sin(chi)| = |(u x r) . v| <= wrist_offset_m`, because E - S and f
  lie in the plane of u and r.
- u lies in the vertical plane of s0, so `u . v` gives s1 up to a sign.
- E = S + upper_m u + elbow_offset_m r, and r points along the part of v normal to u, which is
  `v - (u . v) u`, within an angle of sine `wrist_offset_m / |v - (u . v) u|`.
- The angle between E -> W and the tool's z axis is limited by w1.

Each of these is evaluated with bounds that hold throughout a cell of s0 angles and for every wrist
within a radius of the given one. A cell is excluded if a limit cannot be met anywhere in it; the
others are split. If none is left, no wrist within that radius is reachable. The limits of e0, w0
and w2 are not used, so the proofs hold for every rotation of the tool about its z axis.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from baxter_kin.ik.reach.linkage import Linkage
from baxter_kin.validation import FloatArray

Flags: TypeAlias = NDArray[np.bool_]

_MIN_LENGTH = 1e-9

SWEEP_MARGIN_M = MARGIN_RAD = 5e-6
"""Every proof also holds for wrists and tool axes within this distance. A solution is valid within
1e-6 m and 1e-6 rad of its pose, which moves the wrist by less than 2e-6 m, and the axis of a pose
may itself be off by 1e-6; rounding stays below 1e-9. The deviation of an arm from its linkage is
added."""

BLOCK = 128
"""Number of targets computed together, whose cells fit in the processor's cache."""

FIRST_CELLS, SPLIT, MAX_SURVIVORS = 24, 6, 96
"""The range of s0 starts as 24 cells; survivors are split in six, unless more than 96 remain. Finer
cells proved no further pose of 1,200 just out of reach."""

_BOTH_SIGNS = np.array([[[1.0], [-1.0]]])


class UncertainAngle(NamedTuple):
    """An angle and a bound on its error, rad; with more than half a turn, it may be any angle."""

    middle: FloatArray
    slack: FloatArray

    def part(self, which: Flags) -> UncertainAngle:
        """Some of the angles."""
        return UncertainAngle(self.middle[which], self.slack[which])

    def minus(self, other: UncertainAngle) -> UncertainAngle:
        """The difference of two angles."""
        return UncertainAngle(self.middle - other.middle, self.slack + other.slack)

    def is_within(self, middle: float, half: float) -> Flags:
        """Whether it may be within `half` of an angle, up to whole turns."""
        off = np.abs(np.remainder(self.middle - (middle - math.pi), 2.0 * math.pi) - math.pi)
        return np.asarray(off <= half + self.slack)


class UncertainVector(NamedTuple):
    """The components of a vector in a plane, and a bound on the error of its end."""

    x: FloatArray
    y: FloatArray
    slack: FloatArray

    @property
    def length(self) -> FloatArray:
        """The length of the vector without its error."""
        return np.asarray(np.hypot(self.x, self.y))

    @property
    def angle(self) -> UncertainAngle:
        """The angle from x towards y."""
        length, slack = self.length, self.slack
        turn = np.where(
            slack < length,
            np.arcsin(slack / np.maximum(np.maximum(length, slack), _MIN_LENGTH)),
            math.pi,
        )
        return UncertainAngle(np.arctan2(self.y, self.x), turn)

    def arc_cosine(self, least: FloatArray, most: FloatArray) -> tuple[UncertainAngle, Flags]:
        """The angle to a direction along which the vector has a component in a range.

        And whether there is such a direction.
        """
        length = self.length
        short, long = np.maximum(length - self.slack, _MIN_LENGTH), length + self.slack
        low = least / np.where(least > 0.0, long, short)
        high = most / np.where(most > 0.0, short, long)
        far = np.arccos(np.minimum(np.maximum(low, -1.0), 1.0))
        near = np.arccos(np.minimum(np.maximum(high, -1.0), 1.0))
        is_possible: Flags = (low <= 1.0) & (high >= -1.0)
        return UncertainAngle(0.5 * (far + near), 0.5 * (far - near)), is_possible


class Exclusions(NamedTuple):
    """Proofs for n targets.

    Attributes:
        is_proven: whether there is a proof, shape (n,).
        needs_wrist: whether it uses the limits of w1 besides those of s0, s1 and e1, shape (n,).
    """

    is_proven: Flags
    needs_wrist: Flags


class _Cells(NamedTuple):
    """Cells of s0 with a radius each, and the target seen from their middles; shape (n,).

    Attributes:
        half: half the width of every cell, rad.
        v: W - S at the middles: radially, sideways, up, m.
        t: the tool axis, likewise.
        d: |v|, m.
        d_slack: bound on the error of v in base, m: S moves within the cell, W by the radius and
            the margin.
        plane_slack: bound on the error of the components (radial, up) of v, m.
    """

    half: float
    v: tuple[FloatArray, FloatArray, FloatArray]
    t: tuple[FloatArray, FloatArray, FloatArray]
    d: FloatArray
    d_slack: FloatArray
    plane_slack: FloatArray


class _Bounds(NamedTuple):
    """Lower and upper bounds of a quantity, of one shape."""

    low: FloatArray
    high: FloatArray


class ShoulderSweep:
    """The sweep over s0 for one arm."""

    def __init__(self, linkage: Linkage) -> None:
        self._arm = linkage
        self._margin_m = SWEEP_MARGIN_M + linkage.deviation.wrist_m
        margin_rad = MARGIN_RAD + linkage.deviation.axis
        self._upper, self._fore = linkage.upper_span_m, linkage.fore_span_m
        self._cos_elbow = math.cos(linkage.elbow_angle)
        self._sin_elbow = math.sin(linkage.elbow_angle)
        self._d_max = linkage.wrist_distance_m(0.0)
        d_min = [linkage.wrist_distance_m(a) for a in (linkage.max_bend, linkage.max_overbend)]
        self._d_min = np.reshape(d_min, (2, 1, 1))
        self._min_square_swing = linkage.min_swing_m**2
        self._s1_middle = 0.5 * (linkage.q_min[1] + linkage.q_max[1])
        self._s1_half = 0.5 * (linkage.q_max[1] - linkage.q_min[1])
        self._min_advance = self._fore * (math.cos(linkage.max_wrist_turn) - margin_rad)
        self._offsets = (2.0 * np.arange(SPLIT) + 1.0) / SPLIT - 1.0
        low, high = linkage.q_min[0], linkage.q_max[0]
        self._first_half = (high - low) / (2 * FIRST_CELLS)
        self._first_s0 = low + self._first_half * (2.0 * np.arange(FIRST_CELLS) + 1.0)

    def exclusions(self, targets: FloatArray, radii_m: FloatArray, levels: int) -> Exclusions:
        """The targets for which there is a proof.

        Args:
            targets: `Linkage.targets`, finite, shape (n, 4, 4).
            radii_m: the distances of wrists from each that are excluded as well, shape (n,), m.
            levels: number of cell sizes to try.
        """
        parts = [slice(at, at + BLOCK) for at in range(0, len(targets), BLOCK)]
        found = [self._exclusions(targets[part], radii_m[part], levels) for part in parts]
        if not found:
            return Exclusions(np.zeros(0, bool), np.zeros(0, bool))
        return Exclusions(*(np.concatenate(column) for column in zip(*found, strict=True)))

    def _exclusions(self, targets: FloatArray, radii_m: FloatArray, levels: int) -> Exclusions:
        count = len(targets)
        index, half = np.repeat(np.arange(count), FIRST_CELLS), self._first_half
        s0, needs_wrist = np.tile(self._first_s0, count), np.zeros(count, bool)
        is_proven = np.ones(count, bool)
        for _ in range(levels):
            cells = self._cells(targets[index], radii_m[index], s0, half)
            shoulder, wrist = self._survivors(cells)
            needs_wrist[index[shoulder & ~wrist]] = True
            index, s0 = index[wrist], s0[wrist]
            is_proven &= np.bincount(index, minlength=count) <= MAX_SURVIVORS
            is_open = is_proven[index]
            index, s0 = index[is_open], s0[is_open]
            if index.size == 0:
                break
            index, half = np.repeat(index, SPLIT), half / SPLIT
            s0 = (s0[:, None] + half * SPLIT * self._offsets).ravel()
        is_proven[index] = False
        return Exclusions(is_proven, needs_wrist)

    def _cells(
        self, targets: FloatArray, radius_m: FloatArray, s0: FloatArray, half: float
    ) -> _Cells:
        (x, y, z), (tx, ty, tz) = targets[:, :3, 3].T, targets[:, :3, 2].T
        cos, sin, wobble = np.cos(s0), np.sin(s0), radius_m + self._margin_m
        radially = x * cos + y * sin - self._arm.shoulder_offset_m
        sideways = y * cos - x * sin
        return _Cells(
            half=half,
            v=(radially, sideways, z),
            t=(tx * cos + ty * sin, ty * cos - tx * sin, tz),
            d=np.sqrt(radially * radially + sideways * sideways + z * z),
            d_slack=wobble + self._arm.shoulder_offset_m * half,
            plane_slack=wobble + half * (np.abs(sideways) + half * np.hypot(x, y)),
        )

    def _survivors(self, cells: _Cells) -> tuple[Flags, Flags]:
        """Which cells meet the limits of shoulder and elbow, and which those of w1 as well."""
        d, is_within = self._distances(cells)
        projection = self._projections(d)
        s1, is_possible = self._shoulder_angles(cells, projection)
        is_allowed = s1.is_within(self._s1_middle, self._s1_half)
        shoulder: Flags = is_within & is_possible & is_allowed
        if not shoulder.any():
            return shoulder[0, 0], shoulder[0, 0]
        advance = self._max_advance(cells, d, projection, s1)
        wrist: Flags = shoulder & (advance >= self._min_advance)
        return np.logical_or.reduce(shoulder, (0, 1)), np.logical_or.reduce(wrist, (0, 1))

    def _distances(self, cells: _Cells) -> tuple[_Bounds, Flags]:
        """Bounds of d, elbow bent and bent the other way, (b, 1, n), and whether it is possible.

        b is 2, or 1 if the elbow bends the other way in no cell.
        """
        low, high = cells.d - cells.d_slack, cells.d + cells.d_slack
        least = self._d_min if high.max() >= self._d_min[1, 0, 0] else self._d_min[:1]
        is_within = (low <= self._d_max) & (high >= least)
        clipped_low = np.minimum(np.maximum(low, least), self._d_max)
        clipped_high = np.minimum(np.maximum(high, least), self._d_max)
        return _Bounds(clipped_low, clipped_high), is_within

    def _projections(self, d: _Bounds) -> _Bounds:
        """Bounds of u . v, shape (b, 1, n).

        m grows with d. Bent: the lower bound is `upper_m + fore_span cos(bend + elbow_angle)` with
        bend + elbow_angle below half a turn, and grows with d; q = fore_span sin(bend) is smallest
        at an end. Bent the other way: the bend is below a quarter turn and q falls with d.
        """
        (m_low, q_low), (m_high, q_high) = self._foot(d.low), self._foot(d.high)
        q_least = np.minimum(q_low, q_high)
        q_cos_chi = np.sqrt(np.maximum(q_least * q_least - self._arm.wrist_offset_m**2, 0.0))
        toward = np.concatenate([-q_low[:1], q_cos_chi[1:]])
        away = np.concatenate([-q_cos_chi[:1], q_low[1:]])
        return _Bounds(
            self._cos_elbow * m_low + self._sin_elbow * toward,
            self._cos_elbow * m_high + self._sin_elbow * away,
        )

    def _foot(self, d: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The coordinates of W, m along S -> E and q across it, by the law of cosines."""
        square = d * d
        m = (square + (self._upper**2 - self._fore**2)) / (2.0 * self._upper)
        return m, np.sqrt(np.maximum(square - m * m, 0.0))

    def _shoulder_angles(self, cells: _Cells, projection: _Bounds) -> tuple[UncertainAngle, Flags]:
        """s1, shape (b, 2, n), and whether u can have the projection, (b, 1, n).

        `u . v = rho cos(s1 + gamma)` with (rho, gamma) the polar form of v's (radial, up).
        """
        v = UncertainVector(cells.v[0], cells.v[2], cells.plane_slack)
        turn, is_possible = v.arc_cosine(projection.low, projection.high)
        s1 = UncertainAngle(_BOTH_SIGNS * turn.middle, turn.slack).minus(v.angle)
        return s1, is_possible

    def _max_advance(
        self, cells: _Cells, d: _Bounds, projection: _Bounds, s1: UncertainAngle
    ) -> FloatArray:
        """An upper bound of `t . (W - E)`, the extent of the forearm along t, shape (b, 2, n)."""
        t_v = cells.t[0] * cells.v[0] + cells.t[1] * cells.v[1] + cells.t[2] * cells.v[2]
        t_u = cells.t[0] * np.cos(s1.middle) - cells.t[2] * np.sin(s1.middle)
        u_slack = s1.slack + cells.half
        middle = 0.5 * (projection.low + projection.high)
        farthest = np.maximum(np.abs(projection.low), np.abs(projection.high))
        swing = self._swing(d, projection, farthest)
        slack = cells.d_slack + (projection.high - middle) + farthest * u_slack
        across = t_v - middle * t_u - slack
        askew = math.sqrt(2.0) * self._arm.wrist_offset_m / swing.low
        t_r = across / np.where(across > 0.0, swing.high, swing.low) - askew
        upper = self._arm.upper_m * (t_u - u_slack)
        return t_v + cells.d_slack - upper - self._arm.elbow_offset_m * np.maximum(t_r, -1.0)

    def _swing(self, d: _Bounds, projection: _Bounds, farthest: FloatArray) -> _Bounds:
        """Bounds of |v - (u . v) u|, shape (b, 1, n), given the largest |u . v|."""
        nearest = np.maximum(np.maximum(projection.low, -projection.high), 0.0)
        low = np.maximum(d.low * d.low - farthest * farthest, self._min_square_swing)
        high = np.maximum(d.high * d.high - nearest * nearest, self._min_square_swing)
        return _Bounds(np.sqrt(low), np.sqrt(high))
