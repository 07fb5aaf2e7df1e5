"""Tracking tube: bounds on the joints of an arm of a given response at any time of a motion.

**Theorem.** Let a joint obey T(t) y' = w(t) - y, where T is any measurable function of time with
values in [T_min, T_max], and w(t), the set-point in force, is one that was due at some time within
the last W: w(t) = u(r) for some r in [t - W, t]. Let U(t) be the greatest u(r) of these, and let h
obey

    h' = (U - h) / T_min  where U > h,        h' = (U - h) / T_max  where U <= h.

If y(0) <= h(0), then y(t) <= h(t) at all later times; likewise from below, with the least u(r).

*Proof.* As w <= U, y' = (w - y) / T <= (U - y) / T <= g(U, y), the greater of both quotients, which
is what h' is of h. It falls with y. Were y(t) > h(t) at some t, let t0 be the last time before at
which y = h; then (y - h)' <= g(U, y) - g(U, h) <= 0 from t0 to t, so y - h does not rise from zero
there: a contradiction. (Comparison of differential inequalities, Walter, "Differential and Integral
Inequalities", 1970; for T_min = 0 take the limit: h jumps up to U.) Both bounds are attained, by
the T and w that choose the greater quotient: for independent joints no tighter bounds hold.

**Computation.** Time is divided into cells of `CELL_S` of plan time. In each, U is replaced
by a constant upper bound: the greatest set-point at the ends of all cells that the window touches,
plus what u can rise above them in between, which is an eighth of its greatest second derivative
times the cell squared. Towards a constant, h moves as an exponential and never reaches it, so

    h(t + dt) = U + (h(t) - U) exp(-dt / T),    T = T_min or T_max by the sign of U - h(t),

exactly, and h is monotone in the cell, so its range is that of its ends. `ROUNDING_RAD` is added.

**The stream.** Set-points come at 100 Hz and are held: one tick of age. Further delay, by jitter or
because plan time stood still, is `Response.late_s`. A delay common to all joints, as of a network,
shifts the whole tube in time and changes nothing else, as only the arm moves meanwhile.

**A stream that halts.** Let plan time pass at any rate from zero to that of the speed. By plan time
the joint obeys the same equation with T times that rate, which is in [0, T_max]. So the tube of
T_min = 0 holds for every slower and every halting stream, however often and long it halts; that of
T_min > 0 only for delays that `late_s` covers.

Where a stream may slow or halt in known intervals of plan time only (`halts`), T_min = 0 is used
there, and the response's own outside: the clock of both arms waits for grippers. As the lead of a
set-point is in proportion to the rate, set-points of these intervals are between those without a
lead and those with the whole one. Time that plan time stood still before such an interval is made
up for in it: let the instant in the tube stand until plan time has come there. Then `late_s` covers
each interval between two of them.

**Rests.** Where a motion ends, its last set-point stands, and every bound converges to it. The
next motion begins when all joints have been measured within `SETTLED_RAD` of it, and that set-point
has stood for `Response.rest_s`, so that no older one is in force: at the earliest at the first
instant s0 from then on at which the tube allows that; later than that the joints are nearer still.
The possible positions are divided by the time since s0 into `STARTS` boxes, so that joints that
lag together are not treated as each at its worst; the next motion has a tube from each of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from baxter_kin.validation import FloatArray
from planner.collision.tube_proof import JointTube
from planner.motion.response import Response, remaining_share
from planner.trajectory import Trajectory

CELL_S = 1e-3
"""Duration of a cell in plan time; a tube is wider by the change of the set-point in a cell."""

ROUNDING_RAD = 1e-7
"""Allowance for rounding: jumps at knots are at most 1e-8 rad, and the errors of all cells together
are below 1e-10."""

SETTLED_RAD = 0.0087
"""Maximum distance of measured joints from their goal when the executor continues: half a degree,
as in the original."""

STARTS, START_SHARE = 6, 0.25
"""Number of boxes for the start of a motion, and the duration of each in maximum lags."""

JointRange: TypeAlias = tuple[FloatArray, FloatArray]
"""Minimum and maximum positions, each of shape (7,), rad."""


@dataclass(frozen=True, slots=True, eq=False)
class SettlingTube:
    """The tube of a motion, and of the rest after it.

    Attributes:
        tube: of y; the joints are within the settled error of it. Its last cell stands for all
            later times.
        settled_s: earliest and latest time from which all joints are measured as settled.
        starts: boxes that together contain y whenever the next motion may begin.
        rates: maximum speed of each joint, shape (7,), rad/s; infinite where a joint may catch up
            immediately.
    """

    tube: JointTube
    settled_s: tuple[float, float]
    starts: tuple[JointRange, ...]
    rates: FloatArray


def tracking_tube(
    trajectory: Trajectory,
    response: Response,
    start: JointRange,
    halts: Sequence[tuple[float, float]] = (),
) -> SettlingTube:
    """Bounds on the joints of an arm while it is sent a motion that ends at rest.

    Args:
        trajectory: as planned.
        response: of the arm, and how it is sent.
        start: bounds on y at the beginning.
        halts: intervals of plan time in which the stream may slow or halt, s.
    """
    cell_s = CELL_S / response.speed
    highest_sent, lowest_sent = _sent(trajectory, response, cell_s, halts)
    may_halt = _in_any(halts, _instants(len(highest_sent), CELL_S), CELL_S)
    lag_s = response.lag_s
    starts, sent = np.array([start[1], -start[0]]), np.stack([highest_sent, -lowest_sent], axis=1)
    bounds = _followed(starts, sent, lag_s, cell_s, may_halt)
    high, low = bounds[:, 0], -bounds[:, 1]
    rest = _Rest(low[-1], high[-1], trajectory.q_goal, response)
    after_s: FloatArray = cell_s * np.arange(1.0, rest.cells(cell_s) + 1)
    low_rest, high_rest = rest.at(after_s)
    ends = np.minimum(low_rest[-1:], rest.goal), np.maximum(high_rest[-1:], rest.goal)
    tube = JointTube(
        cell_s * np.arange(float(len(low) + len(after_s) + 1)),
        np.concatenate([low, low_rest, ends[0]]) - ROUNDING_RAD,
        np.concatenate([high, high_rest, ends[1]]) + ROUNDING_RAD,
    )
    since_s = cell_s * (len(low) - 1)
    first_s, last_s = rest.settled_s
    rates = _rates(low, high, (lowest_sent, highest_sent), response, cell_s)
    return SettlingTube(tube, (since_s + first_s, since_s + last_s), tuple(rest.starts()), rates)


def _instants(count: int, step_s: float) -> FloatArray:
    """Some instants from zero on, with a step, shape (count,), s."""
    instants: FloatArray = step_s * np.arange(float(count))
    return instants


def _in_any(
    halts: Sequence[tuple[float, float]], begins_s: FloatArray, length_s: float
) -> NDArray[np.bool_]:
    """Whether each of some cells of plan time overlaps one of several intervals."""
    found = np.zeros(len(begins_s), dtype=np.bool_)
    for begin_s, end_s in halts:
        found |= (begins_s + length_s >= begin_s) & (begins_s <= end_s)
    return found


def _sent(
    trajectory: Trajectory,
    response: Response,
    cell_s: float,
    halts: Sequence[tuple[float, float]],
) -> tuple[FloatArray, FloatArray]:
    """Maximum and minimum set-points that may be in force in each cell, shape (m, 7) both.

    Until only the last one may be.
    """
    motion_s = trajectory.duration / response.speed
    cells = int(np.ceil((motion_s + response.window_s) / cell_s)) + 1
    window = int(np.ceil(response.window_s / cell_s))
    times_s = _instants(cells + 1, cell_s)
    led = response.command(trajectory, times_s).q
    own = led
    if response.lead_s and len(halts):
        slows = _in_any(halts, response.speed * times_s - CELL_S, 2.0 * CELL_S)[:, None]
        own = np.where(slows, trajectory.sample(response.speed * times_s).q, led)
    lowest, highest = (
        np.lib.stride_tricks.sliding_window_view(
            np.concatenate([np.repeat(at_ends[:1], window, axis=0), at_ends]), window + 2, axis=0
        )
        for at_ends in (np.minimum(led, own), np.maximum(led, own))
    )
    speed, between = response.speed, np.abs(trajectory.a).max(axis=0) * response.speed**2
    if trajectory.j.size:
        between = between + response.lead_s * speed**3 * np.abs(trajectory.j).max(axis=0)
    rise = between * cell_s**2 / 8.0
    return highest.max(axis=-1) + rise, lowest.min(axis=-1) - rise


def _followed(
    start: FloatArray,
    sent: FloatArray,
    lag_s: FloatArray,
    cell_s: float,
    may_halt: NDArray[np.bool_],
) -> FloatArray:
    """Upper bounds of k joint vectors at the ends of all cells, shape (m + 1, k, 7).

    Args:
        start: at the first one, shape (k, 7).
        sent: upper bounds on set-points in each cell, shape (m, k, 7).
        lag_s: minimum and maximum, shape (7, 2).
        cell_s: duration of a cell.
        may_halt: whether the stream may halt in each cell, shape (m,).
    """
    rising, falling = remaining_share(cell_s, lag_s[:, 0]), remaining_share(cell_s, lag_s[:, 1])
    bounds = np.empty((len(sent) + 1, *start.shape))
    bounds[0] = bound = np.array(start)
    for number, (aim, halts) in enumerate(zip(sent, may_halt.tolist(), strict=True)):
        off = bound - aim
        bound = aim + off * np.where(off < 0.0, 0.0 if halts else rising, falling)
        bounds[number + 1] = bound
    return bounds


def _rates(
    low: FloatArray, high: FloatArray, sent: JointRange, response: Response, cell_s: float
) -> FloatArray:
    """Maximum |w - y| / T; of a joint without lag, that of the set-points."""
    ahead = (sent[1] - np.minimum(low[:-1], low[1:])).max(axis=0)
    behind = (np.maximum(high[:-1], high[1:]) - sent[0]).max(axis=0)
    min_lag_s, max_lag_s = response.lag_s.T
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        distance_rad = np.maximum(ahead, behind)
        following = np.where(distance_rad > 0.0, distance_rad / min_lag_s, 0.0)
    sending = np.abs(np.diff(sent[0], axis=0)).max(axis=0) / cell_s
    rates: FloatArray = np.where(max_lag_s > 0.0, following, sending)
    return rates


class _Rest:
    """The bounds once only the last set-point is in force.

    Attributes:
        goal: that set-point.
    """

    def __init__(self, low: FloatArray, high: FloatArray, goal: FloatArray, of: Response) -> None:
        self.goal = goal
        self._low, self._high, self._lag_s = low - goal, high - goal, of.lag_s
        self._tolerance = SETTLED_RAD + of.settled_error_rad

    def at(self, after_s: FloatArray) -> JointRange:
        """The bounds at times since then, shape (k,): two of shape (k, 7)."""
        low, high = self._off(after_s[:, None])
        return self.goal + low, self.goal + high

    @property
    def settled_s(self) -> tuple[float, float]:
        """Earliest and latest time at which all joints are measured as settled."""
        nearest = np.maximum(np.maximum(self._low, -self._high), 0.0)
        farthest = np.maximum(self._high, -self._low)
        return self._until(nearest, self._lag_s[:, 0]), self._until(farthest, self._lag_s[:, 1])

    def cells(self, cell_s: float) -> int:
        """Number of cells until all joints are settled, plus one maximum lag."""
        return int(np.ceil((self.settled_s[1] + float(self._lag_s.max())) / cell_s)) + 1

    def starts(self) -> Iterator[JointRange]:
        """Boxes that contain the possible positions when all joints are measured as settled."""
        first_s, part_s = self.settled_s[0], START_SHARE * float(self._lag_s.max())
        for number in range(STARTS):
            lows, highs = self._off(first_s + part_s * np.array([[number], [number + 1]]))
            low, high = lows.min(axis=0), highs.max(axis=0)
            if number == STARTS - 1:  # and for ever after
                low, high = np.minimum(low, 0.0), np.maximum(high, 0.0)
            low, high = np.maximum(low, -self._tolerance), np.minimum(high, self._tolerance)
            if (low <= high).all():
                yield self.goal + low, self.goal + high

    def _off(self, after_s: FloatArray) -> JointRange:
        """The bounds relative to the goal, at times of shape (k, 1)."""
        min_share, max_share = (remaining_share(after_s, lag_s) for lag_s in self._lag_s.T)
        low = self._low * np.where(self._low > 0.0, min_share, max_share)
        high = self._high * np.where(self._high < 0.0, min_share, max_share)
        return low, high

    def _until(self, off: FloatArray, lag_s: FloatArray) -> float:
        """The time after which all of these distances count as settled."""
        is_off: NDArray[np.bool_] = off > self._tolerance
        ratio = np.where(is_off, off / self._tolerance, 1.0)
        return float((lag_s * np.log(ratio)).max())
