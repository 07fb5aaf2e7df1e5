"""Pairs of IK solutions at pick and place: which are worth trying, by what is known so far."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from baxter_kin.arrays import Vector
from planner.choice import Choices
from planner.context import CollisionContext
from planner.motion.free_move import MARGIN_M
from planner.plan import PlanFailure
from planner.plan_builder import NoSolutionError
from planner.stages import PICK_LINES, PLACE_LINES
from planner.tally import Tally

NEIGHBOURHOOD_RAD = 0.15
"""Solutions nearer to each other than this in every joint collide alike: two steps of the samples
in the angle of s0."""


class Solutions:
    """Solutions of one waypoint, in the situation there.

    Attributes:
        stage: label of the move that ends there.
        qs: shape (n, 7), rad.
        is_free: whether the one of a number is.
        has_room: whether it also keeps the distance that searches for a way around keep.
    """

    def __init__(self, stage: str, qs: Vector, around: CollisionContext) -> None:
        self.stage = stage
        self.qs = qs
        self._around = around
        roomy = around.with_margin(around.margin_m + MARGIN_M)
        self.is_free = cache(lambda index: around.is_free(qs[index]))
        self.has_room = cache(lambda index: roomy.is_free(qs[index]))

    def near(self, index: int) -> NDArray[np.bool_]:
        """Which of them are near one, itself among them, shape (n,)."""
        is_near: NDArray[np.bool_] = (
            np.abs(self.qs - self.qs[index]).max(axis=1) < NEIGHBOURHOOD_RAD
        )
        return is_near

    def tally(self) -> Tally:
        """How many collide, and with what."""
        return Tally.of(self.stage, self.qs, self._around)

    def refuse_none_free(self) -> None:
        """Stop when all of them collide.

        Raises:
            NoSolutionError: then.
        """
        if not len(self.qs):
            raise NoSolutionError.at(
                self.stage, "no solution leads on to where the cycle ends", is_certain=True
            )
        if not any(self.is_free(index) for index in range(len(self.qs))):
            tally = self.tally()
            raise NoSolutionError(
                PlanFailure(self.stage, str(tally), is_certain=True, tallies=(tally,))
            )


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Which pairs are left to try.

    Attributes:
        choices: all pairs.
        picks: their solutions at the pick.
        places: their solutions at the place.
    """

    choices: Choices
    picks: Solutions
    places: Solutions
    _closed: NDArray[np.bool_]

    @classmethod
    def of(cls, choices: Choices, picks: Solutions, places: Solutions) -> Pairs:
        """All of them, to begin with."""
        closed = np.zeros((len(picks.qs), len(places.qs)), dtype=np.bool_)
        return cls(choices, picks, places, closed)

    def open_ones(self) -> Iterator[tuple[int, int]]:
        """Those worth trying by what is known when each is asked for.

        Those with room around them come first, among them the fastest.
        """
        picks, places = self.picks, self.places
        for with_room in (True, False):
            for i, j in self.choices.pairs():
                if self._closed[i, j] or not (picks.is_free(i) and places.is_free(j)):
                    continue
                if (picks.has_room(i) and places.has_room(j)) == with_room:
                    yield i, j

    def close(self, pair: tuple[int, int], stage: str) -> bool:
        """Give up what is like a pair that failed at a stage; True if it failed sideways."""
        i, j = pair
        if stage in PICK_LINES:
            self._closed[self.picks.near(i)] = True
        elif stage in PLACE_LINES:
            self._closed[:, self.places.near(j)] = True
        else:
            self._closed[np.ix_(self.picks.near(i), self.places.near(j))] = True
            return True
        return False

    def tallies(self) -> tuple[Tally, Tally]:
        """Of the pick and of the place."""
        return self.picks.tally(), self.places.tally()
