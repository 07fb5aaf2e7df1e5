"""Bounds on the joints of an arm that lags, by a line that they cannot cross.

For a joint with T y' = w - y, where T is within [T_min, T_max] and w at most U, the maximum slope
of y at a height Y is

    s(Y) = (U - Y) / T_min  where U > Y,    (U - Y) / T_max  otherwise,

which decreases with Y. A line that starts no lower than y and at each of its heights is at least as
steep as s is not crossed: to meet it from below, y would have to be steeper than s. In a step of
length g, with U the maximum set-point in that time, such a line has the slope

    (U - Y) / T_min  from a height Y below U, as s is steepest at the start, though only up to U,
    (U - Y) / (T_max + g)  from a height above U, which is the value of s where the line ends.

Where plan time may pass at any lower rate, T_min is 0, and the lead is between zero and its full
value.

The planner's tube has exponentials in place of the line. Set-points are sampled at the ends of
steps; in between they exceed these samples by at most their maximum speed times half a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from planner.motion.response import Response
from planner.trajectory import Trajectory

STEP_S = 5e-4
"""Of plan time."""

ROUNDING_RAD = 1e-6
"""Upper bound on rounding errors and on jumps at knots, which are up to 1e-8 rad."""

MAX_RESTING_LAGS = 50
"""Number of maximum lags after which any arm has settled."""


@dataclass(frozen=True, slots=True, eq=False)
class ResponseTube:
    """Bounds on the joints of an arm during motions that follow one another, and a rest after them.

    Attributes:
        low: lower bounds at the ends of steps, including the settled error, shape (k + 1, 7), rad.
        high: upper bounds, likewise.
        step_s: length of a step, s.
        ends_s: end of each motion, s.
        settled: number of the first end at which all joints may be measured as settled.
        goal: position after the last motion, shape (7,), rad.
    """

    low: FloatArray
    high: FloatArray
    step_s: float
    ends_s: tuple[float, ...]
    settled: int
    goal: FloatArray

    def hull(self, first: int, last: int) -> tuple[FloatArray, FloatArray]:
        """Bounds from the end of one step to that of another, given by their numbers."""
        some = slice(first, last + 1)
        return self.low[some].min(axis=0), self.high[some].max(axis=0)

    def steps_of(self, move: int) -> tuple[int, int]:
        """Numbers of the first and last end in a move; the last move includes the rest."""
        begin_s = self.ends_s[move - 1] if move else 0.0
        first, last = int(begin_s / self.step_s), len(self.low) - 1
        if move < len(self.ends_s) - 1:
            last = min(last, int(np.ceil(self.ends_s[move] / self.step_s)))
        return first, max(last, first + 1)

    def next_start(self, settled_rad: float, error: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Bounds on the joints, without the settled error, when the next moves begin."""
        most = settled_rad + error
        low = np.minimum(self.low[self.settled] + error, self.goal)
        high = np.maximum(self.high[self.settled] - error, self.goal)
        return np.maximum(low, self.goal - most), np.minimum(high, self.goal + most)


def response_tube(
    motions: Sequence[Trajectory],
    response: Response,
    start: tuple[FloatArray, FloatArray],
    settled_rad: float,
    waits: Sequence[tuple[float, float]] = (),
) -> ResponseTube:
    """The tube of motions that follow one another, the last of which ends at rest.

    Args:
        motions: in order.
        response: how the arm follows its set-points, and how these are sent.
        start: bounds on the joints at first, without the settled error, each of shape (7,), rad.
        settled_rad: maximum measured distance from the last set-point of a settled joint, rad.
        waits: intervals of plan time in which that may pass at any lower rate, s.
    """
    step_s = STEP_S / response.speed
    lowest, highest, ends_s = _sent(motions, response, step_s, waits)
    goal = np.array(motions[-1].q[-1])
    error = response.settled_error_rad
    high, low = [start[1]], [-start[0]]
    moving, most = len(highest), settled_rad + error
    for number in range(moving + int(MAX_RESTING_LAGS * response.lag_s.max() / step_s) + 1):
        is_resting = number >= moving
        now = response.speed * step_s * number
        lags_s = response.lag_s * [0.0 if _is_in(waits, now, now + STEP_S) else 1.0, 1.0]
        high.append(_line(high[-1], goal if is_resting else highest[number], lags_s, step_s))
        low.append(_line(low[-1], -goal if is_resting else -lowest[number], lags_s, step_s))
        if is_resting and max((high[-1] - goal - most).max(), (low[-1] + goal - most).max()) <= 0.0:
            break
    upper, lower = np.array(high) + ROUNDING_RAD, -np.array(low) - ROUNDING_RAD
    beyond = np.maximum(lower - goal, goal - upper) - most
    is_possible = beyond.max(axis=1) <= 0.0
    upper[-1], lower[-1] = np.maximum(upper[-1], goal), np.minimum(lower[-1], goal)
    settled = moving + int(is_possible[moving:].argmax())
    return ResponseTube(lower - error, upper + error, step_s, ends_s, settled, goal)


def _is_in(waits: Sequence[tuple[float, float]], begin: float, end: float) -> bool:
    """Whether an interval of plan time meets another of some."""
    return any(begin <= until and end >= since for since, until in waits)


def _line(height: FloatArray, aim: FloatArray, lags_s: FloatArray, step_s: float) -> FloatArray:
    """Height of the line after a step, shape (7,), rad."""
    least, most = lags_s.T
    below = np.maximum(aim - height, 0.0)
    share = step_s / np.maximum(least, step_s)  # the line does not rise above its aim
    rise = below * share
    fall = np.maximum(height - aim, 0.0) * step_s / (most + step_s)
    after: FloatArray = height + rise - fall
    return after


def _sent(
    motions: Sequence[Trajectory],
    response: Response,
    step_s: float,
    waits: Sequence[tuple[float, float]],
) -> tuple[FloatArray, FloatArray, tuple[float, ...]]:
    """Minimum and maximum set-point that may be in force in each step; end of each motion, s."""
    ends = np.cumsum([float(motion.knots_s[-1]) for motion in motions])
    steps = int(np.ceil((ends[-1] / response.speed + response.window_s) / step_s)) + 1
    before = int(np.ceil(response.window_s / step_s))
    times_s = step_s * np.arange(-before, steps + 1)
    plan_s = np.clip(response.speed * times_s, 0.0, ends[-1])
    sent = both = _set_points(motions, ends, response, plan_s)
    if response.lead_s and waits:
        is_slow = [_is_in(waits, at - STEP_S, at + STEP_S) for at in plan_s.tolist()]
        bare = _set_points(motions, ends, evolve(response, lead_s=0.0), plan_s)
        both = np.where(np.array(is_slow)[:, None], bare, sent)
    fastest, pushed = np.max([_peaks(motion) for motion in motions], axis=0)
    between = response.speed * (fastest + response.lead_s * response.speed * pushed) * step_s / 2
    window = len(times_s) - steps
    low, high = (
        np.lib.stride_tricks.sliding_window_view(bound, window + 1, axis=0)
        for bound in (np.minimum(sent, both), np.maximum(sent, both))
    )
    found = low.min(axis=-1) - between, high.max(axis=-1) + between
    return *found, tuple((ends / response.speed).tolist())


def _peaks(trajectory: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Bounds on the speed and the acceleration of each joint, each of shape (7,).

    Between knots, acceleration is linear, and velocity deviates from its chord by at most
    |j| h^2 / 8.
    """
    h = np.diff(trajectory.knots_s)[:, None]
    sag = (np.abs(trajectory.j) * h**2 / 8.0).max(axis=0, initial=0.0)
    return np.abs(trajectory.v).max(axis=0) + sag, np.abs(trajectory.a).max(axis=0)


def _set_points(
    motions: Sequence[Trajectory], ends: FloatArray, response: Response, at: FloatArray
) -> FloatArray:
    """Set-points at some times of the plan, shape (k, 7), rad."""
    number = np.minimum(np.searchsorted(ends, at, side="left"), len(motions) - 1)
    sent = np.empty((len(at), len(response.lag_s)))
    for k, trajectory in enumerate(motions):
        here = number == k
        q, v = positions(trajectory, at[here] - (ends[k] - trajectory.knots_s[-1]))
        led = q + response.lead_s * response.speed * v
        limits = trajectory.limits
        sent[here] = np.clip(led, limits.q_min, limits.q_max) if response.lead_s else q
    return sent


def positions(trajectory: Trajectory, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities from knots and jerks alone, each of shape (k, 7)."""
    if not len(trajectory.j):
        q = np.repeat(trajectory.q, len(times_s), axis=0)
        return q, np.zeros_like(q)
    knots_s = np.asarray(trajectory.knots_s)
    i = np.clip(np.searchsorted(knots_s, times_s, side="right") - 1, 0, len(trajectory.j) - 1)
    t = np.clip(times_s - knots_s[i], 0.0, np.diff(knots_s)[i])[:, None]
    q, v, a, j = (
        np.asarray(x)[i] for x in (trajectory.q, trajectory.v, trajectory.a, trajectory.j)
    )
    return q + t * (v + t * (a / 2 + t * j / 6)), v + t * (a + t * j / 2)
