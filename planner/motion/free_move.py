"""Free moves: from rest to rest around obstacles, proven clear.

The straight line in joint space, if it is clear. Otherwise the motion program, led around the
obstacles on the line, and, where that fails or is much slower, around those on a path that OMPL
finds; if nothing else is clear, that path itself, at rest in each corner. The caller's `is_clear`
decides; it is called for every motion before it is returned.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin import Arm, IKService, JointLimits
from baxter_kin.errors import MissingLibraryError
from baxter_kin.frames import raised
from baxter_kin.ik import sample_solutions
from baxter_kin.validation import FloatArray, expect, positive_scalar
from planner.clearance import checked_margin_m
from planner.collision.context import SCREENING_STEP_RAD, CollisionContext, IsFree, looks_clear
from planner.collision.obstacles import Obstacles
from planner.errors import FreeMoveError, MotionError, StraightMoveError
from planner.motion.joint_move import (
    ROUNDING_RAD,
    checked_start,
    plan_joint_move,
    rest_to_rest_s,
    stopping_at,
)
from planner.motion.paths.straight_line import StraightLine
from planner.motion.program.guess import bent_to, follow, guess_along
from planner.motion.program.motion_program import MotionProgram, Motions, led_around
from planner.motion.program.rows import Clearances
from planner.motion.program.unknowns import MotionTask, Phase
from planner.motion.rrt import EDGE_STEP_RAD, search_corners
from planner.motion.upright import KNOT_SHARES, Upright, max_tilt_rad
from planner.splines import Sketch
from planner.trajectory import Trajectory

DEFAULT_MARGIN_M = 0.005
"""Distance between samples and obstacles, so that the motion between samples is clear too."""

TIMEOUT_S = 5.0
"""Maximum duration of a search; a wall on the table takes a tenth of a second."""

INTERVALS = 32
"""Number of intervals of the program's spline."""

GOOD_ENOUGH = 1.02
"""Maximum duration of a motion that is fast enough, as a multiple of the straight line's duration,
which is a lower bound."""

MAX_SEARCHES = 4
"""Maximum number of searches for a path; each samples twice as closely as the one before, until a
motion is proven clear."""

MAX_FASTER_SEARCHES = 2
"""Maximum number of searches for a faster motion, once one is proven clear."""

BETWEEN = (0.25, 0.5, 0.75)
"""Fractions of the tip's line at which an upright motion is guessed through sampled solutions."""

RISES_M, STRIDE = (0.1, 0.2, 0.3, 0.4), 0.05
"""Heights above start and goal over which an upright motion is tried; and the minimum step on the
way up, as a fraction of it."""

IsClear: TypeAlias = Callable[[Trajectory], bool]
"""Whether a whole motion is clear, also between samples."""


def plan_free_move(
    q_start: ArrayLike,
    q_goal: ArrayLike,
    limits: JointLimits,
    context: CollisionContext,
    is_clear: IsClear | None = None,
    *,
    rng: np.random.Generator | None = None,
    timeout_s: float = TIMEOUT_S,
    margin_m: float = DEFAULT_MARGIN_M,
    clip_start: bool = False,
    upright: Upright | None = None,
) -> Trajectory:
    """A fast, collision-free motion from rest to rest, around obstacles if needed.

    Args:
        q_start: shape (7,), rad, inside the limits.
        q_goal: shape (7,), rad, inside the limits.
        limits: of the arm's joints.
        context: the surroundings of the arm.
        is_clear: judges whole motions; only a motion that it accepts is returned. By default, the
            proof that a motion keeps the context's margin.
        rng: source of random numbers; the same ones give the same motion, unless the time expires.
            By default, always the same.
        timeout_s: maximum duration of the search for paths; optimising them takes additional time.
            With `upright`, no further guess of the motion is optimised after it.
        margin_m: distance to keep while searching; near start and goal, as far as these keep it.
        clip_start: whether a start up to 0.1 rad outside the limits is moved to them, with a
            warning in the log, instead of refused; a start outside by at most 1e-6 rad always is,
            without a warning.
        upright: an axis of the tip that stays within a cone; samples of a motion are checked. No
            paths are searched then, as hardly any random configuration is upright. The cone is
            required, whatever its `is_required` says.

    Raises:
        FreeMoveError: when start or goal collides or leans, no path is found or proven, or OMPL
            would be needed and is missing.
        ConfigurationError: when start or goal has another shape, is not finite or outside the
            limits.
        MotionError: when `limits`, `context`, `is_clear`, `rng`, `timeout_s` or `margin_m` is
            invalid, or a joint is too slow for any motion.
    """
    expect(limits, JointLimits, "limits", MotionError)
    seeds = np.random.default_rng(0) if rng is None else rng
    expect(seeds, np.random.Generator, "rng", MotionError)
    deadline_s = time.monotonic() + positive_scalar(timeout_s, "timeout_s", MotionError)
    proven = expect(context, CollisionContext, "context", MotionError).is_clear
    judge: IsClear = proven if is_clear is None else is_clear
    if not callable(judge):
        raise MotionError(f"is_clear must be callable, got {type(judge).__name__}")
    margin_m = checked_margin_m(margin_m)
    if upright is not None:
        expect(upright, Upright, "upright", MotionError)
    start = checked_start(q_start, limits, clip_start=clip_start)
    ends = np.array([start, limits.check(q_goal, "q_goal", ROUNDING_RAD)])
    if ends.shape[1] != context.joints:
        raise MotionError(f"the limits are of {ends.shape[1]} joints; an arm has {context.joints}")
    for which, q in zip(("start", "goal"), ends, strict=True):
        if not context.is_free(q):
            near = context.clearance(q).too_near(context.margin_m)
            raise FreeMoveError(f"{which} in collision: {near}")
    straight = plan_joint_move(ends[0], ends[1], limits)
    if straight.duration == 0.0 and not judge(straight):
        raise FreeMoveError("start and goal are the same, and staying there is not clear")
    if upright is not None:
        motion = _upright_move(straight, context, judge, margin_m, upright, deadline_s=deadline_s)
        if motion is not None:
            return motion
        max_deg, late = math.degrees(upright.max_tilt_rad), ""
        if time.monotonic() > deadline_s:
            late = f" in {timeout_s:g} s; allow more time, or there is none"
        raise FreeMoveError(f"no motion was found that stays upright within {max_deg:g} deg{late}")
    if looks_clear(straight, context.is_free, SCREENING_STEP_RAD) and judge(straight):
        return straight
    motion, refused = _Search(
        straight, limits, context, judge, margin_m, seeds, deadline_s
    ).fastest()
    if motion is not None:
        return motion
    if refused:
        raise FreeMoveError(f"{refused} ways around the obstacles were found, none proven clear")
    raise FreeMoveError(
        f"the straight line is blocked, and no way around was found in {timeout_s:g} s; allow more "
        "time, or there is none"
    )


def _upright_move(
    straight: Trajectory,
    context: CollisionContext,
    is_clear: IsClear,
    margin_m: float,
    upright: Upright,
    *,
    deadline_s: float,
) -> Trajectory | None:
    """The first motion found that stays upright; None when none is found.

    At least one guess is tried; no other one is begun after the deadline.

    Raises FreeMoveError when start or goal leans.
    """
    arm, limits, ends = context.checker.arm, straight.limits, straight.q[[0, -1]]
    for which, q in zip(("start", "goal"), ends, strict=True):
        refusal = upright.refusal(max_tilt_rad(arm, Trajectory.stay(q, limits), upright.axis))
        if refusal:
            raise FreeMoveError(f"{which} {refusal}")

    def is_kept(motion: Trajectory) -> bool:
        return upright.is_kept_by(arm, motion) and is_clear(motion)

    if is_kept(straight):
        return straight
    program, obstacles = _program(len(limits.names), keeps_upright=True), None
    for share in KNOT_SHARES:
        task = MotionTask(ends[0], q_goal=ends[1], tilt=upright.at_knots(share))

        def solved(
            sketches: Sequence[Sketch], near: Clearances | None, task: MotionTask = task
        ) -> Motions | None:
            return program.solve(sketches, task, arm, limits, near)

        for sketch in _upright_sketches(arm, straight):
            near = solved([sketch], None)
            if near is not None and is_kept(near[0]):
                return near[0]
            obstacles = obstacles or context.obstacles(margin_m, ends)
            for (motion,) in led_around(solved, [obstacles], [sketch]):
                if is_kept(motion):
                    return motion
            if time.monotonic() > deadline_s:
                return None
    return None


def _upright_sketches(arm: Arm, straight: Trajectory) -> Iterator[Sketch]:
    """Guesses, all but the first upright at several poses on the way.

    The joint line; the tip's line, by least-norm steps and by the quickest solutions; and up,
    across and down again.
    """
    yield Sketch.of(straight, INTERVALS)
    limits, fractions = straight.limits, [0.25, 0.5, 0.75, 1.0]
    tips = [arm.T_base_tip(q) for q in (straight.q_start, straight.q_goal)]
    with suppress(StraightMoveError):  # half a turn
        line = StraightLine(*tips)
        sketch = guess_along(
            *(arm, limits, straight.q_start, line, INTERVALS), ends_at_rest=True, min_stride=STRIDE
        )
        if isinstance(sketch, Sketch):
            longest_s = max(sketch.duration_s, straight.duration)
            yield bent_to(sketch, straight.q_goal, longest_s)
        yield _through(_quickest(arm, straight, line), limits)
    top_m = max(T.translation[2] for T in tips)
    for rise_m in RISES_M:
        ways = []
        for q, T in zip((straight.q_start, straight.q_goal), tips, strict=True):
            line = StraightLine(T, raised(T, top_m + rise_m - T.translation[2]))
            ways.append([q, *follow(arm, limits, q, line, fractions, min_stride=STRIDE).qs])
        up, down = ways
        if len(up) == len(down) == 1 + len(fractions):
            yield _through(np.array([*up, *down[::-1]]), limits)


def _quickest(arm: Arm, straight: Trajectory, line: StraightLine) -> FloatArray:
    """The quickest corners from start to goal through solutions of poses on a line of the tip.

    By dynamic programming over samples of all solutions, shape (m, 7), rad.
    """
    ik, ends = IKService(arm), straight.q[[0, -1]]
    sampled = (sample_solutions(ik, line.at(s)) for s in BETWEEN)
    layers = [ends[:1], *(qs for qs in sampled if len(qs)), ends[1:]]
    times, came_from = np.zeros(1), []
    for before, after in pairwise(layers):
        each = times[:, None] + rest_to_rest_s(after[None] - before[:, None], straight.limits)
        came_from.append(each.argmin(axis=0))
        times = each.min(axis=0)
    corners, index = [layers[-1][0]], 0
    for layer, choice in zip(layers[-2::-1], came_from[::-1], strict=True):
        index = int(choice[index])
        corners.append(layer[index])
    return np.array(corners[::-1])


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """A search for a motion around the obstacles on a straight line."""

    straight: Trajectory
    limits: JointLimits
    context: CollisionContext
    is_clear: IsClear
    margin_m: float
    rng: np.random.Generator
    deadline_s: float

    def fastest(self) -> tuple[Trajectory | None, int]:
        """The fastest motion found, and the number of paths without a clear motion."""
        ends = self.straight.q[[0, -1]]
        obstacles = self.context.obstacles(self.margin_m, ends)
        is_free = self.context.with_margin(self.margin_m, *ends).is_free
        best = self._led(obstacles, Sketch.of(self.straight, INTERVALS))
        refused, ways, closeness = 0, 0, 1.0
        while not self._is_enough(best) and ways < (
            MAX_SEARCHES if best is None else MAX_FASTER_SEARCHES
        ):
            try:
                corners = self._corners(is_free, EDGE_STEP_RAD / closeness)
            except MissingLibraryError as cause:
                if best is None:
                    raise FreeMoveError(f"the straight line is blocked, and {cause}") from cause
                break
            if corners is None:
                break
            ways += 1
            candidates = [best, self._led(obstacles, _through(corners, self.limits))]
            if candidates == [None, None]:
                stopping = stopping_at(corners, self.limits)
                candidates.append(stopping if self.is_clear(stopping) else None)
            motions = [motion for motion in candidates if motion is not None]
            best = min(motions, key=lambda motion: motion.duration, default=None)
            refused, closeness = refused + (best is None), 2.0 * closeness
        return best, refused

    def _is_enough(self, best: Trajectory | None) -> bool:
        return best is not None and best.duration <= GOOD_ENOUGH * self.straight.duration

    def _led(self, obstacles: Obstacles, sketch: Sketch) -> Trajectory | None:
        """The first clear motion near a sketch, led around obstacles."""
        task = MotionTask(self.straight.q_start, q_goal=self.straight.q_goal)
        program = _program(len(self.limits.names))
        motions = led_around(
            lambda sketches, near: program.solve(sketches, task, None, self.limits, near),
            [obstacles],
            [sketch],
            enough_s=GOOD_ENOUGH * self.straight.duration,
        )
        return next((motion for (motion,) in motions if self.is_clear(motion)), None)

    def _corners(self, is_free: IsFree, step_rad: float) -> FloatArray | None:
        left_s = self.deadline_s - time.monotonic()
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
def _program(joints: int, *, keeps_upright: bool = False) -> MotionProgram:
    phase = Phase(INTERVALS, rests=True, at_goal=True, keeps_upright=keeps_upright)
    return MotionProgram([phase], joints)


def _through(corners: FloatArray, limits: JointLimits) -> Sketch:
    """A guess along straight lines without a stop."""
    times = np.cumsum([0.0, *rest_to_rest_s(np.diff(corners, axis=0), limits)])
    t = np.linspace(0.0, 1.0, INTERVALS + 1)
    at = times[-1] * t**2 * (3.0 - 2.0 * t)
    q = np.stack([np.interp(at, times, joint) for joint in corners.T], axis=1)
    return Sketch(q, np.zeros((2, q.shape[1])), float(times[-1]))
