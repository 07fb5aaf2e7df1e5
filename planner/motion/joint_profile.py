"""One joint between two moving states: profiles of constant jerk in closed form.

Ruckig tests families of profiles of up to seven phases, and rejects a family when rounding makes
one of its phases negative. Where a phase has zero length, as for a state sampled from a
time-optimal motion, it may miss the fastest profile, and return one that takes several times as
long, or none. The profiles of this module cover those cases:

- `direct`: at most two phases. `Rates.min_duration_s` proves in many cases that nothing is faster.
- `through_rest`: brake, move from rest to rest, and accelerate. It always exists, and can wait at
  rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

ROUNDING = 1e-9
"""Maximum relative violation of a limit that counts as rounding."""

_EPS = 1e-14
"""Rounding of a sum of a few numbers of order one, with a margin."""

MAX_PROFILE_S = 1e4
"""Maximum duration of a profile, for almost zero speeds; powers of longer ones overflow."""

MAX_CORRECTION_S = 1e-7
"""Maximum change of the length of a phase by `corrected`."""


class AxisState(NamedTuple):
    """Position, velocity and acceleration of one joint; rad and s."""

    q: float
    v: float
    a: float

    def reversed(self) -> AxisState:
        """The same state in the reversed motion."""
        return AxisState(self.q, -self.v, self.a)


class Profile(NamedTuple):
    """Consecutive phases of constant jerk of one joint.

    Attributes:
        lengths_s: duration of each phase, not negative.
        jerks: jerk of each phase, rad/s^3.
    """

    lengths_s: tuple[float, ...]
    jerks: tuple[float, ...]

    @property
    def duration(self) -> float:
        """Seconds from beginning to end."""
        return math.fsum(self.lengths_s)

    def end(self, start: AxisState) -> AxisState:
        """The state in which the profile ends when it begins in `start`."""
        *_, end = self.states(start)
        return end

    def states(self, start: AxisState) -> Iterator[AxisState]:
        """The start and the states at the ends of the phases."""
        q, v, a = start
        yield start
        for t, j in zip(self.lengths_s, self.jerks, strict=True):
            q += t * (v + t * (a / 2 + t * j / 6))
            v += t * (a + t * j / 2)
            a += t * j
            yield AxisState(q, v, a)

    def is_within(self, rates: Rates, start: AxisState) -> bool:
        """Whether no velocity or acceleration exceeds its limit by more than `ROUNDING`."""
        v_max, a_max = rates.v * (1.0 + ROUNDING), rates.a * (1.0 + ROUNDING)
        states = list(self.states(start))
        turning = (
            x.v - x.a**2 / (2 * j)
            for (x, y), j in zip(pairwise(states), self.jerks, strict=True)
            if x.a * y.a < 0.0
        )
        return max(abs(x.a) for x in states) <= a_max and all(
            abs(v) <= v_max for v in (*(x.v for x in states), *turning)
        )


class Rates(NamedTuple):
    """Limits of one joint on velocity, acceleration and jerk; positive."""

    v: float
    a: float
    j: float

    def widened(self, share: float) -> Rates:
        """Limits that are higher by this share."""
        return Rates(*(x * (1.0 + share) for x in self))

    def min_duration_s(self, start: AxisState, goal: AxisState) -> float:
        """Lower bound on the duration between two states, by the mean value theorem."""
        return max(abs(y - x) / rate for x, y, rate in zip(start, goal, self, strict=True))

    def moved_inside(self, start: AxisState) -> AxisState:
        """The start, moved inside the limits where it exceeds them by rounding.

        A start is inside when its acceleration is, and its velocity is, too, after the acceleration
        has gone to zero at full jerk: v + a |a| / 2j. A value that exceeds its limit by more than
        `ROUNDING` is not changed.
        """
        a = min(max(start.a, -self.a), self.a)
        a = a if abs(start.a - a) <= ROUNDING * self.a else start.a
        change = a * a / (2 * self.j)
        high, low = self.v - (change if a > 0 else 0.0), -self.v + (change if a < 0 else 0.0)
        v = min(max(start.v, low), high)
        return AxisState(start.q, v if abs(v - start.v) <= ROUNDING * self.v else start.v, a)


def direct(start: AxisState, goal: AxisState, rates: Rates) -> Profile | None:
    """The fastest profile of at most two phases of full or zero jerk that joins the states, if any.

    Velocities and accelerations determine the two lengths; the position then has to agree within
    what a change of the jerk by `ROUNDING` could correct. Between two states that are inside the
    limits (`Rates.moved_inside`) the profile is inside, too.
    """
    profiles = [p for p in _two_phases(start, goal, rates) if _reaches(p, start, goal, rates)]
    return min(profiles, key=lambda p: p.duration, default=None)


def _two_phases(start: AxisState, goal: AxisState, rates: Rates) -> Iterator[Profile]:
    steady = abs(goal.a - start.a) <= _EPS * rates.a and abs(goal.v - start.v) <= _EPS * rates.v
    if steady and start.v:
        yield from _profile(((goal.q - start.q) / start.v,), (0.0,))
    for j in (rates.j, -rates.j):
        ramp = (goal.a - start.a) / j
        mean = (start.a + goal.a) / 2
        yield from _profile((ramp,), (j,))
        if start.a:
            yield from _profile(((goal.v - start.v - mean * ramp) / start.a, ramp), (0.0, j))
        if goal.a:
            yield from _profile((ramp, (goal.v - start.v - mean * ramp) / goal.a), (j, 0.0))
        squared = j * (goal.v - start.v) + (start.a**2 + goal.a**2) / 2
        if squared >= -_EPS * rates.a**2:
            root = math.sqrt(max(squared, 0.0))
            for peak in (root, -root) if root <= rates.a * (1.0 + ROUNDING) else ():
                yield from _profile(((peak - start.a) / j, (peak - goal.a) / j), (j, -j))


def _profile(lengths_s: tuple[float, ...], jerks: tuple[float, ...]) -> Iterator[Profile]:
    """The profile, if its lengths are not negative; lengths negative by rounding count as zero.

    None if it takes longer than `MAX_PROFILE_S`.
    """
    total = sum(map(abs, lengths_s))
    if total <= MAX_PROFILE_S and min(lengths_s) >= -ROUNDING * total:
        yield Profile(tuple(max(t, 0.0) for t in lengths_s), jerks)


def _reaches(profile: Profile, start: AxisState, goal: AxisState, rates: Rates) -> bool:
    t = profile.duration
    end = profile.end(start)
    rounding = (
        _EPS * (1.0 + abs(goal.q) + rates.v * t),
        _EPS * (rates.v + rates.a * t),
        _EPS * rates.a,
    )
    wrong_jerk = rates.j * t**3 / 6, rates.j * t**2 / 2, rates.j * t
    return all(
        abs(x - y) <= small + ROUNDING * min(change, 1.0)
        for x, y, small, change in zip(end, goal, rounding, wrong_jerk, strict=True)
    )


def corrected(
    profile: Profile, start: AxisState, goal: AxisState, duration: float | None = None
) -> Profile:
    """The profile with minimally changed lengths so that it ends at the goal.

    One step of Newton's method: a phase that lasts longer by dt moves its end by (v, a, j) dt, and
    the end of the profile by what the remaining time makes of that. Phases of up to
    `MAX_CORRECTION_S` keep their lengths. If another would change by more than that, the profile is
    not changed.

    Args:
        profile: one that nearly ends at the goal.
        start: its first state.
        goal: its desired last state.
        duration: its desired duration; not constrained when not given.
    """
    _, *ends = profile.states(start)
    misses = [x - y for x, y in zip(goal, ends[-1], strict=True)]
    lengths, jerks = np.array(profile.lengths_s), np.array(profile.jerks)
    _, v, a = np.array(ends).T
    left = lengths[::-1].cumsum()[::-1] - lengths
    moves = np.array([v + left * (a + left * jerks / 2), a + left * jerks, jerks])
    if duration is not None:
        misses.append(duration - profile.duration)
        moves = np.vstack([moves, np.ones_like(lengths)])
    is_free = lengths > MAX_CORRECTION_S
    if not is_free.any():
        return profile
    change = np.linalg.lstsq(moves[:, is_free], np.array(misses), rcond=None)[0]
    if np.abs(change).max() > MAX_CORRECTION_S:
        return profile
    lengths[is_free] += change
    return Profile(tuple(lengths.tolist()), profile.jerks)


def through_rest(
    start: AxisState, goal: AxisState, rates: Rates, min_duration_s: float = 0.0
) -> Profile:
    """Brake to rest, move to the start of the final acceleration, wait, and accelerate."""
    brake, run_up = _braking(start, rates), _braking(goal.reversed(), rates)
    way = run_up.end(goal.reversed()).q - brake.end(start).q
    move = _rest_to_rest(way, rates)
    wait = max(min_duration_s - brake.duration - move.duration - run_up.duration, 0.0)
    return Profile(
        (*brake.lengths_s, *move.lengths_s, wait, *run_up.lengths_s[::-1]),
        (*brake.jerks, *move.jerks, 0.0, *(-j for j in run_up.jerks[::-1])),
    )


def _braking(state: AxisState, rates: Rates) -> Profile:
    """The fastest motion to rest: acceleration reaches a peak, stays, and returns to zero."""
    _, v, a = state
    sign = -1.0 if v + a * abs(a) / (2 * rates.j) > 0.0 else 1.0
    v, a = sign * v, sign * a  # now the acceleration has to rise first
    peak = math.sqrt(max(a * a / 2 - rates.j * v, 0.0))
    hold = 0.0
    if peak > rates.a:
        peak = rates.a
        hold = (-v - (peak * peak - a * a / 2) / rates.j) / peak
    lengths = max((peak - a) / rates.j, 0.0), max(hold, 0.0), peak / rates.j
    return Profile(lengths, (sign * rates.j, 0.0, -sign * rates.j))


def _rest_to_rest(way: float, rates: Rates) -> Profile:
    """The fastest profile from rest to rest; see `joint_move.rest_to_rest_s` for the source."""
    j, distance = math.copysign(rates.j, way), abs(way)
    a_top = min(rates.a, math.sqrt(rates.v * rates.j), (distance * rates.j**2 / 2) ** (1 / 3))
    v_top = (math.sqrt((a_top**2 / rates.j) ** 2 + 4 * a_top * distance) - a_top**2 / rates.j) / 2
    v_top = min(v_top, rates.v)
    ramp = a_top / rates.j
    hold = max(v_top / a_top - ramp, 0.0) if a_top else 0.0
    cruise = max(distance / v_top - v_top / a_top - ramp, 0.0) if v_top else 0.0
    return Profile((ramp, hold, ramp, cruise, ramp, hold, ramp), (j, 0.0, -j, 0.0, -j, 0.0, j))
