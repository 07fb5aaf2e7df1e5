"""PathMotion: a motion along a path, how far it uses the limits, and what would change that.

A motion is a cubic spline s(t) over normalised time 0..1 and a duration. The joints follow the
cubic spline through q(s) at the same knots, with exact rates at both ends. What is compared with a
limit is taken from that joint motion itself: accelerations at the knots and jerks of the segments
as they are, and velocities by the coefficients of their quadratic spline, which bound them (the
convex hull property of B-splines).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baxter_kin import JointLimits
from baxter_kin.arrays import Vector
from planner.clamped_spline import DEGREE, ENDS, ClampedSpline
from planner.spline_program import FREE, SplineProgram
from planner.straight_path import PathState, StraightPath
from planner.trajectory import Trajectory

MARGIN = 1e-6
"""Share of every limit that is left unused, for the rounding of what is computed from it."""

STRAY_RAD = 3e-6
"""How far a joint may be from its path between the knots: some micrometres at the tip."""

STRAY_TURN_RAD = 1e-4
"""How far the orientation may be from the one at the nearest point of the line: a third of the
0.02 deg that a straight move promises. It decides along short lines that turn much."""

SHORTEST_LINE_M = 1e-4
"""Every point of a shorter line is as good as any other: the tip turns on the spot."""

WIDEST_SWING = 0.4
"""Greatest change of an acceleration within a segment, relative to its limit."""

SPEED_SLACK = 0.005
"""How much of a velocity limit the bounding coefficients may leave unused where it is reached."""

SHORTEST_SEGMENT = 1.0 / 300.0
"""Segments of this share of the duration are not halved to gain time: they would gain less."""

MOST_SEGMENTS = 256

_V, _A, _J = slice(0, 7), slice(7, 14), slice(14, 21)
"""The rows of a segment that speak of velocity, acceleration and jerk; row 21 is of progress."""


class PathTask(NamedTuple):
    """What a motion shall do."""

    path: StraightPath
    limits: JointLimits
    start: PathState
    end: PathState

    @property
    def is_from_rest_to_rest(self) -> bool:
        """Whether nothing moves at either end."""
        return self.start.is_at_rest and self.end.is_at_rest

    def ends(self, duration: float) -> tuple[Vector, Vector]:
        """Value, slope and curvature of s over normalised time at both ends, each shape (3,)."""
        rates = np.array([1.0, duration, duration**2])
        start, end = (
            np.array([x.s, x.speed_per_s, x.acceleration_per_s2]) for x in (self.start, self.end)
        )
        return rates * start, rates * end

    def ends_by_log_duration(self, duration: float) -> tuple[Vector, Vector]:
        """The derivative of `ends` by the logarithm of the duration."""
        start, end = self.ends(duration)
        powers = np.array([0.0, 1.0, 2.0])
        return powers * start, powers * end


class PathMotion:
    """One motion; n segments. Between ends at rest it lasts as long as the limits ask.

    Attributes:
        task: what it shall do.
        spline: the space of its splines.
        duration: seconds.
        ratios: of velocities, accelerations and jerks to their limits, with signs, shape (n, 21).
            Those that the ends alone decide are zero.
        excess: by what factor more time the motion would be inside the limits; 1 or less is.
    """

    def __init__(
        self, task: PathTask, spline: ClampedSpline, coefficients: Vector, duration: float
    ) -> None:
        """Follow the path with those coefficients of s, the outermost of them set by the ends."""
        self.task, self.spline, self.duration = task, spline, duration
        head, tail = spline.ends(*task.ends(duration))
        self._c = np.concatenate([head, coefficients[ENDS:-ENDS], tail])
        self._s, self._ds, self._dds = (matrix @ self._c for matrix in spline.at_knots)
        self._point = task.path.at(_inside(self._s))
        self._joints = self._joint_coefficients()
        self.ratios, self.excess = self._used()
        if task.is_from_rest_to_rest:
            self.duration *= self.excess
            self.ratios, self.excess = self._used()

    @classmethod
    def through(cls, task: PathTask, knots: Vector, s: Vector, duration: float) -> PathMotion:
        """The motion through fractions of the path at knots of normalised time, shape (n + 1,)."""
        spline = ClampedSpline.over(knots)
        return cls(task, spline, spline.through(s, *task.ends(duration)), duration)

    def changed(self, by: Vector, log_duration: float) -> PathMotion:
        """The motion with other coefficients, and its duration times exp(log_duration)."""
        duration = self.duration * math.exp(log_duration)
        return PathMotion(self.task, self.spline, self._c + by, duration)

    def program(self, relaxation: float = 0.0) -> SplineProgram:
        """The linear program of the best change of the coefficients and of log(duration).

        Args:
            relaxation: by how much more than its limit every ratio may be.
        """
        A, ratios = self._sensitivities(), self.ratios
        n = self.spline.segments
        b = np.concatenate([-ratios[:, _V], -2 * ratios[:, _A], -3 * ratios[:, _J]], axis=1)
        b = np.concatenate([b, np.zeros((n, 1))], axis=1) + self._effect_of_ends(A)
        r = np.concatenate([ratios, (self.spline.slopes @ self._c)[:, None]], axis=1)
        high = np.full_like(r, 1.0 - MARGIN + relaxation)
        low = -high
        low[:, -1], high[:, -1] = 0.0, FREE
        low[_decided_by_ends(n)], high[_decided_by_ends(n)] = -FREE, FREE
        return SplineProgram(A, b, r, low, high)

    def refined(self) -> PathMotion | None:
        """The same motion with coarse segments halved, or None when none is coarse."""
        is_coarse, knots = self._coarse(), self.spline.knots
        if not is_coarse.any() or self.spline.segments >= MOST_SEGMENTS:
            return None
        middles = 0.5 * (knots[1:] + knots[:-1])[is_coarse]
        order = np.argsort(np.concatenate([knots, middles]), kind="stable")
        finer = np.concatenate([knots, middles])[order]
        s = np.concatenate([self._s, self._middles()[is_coarse]])[order]
        return PathMotion.through(self.task, finer, s, self.duration)

    def trajectory(self) -> Trajectory:
        """The motion of the joints."""
        T, (values, first, second) = self.duration, self.spline.at_knots
        q = self._point.q[0] + values @ self._joints
        v, a = first @ self._joints / T, second @ self._joints / T**2
        for i, state in ((0, self.task.start), (-1, self.task.end)):
            q[i], v[i], a[i] = self.task.path.joint_state(state)
        j = self.spline.third @ self._joints / T**3
        return Trajectory(self.task.limits, self.spline.knots * T, q, v, a, j)

    def _joint_coefficients(self) -> Vector:
        """Of the spline of the joints' way from the start, shape (n + 3, 7).

        Of the way, because positions would lose the digits of tiny ones.
        """
        point, ds, dds = self._point, self._ds[:, None], self._dds[:, None]
        way, v, a = point.q - point.q[0], point.dq * ds, point.ddq * ds**2 + point.dq * dds
        first, last = (np.stack([way[i], v[i], a[i]]) for i in (0, -1))
        return self.spline.through(way, first, last)

    def _used(self) -> tuple[Vector, float]:
        """The ratios, and the excess."""
        joints, spline = self._joints, self.spline
        rates = (spline.slopes @ joints, spline.at_knots[2][1:] @ joints, spline.third @ joints)
        ratios = np.concatenate(rates, axis=1) / self._scales()
        ratios[_decided_by_ends(spline.segments)[:, :-1]] = 0.0
        worst = [float(np.abs(ratios[:, rows]).max()) for rows in (_V, _A, _J)]
        return ratios, max(worst[0], worst[1] ** (1 / 2), worst[2] ** (1 / 3)) / (1.0 - MARGIN)

    def _scales(self) -> Vector:
        """The limits by normalised time, shape (21,)."""
        limits, T = self.task.limits, self.duration
        return np.concatenate([limits.v_max * T, limits.a_max * T**2, limits.j_max * T**3])

    def _sensitivities(self) -> Vector:
        """Effect of the coefficients of s on ratios and progress, shape (n, 22, 4)."""
        spline, scale = self.spline, self._scales()
        right = [spline.columns(matrix[1:]) for matrix in spline.at_knots]
        left = [spline.columns(matrix[:-1]) for matrix in spline.at_knots]
        ds, dds, point = self._ds[:, None], self._dds[:, None], self._point
        by_s = point.dddq * ds**2 + point.ddq * dds
        acceleration = (by_s, 2.0 * point.ddq * ds, point.dq)
        at_right = sum(_outer(x[1:], base) for x, base in zip(acceleration, right, strict=True))
        at_left = sum(_outer(x[:-1], base) for x, base in zip(acceleration, left, strict=True))
        jerk = (at_right - at_left) / np.diff(spline.knots)[:, None, None]
        slopes = spline.columns(spline.slopes)
        middle = self.task.path.at(_inside(self._middles()))
        bend = middle.ddq * (spline.slopes @ self._c)[:, None]
        velocity = _outer(middle.dq, slopes) + _outer(bend, 0.5 * (left[0] + right[0]))
        rates = np.concatenate([velocity, at_right, jerk], axis=1) / scale[:, None]
        return np.concatenate([rates, slopes[:, None]], axis=1)

    def _effect_of_ends(self, A: Vector) -> Vector:
        """How the rows change with log(duration) through the outermost coefficients."""
        n = self.spline.segments
        head, tail = self.spline.ends(*self.task.ends_by_log_duration(self.duration))
        moved = np.concatenate([head, np.zeros(n + DEGREE - 2 * ENDS), tail])
        here = np.arange(n)[:, None] + np.arange(DEGREE + 1)
        effect: Vector = np.matmul(A, moved[here][:, :, None])[:, :, 0]
        return effect

    def _middles(self) -> Vector:
        """Fractions of the path in the middle of every segment."""
        return _middle(self._s, self._ds, self._dds, self.spline.third @ self._c, self.spline)

    def _coarse(self) -> NDArray[np.bool_]:
        """Which segments are too long for an exact and fast motion."""
        spline, joints, scale = self.spline, self._joints, self._scales()
        q, v, a = (matrix @ joints for matrix in spline.at_knots)
        j, length = spline.third @ joints, np.diff(spline.knots)[:, None]
        swing = np.abs(length * j / scale[_A]).max(axis=1)
        slack = np.abs(length**2 * j / 8.0 / scale[_V]).max(axis=1)
        is_fast = np.abs(self.ratios[:, _V]).max(axis=1) > 1.0 - 10.0 * SPEED_SLACK
        is_wasteful = (swing > WIDEST_SWING) | (is_fast & (slack > SPEED_SLACK))
        middle = self._point.q[0] + _middle(q, v, a, j, spline)
        stray = np.abs(middle - self.task.path.at(_inside(self._middles())).q).max(axis=1)
        is_long = length[:, 0] > SHORTEST_SEGMENT
        return np.asarray((is_wasteful & is_long) | (stray > _allowed_stray(self.task.path)))


def _decided_by_ends(n: int) -> NDArray[np.bool_]:
    """Rows that no free coefficient changes, or not to the better; shape (n, 22)."""
    fixed = np.zeros((n, 22), dtype=np.bool_)
    fixed[[0, -1], _V] = fixed[-1, _A] = fixed[[0, -1], -1] = True
    return fixed


def _allowed_stray(path: StraightPath) -> float:
    """Where a short line turns much, an error along it is an error of orientation."""
    if path.line.angle_rad == 0.0 or path.length_m < SHORTEST_LINE_M:
        return STRAY_RAD
    return min(STRAY_TURN_RAD * path.length_m / path.line.angle_rad, STRAY_RAD)


def _middle(x: Vector, dx: Vector, ddx: Vector, dddx: Vector, spline: ClampedSpline) -> Vector:
    """A cubic spline in the middle of its segments, from its derivatives at the knots."""
    half = 0.5 * np.diff(spline.knots).reshape(-1, *[1] * (x.ndim - 1))
    return x[:-1] + half * (dx[:-1] + half * (ddx[:-1] / 2.0 + half * dddx / 6.0))


def _outer(rates: Vector, base: Vector) -> Vector:
    """Products of rates (n, 7) and basis values (n, 4): shape (n, 7, 4)."""
    return rates[:, :, None] * base[:, None]


def _inside(s: Vector) -> Vector:
    return np.clip(s, 0.0, 1.0)
