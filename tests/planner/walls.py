"""A wall on the demo's table, and the arm on either side of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner import Body, Box, Manipulator, Part, Scene, Trajectory
from planner.collision import ClearanceChecker
from planner.collision.context import CollisionContext, sample_times
from tests.conftest import at, overhead

FloatArray = NDArray[np.float64]

TABLE_TOP_M = -0.155
DENSE_RAD = 0.005


def wall(height_m: float = 0.3, y: float = 0.0) -> Body:
    """A wall across the table, 4 cm thick."""
    box = Box((0.3, 0.04, height_m))
    return Body("wall", (Part(box, at(0.0, 0.0, 0.0)),), at(0.7, y, TABLE_TOP_M + height_m / 2))


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """An arm in a scene, its fingers open."""

    manipulator: Manipulator
    checker: ClearanceChecker

    @classmethod
    def of(cls, manipulator: Manipulator, scene: Scene) -> Room:
        """With nothing in the hand and nothing to touch."""
        return cls(manipulator, ClearanceChecker(manipulator.shapes, manipulator.arm, scene))

    @property
    def space(self) -> CollisionContext:
        """Where the arm is free."""
        return CollisionContext(self.checker, self.full(self.manipulator.arm.neutral))

    def full(self, q: FloatArray) -> FloatArray:
        """A configuration of the whole robot."""
        hand = self.manipulator.hand
        return next(self.manipulator.configurations(q[None], hand.stroke_m))

    def distance_m(self, q: FloatArray) -> float:
        """The clearance, computed pair by pair."""
        return self.checker.clearance(self.full(q)).distance_m

    def least_distance_m(self, motion: Trajectory) -> float:
        """At dense samples, computed pair by pair."""
        qs = motion.sample(sample_times(motion, DENSE_RAD)).q
        return min(self.distance_m(q) for q in qs)

    def beside(self, y: float, z: float = -0.1) -> FloatArray:
        """The hand down over the table."""
        ik = self.manipulator.ik.solve(overhead(0.65, y, z), current=self.manipulator.arm.start)
        assert ik.is_valid
        return ik.q
