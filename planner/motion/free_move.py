"""A free move: from rest to rest around whatever stands in the way, proven clear.

The straight joint line if it is clear. Else the motion program, led around what the line meets, and
where that fails or is much slower, around what a way that OMPL finds meets; that way itself, at
rest in each corner, if nothing else is clear. What decides is the caller's `is_clear`, asked about
every motion before it is returned.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin import JointLimits
from baxter_kin.arrays import Vector, positive_scalar
from baxter_kin.copying import Frozen
from baxter_kin.display import OneLine, seconds, sentence
from baxter_kin.errors import expect, quoted
from baxter_kin.fields import check_fields
from planner.collision import Clearance
from planner.errors import MotionError
from planner.motion.avoidance import Bounded, led_around
from planner.motion.phases import MotionTask, Phase
from planner.motion.program import MotionProgram
from planner.motion.splines import Sketch
from planner.motion.unknowns import JOINTS
from planner.path import EDGE_STEP_RAD, search_corners
from planner.rest_time import rest_to_rest_s
from planner.screening import SCREENING_STEP_RAD, IsFree, looks_clear
from planner.swept import checked_margin_m
from planner.timing import plan_joint_move, stopping_at
from planner.trajectory import Trajectory

MARGIN_M = 0.005
"""Distance kept between samples and obstacles, so that the motion between samples is clear too."""

TIMEOUT_S = 5.0
"""When to give up; a wall on the table takes a tenth of a second."""

INTERVALS = 32
"""Of the program's spline."""

ENOUGH = 1.02
"""Motions that take no longer, times the straight line that nothing beats, are fast enough."""

ROUNDS = 4
"""Ways that are searched; each is looked at twice as closely as the one before, until one is proven
clear."""

WAYS = 2
"""Ways that are searched for a faster motion, once one is proven clear."""

IsClear: TypeAlias = Callable[[Trajectory], bool]
"""Whether a whole motion is clear, also between samples."""


class GuardedSpace(Protocol):
    """Free configurations that keep a distance to everything."""

    def is_free(self, q: Vector) -> bool:
        """Whether `q`, shape (7,), rad, is one."""


class Space(Protocol):
    """The free configurations of an arm; `planner.free_space.FreeSpace` is one."""

    def is_free(self, q: Vector) -> bool:
        """Whether the arm touches nothing at `q`, shape (7,), rad."""

    def clearance(self, q: Vector) -> Clearance:
        """The least distance at `q`, shape (7,), rad, and between what."""

    def with_margin(self, margin_m: float, *ends: Vector) -> GuardedSpace:
        """The part of it that keeps a margin, the ends still in it."""

    def obstacles(self, resting: Vector, margin_m: float) -> Bounded:
        """What is in the way, to be kept at a distance, or what is left at ends, shape (k, 7)."""


class Obstruction(str, Enum):
    """What kept a free move from being found."""

    START_IN_COLLISION = "start in collision"
    GOAL_IN_COLLISION = "goal in collision"
    NOT_FOUND = "no way found"
    NOT_PROVEN = "no way proven clear"


@dataclass(frozen=True, slots=True, repr=False)
class FreeMoveFailure(OneLine):
    """Why there is no free move; `str()` of it is one sentence.

    Attributes:
        kind: start, goal or way.
        reason: the sentence, with names and numbers.
        clearance: what collides and how deep, when start or goal does.

    Raises:
        MotionError: when a value is of another class.
    """

    kind: Obstruction
    reason: str
    clearance: Clearance | None = None

    def __post_init__(self) -> None:
        """Check."""
        check_fields(self, MotionError)

    def __str__(self) -> str:
        """The reason."""
        return self.reason

    def _facts(self) -> tuple[str, ...]:
        return (sentence(self.reason),)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FreeMove(Frozen, OneLine):
    """A motion around the obstacles, or why there is none.

    Attributes:
        trajectory: the motion, proven clear; None when there is none.
        is_straight: whether it is the straight joint line, which was clear.
        failure: None, or why there is no motion.

    Raises:
        MotionError: when a value is of another class.
    """

    trajectory: Trajectory | None
    is_straight: bool = False
    failure: FreeMoveFailure | None = None

    def __post_init__(self) -> None:
        """Check."""
        check_fields(self, MotionError)

    def _facts(self) -> tuple[str, ...]:
        if self.trajectory is None:
            return (f"invalid: {sentence(self.failure)}",)
        way = "straight" if self.is_straight else "around"
        return way, seconds(self.trajectory.duration), "valid"


def plan_free_move(
    q_start: ArrayLike,
    q_goal: ArrayLike,
    limits: JointLimits,
    space: Space,
    is_clear: IsClear,
    *,
    rng: np.random.Generator | None = None,
    timeout_s: float = TIMEOUT_S,
    margin_m: float = MARGIN_M,
) -> FreeMove:
    """A fast motion from rest to rest that touches nothing, around obstacles if need be.

    Args:
        q_start: shape (7,), rad, inside the limits.
        q_goal: shape (7,), rad, inside the limits.
        limits: of the arm's joints.
        space: where the arm is free.
        is_clear: the judge of a whole motion; no other is returned than it says yes to.
        rng: where random numbers come from; the same ones make the same motion, as long as time is
            not up. Always the same when not given.
        timeout_s: when to give up searching for ways around; to make them fast takes its own time.
        margin_m: distance to keep while searching; near start and goal, what they leave.

    Returns:
        A move; when there is none, with the reason.

    Raises:
        ConfigurationError: when start or goal has another shape, is not finite or outside the
            limits.
        MotionError: when `limits`, `space`, `is_clear`, `rng`, `timeout_s` or `margin_m` makes no
            sense, or a joint is too slow for any motion.
    """
    expect(limits, JointLimits, "limits", MotionError)
    seeds = np.random.default_rng(0) if rng is None else rng
    expect(seeds, np.random.Generator, "rng", MotionError)
    clock = _Clock(positive_scalar(timeout_s, "timeout_s", MotionError))
    _check_collaborators(space, is_clear)
    margin_m = checked_margin_m(margin_m)
    ends = np.array([limits.check(q_start, "q_start"), limits.check(q_goal, "q_goal")])
    if ends.shape[1] != JOINTS:
        raise MotionError(f"the limits are of {ends.shape[1]} joints; an arm has {JOINTS}")
    failure = _blocked_end(ends, space)
    if failure is not None:
        return FreeMove(None, failure=failure)
    straight = plan_joint_move(ends[0], ends[1], limits)
    if looks_clear(straight, space.is_free, SCREENING_STEP_RAD) and is_clear(straight):
        return FreeMove(straight, is_straight=True)
    return _Search(straight, limits, space, is_clear, margin_m, seeds, clock).fastest()


def _check_collaborators(space: object, is_clear: object) -> None:
    lacking = [n for n in _OF_A_SPACE if not callable(getattr(space, n, None))]
    if lacking or isinstance(space, type):
        raise MotionError(
            f"space must be an object with the methods {', '.join(_OF_A_SPACE)}, such as a "
            f"FreeSpace, got {quoted(space)}"
        )
    if not callable(is_clear):
        raise MotionError(f"is_clear must be callable, got {type(is_clear).__name__}")


_OF_A_SPACE = ("is_free", "clearance", "with_margin", "obstacles")


class _Clock:
    """How much of the time is left."""

    def __init__(self, timeout_s: float) -> None:
        self.timeout_s = timeout_s
        self._deadline_s = time.monotonic() + timeout_s

    @property
    def left_s(self) -> float:
        return self._deadline_s - time.monotonic()


def _blocked_end(ends: Vector, space: Space) -> FreeMoveFailure | None:
    kinds = (Obstruction.START_IN_COLLISION, Obstruction.GOAL_IN_COLLISION)
    for kind, q in zip(kinds, ends, strict=True):
        if not space.is_free(q):
            nearest = space.clearance(q)
            return FreeMoveFailure(kind, f"{kind.value}: {nearest.text}", nearest)
    return None


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """A search for a way around what a straight line meets."""

    straight: Trajectory
    limits: JointLimits
    space: Space
    is_clear: IsClear
    margin_m: float
    rng: np.random.Generator
    clock: _Clock

    def fastest(self) -> FreeMove:
        """The fastest motion that was found, or why there is none."""
        ends = self.straight.q[[0, -1]]
        obstacles = self.space.obstacles(ends, self.margin_m)
        is_free = self.space.with_margin(self.margin_m, *ends).is_free
        found = self._led(obstacles, Sketch.of(self.straight, INTERVALS))
        refused, ways, closeness = 0, 0, 1.0
        while not self._is_enough(found) and ways < (ROUNDS if found is None else WAYS):
            corners = self._corners(is_free, EDGE_STEP_RAD / closeness)
            if corners is None:
                break
            ways += 1
            candidates = [found, self._led(obstacles, _through(corners, self.limits))]
            if candidates == [None, None]:
                stopping = stopping_at(corners, self.limits)
                candidates.append(stopping if self.is_clear(stopping) else None)
            there = [motion for motion in candidates if motion is not None]
            found = min(there, key=lambda motion: motion.duration, default=None)
            refused, closeness = refused + (found is None), 2.0 * closeness
        if found is None:
            return FreeMove(None, failure=_no_way(refused, self.clock))
        return FreeMove(found)

    def _is_enough(self, found: Trajectory | None) -> bool:
        return found is not None and found.duration <= ENOUGH * self.straight.duration

    def _led(self, obstacles: Bounded, sketch: Sketch) -> Trajectory | None:
        """The first clear motion near a sketch, led around obstacles."""
        task = MotionTask(self.straight.q_start, q_goal=self.straight.q_goal)
        motions = led_around(
            lambda sketches, near: _program().solve(sketches, task, None, self.limits, near),
            [obstacles],
            [sketch],
            enough_s=ENOUGH * self.straight.duration,
        )
        return next((motion for (motion,) in motions if self.is_clear(motion)), None)

    def _corners(self, is_free: IsFree, step_rad: float) -> Vector | None:
        left_s = self.clock.left_s
        if left_s <= 0.0:
            return None
        return search_corners(
            self.straight.q_start,
            self.straight.q_goal,
            self.limits,
            is_free,
            rng=self.rng,
            timeout_s=left_s,
            step_rad=step_rad,
        )


@cache
def _program() -> MotionProgram:
    return MotionProgram([Phase(INTERVALS, rests=True, at_goal=True)], keeps_clear=True)


def _through(corners: Vector, limits: JointLimits) -> Sketch:
    """Along straight lines, without a stop; a guess."""
    times = np.cumsum([0.0, *rest_to_rest_s(np.diff(corners, axis=0), limits)])
    t = np.linspace(0.0, 1.0, INTERVALS + 1)
    at = times[-1] * t**2 * (3.0 - 2.0 * t)
    q = np.stack([np.interp(at, times, joint) for joint in corners.T], axis=1)
    return Sketch(q, np.zeros((2, JOINTS)), float(times[-1]))


def _no_way(refused: int, clock: _Clock) -> FreeMoveFailure:
    if refused:
        reason = f"{refused} ways around the obstacles were found, none proven clear"
        return FreeMoveFailure(Obstruction.NOT_PROVEN, reason)
    reason = (
        f"the straight line is blocked, and no way around was found in {clock.timeout_s:g} s; "
        "allow more time, or there is none"
    )
    return FreeMoveFailure(Obstruction.NOT_FOUND, reason)
