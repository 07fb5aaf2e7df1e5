"""Time-optimal motion from one joint state to another (Ruckig enters here).

Ruckig (Berscheid and Kroeger 2021) finds the fastest motion under limits on velocity, acceleration
and jerk. It checks little of what it is given, so everything is checked before: wrong sizes and
NaN make it read out of bounds, and limits left unset count as infinite. Its position limits are
ignored by the library, so the exact extrema of the result are compared with ours.
"""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
import ruckig
from numpy.typing import ArrayLike

from baxter_kin import JointLimits
from baxter_kin.errors import expect
from baxter_kin.validation import FloatArray, finite_array, float_array
from planner.errors import MotionError, TrajectoryError
from planner.trajectory import CONTINUITY_TOLERANCE, JointState, Trajectory, joined

SHORTEST_SEGMENT_S = 1e-12
"""Phases shorter than this are rounding of Ruckig's and are dropped."""

LONGEST_MOTION_S = 7.6e3
"""Ruckig computes no motion that takes longer."""

_TOO_LONG = f"it takes longer than {LONGEST_MOTION_S:g} s"
_TOO_LONG_CODE = "-101 "
"""Ruckig's result code for that, which its Python binding does not know and stumbles over."""

GOAL_TOLERANCE_RAD = CONTINUITY_TOLERANCE
"""How far Ruckig's motion may miss its goal, by rounding; it then is made to end there exactly."""

POSITION_TOLERANCE_RAD = 1e-9
"""How far a motion may leave the position limits, by rounding."""

RATIO_TOLERANCE = 1e-9
"""How far a velocity, acceleration or jerk may exceed its limit, relative to it, by rounding."""


def plan_joint_move(
    q_start: ArrayLike,
    q_goal: ArrayLike,
    limits: JointLimits,
    *,
    v_start: ArrayLike | None = None,
    a_start: ArrayLike | None = None,
    v_goal: ArrayLike | None = None,
    a_goal: ArrayLike | None = None,
) -> Trajectory:
    """The fastest motion between two joint states; from rest to rest unless said otherwise.

    The slowest joint sets the duration and all joints end together. From rest to rest they also
    move in proportion, along a straight line in joint space, where the limits allow that in the
    same time.

    Args:
        q_start: shape (n,), rad, inside the limits.
        q_goal: shape (n,), rad, inside the limits.
        limits: of those n joints.
        v_start: shape (n,), rad/s; zero when not given, as the next three.
        a_start: shape (n,), rad/s^2.
        v_goal: shape (n,), rad/s.
        a_goal: shape (n,), rad/s^2.

    Raises:
        ConfigurationError: when a position has another shape, is not finite or outside the limits.
        MotionError: when a velocity or acceleration is malformed or above its limit, or when no
            motion inside the limits joins the states within `LONGEST_MOTION_S`.
    """
    expect(limits, JointLimits, "limits", MotionError)
    start = _checked_state("start", q_start, v_start, a_start, limits)
    goal = _checked_state("goal", q_goal, v_goal, a_goal, limits)
    at_rest = not np.any([start.v, start.a, goal.v, goal.a])
    if _same(start, goal):
        return _instant(goal, limits)
    synchronization = ruckig.Synchronization.Phase if at_rest else ruckig.Synchronization.Time
    _refuse_endless(start, goal, limits)
    profile = _solved(_problem(start, goal, limits, synchronization), limits.names)
    trajectory = _trajectory(profile, start, goal, limits)
    _check_bounds(trajectory)
    return trajectory


def rest_to_rest_s(displacement: ArrayLike, limits: JointLimits) -> FloatArray:
    """Durations of the fastest motions from rest to rest, shape (...,), s.

    What `plan_joint_move` takes, a hundred times faster and for many ways at once. One joint
    accelerates, cruises and brakes, each change of acceleration at full jerk. Short ways reach
    neither the greatest acceleration nor velocity, longer ones the first, long ones both (Biagiotti
    and Melchiorri, "Trajectory Planning for Automatic Machines and Robots", Springer 2008, section
    3.4). The slowest joint sets the duration of all.

    Args:
        displacement: of the joints, shape (..., n), rad, finite.
        limits: of those n joints.

    Raises:
        MotionError: when the last axis is none of n finite numbers.
    """
    names = expect(limits, JointLimits, "limits", MotionError).names
    way = np.abs(float_array(displacement, "displacement", MotionError))
    if not way.ndim or way.shape[-1] != len(names) or not np.isfinite(way).all():
        raise MotionError(f"a displacement is {len(names)} finite numbers, got shape {way.shape}")
    v, a, j = limits.v_max, limits.a_max, limits.j_max
    a_top = np.minimum(a, np.sqrt(v * j))  # what velocity leaves room for
    unlimited = 4.0 * np.cbrt(way / (2.0 * j))
    v_top = 0.5 * (np.sqrt((a_top**2 / j) ** 2 + 4.0 * a_top * way) - a_top**2 / j)
    steady = 2.0 * (v_top / a_top + a_top / j)
    cruising = way / v + v / a_top + a_top / j
    needs_less = j * unlimited / 4.0 <= a_top
    joints = np.where(needs_less, unlimited, np.where(v_top <= v, steady, cruising))
    slowest: FloatArray = joints.max(axis=-1)
    return slowest


def stopping_at(corners: FloatArray, limits: JointLimits) -> Trajectory:
    """The fastest motion along straight lines from corner to corner, (m, n), at rest in each."""
    return joined([plan_joint_move(q, q_next, limits) for q, q_next in pairwise(corners)])


def _same(state: JointState, other: JointState) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(state, other, strict=True))


def _checked_state(
    which: str, q: ArrayLike, v: ArrayLike | None, a: ArrayLike | None, limits: JointLimits
) -> JointState:
    position = limits.check(q, f"q_{which}")
    velocity = _checked_rate(f"v_{which}", v, limits.v_max, limits.names)
    acceleration = _checked_rate(f"a_{which}", a, limits.a_max, limits.names)
    return JointState(position, velocity, acceleration)


def _checked_rate(
    what: str, rate: ArrayLike | None, bound: FloatArray, names: tuple[str, ...]
) -> FloatArray:
    if rate is None:
        return np.zeros(len(names))
    array = finite_array(rate, (len(names),), what, MotionError)
    for i in np.flatnonzero(np.abs(array) > bound):
        raise MotionError(
            f"{what} asks {array[i]:g} of {names[i]}, whose limit is {bound[i]:g}; slow it down"
        )
    return array


def _problem(
    start: JointState,
    goal: JointState,
    limits: JointLimits,
    synchronization: ruckig.Synchronization,
) -> ruckig.InputParameter:
    problem = ruckig.InputParameter(len(limits.names))
    problem.current_position = start.q.tolist()
    problem.current_velocity = start.v.tolist()
    problem.current_acceleration = start.a.tolist()
    problem.target_position = goal.q.tolist()
    problem.target_velocity = goal.v.tolist()
    problem.target_acceleration = goal.a.tolist()
    problem.max_velocity = limits.v_max.tolist()
    problem.max_acceleration = limits.a_max.tolist()
    problem.max_jerk = limits.j_max.tolist()
    problem.synchronization = synchronization
    return problem


def _instant(state: JointState, limits: JointLimits) -> Trajectory:
    """The motion of no duration."""
    none = np.zeros((0, len(limits.names)))
    return Trajectory(limits, np.zeros(1), state.q[None], state.v[None], state.a[None], none)


def _refuse_endless(start: JointState, goal: JointState, limits: JointLimits) -> None:
    least_s = np.abs(goal.q - start.q) / limits.v_max
    slowest = int(least_s.argmax())
    if least_s[slowest] > LONGEST_MOTION_S:
        raise MotionError(
            f"{limits.names[slowest]} needs at least {least_s[slowest]:.4g} s at "
            f"{limits.v_max[slowest]:.4g} rad/s; motions of up to {LONGEST_MOTION_S:g} s are "
            "planned: allow more speed"
        )


def _solved(problem: ruckig.InputParameter, names: tuple[str, ...]) -> ruckig.Trajectory:
    profile = ruckig.Trajectory(len(names))
    try:
        result = ruckig.Ruckig(len(names)).calculate(problem, profile)
    except (ruckig.RuckigError, ValueError) as cause:
        raise MotionError(f"no motion under the limits: {_reason(cause, names)}") from cause
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise MotionError(f"no motion under the limits: Ruckig says {result}")
    if profile.duration > LONGEST_MOTION_S:  # Ruckig itself refuses only for several joints
        raise MotionError(f"no motion under the limits: {_TOO_LONG}")
    return profile


def _reason(cause: Exception, names: tuple[str, ...]) -> str:
    """The first line of what Ruckig says, with the joint by its name."""
    if str(cause).startswith(_TOO_LONG_CODE):
        return _TOO_LONG
    first_line = str(cause).strip().splitlines()[0].removeprefix("[ruckig] ")
    return re.sub(r"\b(?:DoF|dof:) (\d+)", lambda number: names[int(number[1])], first_line)


def _trajectory(
    profile: ruckig.Trajectory, start: JointState, goal: JointState, limits: JointLimits
) -> Trajectory:
    if profile.duration <= SHORTEST_SEGMENT_S:  # the states differ by rounding, if at all
        return _instant(goal, limits)
    joints = [_phases(joint) for joint in profile.profiles[0]]
    knots = _merged([begins for begins, _ in joints], profile.duration)
    states = [profile.at_time(t) for t in knots.tolist()]
    q, v, a = np.array(states).swapaxes(0, 1)
    middles = (knots[:-1] + knots[1:]) / 2
    j = np.array(
        [jerks[np.searchsorted(begins, middles, side="right") - 1] for begins, jerks in joints]
    ).T
    miss = float(np.abs(q[-1] - goal.q).max())
    if miss > GOAL_TOLERANCE_RAD:
        raise MotionError(f"Ruckig's motion misses its goal by {miss:.3g} rad")
    q[0], v[0], a[0] = start.q, start.v, start.a
    q[-1], v[-1], a[-1] = goal.q, goal.v, goal.a
    try:
        return Trajectory(limits, knots, q, v, a, j)
    except TrajectoryError as cause:
        raise MotionError(f"the limits leave no room for exact arithmetic: {cause}") from cause


def _phases(profile: ruckig.Profile) -> tuple[FloatArray, FloatArray]:
    """When each of one joint's phases of constant jerk begins, shape (10,), and that jerk.

    Up to two to brake come before the seven; no jerk after the last.
    """
    lasting = [*profile.brake.t, *profile.t]
    jerks = [*profile.brake.j, *profile.j, 0.0]
    return np.cumsum([0.0, *lasting]), np.array(jerks)


def _merged(times: list[FloatArray], duration: float) -> FloatArray:
    """All phase boundaries in order, those closer than rounding made one; 0 and the end stay."""
    knots = [0.0]
    for t in np.unique(np.concatenate(times)).tolist():
        if t - knots[-1] > SHORTEST_SEGMENT_S and duration - t > SHORTEST_SEGMENT_S:
            knots.append(t)
    return np.array([*knots, duration])


def _check_bounds(trajectory: Trajectory) -> None:
    """Near a limit, some boundary states cannot but overshoot it; Ruckig lets them."""
    limits = trajectory.limits
    ratios = trajectory.peak_ratios()
    if max(ratios) > 1.0 + RATIO_TOLERANCE:
        raise MotionError(
            f"the states force the motion over its limits: velocity {ratios.velocity:.6g} x, "
            f"acceleration {ratios.acceleration:.6g} x, jerk {ratios.jerk:.6g} x; start or end "
            "slower"
        )
    for q in trajectory.position_extrema():
        violations = limits.violations(q, POSITION_TOLERANCE_RAD)
        if violations:
            raise MotionError(f"the motion leaves the joint limits: {'; '.join(violations)}")
