"""A world of two joints whose obstacles are known in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from baxter_kin import JointLimits
from planner import Clearance

Vector = NDArray[np.float64]

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


@dataclass(frozen=True, slots=True)
class Disc:
    """Configurations nearer than the radius to the centre are in collision."""

    x: float
    y: float
    radius: float

    def distance(self, q: Vector) -> float:
        """From a configuration to its edge."""
        return float(np.hypot(q[0] - self.x, q[1] - self.y) - self.radius)


@dataclass(frozen=True, slots=True)
class Ring:
    """What is enclosed by it cannot be left."""

    x: float
    y: float
    radius: float
    width: float

    def distance(self, q: Vector) -> float:
        """From a configuration to its edge."""
        return float(abs(np.hypot(q[0] - self.x, q[1] - self.y) - self.radius) - self.width / 2)


@dataclass(frozen=True, slots=True)
class ToySpace:
    """The free configurations of a world of discs and rings."""

    obstacles: tuple[Disc | Ring, ...]
    margin_m: float = 0.0

    def is_free(self, q: Vector) -> bool:
        """Whether it is outside all of them."""
        return self.clearance(q).distance_m > self.margin_m

    def clearance(self, q: Vector) -> Clearance:
        """The distance to the nearest."""
        return Clearance(min(o.distance(q) for o in self.obstacles), "finger", "disc")

    def with_margin(self, margin_m: float, *ends: Vector) -> ToySpace:
        """The space around larger obstacles."""
        least = min(self.clearance(q).distance_m for q in ends)
        return ToySpace(self.obstacles, min(margin_m, least / 2))


DISC = Disc(0.0, 0.0, 0.8)
AROUND_DISC = ToySpace((DISC,))


def least_distance(space: ToySpace, qs: Vector) -> float:
    """Of many configurations, shape (m, 2)."""
    return min(space.clearance(q).distance_m for q in qs)


def along(corners: Vector, step: float = 1e-3) -> Vector:
    """Points on the straight lines between corners, at most a step apart."""
    lines = []
    for start, end in pairwise(corners):
        count = 2 + int(np.linalg.norm(end - start) / step)
        lines.append(np.linspace(start, end, count))
    return np.concatenate(lines)
