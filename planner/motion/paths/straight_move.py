"""Straight-line motion of the tip at the joints' own limits, as a motion program of one phase."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin import Arm, IKService, JointLimits
from baxter_kin.display import millimetres_hint
from baxter_kin.frames import PoseLike
from baxter_kin.ik import sample_solutions
from baxter_kin.ik.reach.bound import ReachBound
from baxter_kin.validation import FloatArray, expect, finite_scalar, whole_scalar
from planner.errors import MotionError, StraightMoveError
from planner.motion.joint_move import (
    checked_start,
    plan_joint_move,
    rest_to_rest_s,
    stopping_at,
)
from planner.motion.paths.straight_line import (
    DEFAULT_TOLERANCE,
    LineTolerance,
    StraightLine,
    checked_line_tolerance,
    intervals_of,
    is_on_line,
    knot_tolerance,
)
from planner.motion.program.guess import LineFollowed, bent_to, guess_along
from planner.motion.program.motion_program import MotionProgram
from planner.motion.program.unknowns import MotionTask, Phase
from planner.trajectory import Trajectory

MIN_INTERVALS = 20
"""Minimum number of intervals on a line."""

MAX_HALVINGS = 3
"""Maximum number of times that intervals are halved when the tip leaves its line between knots."""

MAX_JOINT_LINE = 1e-4
"""Lines up to this length, in m and rad combined, are straight in joint space except near
singularities."""

MAX_OTHERS, TURNS, MIN_DIFFERENCE_RAD, MAX_TIME_RATIO = 4, 192, 0.12, 0.99
"""Maximum number of other solutions of the goal that are tried; number of sampled angles of s0;
minimum distance of these solutions in some joint; maximum ratio of times that is an improvement."""

LIMIT_TOLERANCE_RAD = 1e-6
"""Maximum distance from a limit of a joint that counts as being there."""


def plan_straight_move(
    arm: Arm,
    q_start: ArrayLike,
    T_base_goal: PoseLike,
    limits: JointLimits,
    *,
    speed_start_m_s: float = 0.0,
    acceleration_start_m_s2: float = 0.0,
    speed_end_m_s: float = 0.0,
    acceleration_end_m_s2: float = 0.0,
    line_tolerance: LineTolerance = DEFAULT_TOLERANCE,
    fineness: int = 1,
    clip_start: bool = False,
) -> Trajectory:
    """The fastest motion that takes the tip along a straight line; from rest to rest by default.

    The tip's position stays on the line from its pose at `q_start` to `T_base_goal`, and its
    orientation on the shortest rotation between both, at the same fraction of the way, within the
    tolerance, and at both ends within 1e-8. The arm's self-motion is free; it does not jump between
    IK branches. Other local optima are searched with `IKService`, which may have to be compiled
    first. A line shorter than `straight_line.MIN_LENGTH` (m and rad combined) gives a motion of
    zero duration. Where no fast motion is found, the arm moves from knot to knot of the line.

    Args:
        arm: the arm whose tip moves.
        q_start: initial configuration, shape (7,), rad, inside the limits.
        T_base_goal: final pose of the tip in base; less than half a turn away.
        limits: of the arm's joints.
        speed_start_m_s: initial speed of the tip along the line, not negative.
        acceleration_start_m_s2: initial acceleration of the tip along the line.
        speed_end_m_s: final speed of the tip along the line, not negative.
        acceleration_end_m_s2: final acceleration of the tip along the line.
        line_tolerance: maximum deviation of the tip.
        fineness: multiplies the number of intervals of constant jerk, 1 to 16: more take longer and
            come closer to the optimum.
        clip_start: whether a start up to 0.1 rad outside the limits is moved to them, with a
            warning in the log, instead of refused; a start outside by at most 1e-6 rad always is,
            without a warning.

    Raises:
        ConfigurationError: when `q_start` has another shape, is not finite or outside the limits.
        PoseError: when `T_base_goal` is an invalid pose.
        StraightMoveError: when the line leaves the arm's reach, crosses a singularity, drives a
            joint into a limit, or turns by half a turn; with the fraction of it that least-norm
            steps can follow.
        MotionError: when the limits are of other joints, the ends are too fast, or no motion is
            found.
    """
    names = expect(limits, JointLimits, "limits", MotionError).names
    if names != expect(arm, Arm, "arm", MotionError).joint_names:
        raise MotionError(
            f"the limits are for {', '.join(names)}; the {arm.side} arm has "
            f"{', '.join(arm.joint_names)}"
        )
    tolerance = checked_line_tolerance(line_tolerance)
    q = checked_start(q_start, limits, clip_start=clip_start)
    line = StraightLine(arm.T_base_tip(q), T_base_goal)
    rates = (
        *_rates(line, "start", speed_start_m_s, acceleration_start_m_s2),
        *_rates(line, "end", speed_end_m_s, acceleration_end_m_s2),
    )
    if line.is_point:
        return Trajectory.stay(q, limits)
    task = MotionTask(q, (line,), knot_tolerance(tolerance, (line,)), rates=rates)
    times = whole_scalar(fineness, "fineness", MotionError, least=1, most=16)
    return _planned(arm, limits, line, task, tolerance=tolerance, fineness=times)


def _planned(
    arm: Arm,
    limits: JointLimits,
    line: StraightLine,
    task: MotionTask,
    *,
    tolerance: LineTolerance,
    fineness: int,
) -> Trajectory:
    """The motion of a checked task.

    Optima are local. So the next guess ends in another solution of the goal, as long as there is
    one that the arm could reach sooner than the best known motion, if it could leave the line.
    """
    is_at_rest = not any(task.rates)
    motion = _near(arm, limits, line, task, tolerance=tolerance, fineness=fineness)
    if motion is None:
        ends = "" if is_at_rest else " that has these speeds and accelerations at its ends"
        raise MotionError(
            "no motion inside the limits was found along the line of "
            f"{1e3 * line.length_m:.3g} mm{ends}"
        )
    if not is_at_rest or np.linalg.norm(line.twist) <= MAX_JOINT_LINE:
        return motion
    solutions = sample_solutions(IKService(arm), line.T_base_goal, turns=TURNS)
    min_s, q_tried = rest_to_rest_s(solutions - task.q_start, limits), motion.q_goal
    for _ in range(MAX_OTHERS):
        for q in (q_tried, motion.q_goal):
            min_s[np.abs(solutions - q).max(axis=1) < MIN_DIFFERENCE_RAD] = np.inf
        if min_s.min(initial=np.inf) >= MAX_TIME_RATIO * motion.duration:
            break
        q_tried = solutions[min_s.argmin()]
        other = q_tried, motion.duration
        nearer = _near(arm, limits, line, task, tolerance=tolerance, fineness=fineness, other=other)
        motion = nearer or motion
    return motion


def _near(
    arm: Arm,
    limits: JointLimits,
    line: StraightLine,
    task: MotionTask,
    *,
    tolerance: LineTolerance,
    fineness: int,
    other: tuple[FloatArray, float] | None = None,
) -> Trajectory | None:
    """The motion near least-norm steps, or near a guess with another end if that is faster."""
    rates = task.rates
    intervals, is_at_rest = fineness * intervals_of(line, tolerance, MIN_INTERVALS), not any(rates)
    enters, leaves = any(rates[:2]), any(rates[2:])
    for _ in range(1 + MAX_HALVINGS):
        guess = guess_along(arm, limits, task.q_start, line, intervals, ends_at_rest=True)
        if isinstance(guess, LineFollowed):
            if other is not None:
                return None
            raise _why_not(arm, limits, line, guess)
        if is_at_rest and np.linalg.norm(line.twist) <= MAX_JOINT_LINE:
            motion = plan_joint_move(task.q_start, guess.q[-1], limits)
            if is_on_line(arm, line, motion, tolerance):
                return motion
        _refuse_too_fast(arm, limits, line, task, guess.q[-1])
        phase = Phase(intervals, 0, rests=not leaves, enters=enters, leaves=leaves)
        if other is not None:
            guess = bent_to(guess, *other)
        motions = _program(phase, len(limits.names)).solve([guess], task, arm, limits)
        if other is not None and (
            motions is None or motions[0].duration >= MAX_TIME_RATIO * other[1]
        ):
            return None
        if motions is not None and is_on_line(arm, line, motions[0], tolerance):
            return motions[0]
        if motions is None and not is_at_rest and intervals > fineness * MIN_INTERVALS:
            break
        intervals *= 2
    if is_at_rest and other is None:
        motion = stopping_at(np.concatenate([task.q_start[None], guess.q[1:]]), limits)
        if is_on_line(arm, line, motion, tolerance):
            return motion
    return None


@lru_cache(maxsize=16)
def _program(phase: Phase, joints: int) -> MotionProgram:
    return MotionProgram((phase,), joints)


def _rates(line: StraightLine, which: str, speed: float, acceleration: float) -> FloatArray:
    """First and second time derivative of the line's fraction, shape (2,)."""
    speed = finite_scalar(speed, f"speed_{which}_m_s", MotionError)
    acceleration = finite_scalar(acceleration, f"acceleration_{which}_m_s2", MotionError)
    if speed < 0.0:
        raise MotionError(f"speed_{which}_m_s must not be negative, got {speed:g}")
    if speed == 0.0 and acceleration == 0.0:
        return np.zeros(2)
    backwards = acceleration < 0.0 if which == "start" else acceleration > 0.0
    if speed == 0.0 and backwards:
        raise MotionError(
            f"acceleration_{which}_m_s2 of {acceleration:g} without a speed there leads off the "
            f"{which} of the line"
        )
    if line.length_m <= 0.0 or line.is_point:
        raise MotionError(
            f"the tip turns on the spot, so it has no speed along the line; speed_{which}_m_s and "
            f"acceleration_{which}_m_s2 must be zero"
        )
    return np.array([speed, acceleration]) / line.length_m


def _refuse_too_fast(
    arm: Arm, limits: JointLimits, line: StraightLine, task: MotionTask, q_end: FloatArray
) -> None:
    """Raise an error where even the least-norm joint velocities at an end exceed all limits."""
    for which, q, speed in (("start", task.q_start, task.rates[0]), ("end", q_end, task.rates[2])):
        v = np.linalg.lstsq(arm.jacobian(q), speed * line.twist, rcond=None)[0]
        if np.linalg.norm(v) > np.linalg.norm(limits.v_max):
            i = int(np.argmax(np.abs(v) / limits.v_max))
            raise MotionError(
                f"the {which} of the line asks {abs(v[i]):.3g} rad/s of {limits.names[i]}, whose "
                f"limit is {limits.v_max[i]:g}; slow it down"
            )


def _why_not(
    arm: Arm, limits: JointLimits, line: StraightLine, end: LineFollowed
) -> StraightMoveError:
    """Where the arm left the line, and why."""
    reason = _stopped(arm, limits, end.q)
    proof = ReachBound(arm).proof(line.T_base_goal)
    if proof is not None:
        reason = f"the goal is out of reach, {proof}; {reason}"
    hint = millimetres_hint(*line.T_base_goal.translation)
    return StraightMoveError(end.fraction, f"{reason}{hint}")


def _stopped(arm: Arm, limits: JointLimits, q: FloatArray) -> str:
    for which, bound in (("lower", limits.q_min), ("upper", limits.q_max)):
        at_limit = np.flatnonzero(np.abs(q - bound) <= LIMIT_TOLERANCE_RAD)
        if at_limit.size:
            i = int(at_limit[0])
            return (
                f"{limits.names[i]} runs into its {which} limit of {bound[i]:.6g} rad; start from "
                "another configuration of the arm"
            )
    smallest = float(np.linalg.svd(arm.jacobian(q), compute_uv=False)[-1])
    return (
        "the arm is at a singularity, or so near that its joints would turn too sharply: the "
        f"smallest singular value of its Jacobian is {smallest:.2g} (m, rad)"
    )
