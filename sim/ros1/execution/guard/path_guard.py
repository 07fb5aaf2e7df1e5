"""The guard: is the arm near enough to where its plan was proven clear?

Every configuration of the path was proven to keep a distance c from what stands still. The distance
of two shapes changes by no more than the points of the moving one are displaced. So an arm none of
whose points is displaced by more than c - `KEPT_M` from where it is at *some* configuration of the
path keeps `KEPT_M` at least, whatever lag or gravity does to it. Displaced points are measured, not
estimated: a displacement between two placings of a rigid shape is a convex function of the point,
so the corners of a box around the shape have the greatest. Pairs of the arm with itself are judged
by the bound of `planner.collision.motion_bounds`, which holds seen from any inner link.

The path is that of the last `WINDOW_S`: q(t) of the plan, not what is sent ahead of it. Beyond the
path, a joint may be off its own set-point by so much as its move says at most, and once the
set-point stands no joint may move away from it by more than `GROWTH_RAD`.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baxter_kin.validation import FloatArray, Indices
from planner.collision.context import CollisionContext
from planner.collision.distances import Covers, placed_points
from planner.collision.motion_bounds import Placed
from sim.ros1.execution.guard.stages import Room, shared_joints
from sim.ros1.execution.stops import StopCause

WINDOW_S = 1.5
"""How long the path is remembered."""

KEPT_M = 0.003
"""What is left of the clearance when the guard acts."""

GROWTH_RAD = 0.02
"""Twice what counts as settled, and far above what sensors do."""

STANDS_S = 0.1
"""A set-point that did not change for so long stands."""

NEAR = 8
"""Configurations of the path that are looked at first: those around where the arm was last."""


class Alarm(NamedTuple):
    """What the guard has found.

    Attributes:
        cause: one of `StopCause.OFF_PATH`, `JOINT_OFF`, `RUNNING_AWAY`.
        subject: the shape or joint that is farthest.
        value: how far, m for the path, rad else.
        bound: what is allowed.
    """

    cause: StopCause
    subject: str
    value: float
    bound: float


@dataclass(slots=True, eq=False)
class _Point:
    """A configuration of the path."""

    time_s: float
    q: FloatArray
    corners: FloatArray  # (shapes, 8, 3), m, in base
    room: Room


class PathGuard:
    """Watches one arm between two actions of its fingers."""

    def __init__(self, context: CollisionContext, names: tuple[str, ...]) -> None:
        """Watch the arm of a situation.

        Args:
            context: what is around it, and what it holds.
            names: of its joints.
        """
        checker = context.checker
        self._bounds, self._names = checker.motion_bounds, names
        self._full = context.q_others
        shared = shared_joints(checker)
        shapes = np.unique(checker.pairs[shared == 0])
        self._shapes = shapes[self._bounds.moves[shapes].any(axis=1)]
        self._corners = _corners(checker.checked.covers, self._shapes)
        self._own = checker.pairs[shared > 0]
        self._hangs = shared[shared > 0] == np.arange(1, len(names) + 1)[:, None]  # joint, own pair
        self._path: deque[_Point] = deque()
        self._at = 0
        self._stood_since_s: float | None = None
        self._least_off: FloatArray | None = None

    def passes(self, time_s: float, q: FloatArray, room: Room) -> None:
        """The set-point is at `q` of the path, shape (7,), rad, on a move with that room."""
        last = self._path[-1] if self._path else None
        if last is not None and np.array_equal(last.q, q):
            self._stands(time_s)
        else:
            self._stood_since_s, self._least_off = None, None
            self._path.append(_Point(time_s, q, self._placed(q)[1], room))
        while len(self._path) > 1 and self._path[1].time_s < time_s - WINDOW_S:
            self._path.popleft()
            self._at -= 1

    def look(self, q: FloatArray, q_now: FloatArray) -> Alarm | None:
        """Whether an arm that is measured at `q` is where it may be, both shape (7,), rad.

        Args:
            q: measured.
            q_now: the set-point of the path now.
        """
        off = np.abs(q - q_now)
        worst = int(off.argmax())
        most_rad = self._path[-1].room.most_off_rad
        if off[worst] > most_rad:
            return Alarm(StopCause.JOINT_OFF, self._names[worst], float(off[worst]), most_rad)
        return self._growing(off) or self._off_path(q)

    def _stands(self, time_s: float) -> None:
        if self._stood_since_s is None:
            self._stood_since_s = time_s
        elif time_s - self._stood_since_s >= STANDS_S and self._least_off is None:
            self._least_off = np.full(len(self._names), np.inf)

    def _growing(self, off: FloatArray) -> Alarm | None:
        if self._least_off is None:
            return None
        self._least_off = np.minimum(self._least_off, off)
        growth = off - self._least_off
        worst = int(growth.argmax())
        if growth[worst] <= GROWTH_RAD:
            return None
        name = self._names[worst]
        return Alarm(StopCause.RUNNING_AWAY, name, float(growth[worst]), GROWTH_RAD)

    def _off_path(self, q: FloatArray) -> Alarm | None:
        placed, corners = self._placed(q)
        near = self._nearest(q, corners, placed, self._around())
        if near.is_off:
            near = self._nearest(q, corners, placed, range(len(self._path)))
        self._at = near.nearest
        return near.alarm if near.is_off else None

    def _around(self) -> range:
        last = len(self._path) - 1
        at = min(max(self._at, 0), last)
        return range(max(0, at - NEAR // 2), min(last, at + NEAR) + 1)

    def _nearest(self, q: FloatArray, corners: FloatArray, placed: Placed, numbers: range) -> _Near:
        """How far the arm is from some configurations of the path."""
        points = [self._path[number] for number in numbers]
        offs = np.array([point.corners for point in points]) - corners
        moved = np.sqrt((offs**2).sum(axis=-1).max(axis=(1, 2)))
        turns = np.abs(np.array([point.q for point in points]) - q)
        number, own = np.indices((len(points), len(self._own))).reshape(2, -1)
        seen = self._bounds.motions_m(placed, turns, number, self._own[own])
        seen = np.where(self._hangs, seen.reshape(len(points), 1, -1), 0.0).max(axis=2)
        displaced = np.column_stack([moved, seen])
        allowed = np.array([point.room.clear_m for point in points]) - KEPT_M
        excess = displaced - allowed
        best = int(excess.max(axis=1).argmin())
        worst = int(excess[best].argmax())
        return _Near(
            numbers[int(displaced[:, 0].argmin())],
            Alarm(
                StopCause.OFF_PATH,
                points[best].room.label,
                float(displaced[best, worst]),
                float(allowed[best, worst]),
            ),
        )

    def _placed(self, q: FloatArray) -> tuple[Placed, FloatArray]:
        placed = self._bounds.place(self._full, q[None])
        return placed, placed_points(placed.shapes[:, self._shapes], self._corners)[0]


class _Near(NamedTuple):
    """How far an arm is from some configurations of its path.

    Attributes:
        nearest: the number of the one that the arm is displaced least from.
        alarm: how far it is displaced from the one that leaves most room, and what is allowed.
    """

    nearest: int
    alarm: Alarm

    @property
    def is_off(self) -> bool:
        """Whether the arm is farther away than it may be."""
        return self.alarm.value > self.alarm.bound


def _corners(covers: Covers, shapes: Indices) -> FloatArray:
    """The corners of boxes around shapes, each in the shape's own frame, shape (n, 8, 3)."""
    is_high = np.array([[number >> axis & 1 for axis in range(3)] for number in range(8)], bool)
    low, high = covers.lowest[shapes], covers.highest[shapes]
    corners: FloatArray = np.where(is_high, high[:, None, :], low[:, None, :])
    return corners
