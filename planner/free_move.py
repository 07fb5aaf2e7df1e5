"""A free move: from rest to rest around whatever stands in the way, proven clear.

The straight joint line if it is clear. Else corners from a search that looks at samples and keeps a
margin, and a smooth motion along them. What decides is the caller's `is_clear`, asked about every
motion before it is returned; a motion that it refuses costs another, closer search.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin import JointLimits
from baxter_kin.arrays import Vector, float_array, positive_scalar
from baxter_kin.copying import Frozen
from baxter_kin.display import OneLine, count, seconds, sentence
from baxter_kin.errors import expect, quoted
from baxter_kin.fields import check_fields
from planner.collision import Clearance
from planner.errors import MotionError
from planner.path import EDGE_STEP_RAD, search_corners
from planner.screening import IsFree, looks_clear
from planner.smoothing import SCREENING_STEP_RAD, smoothed
from planner.swept import checked_margin_m
from planner.timing import plan_joint_move
from planner.trajectory import Trajectory

MARGIN_M = 0.005
"""Distance kept between samples and obstacles, so that the motion between samples is clear too."""

TIMEOUT_S = 5.0
"""When to give up; a wall on the table takes a tenth of a second."""

ROUNDS = 4
"""Searches until a motion is proven clear; each looks twice as closely as the one before."""

IsClear: TypeAlias = Callable[[Trajectory], bool]
"""Whether a whole motion is clear, also between samples."""


class GuardedSpace(Protocol):
    """Free configurations that keep a distance to everything."""

    def is_free(self, q: Vector) -> bool:
        """Whether `q`, shape (n,), rad, is one."""


class Space(Protocol):
    """The free configurations of an arm; `planner.free_space.FreeSpace` is one."""

    def is_free(self, q: Vector) -> bool:
        """Whether the arm touches nothing at `q`, shape (n,), rad."""

    def clearance(self, q: Vector) -> Clearance:
        """The least distance at `q`, shape (n,), rad, and between what."""

    def with_margin(self, margin_m: float, *ends: Vector) -> GuardedSpace:
        """The part of it that keeps a margin, the ends still in it."""


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
        corners: the straight lines it was made of, shape (m, n), rad; two for a straight move, none
            when there is no motion.
        failure: None, or why there is no motion.

    Raises:
        MotionError: when a value is of another class, or the corners are not finite.
    """

    trajectory: Trajectory | None
    corners: Vector
    failure: FreeMoveFailure | None = None

    def __post_init__(self) -> None:
        """Check, copy and freeze."""
        check_fields(self, MotionError)
        corners = float_array(self.corners, "corners", MotionError)
        if corners.ndim != 2 or not np.isfinite(corners).all():
            raise MotionError(f"corners must be finite, of shape (m, n), got {quoted(corners)}")
        corners.setflags(write=False)
        object.__setattr__(self, "corners", corners)

    @property
    def is_straight(self) -> bool:
        """Whether the straight joint line was clear."""
        return len(self.corners) == 2

    def _facts(self) -> tuple[str, ...]:
        if self.trajectory is None:
            return (f"invalid: {sentence(self.failure)}",)
        return count(len(self.corners), "corner"), seconds(self.trajectory.duration), "valid"


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
        q_start: shape (n,), rad, inside the limits.
        q_goal: shape (n,), rad, inside the limits.
        limits: of those n joints.
        space: where the arm is free.
        is_clear: the judge of a whole motion; no other is returned than it says yes to.
        rng: where random numbers come from; the same ones make the same motion, as long as time is
            not up. Always the same when not given.
        timeout_s: when to give up searching.
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
    failure = _blocked_end(ends, space)
    if failure is not None:
        return FreeMove(None, ends[:0], failure)
    straight = plan_joint_move(ends[0], ends[1], limits)
    if looks_clear(straight, space.is_free, SCREENING_STEP_RAD) and is_clear(straight):
        return FreeMove(straight, ends)
    guarded = space.with_margin(margin_m, *ends)
    return _Search(ends, limits, guarded.is_free, seeds, clock).first_clear(is_clear)


def _check_collaborators(space: object, is_clear: object) -> None:
    lacking = [n for n in _OF_A_SPACE if not callable(getattr(space, n, None))]
    if lacking or isinstance(space, type):
        raise MotionError(
            f"space must be an object with the methods {', '.join(_OF_A_SPACE)}, such as a "
            f"FreeSpace, got {quoted(space)}"
        )
    if not callable(is_clear):
        raise MotionError(f"is_clear must be callable, got {type(is_clear).__name__}")


_OF_A_SPACE = ("is_free", "clearance", "with_margin")


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
    """What every round of a search for a way around starts from."""

    ends: Vector
    limits: JointLimits
    is_free: IsFree
    rng: np.random.Generator
    clock: _Clock

    def first_clear(self, is_clear: IsClear) -> FreeMove:
        refused = 0
        for closeness in 2.0 ** np.arange(ROUNDS):
            corners = self._corners(EDGE_STEP_RAD / closeness)
            if corners is None:
                break
            step_rad = SCREENING_STEP_RAD / closeness
            motion = smoothed(corners, self.limits, self.is_free, self.rng, step_rad=step_rad)
            if is_clear(motion):
                return FreeMove(motion, corners)
            refused += 1
        return FreeMove(None, self.ends[:0], _no_way(refused, self.clock))

    def _corners(self, step_rad: float) -> Vector | None:
        left_s = self.clock.left_s
        if left_s <= 0.0:
            return None
        start, goal = self.ends
        return search_corners(
            start,
            goal,
            self.limits,
            self.is_free,
            rng=self.rng,
            timeout_s=left_s,
            step_rad=step_rad,
        )


def _no_way(refused: int, clock: _Clock) -> FreeMoveFailure:
    if refused:
        reason = f"{refused} ways around the obstacles were found, none proven clear"
        return FreeMoveFailure(Obstruction.NOT_PROVEN, reason)
    reason = (
        f"the straight line is blocked, and no way around was found in {clock.timeout_s:g} s; "
        "allow more time, or there is none"
    )
    return FreeMoveFailure(Obstruction.NOT_FOUND, reason)
