"""Free moves: from rest to rest around obstacles, proven clear.

The straight line in joint space, if it is clear; otherwise what `planner.motion.free_search` finds.
The caller's `is_clear` decides; it is called for every motion before it is returned.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin import Arm, IKService, JointLimits
from baxter_kin.frames import raised
from baxter_kin.ik import sample_solutions
from baxter_kin.validation import FloatArray, expect, positive_scalar
from planner.clearance import checked_margin_m
from planner.collision.context import SCREENING_STEP_RAD, CollisionContext, looks_clear
from planner.errors import FreeMoveError, MotionError, StraightMoveError
from planner.motion.free_search import INTERVALS, IsClear, Search, program, through
from planner.motion.joint_move import (
    ROUNDING_RAD,
    checked_start,
    plan_joint_move,
    rest_to_rest_s,
)
from planner.motion.paths.straight_line import StraightLine
from planner.motion.program.guess import bent_to, follow, guess_along
from planner.motion.program.motion_program import Motions, led_around
from planner.motion.program.rows import Clearances
from planner.motion.program.unknowns import MotionTask
from planner.motion.upright import KNOT_SHARES, Upright, max_tilt_rad
from planner.splines import Sketch
from planner.trajectory import Trajectory

DEFAULT_MARGIN_M = 0.005
"""Distance between samples and obstacles, so that the motion between samples is clear too."""

TIMEOUT_S = 5.0
"""Maximum duration of a search; a wall on the table takes a tenth of a second."""

BETWEEN = (0.25, 0.5, 0.75)
"""Fractions of the tip's line at which an upright motion is guessed through sampled solutions."""

RISES_M, STRIDE = (0.1, 0.2, 0.3, 0.4), 0.05
"""Heights above start and goal over which an upright motion is tried; and the minimum step on the
way up, as a fraction of it."""


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
        q_start: shape (7,), rad, inside the limits; of both arms (14,), the left one first.
        q_goal: shape (7,) or (14,), rad, inside the limits.
        limits: of these joints.
        context: the surroundings of the arm, or of both (`context_of_both`).
        is_clear: judges whole motions; only a motion that it accepts is returned. By default, the
            proof that a motion keeps the context's margin.
        rng: source of random numbers; the same ones give the same motion, unless the time expires.
            By default, always the same.
        timeout_s: maximum duration of the search for paths, of each arm; optimising them takes
            additional time. With `upright`, no further guess of the motion is optimised after it.
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
            invalid, a joint is too slow for any motion, or both arms are to stay upright.
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
        raise MotionError(f"the limits are of {ends.shape[1]} joints; {context.joints} move")
    if upright is not None and len(context.arms) > 1:
        raise MotionError("upright is of one arm's tip; both arms move")
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
    search = Search(straight, limits, context, judge, margin_m, seeds, timeout_s, straight.duration)
    return search.of_both() if len(context.arms) > 1 else search.fastest()


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
    upright_program, obstacles = program(len(limits.names), keeps_upright=True), None
    for share in KNOT_SHARES:
        task = MotionTask(ends[0], q_goal=ends[1], tilt=upright.at_knots(share))

        def solved(
            sketches: Sequence[Sketch], near: Clearances | None, task: MotionTask = task
        ) -> Motions | None:
            return upright_program.solve(sketches, task, arm, limits, near)

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
        yield through(_quickest(arm, straight, line), limits)
    top_m = max(T.translation[2] for T in tips)
    for rise_m in RISES_M:
        ways = []
        for q, T in zip((straight.q_start, straight.q_goal), tips, strict=True):
            line = StraightLine(T, raised(T, top_m + rise_m - T.translation[2]))
            ways.append([q, *follow(arm, limits, q, line, fractions, min_stride=STRIDE).qs])
        up, down = ways
        if len(up) == len(down) == 1 + len(fractions):
            yield through(np.array([*up, *down[::-1]]), limits)


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
