"""Candidates: the IK solutions at pick and place that are tried, and their order.

Samples of both solution sets are ranked by the durations of direct motions from rest to rest, in
closed form: from the start to the pick, on to the place, and up from there. Failures exclude
similar pairs.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from baxter_kin import IKService, JointLimits
from baxter_kin.ik import sample_solutions
from baxter_kin.kinematics.arm import JOINTS
from baxter_kin.validation import FloatArray, Indices, expect
from planner.collision.context import CollisionContext
from planner.errors import MotionError
from planner.motion.free_move import DEFAULT_MARGIN_M
from planner.motion.joint_move import rest_to_rest_s
from planner.pick_place.plan_builder import NoSolutionError
from planner.pick_place.task import PICK_LINES, PLACE_LINES, PickAndPlace, PlanRequest
from planner.plan import CollisionSummary, PlanFailure

BOUND_TURNS = 192
"""Number of angles of s0 for a bound: four times as many as for a choice, 0.02 rad apart."""

NEIGHBOURHOOD_RAD = 0.15
"""Maximum distance in every joint of solutions that are expected to collide alike: two steps of the
samples in the angle of s0."""


class CandidatePair(NamedTuple):
    """A solution at the pick and one at the place, each of shape (7,), rad."""

    q_pick: FloatArray
    q_place: FloatArray


class Solutions:
    """Solutions of one waypoint, in the collision context there.

    Attributes:
        stage: label of the move that ends there.
        qs: shape (n, 7), rad.
        is_free: whether the solution of a number is free.
        has_room: whether it also keeps the distance that searches for paths keep; it is then free.
    """

    def __init__(self, stage: str, qs: FloatArray, context: CollisionContext) -> None:
        self.stage, self.qs, self._context = stage, qs, context
        roomy = context.with_margin(context.margin_m + DEFAULT_MARGIN_M)
        self.is_free = cache(lambda index: context.is_free(qs[index]))
        self.has_room = cache(lambda index: roomy.is_free(qs[index]))

    def near(self, index: int) -> Indices:
        """Numbers of the solutions near one, including itself."""
        return np.flatnonzero(np.abs(self.qs - self.qs[index]).max(axis=1) < NEIGHBOURHOOD_RAD)

    def summary(self) -> CollisionSummary:
        """Summary of the collisions of the solutions."""
        return CollisionSummary.of(self.stage, self.qs, self._context)

    def refuse_none_free(self) -> None:
        """Raise NoSolutionError when all solutions collide."""
        if not len(self.qs):
            raise NoSolutionError.at(
                self.stage, "no solution leads on to where the cycle ends", is_certain=True
            )
        each = range(len(self.qs))
        if not any(map(self.has_room, each)) and not any(map(self.is_free, each)):
            summary = self.summary()
            raise NoSolutionError(
                PlanFailure(self.stage, str(summary), is_certain=True, tallies=(summary,))
            )


class Candidates:
    """Pairs of solutions, ordered by the expected duration of the cycle.

    Attributes:
        picks: solutions at the pick, shape (n, 7), rad.
        places: solutions at the place from which the end is reached, shape (m, 7), rad.
        order: numbers of a pick and a place, shape (n * m, 2).
    """

    def __init__(self, request: PlanRequest, task: PickAndPlace) -> None:
        """Combine all samples of both solution sets."""
        ik, limits = request.manipulator.ik, request.manipulator.limits
        in_air = request.in_air
        self.picks, places = (
            in_air.q[None]
            if in_air is not None and in_air.end == end and in_air.q is not None
            else _samples(ik, T)
            for end, T in (("pick", task.T_base_pick), ("place", task.T_base_place))
        )
        self.places, q_ends = _leading_to(ik, places, task.T_base_end)
        there = rest_to_rest_s(self.picks - request.q_start, limits)[:, None]
        across = rest_to_rest_s(self.places[None] - self.picks[:, None], limits)
        away = rest_to_rest_s(q_ends - self.places, limits)[None]
        times = there + across + away
        ranked = np.argsort(times, axis=None, kind="stable")
        self.order: Indices = np.stack(np.unravel_index(ranked, times.shape), axis=1)
        self._closed = np.zeros(times.shape, dtype=np.bool_)

    def pair(self, pick: int, place: int) -> CandidatePair:
        """One pair by its numbers."""
        return CandidatePair(self.picks[pick], self.places[place])

    def open_ones(self, picks: Solutions, places: Solutions) -> Iterator[tuple[int, int]]:
        """Pairs that are not excluded at the time when each is requested.

        Those with room around them come first; within each group, the fastest.
        """
        closed, pairs = self._closed, self.order.tolist()
        has_room = cache(lambda i, j: picks.has_room(i) and places.has_room(j))
        yield from ((i, j) for i, j in pairs if not closed[i, j] and has_room(i, j))
        for i, j in pairs:
            if not (closed[i, j] or has_room(i, j)) and picks.is_free(i) and places.is_free(j):
                yield i, j

    def close(self, picks: Indices, places: Indices, stage: str) -> bool:
        """Exclude pairs that are like one that failed at a stage; True if it failed sideways.

        Args:
            picks: numbers of the solutions near that of the pair.
            places: likewise.
            stage: a line up or down excludes its solution, other stages the pair.
        """
        if stage in PICK_LINES:
            self._closed[picks] = True
        elif stage in PLACE_LINES:
            self._closed[:, places] = True
        else:
            self._closed[np.ix_(picks, places)] = True
        return stage not in PICK_LINES + PLACE_LINES


def transfer_bound_s(
    ik: IKService, limits: JointLimits, T_base_pick: pin.SE3, T_base_place: pin.SE3
) -> float:
    """The duration of the fastest direct motion from any solution of one pose to any of the other.

    From rest to rest, over samples of both solution sets: a lower bound for any motion from pick to
    place, up to what lies between the samples. Infinite where a pose has no solution.

    Raises:
        PoseError: when a pose is invalid.
        RequestError: when `ik` is not an `IKService`.
        MotionError: when `limits` have the wrong type, or another number of joints.
    """
    joints = len(expect(limits, JointLimits, "limits", MotionError).names)
    if joints != len(JOINTS):
        raise MotionError(f"the limits are of {joints} joints; an arm has {len(JOINTS)}")
    picks, places = (
        sample_solutions(ik, T, turns=BOUND_TURNS) for T in (T_base_pick, T_base_place)
    )
    times = rest_to_rest_s(places[None] - picks[:, None], limits)
    return float(times.min(initial=np.inf))


def _samples(ik: IKService, T_base_tip: pin.SE3) -> FloatArray:
    """Samples; where all of them miss a small solution set, the solution of the service."""
    samples = sample_solutions(ik, T_base_tip)
    result = ik.solve(T_base_tip)
    return result.q[None] if not len(samples) and result.is_valid else samples


def _leading_to(
    ik: IKService, qs: FloatArray, T_base_tip: pin.SE3
) -> tuple[FloatArray, FloatArray]:
    """The configurations from which the search reaches a pose, and its results."""
    if not len(qs):
        return qs, qs
    results = ik.search.search(qs, np.repeat(T_base_tip.homogeneous[None], len(qs), axis=0))
    return qs[results.is_valid], results.q[results.is_valid]
