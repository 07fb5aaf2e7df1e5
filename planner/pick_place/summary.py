"""CollisionSummary: how many solutions of a pose collide, and with what: why a pick failed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.errors import ConfigurationError
from baxter_kin.validation import Checked, float_array
from planner.clearance import SHOWN_M, Clearance
from planner.collision.context import CollisionContext
from planner.errors import TaskError

MOST_MEASURED = 64
"""Solutions whose collisions are measured, which takes 1.6 ms each."""

MOST_NAMED = 3
"""Pairs that are named in the sentence; the data has all."""


@dataclass(frozen=True, slots=True)
class CollisionCount(Checked, error=TaskError):
    """How often two things collide.

    Attributes:
        first: link or body.
        second: link or body.
        count: in how many solutions these two come closest.
        distance_m: the greatest of their distances there: how near a miss it was. Negative when
            they are inside each other.
    """

    first: str
    second: str
    count: int
    distance_m: float

    @property
    def nearest(self) -> str:
        """Who, and how deep or how far apart at best."""
        distance_mm = 1e3 * self.distance_m
        if abs(self.distance_m) < SHOWN_M:
            gap = "touching"
        elif distance_mm > 0.0:
            gap = f"{distance_mm:.1f} mm apart"
        else:
            gap = f"{-distance_mm:.1f} mm deep"
        return f"{self.first} with {self.second}, at best {gap}"


@dataclass(frozen=True, slots=True)
class CollisionSummary(Checked, error=TaskError):
    """How many solutions of a waypoint collide; `str()` of it is one sentence.

    Attributes:
        stage: label of the move that would end there.
        solutions: how many were looked at, evenly chosen from all samples.
        collisions: what collides in the others, or is nearer than the margin, the most frequent
            first.
        margin_m: the distance that was asked for.
    """

    stage: str
    solutions: int
    collisions: tuple[CollisionCount, ...]
    margin_m: float = 0.0

    @classmethod
    def of(cls, stage: str, qs: ArrayLike, around: CollisionContext) -> CollisionSummary:
        """Look at solutions in a situation.

        Args:
            stage: label of the move that would end there.
            qs: the solutions, shape (n, 7), rad.
            around: the situation there.

        Raises:
            ConfigurationError: when a solution is malformed.
        """
        given = float_array(qs, "qs", ConfigurationError)
        solutions = given[
            np.linspace(0, len(given) - 1, min(len(given), MOST_MEASURED)).round().astype(int)
        ]
        blocked = [around.clearance(q) for q in solutions if not around.is_free(q)]
        return cls(stage, len(solutions), _counts(blocked), around.margin_m)

    @property
    def colliding(self) -> int:
        """How many of them collide."""
        return sum(collision.count for collision in self.collisions)

    def __str__(self) -> str:
        is_all = self.colliding == self.solutions
        share = f"all {self.solutions}" if is_all else f"{self.colliding} of {self.solutions}"
        named = [
            f"{collision.nearest} ({collision.count})"
            if len(self.collisions) > 1
            else collision.nearest
            for collision in self.collisions[:MOST_NAMED]
        ]
        if len(self.collisions) > MOST_NAMED:
            named.append(f"{len(self.collisions) - MOST_NAMED} other pairs")
        return f"{share} IK solutions {self._verb}: {'; '.join(named)}"

    @property
    def _verb(self) -> str:
        closer = f"come closer than the {1e3 * self.margin_m:.1f} mm asked for"
        if not any(collision.distance_m < SHOWN_M for collision in self.collisions):
            return closer
        return "collide" if self.margin_m == 0.0 else f"collide or {closer}"


def _counts(clearances: Iterable[Clearance]) -> tuple[CollisionCount, ...]:
    distances: dict[tuple[str, str], list[float]] = {}
    for found in clearances:
        distances.setdefault((found.first, found.second), []).append(found.distance_m)
    counts = (CollisionCount(*pair, len(each), max(each)) for pair, each in distances.items())
    return tuple(sorted(counts, key=lambda count: (-count.count, -count.distance_m)))
