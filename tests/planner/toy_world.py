"""A world whose obstacles are known in closed form, in the plane of the first two joints."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from baxter_kin import Arm, JointLimits
from planner.collision import Clearance
from planner.collision.context import CollisionContext
from planner.collision.obstacles import PAIRS, REACH_M, LinearBounds, Obstacles, SampledDistances
from planner.splines import weights_at

FloatArray = NDArray[np.float64]

LIMITS = JointLimits(
    names=("first", "second"),
    q_min=np.full(2, -2.0),
    q_max=np.full(2, 2.0),
    v_max=np.full(2, 1.5),
    a_max=np.full(2, 2.0),
    j_max=np.full(2, 20.0),
)

LEFT, RIGHT = np.array([-1.5, 0.0]), np.array([1.5, 0.1])
"""Either side of `DISC`."""

ARM_LIMITS = JointLimits(
    tuple(f"joint {i}" for i in range(7)),
    q_min=np.full(7, -2.0),
    q_max=np.full(7, 2.0),
    v_max=np.full(7, 1.5),
    a_max=np.full(7, 2.0),
    j_max=np.full(7, 20.0),
)
"""Limits of an arm of which only the first two joints matter."""

ARM_LEFT, ARM_RIGHT = (np.array([x, y, *np.zeros(5)]) for x, y in (LEFT, RIGHT))
"""`LEFT` and `RIGHT` as configurations of that arm."""


@dataclass(frozen=True, slots=True)
class Disc:
    """Configurations nearer than the radius to the centre are in collision."""

    x: float
    y: float
    radius: float

    def distance(self, q: FloatArray) -> float:
        """From a configuration to its edge."""
        return float(np.hypot(q[0] - self.x, q[1] - self.y) - self.radius)


@dataclass(frozen=True, slots=True)
class Ring:
    """What is enclosed by it cannot be left."""

    x: float
    y: float
    radius: float
    width: float

    def distance(self, q: FloatArray) -> float:
        """From a configuration to its edge."""
        return float(abs(np.hypot(q[0] - self.x, q[1] - self.y) - self.radius) - self.width / 2)


@dataclass(frozen=True, slots=True)
class ToySpace(CollisionContext):
    """The free configurations of a world of discs and rings."""

    things: tuple[Disc | Ring, ...]
    margin_m: float = 0.0

    @property
    def arms(self) -> tuple[Arm, ...]:
        """None: there is no tip."""
        return ()

    @property
    def joints(self) -> int:
        """As many as an arm has; all but two do not matter."""
        return 7

    def is_free(self, q: FloatArray) -> bool:  # type: ignore[override]
        """Whether it is outside all of them."""
        return self.clearance(q).distance_m > self.margin_m

    def clearance(self, q: FloatArray) -> Clearance:  # type: ignore[override]
        """The distance to the nearest."""
        return Clearance(min(o.distance(q) for o in self.things), "finger", "disc")

    def with_margin(  # type: ignore[override]
        self, margin_m: float, *ends: FloatArray
    ) -> ToySpace:
        """The space around larger obstacles."""
        least = min(self.clearance(q).distance_m for q in ends)
        return ToySpace(self.things, min(margin_m, least / 2))

    def obstacles(  # type: ignore[override]
        self, margin_m: float, resting: FloatArray
    ) -> ToyObstacles:
        """The same for motions, which rest at configurations, shape (k, n)."""
        return ToyObstacles(self.with_margin(margin_m, *resting))


@dataclass(frozen=True, slots=True)
class ToyObstacles(Obstacles):
    """Distances to all of them near a motion, by finite differences."""

    space: ToySpace

    def sampled(self, controls: FloatArray, reach_m: float = REACH_M) -> SampledDistances:
        """In the middle of each interval, shape (n + 3, 7)."""
        weights = weights_at(np.array([0.5]))
        windows = np.lib.stride_tricks.sliding_window_view(controls, 4, axis=0)
        qs = windows @ weights[0]
        numbers = np.zeros((len(qs), PAIRS, qs.shape[1] + 1))
        numbers[:, :, -1] = reach_m
        step = 1e-6 * np.eye(qs.shape[1])[:2]
        least: list[float] = []
        for q, rows in zip(qs, numbers, strict=True):
            least.append(reach_m)
            for row, thing in zip(rows, self.space.things, strict=False):
                excess = thing.distance(q) - self.space.margin_m
                ahead = [thing.distance(q + one) - thing.distance(q - one) for one in step]
                row[:2] = np.array(ahead) / 2e-6
                row[-1] = excess - row[:2] @ q[:2]
                least[-1] = min(least[-1], excess)
        linear = LinearBounds(np.tile(weights, (len(qs), 1)), numbers)
        return SampledDistances(np.array(least), lambda: linear)


DISC = Disc(0.0, 0.0, 0.8)
AROUND_DISC = ToySpace((DISC,))


def least_distance(space: ToySpace, qs: FloatArray) -> float:
    """Of many configurations, shape (m, 2)."""
    return min(space.clearance(q).distance_m for q in qs)


def along(corners: FloatArray, step: float = 1e-3) -> FloatArray:
    """Points on the straight lines between corners, at most a step apart."""
    lines = []
    for start, end in pairwise(corners):
        count = 2 + int(np.linalg.norm(end - start) / step)
        lines.append(np.linspace(start, end, count))
    return np.concatenate(lines)
