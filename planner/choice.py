"""Choice of IK solutions: which elbow at the pick and which at the place make a cycle short.

Solutions all over both solution sets are compared by the times of direct motions from rest to
rest, in closed form: from the start to the pick, on to the place, and up from there. That ranks
pairs; the best few are planned exactly.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin import IKService, JointLimits
from baxter_kin.arrays import Indices, Vector
from baxter_kin.errors import expect
from baxter_kin.ik import sample_solutions
from planner.errors import MotionError
from planner.lines import Lines
from planner.rest_time import rest_to_rest_s

BOUND_TURNS = 192
"""Angles of s0 for a bound: four times as many as for a choice, 0.02 rad apart."""


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """A pair of solutions.

    Attributes:
        q_pick: at the pick, shape (7,), rad.
        q_place: at the place, shape (7,), rad.
    """

    q_pick: Vector
    q_place: Vector


@dataclass(frozen=True, slots=True, eq=False)
class Choices:
    """Pairs of solutions, in the order of the times that they promise.

    Attributes:
        picks: solutions at the pick, shape (n, 7), rad.
        places: solutions at the place from which the end is reached, shape (m, 7), rad.
        order: pairs of both in order, i * m + j for picks i and places j, shape (n * m,).
    """

    picks: Vector
    places: Vector
    order: Indices

    @classmethod
    def of(cls, ik: IKService, limits: JointLimits, q_start: Vector, lines: Lines) -> Choices:
        """All pairs of samples of both solution sets.

        Args:
            ik: the arm's.
            limits: what its moves may use.
            q_start: where it stands, shape (7,), rad.
            lines: where the cycle leads the tip.
        """
        picks, places = (_solutions(ik, T) for T in (lines.T_base_pick, lines.T_base_place))
        places, q_ends = _leading_to(ik, places, lines.T_base_end)
        there = rest_to_rest_s(picks - q_start, limits)[:, None]
        across = rest_to_rest_s(places[None] - picks[:, None], limits)
        away = rest_to_rest_s(q_ends - places, limits)[None]
        return cls(picks, places, np.argsort(there + across + away, axis=None, kind="stable"))

    def pairs(self) -> Iterator[tuple[int, int]]:
        """Numbers of a pick and a place; those first that promise the shortest cycle."""
        for index in self.order.tolist():
            yield divmod(index, len(self.places))

    def at(self, pick: int, place: int) -> Choice:
        """One pair by its numbers."""
        return Choice(self.picks[pick], self.places[place])


def transfer_bound_s(
    ik: IKService, limits: JointLimits, T_base_pick: pin.SE3, T_base_place: pin.SE3
) -> float:
    """The time of the fastest direct motion from any solution of one pose to any of the other.

    From rest to rest, over samples of both solution sets: no way from pick to place is faster, but
    for what lies between the samples. Infinite where a pose has no solution.

    Raises:
        PoseError: when a pose is not a valid one.
        RequestError: when `ik` is no service.
        MotionError: when `limits` are none, or of another number of joints.
    """
    expect(limits, JointLimits, "limits", MotionError)
    picks, places = (
        sample_solutions(ik, T, turns=BOUND_TURNS) for T in (T_base_pick, T_base_place)
    )
    times = rest_to_rest_s(places[None] - picks[:, None], limits)
    return float(times.min(initial=np.inf))


def _solutions(ik: IKService, T_base_tip: pin.SE3) -> Vector:
    """Samples; where all of them miss a small solution set, the one that the service finds."""
    samples = sample_solutions(ik, T_base_tip)
    found = ik.solve(T_base_tip)
    return found.q[None] if not len(samples) and found.is_valid else samples


def _leading_to(ik: IKService, qs: Vector, T_base_tip: pin.SE3) -> tuple[Vector, Vector]:
    """Those configurations from which the search reaches a pose, and where it arrives."""
    if not len(qs):
        return qs, qs
    found = ik.search.search(qs, np.repeat(T_base_tip.homogeneous[None], len(qs), axis=0))
    return qs[found.is_valid], found.q[found.is_valid]
