"""Time-optimal motion from one joint state to another, by Ruckig.

Ruckig (Berscheid and Kroeger 2021) finds the fastest motion under limits on velocity, acceleration
and jerk. It hardly checks its input, so everything is checked before: wrong sizes and NaN make it
read out of bounds, and unset limits count as infinite. The library ignores its position limits, so
the exact extrema of the result are compared with ours.

Between moving states each joint is planned separately, with limits that are wider by rounding, and
compared with the closed forms of `joint_profile`, which explains why. Then all joints get the
duration of the slowest.
"""

from __future__ import annotations

import contextlib
import logging
import re
from collections.abc import Iterator
from itertools import pairwise, starmap
from typing import NamedTuple

import numpy as np
import ruckig
from numpy.typing import ArrayLike

from baxter_kin import JointLimits
from baxter_kin.display import degrees_hint
from baxter_kin.errors import ConfigurationError
from baxter_kin.validation import FloatArray, expect, finite_array
from planner.errors import MotionError, TrajectoryError
from planner.motion.joint_profile import (
    ROUNDING,
    AxisState,
    Profile,
    Rates,
    corrected,
    direct,
    through_rest,
)
from planner.trajectory import CONTINUITY_TOLERANCE, JointState, Trajectory, joined

MIN_SEGMENT_S = 1e-12
"""Minimum duration of a phase; shorter ones are due to Ruckig's rounding and are dropped."""

MAX_MOTION_S = 7.6e3
"""Maximum duration of a motion that Ruckig computes."""

_TOO_LONG = f"it takes longer than {MAX_MOTION_S:g} s"
_TOO_LONG_CODE = "-101 "
"""Ruckig's result code for that, which its Python binding does not know."""

GOAL_TOLERANCE_RAD = CONTINUITY_TOLERANCE
"""Maximum rounding error of the goal of Ruckig's motion, which is then made exact."""

POSITION_TOLERANCE_RAD = 1e-9
"""Maximum violation of the position limits by rounding."""

RATIO_TOLERANCE = ROUNDING
"""Maximum violation of a limit of velocity, acceleration or jerk by rounding, relative to the
limit."""

_WIDENING = 1e-12, 0.5 * RATIO_TOLERANCE, 0.99 * RATIO_TOLERANCE
"""Relative widening of the limits between moving states; the first is enough for most.

A state sampled from a time-optimal motion lies on the boundary of what can be reached in the
remaining time: rounding decides on which side, and on the wrong side the fastest motion may take
seconds longer. Under wider limits the state lies inside. Where a motion needs the second, its
samples may need the third."""

_DELAYS_S = 0.0, 1e-9, 1e-8, 1e-7
"""Delays that are tried where Ruckig finds no profile of a given duration near its shortest."""

_END_TOLERANCE = 0.2 * CONTINUITY_TOLERANCE
"""Maximum error of a joint, in rad and rad/s, because it ends slightly before the others."""

_EXACT = 1e-11
"""Maximum error of a profile at its goal, in rad, rad/s and rad/s^2; Ruckig accepts 1e-8."""

_MIN_KNOT_GAP_S = 1e-14
"""Minimum distance of knots of several joints; closer ones are merged. Merging more distant ones
would matter at the end of a long motion: a jerk that lasts too long by dt moves the end by
j dt t^2 / 2."""

_MAX_ROUNDS = 50
"""Maximum number of times that the duration is raised before each joint passes through rest; seven
joints need a few."""

_MIN_GAIN_S = 1e-7
"""Minimum gain of a profile that is preferred to one that is closer to the required limits."""


ROUNDING_RAD = 1e-6
"""Maximum violation of the position limits by a start or goal that is moved inside silently."""

MAX_CLIP_RAD = 0.1
"""Maximum distance of a real arm from its limits, as of tucked arms."""

_LOG = logging.getLogger(__name__)


def plan_joint_move(
    q_start: ArrayLike,
    q_goal: ArrayLike,
    limits: JointLimits,
    *,
    v_start: ArrayLike | None = None,
    a_start: ArrayLike | None = None,
    v_goal: ArrayLike | None = None,
    a_goal: ArrayLike | None = None,
    clip_start: bool = False,
) -> Trajectory:
    """The fastest motion between two joint states; from rest to rest by default.

    The slowest joint determines the duration, and all joints end together. From rest to rest they
    also move in proportion, along a straight line in joint space, where the limits allow that in
    the same time.

    A velocity or acceleration that exceeds its limit by at most `RATIO_TOLERANCE` of the limit is
    reduced to it, and so is a velocity that would exceed it once the acceleration has reached zero.
    The motion begins and ends in these states, and its rates exceed no limit by more than the same
    share. Planning repeatedly from samples of the previous motion is therefore possible.

    Args:
        q_start: shape (n,), rad, inside the limits.
        q_goal: shape (n,), rad, inside the limits.
        limits: of those n joints.
        v_start: shape (n,), rad/s; zero by default, as the next three.
        a_start: shape (n,), rad/s^2.
        v_goal: shape (n,), rad/s.
        a_goal: shape (n,), rad/s^2.
        clip_start: whether a start up to `MAX_CLIP_RAD` outside the limits is moved to them, with a
            warning in the log, instead of refused; a start outside by at most `ROUNDING_RAD` always
            is, without a warning.

    Raises:
        ConfigurationError: when a position has another shape, is not finite or outside the limits.
        MotionError: when a velocity or acceleration is malformed or above its limit, or when no
            motion inside the limits joins the states within `MAX_MOTION_S`.
    """
    expect(limits, JointLimits, "limits", MotionError)
    q_first = checked_start(q_start, limits, clip_start=clip_start)
    start = _checked_state("start", q_first, v_start, a_start, limits)
    goal = _checked_state("goal", q_goal, v_goal, a_goal, limits)
    if _same(start, goal):
        return _instant(goal, limits)
    _refuse_endless(start, goal, limits)
    if np.any([start.v, start.a, goal.v, goal.a]):
        trajectory = _between_moving_states(start, goal, limits)
    else:
        profile = _solved(_problem(start, goal, limits), limits.names)
        trajectory = _trajectory(profile, start, goal, limits)
    _check_bounds(trajectory)
    return trajectory


def checked_start(
    q: ArrayLike, limits: JointLimits, what: str = "q_start", *, clip_start: bool = False
) -> FloatArray:
    """The start of a motion, moved inside the limits, shape (n,), rad.

    Args:
        q: initial configuration, shape (n,), rad.
        limits: of those n joints.
        what: name of `q` in messages.
        clip_start: whether a start up to `MAX_CLIP_RAD` outside the limits is moved to them, with a
            warning in the log; a start outside by at most `ROUNDING_RAD` always is, without one.
    """
    clip_rad = MAX_CLIP_RAD if expect(clip_start, bool, "clip_start", MotionError) else 0.0
    angles = finite_array(q, (len(limits.names),), what, ConfigurationError)
    outside = limits.violations(angles, ROUNDING_RAD)
    beyond_rad = float(np.maximum(limits.q_min - angles, angles - limits.q_max).max())
    if beyond_rad > clip_rad + ROUNDING_RAD:
        raise ConfigurationError(
            f"{what} is outside the joint limits: {'; '.join(outside)}, by {beyond_rad:.3g} rad at "
            f"most; move the arm inside: clip_start=True plans from the limits where it is up to "
            f"{MAX_CLIP_RAD:g} rad outside{degrees_hint(*angles)}"
        )
    if outside:
        _LOG.warning(
            "%s is outside the joint limits by up to %.3g rad, so the plan starts at the limits: "
            "%s; move the arm there first",
            what,
            beyond_rad,
            "; ".join(outside),
        )
    return limits.check(angles, what, clip_rad + ROUNDING_RAD)


def rest_to_rest_s(displacement: FloatArray, limits: JointLimits) -> FloatArray:
    """Durations of the fastest motions from rest to rest, shape (...,), s.

    Those of `plan_joint_move`, a hundred times faster and vectorised. One joint accelerates,
    cruises and brakes, with each change of acceleration at full jerk. Short motions reach neither
    the maximum acceleration nor velocity, longer ones the former, long ones both (Biagiotti and
    Melchiorri, "Trajectory Planning for Automatic Machines and Robots", Springer 2008, section
    3.4). The slowest joint determines the duration.

    Args:
        displacement: of the joints, shape (..., n), rad.
        limits: of those n joints.
    """
    way = np.abs(displacement)
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
    position = limits.check(q, f"q_{which}", ROUNDING_RAD)
    velocity = _checked_rate(f"v_{which}", v, limits.v_max, limits.names)
    acceleration = _checked_rate(f"a_{which}", a, limits.a_max, limits.names)
    return JointState(position, velocity, acceleration)


def _checked_rate(
    what: str, rate: ArrayLike | None, bound: FloatArray, names: tuple[str, ...]
) -> FloatArray:
    if rate is None:
        return np.zeros(len(names))
    array = finite_array(rate, (len(names),), what, MotionError)
    for i in np.flatnonzero(np.abs(array) > bound * (1.0 + RATIO_TOLERANCE)):
        raise MotionError(
            f"{what} asks {array[i]:.12g} of {names[i]}, whose limit is {bound[i]:g}; slow it down"
        )
    return array


def _problem(start: JointState, goal: JointState, limits: JointLimits) -> ruckig.InputParameter:
    """Ruckig's problem; in proportion where the limits allow that in the same time."""
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
    problem.synchronization = ruckig.Synchronization.Phase
    return problem


class _Joint(NamedTuple):
    """The task of one joint between moving states."""

    start: AxisState
    goal: AxisState
    rates: Rates

    @classmethod
    def moved_inside(cls, start: AxisState, goal: AxisState, rates: Rates) -> _Joint:
        """The task, with states that exceed a limit by rounding moved inside it."""
        widest = rates.widened(_WIDENING[-1])
        goal_backwards = widest.moved_inside(goal.reversed())
        return cls(widest.moved_inside(start), goal_backwards.reversed(), rates)

    def fastest(self, min_duration_s: float = 0.0, soon_enough_s: float = 0.0) -> Profile:
        """The fastest profile found.

        The first of `direct`, Ruckig's under the narrower and under the wider limits, and
        `through_rest`, unless a later one is faster.

        Args:
            min_duration_s: minimum duration.
            soon_enough_s: a profile of at most this duration is returned even if another is faster.
        """
        profiles = []
        min_s = max(self.rates.min_duration_s(self.start, self.goal), min_duration_s, soon_enough_s)
        for profile in self._candidates(min_duration_s):
            if profile.duration <= min_s + _MIN_GAIN_S:
                return profile
            profiles.append(profile)
        min_s = min(profile.duration for profile in profiles)
        return next(profile for profile in profiles if profile.duration <= min_s + _MIN_GAIN_S)

    def _candidates(self, min_duration_s: float) -> Iterator[Profile]:
        shortest = direct(*self)
        if shortest is not None and shortest.duration >= min_duration_s - self.same_time_s:
            yield shortest
        for widening in _WIDENING:
            profile = self._by_ruckig(self.rates.widened(widening), min_duration_s)
            if profile is not None:
                yield profile
        yield through_rest(*self, min_duration_s)

    def lasting(self, duration: float, profile: Profile) -> Profile:
        """A profile of at least `duration`, given a shorter one."""
        stretched = self.stretched(duration, profile)
        return stretched if self._fits(stretched, duration) else self.fastest(duration)

    def stretched(self, duration: float, profile: Profile) -> Profile:
        """The profile, slightly lengthened if it can be corrected to that."""
        if duration - profile.duration > _MIN_GAIN_S:
            return profile
        exact = corrected(profile, self.start, self.goal, duration)
        return exact if self._fits(exact, duration) else profile

    @property
    def same_time_s(self) -> float:
        """Maximum time by which the joint may end before the others, within the tolerance."""
        return _END_TOLERANCE / max(self.rates.v, self.rates.a)

    def _by_ruckig(self, rates: Rates, min_duration_s: float) -> Profile | None:
        """Ruckig's profile; None where it finds none, or one that does not fit."""
        problem = ruckig.InputParameter(1)
        problem.current_position, problem.target_position = [self.start.q], [self.goal.q]
        problem.current_velocity, problem.target_velocity = [self.start.v], [self.goal.v]
        problem.current_acceleration, problem.target_acceleration = [self.start.a], [self.goal.a]
        problem.max_velocity, problem.max_acceleration = [rates.v], [rates.a]
        problem.max_jerk = [rates.j]
        for delay_s in _DELAYS_S if min_duration_s else _DELAYS_S[:1]:
            if min_duration_s:
                problem.minimum_duration = min_duration_s + delay_s
            with contextlib.suppress(MotionError):
                (phases,) = _solved(problem, ("",)).profiles[0]
                lengths_s = tuple(
                    t if t > MIN_SEGMENT_S else 0.0 for t in (*phases.brake.t, *phases.t)
                )
                profile = Profile(lengths_s, (*phases.brake.j, *phases.j))
                if self._miss(profile) > _EXACT:
                    profile = corrected(profile, self.start, self.goal)
                if self._fits(profile, min_duration_s):
                    return profile
        return None

    def _fits(self, profile: Profile, min_duration_s: float) -> bool:
        in_time = min_duration_s - self.same_time_s <= profile.duration <= MAX_MOTION_S
        return (
            in_time and self._miss(profile) <= _EXACT and profile.is_within(self.rates, self.start)
        )

    def _miss(self, profile: Profile) -> float:
        return max(abs(x - y) for x, y in zip(profile.end(self.start), self.goal, strict=True))


def _between_moving_states(start: JointState, goal: JointState, limits: JointLimits) -> Trajectory:
    rates = zip(limits.v_max.tolist(), limits.a_max.tolist(), limits.j_max.tolist(), strict=True)
    joints = [
        _Joint.moved_inside(*joint)
        for joint in zip(_by_joint(start), _by_joint(goal), starmap(Rates, rates), strict=True)
    ]
    profiles = _in_the_same_time(joints)
    duration = max(profile.duration for profile in profiles)
    if duration > MAX_MOTION_S:
        raise MotionError(f"no motion under the limits: {_TOO_LONG}")
    start, goal = (
        JointState(*np.array(states).T)
        for states in ([x.start for x in joints], [x.goal for x in joints])
    )
    if duration <= MIN_SEGMENT_S:
        return _instant(goal, limits)
    phases = [(np.cumsum([0.0, *p.lengths_s]), np.array([*p.jerks, 0.0])) for p in profiles]
    knots = _merged([begins for begins, _ in phases], duration, shortest_s=_MIN_KNOT_GAP_S)
    middles = (knots[:-1] + knots[1:]) / 2
    states = []
    for joint, profile, (begins, jerks) in zip(joints, profiles, phases, strict=True):
        # of the phase that follows a knot: its state counts through a segment that may be long
        i = np.searchsorted(begins, [*middles, duration], side="right") - 1
        q, v, a = np.array(list(profile.states(joint.start))).T[:, i]
        t, j = knots - begins[i], jerks[i]
        states.append((q + t * (v + t * (a / 2 + t * j / 6)), v + t * (a + t * j / 2), a + t * j))
    at_knots = JointState(*np.array(states).transpose(1, 2, 0))
    return _exact_trajectory(knots, at_knots, phases, (start, goal), limits)


def _by_joint(state: JointState) -> list[AxisState]:
    return list(starmap(AxisState, np.transpose(state).tolist()))


def _in_the_same_time(joints: list[_Joint]) -> list[Profile]:
    """The fastest profiles found that end together.

    A joint may be unable to take slightly longer than its fastest motion without reversing; then it
    takes much longer, and the others wait for it.
    """
    profiles = []
    duration = 0.0
    for joint in joints:
        profiles.append(joint.fastest(soon_enough_s=duration))
        duration = max(duration, profiles[-1].duration)
    for _ in range(_MAX_ROUNDS):
        duration = max(profile.duration for profile in profiles)
        last_s = [duration - joint.same_time_s for joint in joints]
        early = [i for i, p in enumerate(profiles) if p.duration < last_s[i]]
        if not early:
            pairs = zip(joints, profiles, strict=True)
            return [joint.stretched(duration, profile) for joint, profile in pairs]
        for i in early:
            profiles[i] = joints[i].lasting(duration, profiles[i])
    duration = max(p.duration for p in (*profiles, *starmap(through_rest, joints)))
    return [through_rest(*joint, duration) for joint in joints]


def _instant(state: JointState, limits: JointLimits) -> Trajectory:
    """The motion of zero duration."""
    none = np.zeros((0, len(limits.names)))
    return Trajectory(limits, np.zeros(1), state.q[None], state.v[None], state.a[None], none)


def _refuse_endless(start: JointState, goal: JointState, limits: JointLimits) -> None:
    min_s = np.abs(goal.q - start.q) / limits.v_max
    slowest = int(min_s.argmax())
    if min_s[slowest] > MAX_MOTION_S:
        raise MotionError(
            f"{limits.names[slowest]} needs at least {min_s[slowest]:.4g} s at "
            f"{limits.v_max[slowest]:.4g} rad/s; motions of up to {MAX_MOTION_S:g} s are "
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
    if profile.duration > MAX_MOTION_S:  # Ruckig itself refuses only for several joints
        raise MotionError(f"no motion under the limits: {_TOO_LONG}")
    return profile


def _reason(cause: Exception, names: tuple[str, ...]) -> str:
    """The first line of Ruckig's message, with the joint's name."""
    if str(cause).startswith(_TOO_LONG_CODE):
        return _TOO_LONG
    first_line = str(cause).strip().splitlines()[0].removeprefix("[ruckig] ")
    return re.sub(r"\b(?:DoF|dof:) (\d+)", lambda number: names[int(number[1])], first_line)


def _trajectory(
    profile: ruckig.Trajectory, start: JointState, goal: JointState, limits: JointLimits
) -> Trajectory:
    if profile.duration <= MIN_SEGMENT_S:  # the states differ by rounding, if at all
        return _instant(goal, limits)
    joints = [_phases(joint) for joint in profile.profiles[0]]
    knots = _merged([begins for begins, _ in joints], profile.duration)
    q, v, a = np.array([profile.at_time(t) for t in knots.tolist()]).swapaxes(0, 1)
    return _exact_trajectory(knots, JointState(q, v, a), joints, (start, goal), limits)


def _exact_trajectory(
    knots: FloatArray,
    states: JointState,
    phases: list[tuple[FloatArray, FloatArray]],
    ends: tuple[JointState, JointState],
    limits: JointLimits,
) -> Trajectory:
    """The motion through states at the knots, with exact start and goal."""
    q, v, a = states
    start, goal = ends
    middles = (knots[:-1] + knots[1:]) / 2
    j = np.array(
        [jerks[np.searchsorted(begins, middles, side="right") - 1] for begins, jerks in phases]
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
    """When each phase of constant jerk of one joint begins, shape (10,), and that jerk.

    Up to two braking phases precede the seven; there is no jerk after the last.
    """
    lasting = [*profile.brake.t, *profile.t]
    jerks = [*profile.brake.j, *profile.j, 0.0]
    return np.cumsum([0.0, *lasting]), np.array(jerks)


def _merged(
    times: list[FloatArray], duration: float, *, shortest_s: float = MIN_SEGMENT_S
) -> FloatArray:
    """All phase boundaries in order, merged within rounding; 0 and the end are kept."""
    knots = [0.0]
    for t in np.unique(np.concatenate(times)).tolist():
        if t - knots[-1] > shortest_s and duration - t > shortest_s:
            knots.append(t)
    return np.array([*knots, duration])


def _check_bounds(trajectory: Trajectory) -> None:
    """Raise an error where boundary states near a limit force the motion to overshoot it."""
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
