"""How the shapes of a situation move: where they are, and how far they come about it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from baxter_kin.validation import FloatArray, Indices
from planner.collision.checker import ClearanceChecker
from planner.collision.continuous.motion_bounds import JointSpan
from planner.trajectory import Trajectory


class Around(NamedTuple):
    """Shapes around the middles of m intervals.

    Attributes:
        poses: of all shapes in base at the middles, shape (m, n, 4, 4).
        gaps_m: lower bounds on the distances there of pairs, for (interval, pair) of shape (k,).
        motions_m: bounds on how far they come nearer during the interval, likewise.
    """

    poses: FloatArray
    gaps_m: Callable[[Indices, Indices], FloatArray]
    motions_m: Callable[[Indices, Indices], FloatArray]


class ShapeMotion(Protocol):
    """How the shapes of a situation move."""

    @property
    def duration_s(self) -> float:
        """From its begin to its end."""

    def around(self, starts_s: FloatArray, ends_s: FloatArray) -> Around:
        """The shapes in the middle of intervals, shape (m,) both, and their motion about it."""


class ArmShapeMotion:
    """A trajectory of the mover of a checker, all else at rest."""

    def __init__(self, checker: ClearanceChecker, trajectory: Trajectory, full: FloatArray) -> None:
        self.duration_s = trajectory.duration
        self._full, self._span = full, JointSpan(trajectory)
        self._motion_bounds, self._checked = checker.motion_bounds, checker.checked
        moved = self._motion_bounds.moves.sum(axis=1)[checker.pairs]
        swap = moved[:, :1] < moved[:, 1:]  # a ball fits what moves better than what stands
        self._pairs = np.where(swap, checker.pairs[:, ::-1], checker.pairs)

    def around(self, starts_s: FloatArray, ends_s: FloatArray) -> Around:
        """By lever arms and exact turns."""
        qs, turns = self._span.around_middle(starts_s, ends_s)
        placed = self._motion_bounds.place(self._full, qs)

        def gaps_m(interval: Indices, pair: Indices) -> FloatArray:
            gaps = self._checked.covers.gaps_m(placed.shapes, interval, *self._pairs[pair].T)
            return gaps - self._checked.padding_m[pair]

        def motions_m(interval: Indices, pair: Indices) -> FloatArray:
            return self._motion_bounds.motions_m(placed, turns, interval, self._pairs[pair])

        return Around(placed.shapes, gaps_m, motions_m)
