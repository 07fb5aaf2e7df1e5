"""Set-points: what is sent to an arm while it carries out moves, slowed down and led.

The moves between two rests are one motion q(t) of plan time t. At speed s plan time passes s times
as fast as time, so velocities are those of the plan times s. A robot that follows its set-points
late, by a lag T to first order, is where it should be when q + T v is sent in place of q: its joint
obeys T q' = u - q, and u = q + T q' is solved by q itself. That is the lead; it ends at the joint
limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baxter_kin.fields import frozen, scalar
from baxter_kin.validation import FloatArray, expect_all
from planner import Move, Trajectory
from planner.motion.response import MAX_LEAD_S
from planner.trajectory import joined
from sim.errors import SimulationError

DEFAULT_SPEED = 0.3

FASTEST_RAD_S: tuple[float, ...] = (2.0, 2.0, 2.0, 2.0, 4.0, 4.0, 4.0)
"""How fast a Baxter lets its joints s0 .. w2 turn in position mode, at speed ratio 1."""

RESERVE = 1.2
"""The robot's cap exceeds what is sent by this factor, so that it does not cut it."""

LEAST_RATIO = 0.01

_LOOK_S = 0.001
"""Step of the search for the greatest speed that is sent."""


@frozen(error=SimulationError, eq=True)
class Pace:
    """How a plan is sent.

    Attributes:
        speed: of plan time to time, in (0, 1].
        lead_s: how far the set-points lead along the velocity, 0 .. `MAX_LEAD_S`.

    Raises:
        SimulationError: when a value is no number or outside its range.
    """

    speed: float = scalar(above=0.0, most=1.0, default=DEFAULT_SPEED)
    lead_s: float = scalar(least=0.0, most=MAX_LEAD_S, default=0.0)


class SetPoint(NamedTuple):
    """What belongs to one instant.

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
        """How long it takes as it is sent."""
        return self.trajectory.duration / self.pace.speed

    def number_at(self, plan_s: float) -> int:
        """Which of the moves is under way at a plan time."""
        return int(np.searchsorted(self.starts_s, plan_s, side="right")) - 1

    def at(self, plan_s: float) -> SetPoint:
        """The set-point at a plan time from 0 to the end."""
        state = self.trajectory.sample(min(plan_s, self.trajectory.duration))
        return SetPoint(state.q, self._led(state.q, state.v))

    def peak_speeds(self) -> FloatArray:
        """The greatest speed of each joint from one thing sent to the next, shape (7,), rad/s."""
        count = max(2, int(np.ceil(self.duration_s / _LOOK_S)) + 1)
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
    """The same way at a speed in (0, 1]: what an arm without lag does when it is sent."""
    return Trajectory(
        trajectory.limits,
        trajectory.knots_s / speed,
        trajectory.q,
        speed * trajectory.v,
        speed**2 * trajectory.a,
        speed**3 * trajectory.j,
    )


def motions_of(moves: Sequence[Move], pace: Pace) -> tuple[SentMotion, ...]:
    """Consecutive moves as motions that each end at rest."""
    motions, pending = [], list[Move]()
    for move in moves:
        pending.append(move)
        if _ends_at_rest(move.trajectory):
            motions.append(SentMotion(pending, pace))
            pending = []
    return tuple(motions) if not pending else (*motions, SentMotion(pending, pace))


REST_RAD_S = 1e-6
"""What is slower rests."""


def _ends_at_rest(trajectory: Trajectory) -> bool:
    return float(np.abs(trajectory.v[-1]).max()) < REST_RAD_S


def speed_ratio_for(peaks: FloatArray) -> float:
    """The speed ratio at which a Baxter's cap exceeds these peaks by `RESERVE`; 1 at most.

    Args:
        peaks: greatest speeds that are sent, shape (7,), rad/s.
    """
    needed = RESERVE * float((peaks / np.array(FASTEST_RAD_S)).max())
    return min(1.0, max(LEAST_RATIO, needed))


def too_fast(peaks: FloatArray) -> tuple[int, ...]:
    """The joints, counted from 0, that a Baxter cannot turn as fast as these peaks."""
    return tuple(np.flatnonzero(peaks > np.array(FASTEST_RAD_S)).tolist())
