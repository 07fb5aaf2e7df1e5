"""The fastest motion along a path under limits on velocity, acceleration and jerk.

That is a nonlinear program for a spline s(t) and its duration. Near a motion it is a linear one,
which is solved again and again (successive linear programming: Palacios-Gomez, Lasdon and Engquist,
Management Science 28(10), 1982). A minimum-time motion lies in a corner of its constraints, so this
converges as fast as Newton's method does. Coarse segments are halved on the way.

Between ends at rest any motion that is slowed down is inside the limits, so every iterate is one.
"""

from __future__ import annotations

import math

import numpy as np

from baxter_kin import JointLimits
from baxter_kin.arrays import Vector
from baxter_kin.errors import expect
from planner.errors import MotionError
from planner.path_motion import MARGIN, PathMotion, PathTask
from planner.straight_path import PathState, StraightPath
from planner.timing import POSITION_TOLERANCE_RAD, RATIO_TOLERANCE, plan_joint_move
from planner.trajectory import Trajectory

SEGMENTS = 24
"""How many a motion has at first, of equal duration."""

GAIN = 1e-4
"""Relative gain of time at which the search ends."""

COARSE_GAIN = 1e-2
"""Relative gain at which the segments are fine-tuned."""

LEAST_WAY = 1e-12
"""Fractions of a path closer than this are the same."""

_ITERATIONS = 40
_SAMPLES = 65
_LEAST_SLOPE = 1e-12
_BEYOND = 1.001
_SHARES = (1.0, 0.5, 0.25, 0.125, 0.0625)
_RELAXATIONS = (0.0, 0.5, 0.9, 1.0)
_BOLDNESS = (1.0, 2.0, 4.0, 8.0, 16.0)


def plan_path_move(
    path: StraightPath,
    limits: JointLimits,
    *,
    start: PathState | None = None,
    end: PathState | None = None,
) -> Trajectory:
    """The fastest motion along a path, never backwards; from rest to rest unless said otherwise.

    By `scripts/straight_optimum.py` it takes 0.1 % longer than the optimum for a descent of 15 cm,
    and at most 0.7 % longer for all other moves there. It has 24 to some 60 segments.

    Args:
        path: where the joints go.
        limits: of those joints.
        start: where on the path and how fast it begins; at rest at 0 when not given.
        end: where and how fast it ends; at rest at 1 when not given.

    Raises:
        MotionError: when the limits are of other joints, when an end is not on the path, is not
            after the start or asks more of a joint than its limits, or when no motion inside the
            limits joins both.
    """
    expect(path, StraightPath, "path", MotionError)
    names = expect(limits, JointLimits, "limits", MotionError).names
    if names != path.arm.joint_names:
        raise MotionError(f"the limits are for {names}, the path is for {path.arm.joint_names}")
    task = PathTask(path, limits, *_checked_ends(start, end))
    for which, state in (("start", task.start), ("end", task.end)):
        _check_rates(which, state, task)
    if _is_nothing(task):
        return Trajectory.stay(path.at(task.start.s).q, limits)
    trajectory = _fastest(_first_guess(task)).trajectory()
    _check_bounds(trajectory)
    return trajectory


def _fastest(motion: PathMotion) -> PathMotion:
    """The fastest motion near one; slower than the optimum only where the segments are coarse."""
    for _ in range(_ITERATIONS):
        ahead = _improved(motion)
        if ahead is None:
            break
        gain = abs(math.log(_cost(ahead) / _cost(motion)))
        motion = ahead
        finer = motion.refined() if gain < COARSE_GAIN else None
        if finer is not None:
            motion = finer
        elif gain < GAIN and _is_inside(motion):
            break
    if not _is_inside(motion):
        raise MotionError(_too_fast(motion.task))
    return motion


def _improved(motion: PathMotion) -> PathMotion | None:
    """The best of several shares of the step that the linear program proposes."""
    change = _best_change(motion)
    if change is None:
        return None
    cost, tried = _cost(motion), []
    for share in _SHARES:
        tried.append(motion.changed(share * change[0], share * change[1]))
        if _cost(tried[-1]) <= cost * (1.0 + GAIN):
            break
    best = min(tried, key=_cost)
    is_worse = _is_inside(motion) and _cost(best) > cost
    return motion if is_worse else best


def _best_change(motion: PathMotion) -> tuple[Vector, float] | None:
    """Of the coefficients and log(duration); where limits cannot be kept at once, towards them."""
    above = max(0.0, float(np.abs(motion.ratios).max()) - 1.0)
    for relaxation in _RELAXATIONS if above > MARGIN else (0.0,):
        change = motion.program(relaxation * above).solved()
        if change is not None:
            return change
    return None


def _cost(motion: PathMotion) -> float:
    """The time it would take inside the limits."""
    return motion.duration * max(1.0, motion.excess)


def _is_inside(motion: PathMotion) -> bool:
    return motion.excess <= 1.0 + MARGIN


def _first_guess(task: PathTask) -> PathMotion:
    """The fastest motion of s alone, under limits that hold for the whole path or are bolder."""
    knots = np.linspace(0.0, 1.0, SEGMENTS + 1)
    for boldness in _BOLDNESS:
        try:
            guess = _motion_of_s(task, boldness)
        except MotionError:  # the way is too short for such low limits
            continue
        s = guess.sample(np.minimum(knots * guess.duration, guess.duration)).q[:, 0]
        return PathMotion.through(task, knots, s, guess.duration)
    if not task.is_from_rest_to_rest:
        raise MotionError(_too_fast(task))
    # limits too far apart for exact arithmetic: the shape of least jerk does for a start
    shape = knots**3 * (10.0 - 15.0 * knots + 6.0 * knots**2)
    return PathMotion.through(task, knots, task.start.s + (task.end.s - task.start.s) * shape, 1.0)


def _motion_of_s(task: PathTask, boldness: float) -> Trajectory:
    (start, end), limits = (task.start, task.end), task.limits
    slope = np.abs(task.path.at(np.linspace(start.s, end.s, _SAMPLES)).dq).max(axis=0)
    slope = slope + _LEAST_SLOPE
    fastest = _BEYOND * max(start.speed_per_s, end.speed_per_s)
    hardest = _BEYOND * max(abs(start.acceleration_per_s2), abs(end.acceleration_per_s2))
    of_s = JointLimits(
        names=("s",),
        q_min=np.array([start.s]),
        q_max=np.array([end.s]),
        v_max=np.array([max(float((limits.v_max / slope).min()), fastest)]),
        a_max=np.array([max(boldness * float((limits.a_max / slope).min()), hardest)]),
        j_max=np.array([boldness * float((limits.j_max / slope).min())]),
    )
    return plan_joint_move(
        [start.s],
        [end.s],
        of_s,
        v_start=[start.speed_per_s],
        a_start=[start.acceleration_per_s2],
        v_goal=[end.speed_per_s],
        a_goal=[end.acceleration_per_s2],
    )


def _checked_ends(start: PathState | None, end: PathState | None) -> tuple[PathState, PathState]:
    first = PathState(0.0) if start is None else expect(start, PathState, "start", MotionError)
    last = PathState(1.0) if end is None else expect(end, PathState, "end", MotionError)
    if last.s < first.s:
        raise MotionError(
            f"the end at s = {last.s:g} is before the start at {first.s:g}; reverse the path"
        )
    return first, last


def _check_rates(which: str, state: PathState, task: PathTask) -> None:
    joints, limits = task.path.joint_state(state), task.limits
    for what, rates, bound in (
        ("rad/s", joints.v, limits.v_max),
        ("rad/s^2", joints.a, limits.a_max),
    ):
        i = int(np.argmax(np.abs(rates) / bound))
        if abs(rates[i]) > bound[i] * (1.0 + RATIO_TOLERANCE):
            raise MotionError(
                f"the {which} of the path motion asks {rates[i]:.6g} {what} of {limits.names[i]}, "
                f"whose limit is {bound[i]:.6g}; slow it down by a factor of "
                f"{abs(rates[i]) / bound[i]:.4g}"
            )


def _is_nothing(task: PathTask) -> bool:
    if not task.path.line.is_point and task.end.s - task.start.s >= LEAST_WAY:
        return False
    if not task.is_from_rest_to_rest:
        raise MotionError(
            f"there is no way from s = {task.start.s:g} to {task.end.s:g} on a line of "
            f"{task.path.length_m:.3g} m, so nothing can move along it; start and end at rest"
        )
    return True


def _too_fast(task: PathTask) -> str:
    start, end = (
        f"{x.speed_per_s:.4g} 1/s and {x.acceleration_per_s2:.4g} 1/s^2 at s = {x.s:.4g}"
        for x in (task.start, task.end)
    )
    return (
        f"no motion under the limits leads along the path from {start} to {end}: the way of "
        f"{task.path.length_m * (task.end.s - task.start.s):.4g} m between is too short for that "
        "change of speed; start or end slower"
    )


def _check_bounds(trajectory: Trajectory) -> None:
    """Next to an end in motion a velocity may still overshoot; next to a limit, a position."""
    ratios = trajectory.peak_ratios()
    if max(ratios) > 1.0 + RATIO_TOLERANCE:
        raise MotionError(
            f"the ends force the motion over its limits: velocity {ratios.velocity:.6g} x, "
            f"acceleration {ratios.acceleration:.6g} x, jerk {ratios.jerk:.6g} x; start or end "
            "slower"
        )
    for q in trajectory.position_extrema():
        violations = trajectory.limits.violations(q, POSITION_TOLERANCE_RAD)
        if violations:
            raise MotionError(f"the motion leaves the joint limits: {'; '.join(violations)}")
