"""Response: how a real arm follows the set-points that it is sent, and how these are sent.

A Baxter in position mode follows late. Each joint is taken to be of first order,

    T(t) y'(t) = u(t) - y(t),        |q(t) - y(t)| <= e,

with the set-point u that is in force, a lag T(t) that may change at any time within an interval,
and a joint q that is off that by an error of e at most, at any time: gravity, friction, backlash,
calibration. What is sent is the plan q(t) slowed down, and led along its velocity:

    u(t) = q(s t) + L s q'(s t), within the joint limits,        s the speed, L the lead.

A joint that has just the lag L follows a led plan without any: u = q + L q' is solved by y = q.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from baxter_kin.errors import expect
from baxter_kin.kinematics.arm import JOINTS
from baxter_kin.validation import FloatArray, finite_array, finite_scalar, float_array
from baxter_kin.value_objects import Frozen, OneLine, seconds
from planner.errors import ResponseError
from planner.trajectory import Trajectory

TICK_S = 0.01
"""Between two set-points: 100 Hz, at which the original clients command."""

LATE_S = 0.02
"""How late the stream may be unless said otherwise: what the executor lets pass."""

REST_PLAN_S = 0.01
"""In plan time: more than the cells by which tubes count a motion as longer than it is."""

LONGEST_LAG_S, LONGEST_LEAD_S, LONGEST_LATE_S, LARGEST_ERROR_RAD = 5.0, 1.0, 1.0, 0.2
"""Beyond these it is no response of an arm, but a number in another unit."""


class Command(NamedTuple):
    """What is sent, each of shape (n,) or (m, n).

    Attributes:
        q: positions, rad, within the joint limits.
        v: velocity of the plan as it is slowed down, rad/s.
    """

    q: FloatArray
    v: FloatArray


@dataclass(frozen=True, slots=True, eq=False, repr=False, init=False)
class Response(Frozen, OneLine):
    """How an arm follows its set-points, as bounds; and how these are sent.

    Attributes:
        lag_s: least and greatest lag of each joint, shape (7, 2), s. Zero is a joint that follows
            at once.
        settled_error_rad: how far each joint may be from where its lag alone has it, shape (7,),
            rad.
        speed: of plan time to time, in (0, 1].
        lead_s: how far set-points lead along the velocity, s.
        late_s: how much later than in an even stream of 100 Hz a set-point may come in force, in
            all: the greatest lateness of one, and all that plan time stood still since the arm last
            rested. What comes later is not covered.
    """

    lag_s: FloatArray
    settled_error_rad: FloatArray
    speed: float
    lead_s: float
    late_s: float

    def __init__(
        self,
        lag_s: ArrayLike,
        settled_error_rad: ArrayLike = 0.0,
        speed: float = 1.0,
        lead_s: float = 0.0,
        late_s: float = LATE_S,
    ) -> None:
        """Check what is said of the arm.

        Args:
            lag_s: shape (7, 2), s; one pair of shape (2,) stands for all joints.
            settled_error_rad: shape (7,), rad; one number stands for all joints.
            speed: of plan time to time, in (0, 1].
            lead_s: how far set-points lead, 0 .. `LONGEST_LEAD_S`.
            late_s: how late the stream may be, 0 .. `LONGEST_LATE_S`.

        Raises:
            ResponseError: when a number is none, or outside its range; names the range.
        """
        object.__setattr__(self, "lag_s", _lags(lag_s))
        object.__setattr__(self, "settled_error_rad", _errors(settled_error_rad))
        object.__setattr__(self, "speed", _speed(speed))
        object.__setattr__(self, "lead_s", _time(lead_s, "lead_s", LONGEST_LEAD_S))
        object.__setattr__(self, "late_s", _time(late_s, "late_s", LONGEST_LATE_S))

    @property
    def window_s(self) -> float:
        """How old the set-point in force may be: a tick, and what the stream is late."""
        return TICK_S + self.late_s

    @property
    def rest_s(self) -> float:
        """How long the last set-point stands at least before the next motion may begin, s.

        It is in force for good then; tubes of what begins later are from there on.
        """
        return self.window_s + REST_PLAN_S / self.speed

    def at_speed(self, speed: float) -> Response:
        """The same arm, sent the same plan at another speed.

        Raises:
            ResponseError: when it is not above 0 and at most 1.
        """
        return replace(self, speed=speed)

    def command(self, trajectory: Trajectory, t_s: ArrayLike) -> Command:
        """What is sent at a time, or at many, from the begin of a motion on.

        Args:
            trajectory: the motion as planned.
            t_s: one time, or shape (m,), s, not negative; after its end the motion rests.

        Raises:
            TrajectoryError: when a time is not a number, negative, or after the end of a motion
                that does not end at rest.
            ResponseError: when it is no `Trajectory`.
        """
        expect(trajectory, Trajectory, "trajectory", ResponseError)
        state = trajectory.sample(self.speed * float_array(t_s, "t_s", ResponseError))
        v = self.speed * state.v
        limits = trajectory.limits
        led = np.clip(state.q + self.lead_s * v, limits.q_min, limits.q_max)
        return Command(led if self.lead_s > 0.0 else state.q, v)

    def _facts(self) -> tuple[str, ...]:
        least, most = self.lag_s.min(), self.lag_s.max()
        lag = f"lag {least:.3g} .. {most:.3g} s"
        error = f"error {self.settled_error_rad.max():.3g} rad"
        lead = f"lead {seconds(self.lead_s)}" if self.lead_s else ""
        return lag, error, f"speed {self.speed:.3g}", lead, f"{1e3 * self.late_s:.3g} ms late"


def left_over(time_s: float | FloatArray, lag_s: FloatArray) -> FloatArray:
    """What is left of a distance after a time, as a share; nothing without lag."""
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):  # lags of 0, or near it
        share = np.exp(-np.divide(time_s, lag_s))
    return np.where((lag_s > 0.0) | (np.asarray(time_s) <= 0.0), np.nan_to_num(share, nan=1.0), 0.0)


def _lags(given: ArrayLike) -> FloatArray:
    lags = float_array(given, "lag_s", ResponseError)
    if lags.shape == (2,):
        lags = np.tile(lags, (len(JOINTS), 1))
    lags = finite_array(lags, (len(JOINTS), 2), "lag_s", ResponseError)
    for number, (least, most) in enumerate(lags.tolist()):
        if not 0.0 <= least <= most <= LONGEST_LAG_S:
            raise ResponseError(
                f"lag_s of joint {number} must be least and greatest, from 0 to "
                f"{LONGEST_LAG_S:g} s, got {least:g} and {most:g}"
            )
    return lags


def _errors(given: ArrayLike) -> FloatArray:
    errors = float_array(given, "settled_error_rad", ResponseError)
    if errors.ndim == 0:
        errors = np.full(len(JOINTS), errors)
    errors = finite_array(errors, (len(JOINTS),), "settled_error_rad", ResponseError)
    if not ((errors >= 0.0) & (errors <= LARGEST_ERROR_RAD)).all():
        raise ResponseError(
            f"settled_error_rad must be from 0 to {LARGEST_ERROR_RAD:g} rad, got {errors.tolist()}"
        )
    return errors


def _speed(given: object) -> float:
    speed = finite_scalar(given, "speed", ResponseError)
    if not 0.0 < speed <= 1.0:
        raise ResponseError(f"speed must be above 0 and at most 1, got {speed:g}")
    return speed


def _time(given: object, name: str, most: float) -> float:
    value = finite_scalar(given, name, ResponseError)
    if not 0.0 <= value <= most:
        raise ResponseError(f"{name} must be from 0 to {most:g} s, got {value:g}")
    return value
