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
from baxter_kin.arrays import Vector
from baxter_kin.ik import sample_solutions
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


def choices(ik: IKService, limits: JointLimits, q_start: Vector, lines: Lines) -> Iterator[Choice]:
    """Pairs of solutions, those that promise the shortest cycle first.

    Args:
        ik: the arm's.
        limits: what its moves may use.
        q_start: where it stands, shape (7,), rad.
        lines: where the cycle leads the tip.
    """
    picks, places = (sample_solutions(ik, T) for T in (lines.T_base_pick, lines.T_base_place))
    if not len(picks) or not len(places):
        return
    end = lines.T_base_end.homogeneous[None]
    ends = ik.search.search(places, np.repeat(end, len(places), axis=0))
    places, ends_q = places[ends.is_valid], ends.q[ends.is_valid]
    there = rest_to_rest_s(picks - q_start, limits)[:, None]
    across = rest_to_rest_s(places[None] - picks[:, None], limits)
    away = rest_to_rest_s(ends_q - places, limits)[None]
    for index in np.argsort(there + across + away, axis=None, kind="stable").tolist():
        i, j = divmod(index, len(places))
        yield Choice(picks[i], places[j])


def transfer_bound_s(
    ik: IKService, limits: JointLimits, T_base_pick: pin.SE3, T_base_place: pin.SE3
) -> float:
    """The time of the fastest direct motion from any solution of one pose to any of the other.

    From rest to rest, over samples of both solution sets: no way from pick to place is faster, but
    for what lies between the samples. Infinite where a pose has no solution.
    """
    picks, places = (
        sample_solutions(ik, T, turns=BOUND_TURNS) for T in (T_base_pick, T_base_place)
    )
    times = rest_to_rest_s(places[None] - picks[:, None], limits)
    return float(times.min(initial=np.inf))
