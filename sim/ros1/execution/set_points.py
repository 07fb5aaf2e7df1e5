"""Joint set-points for a plan: speed scaling, lead compensation and timing.

The moves between two rests are one motion q(t) of plan time t. At speed s plan time passes s times
as fast as time, so velocities are those of the plan times s. A robot that follows its set-points
late, by a lag T to first order, is where it should be when q + T v is sent in place of q: its joint
obeys T q' = u - q, and u = q + T q' is solved by q itself. That is the lead; it ends at the joint
limits.

Set-points are sent on a grid on the monotonic clock (`Schedule`). A tick that comes late is not
made up by a burst: the next one is the next of the grid that has not passed. Plan time
(`PlanTime`) follows the clock, but by two ticks at most from one set-point to the next, and by one
where more than a tick and `MAX_LATENESS_S` have passed. A busy machine therefore delays the arm but
never makes it jump.

A plan of both arms has one clock, `CommonClock`, from which both arms' set-points are taken. It can
be slowed to rest and go on again: its rate changes smoothly, so that the arms stay on their paths.
At speed s and rate r, a joint accelerates by s^2 r^2 a + s r' v; `ramp_s_for` finds how long the
rate must take from one to zero, so that this stays within the limits.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from baxter_kin.fields import frozen, scalar
from baxter_kin.kinematics.arm import MAX_SPEED_RAD_S
from baxter_kin.validation import FloatArray, expect_all
from planner import Grip, Move, Plan, Trajectory
from planner.motion.response import MAX_LEAD_S, TICK_S
from planner.trajectory import joined
from sim.errors import SimulationError

DEFAULT_SPEED = 0.3

RESERVE = 1.2
"""The robot's cap exceeds the speed that is sent by this factor, so that it does not cut it."""

MIN_RATIO = 0.01

REST_RAD_S = 1e-6
"""Joints slower than this are at rest."""

PEAK_STEP_S = 0.001
"""Step of the search for the greatest speed that is sent."""

MAX_LATENESS_S = 0.02
"""An interval longer than a tick plus this advances by one tick only."""

MAX_STEP_TICKS = 2.0
"""Maximum advance from one set-point to the next."""


@frozen(error=SimulationError, eq=True)
class Pace:
    """How fast a plan is sent.

    Attributes:
        speed: of plan time to time, in (0, 1].
        lead_s: how far the set-points lead along the velocity, 0 .. `MAX_LEAD_S`.

    Raises:
        SimulationError: when a value is no number or outside its range.
    """

    speed: float = scalar(above=0.0, most=1.0, default=DEFAULT_SPEED)
    lead_s: float = scalar(least=0.0, most=MAX_LEAD_S, default=0.0)


class SetPoint(NamedTuple):
    """The set-point of one instant.

    Attributes:
        q_path: where the plan has the arm, shape (7,), rad.
        q_sent: what is sent, shape (7,), rad, within the limits.
    """

    q_path: FloatArray
    q_sent: FloatArray


class SentMotion:
    """Moves without a rest in between, as they are sent.

    Attributes:
        moves: in order; only the last one ends at rest.
        trajectory: all of them, in plan time.
        pace: speed and lead.
        starts_s: plan times at which the moves begin, shape (n,).
    """

    def __init__(self, moves: Sequence[Move], pace: Pace) -> None:
        """Join the moves."""
        self.moves = expect_all(moves, Move, "the moves", SimulationError)
        if not self.moves:
            raise SimulationError("nothing to send: a motion needs at least one move")
        self.trajectory = joined(move.trajectory for move in self.moves)
        self.pace = pace
        durations = [move.trajectory.duration for move in self.moves]
        self.starts_s: FloatArray = np.cumsum([0.0, *durations[:-1]])

    @property
    def duration_s(self) -> float:
        """Duration as it is sent."""
        return self.trajectory.duration / self.pace.speed

    def index_at(self, plan_s: float) -> int:
        """Index of the move that is under way at a plan time."""
        return int(np.searchsorted(self.starts_s, plan_s, side="right")) - 1

    def at(self, plan_s: float, rate: float = 1.0) -> SetPoint:
        """The set-point at a plan time from 0 to the end, which passes `rate` times its speed."""
        state = self.trajectory.sample(min(plan_s, self.trajectory.duration))
        return SetPoint(state.q, self._led(state.q, rate * state.v))

    def peak_speeds(self) -> FloatArray:
        """The greatest speed of each joint from one set-point to the next, shape (7,), rad/s."""
        count = max(2, int(np.ceil(self.duration_s / PEAK_STEP_S)) + 1)
        times = np.linspace(0.0, self.trajectory.duration, count)
        state = self.trajectory.sample(times)
        steps = np.abs(np.diff(self._led(state.q, state.v), axis=0))
        if self.duration_s == 0.0:
            return np.zeros(steps.shape[1])
        peaks: FloatArray = steps.max(axis=0) / (self.duration_s / (count - 1))
        return peaks

    def _led(self, q: FloatArray, v: FloatArray) -> FloatArray:
        limits, pace = self.trajectory.limits, self.pace
        if pace.lead_s == 0.0:
            return q
        led: FloatArray = np.clip(q + pace.lead_s * pace.speed * v, limits.q_min, limits.q_max)
        return led


def slowed(trajectory: Trajectory, speed: float) -> Trajectory:
    """The same path at a speed in (0, 1], as an arm without lag follows it."""
    if speed == 1.0:
        return trajectory
    return Trajectory(
        trajectory.limits,
        trajectory.knots_s / speed,
        trajectory.q,
        speed * trajectory.v,
        speed**2 * trajectory.a,
        speed**3 * trajectory.j,
    )


def motions_of(moves: Iterable[Move], pace: Pace) -> tuple[SentMotion, ...]:
    """Consecutive moves as motions that each end at rest."""
    motions, pending = [], list[Move]()
    for move in moves:
        pending.append(move)
        if float(np.abs(move.trajectory.v[-1]).max()) < REST_RAD_S:
            motions.append(SentMotion(pending, pace))
            pending = []
    return tuple(motions) if not pending else (*motions, SentMotion(pending, pace))


def parts_of(plan: Plan, pace: Pace) -> Iterator[SentMotion | Grip]:
    """Motions as they are sent, and the actions of the fingers between them, in order."""
    for is_grip, steps in groupby(plan, lambda step: isinstance(step, Grip)):
        parts = list(steps)
        if is_grip:
            yield from (step for step in parts if isinstance(step, Grip))
        else:
            yield from motions_of((step for step in parts if isinstance(step, Move)), pace)


def speed_ratio_for(peaks: FloatArray) -> float:
    """The speed ratio at which a Baxter's cap exceeds these peaks by `RESERVE`; 1 at most.

    Args:
        peaks: greatest speeds that are sent, shape (7,), rad/s.
    """
    needed = RESERVE * float((peaks / np.array(MAX_SPEED_RAD_S)).max())
    return min(1.0, max(MIN_RATIO, needed))


def too_fast(peaks: FloatArray) -> tuple[int, ...]:
    """Indices of the joints that a Baxter cannot turn as fast as these peaks, shape (7,), rad/s."""
    return tuple(np.flatnonzero(peaks > np.array(MAX_SPEED_RAD_S)).tolist())


class Schedule:
    """A grid of ticks.

    Attributes:
        due_s: when the next tick is due, on the clock.
        lateness_s: how late the last tick was.
    """

    def __init__(self, now_s: float, tick_s: float = TICK_S) -> None:
        """Begin the grid; the first tick is due now."""
        self._tick_s, self._begin_s, self.due_s, self.lateness_s = tick_s, now_s, now_s, 0.0

    def advance(self, now_s: float) -> float:
        """Go on to the next tick; returns how late the one that has come is."""
        self.lateness_s = max(0.0, now_s - self.due_s)
        passed = math.floor((max(now_s, self.due_s) - self._begin_s) / self._tick_s + 1e-9)
        self.due_s = self._begin_s + (passed + 1) * self._tick_s
        return self.lateness_s


class PlanTime:
    """How far plan time has come, as time passes for the arm.

    Attributes:
        motion_s: so far, as the motion is sent; times the speed it is plan time.
        stood_s: time for which it stood still, in total.
        late_s: by how much the last set-point before the tick that has come was late just then,
            relative to an even stream: what the tick was late, and `stood_s` before it.
    """

    def __init__(self, now_s: float, tick_s: float = TICK_S) -> None:
        """Begin at zero."""
        self._tick_s, self._last_s, self.motion_s = tick_s, now_s, 0.0
        self.stood_s = self.late_s = 0.0

    def advance(self, now_s: float) -> float:
        """Advance to the tick that has come; returns `motion_s`."""
        passed_s = max(0.0, now_s - self._last_s)
        self._last_s = max(now_s, self._last_s)
        self.late_s = self.stood_s + max(0.0, passed_s - self._tick_s)
        is_long = passed_s > self._tick_s + MAX_LATENESS_S
        advance_s = self._tick_s if is_long else min(passed_s, MAX_STEP_TICKS * self._tick_s)
        self.motion_s += advance_s
        self.stood_s += passed_s - advance_s
        return self.motion_s


STEEPEST = 1.5
"""Maximum slope of the rate over the share of the ramp, 3 u^2 - 2 u^3."""

RAMP_STEP_S = 0.01
"""Step of the search for what a ramp adds to accelerations."""

MIN_RAMP_S = 0.2

RESERVE_S = 2.0 * MAX_STEP_TICKS * TICK_S
"""A clock that must rest by a time rests before it, by the time that two late ticks take."""


def ramp_s_for(trajectories: Iterable[Trajectory], speed: float) -> float:
    """How long the rate of a clock must take from one to zero, at any time; infinite if too fast.

    The accelerations of all joints then stay within the limits of their trajectories.

    Args:
        trajectories: all that are sent.
        speed: of plan time to time, in (0, 1].
    """
    ramp_s = MIN_RAMP_S
    for each in trajectories:
        count = max(2, math.ceil(each.duration / RAMP_STEP_S) + 1)
        state = each.sample(np.linspace(0.0, each.duration, count))
        room = each.limits.a_max - speed**2 * np.abs(state.a)
        added = STEEPEST * speed * np.abs(state.v)
        is_fast = added > 0.0
        if (room[is_fast] <= 0.0).any():
            return math.inf
        ramp_s = max(ramp_s, float((added[is_fast] / room[is_fast]).max(initial=0.0)))
    return ramp_s


def slowing_s_for(ramp_s: float, speed: float) -> float:
    """By how much a clock passes at most while it slows to rest, with its reserve, or begins again.

    Args:
        ramp_s: how long the rate takes from one to zero.
        speed: of the clock to time, in (0, 1].
    """
    return speed * (0.5 * ramp_s + RESERVE_S)


class CommonClock:
    """The clock of a plan of both arms, which can be slowed to rest and go on again.

    Attributes:
        time_s: time on the clock, from 0 to the plan's end.
        rate: 1 at full speed, 0 at rest.
        late_s: how late set-points are by now, since the clock last might wait: `PlanTime.late_s`,
            with what it stood still since then.
    """

    def __init__(
        self,
        now_s: float,
        end_s: float,
        speed: float,
        ramp_s: float,
        waits: Sequence[tuple[float, float]] = (),
    ) -> None:
        """Begin at zero and at full speed.

        Args:
            now_s: the time.
            end_s: where the clock ends.
            speed: of the clock to time, in (0, 1].
            ramp_s: how long the rate takes from one to zero, and back.
            waits: intervals of it in which it may wait, so that it may stand still as long as it
                likes.
        """
        self._waits, self._covered_s, self.late_s = tuple(waits), 0.0, 0.0
        self._passed, self._end_s, self._speed, self._ramp_s = PlanTime(now_s), end_s, speed, ramp_s
        self.time_s, self.rate = 0.0, 1.0
        self._share, self._awaited_s = 1.0, math.inf

    @property
    def is_over(self) -> bool:
        """Whether it has come to its end."""
        return self.time_s >= self._end_s

    @property
    def stopping_s(self) -> float:
        """How far it goes on until it rests, if it slows from now on."""
        return self._speed * self._ramp_s * _area(self._share)

    def advance(self, now_s: float, due_s: float = math.inf, *, is_ending: bool = False) -> float:
        """Advance to the tick that has come; returns `time_s`.

        Args:
            now_s: the time.
            due_s: the clock must not pass this; once it slows before it, it goes on when another
                time is given.
            is_ending: whether it slows until it rests.
        """
        before_s = self._passed.motion_s
        passed_s = self._passed.advance(now_s) - before_s
        if self.is_over or self._may_wait():
            self._covered_s, self.late_s = self._passed.stood_s, 0.0
        else:
            self.late_s = self._passed.late_s - self._covered_s
        if due_s - self.time_s <= self.stopping_s + self._speed * RESERVE_S:
            self._awaited_s = due_s
        is_slowing = is_ending or (due_s < math.inf and due_s == self._awaited_s)
        share = self._share + (-passed_s if is_slowing else passed_s) / self._ramp_s
        after = min(max(share, 0.0), 1.0)
        in_ramp_s = abs(after - self._share) * self._ramp_s
        moved_s = self._ramp_s * abs(_area(after) - _area(self._share))
        self._share, self.rate = after, _rate(after)
        moved_s += self.rate * (passed_s - in_ramp_s)
        self.time_s = min(self.time_s + self._speed * moved_s, due_s, self._end_s)
        return self.time_s

    def _may_wait(self) -> bool:
        return any(begin_s <= self.time_s <= end_s for begin_s, end_s in self._waits)


def _rate(share: float) -> float:
    return share**2 * (3.0 - 2.0 * share)


def _area(share: float) -> float:
    """The integral of the rate from zero to a share of the ramp."""
    return share**3 - 0.5 * share**4
