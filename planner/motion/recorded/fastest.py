"""The fastest motions along recorded samples, within all limits, from rest to rest.

Only the path counts. The smoothed recording is cut into stretches, pauses are left out, and each
stretch becomes a polynomial P(s) in 0..1. The motion has a uniform spline with a duration of its
own along each, and at every knot it is within a tolerance of P at an unknown s; so it cuts corners
as far as the tolerance permits. The sum of the durations is minimal. Windows of some stretches are
solved one after the other, each from the state in which the kept part of the last one ends, to
rest; so the cost is linear in the length. If a window has no solution, a shorter one is tried, and
at last the rest of the previous window is kept, which ends at rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from baxter_kin import JointLimits
from baxter_kin.validation import FloatArray
from planner.errors import MotionError
from planner.motion.joint_move import rest_to_rest_s
from planner.motion.recorded.smoothing import (
    OPTIONS,
    WITHIN,
    NearMotion,
    Solver,
    from_rest_to_rest,
    smoothed,
)
from planner.splines import AT_KNOT, DIFFERENCES, Sketch, trajectory_of
from planner.trajectory import Trajectory, joined

STRETCH_RAD, STRETCH_SAMPLES = 0.15, 60
"""Maximum travel of a joint along a stretch, and maximum number of its samples."""

SAMPLE_S, STILL_RAD_S, SLOW_RAD_S, MIN_SAMPLES = 0.01, 0.1, 0.1, 5
"""Step of the samples of the smoothed recording; speed to which slower parts of it are raised;
speed below which a stretch may end where the arm is slowest; and samples of the shortest one."""

DEGREE, FIT_POINTS = 7, 24
"""Of the polynomials, whose misfit is at most 0.9 mrad, and number of points they are fitted to."""

WINDOW, KEPT = 8, 6
"""Number of stretches that are solved together, and of those whose motion is kept; with 4 kept, the
motions are faster by 0.5 %, for 1.7 times the cost."""

SLOWER = 1.2
"""Duration of a guess, relative to the recorded one, or to the shortest one within the limits at
the recorded profile of speed, or from and to rest at the ends of the window."""

PATH_SHARE, FITS = 0.5, (1.0, 0.5, 0.25)
"""Share of the tolerance for the distance of the smoothed path from the samples; and the shares of
that which are tried as the tolerance of the mean distance, until it is kept."""

PLAY = 0.1
"""Share of the tolerance within which an arm that stands still may wander, due to noise."""

ROUNDS = ((6, 0.4), (10, 0.25))
"""Intervals of a stretch, and the share of the tolerance for the distance of the knots from the
smoothed path. The second is tried if the first, between its knots, is too far from a sample."""

APART_RAD = 1e-3
"""Distance of the points of a motion to which samples are compared."""

MIN_DURATION, MAX_DURATION = 1e-3, 1e3
"""Bounds of the duration of a stretch, in units of the longest one of the guess."""

_FAST: dict[str, Any] = OPTIONS | {
    "no_nlp_grad": True,
    "ipopt.tol": 1e-3,  # later iterations gain less than a thousandth
    "ipopt.max_iter": 80,  # most need 20 to 50
    "ipopt.mu_init": 1e-3,
    "ipopt.bound_push": 1e-3,
    "ipopt.bound_frac": 1e-3,
    "ipopt.slack_bound_push": 0.1,
    "ipopt.slack_bound_frac": 0.1,
    "ipopt.bound_mult_init_val": 0.1,
    "ipopt.mu_superlinear_decrease_power": 1.8,
    "ipopt.fast_step_computation": "yes",
}


def as_fast_as_possible(
    times_s: FloatArray,
    q: FloatArray,
    limits: JointLimits,
    tolerance_rad: float,
    q_start: FloatArray | None = None,
) -> NearMotion:
    """The fastest motion found along samples, from rest to rest.

    Arguments as of `at_recorded_speed`; the times only matter for smoothing. Where no motion within
    the tolerance is found, the nearest one is returned.

    Raises:
        MotionError: when no motion is found.
    """
    times_s = from_rest_to_rest(times_s, q, limits)
    path = _path(times_s, q, limits, PATH_SHARE * tolerance_rad, q_start)
    stretches = _stretches(path, PLAY * tolerance_rad)
    if not stretches:
        there = Trajectory.stay(path.q_start, limits)
        return NearMotion(there, there.q_start - q)
    ends_s, tried = [stretch.end_s for stretch in stretches], list[NearMotion]()
    for intervals, share in ROUNDS:
        solved = _pieces(stretches, path.q_start, limits, share * tolerance_rad, intervals)
        pieces = [trajectory_of(*piece, limits) for piece in solved]
        off_rad = _differences(times_s, q, ends_s, pieces)
        tried.append(NearMotion(joined(pieces), off_rad))
        if tried[-1].deviation_rad <= tolerance_rad:
            break
    return min(tried, key=lambda each: each.deviation_rad)


class _Stretch(NamedTuple):
    """A part of a path.

    Attributes:
        coefficients: of powers of s in 0..1, shape (`DEGREE` + 1, joints), rad.
        duration_s: recorded, or longer where that exceeds the limits.
        end_s: its end in the recording.
    """

    coefficients: FloatArray
    duration_s: float
    end_s: float

    @property
    def ends(self) -> FloatArray:
        """The first and the last position, shape (2, joints), rad."""
        return np.array([self.coefficients[0], self.coefficients.sum(axis=0)])

    def sketch(self, intervals: int, duration_s: float, *, stops: bool) -> Sketch:
        """A guess of the motion along it; `stops`: whether it ends at rest."""
        t = np.linspace(0.0, 1.0, intervals + 1)
        s = t + t**2 - t**3 if stops else t
        slopes = np.arange(DEGREE + 1) * (not stops)
        ends = np.array([self.coefficients[1], slopes @ self.coefficients])
        q: FloatArray = np.vander(s, DEGREE + 1, increasing=True) @ self.coefficients
        return Sketch(q, ends / duration_s, duration_s)


def _sketches(
    stretches: Sequence[_Stretch], intervals: int, limits: JointLimits, *, rests: bool
) -> Iterator[Sketch]:
    """Guesses along stretches, slower than recorded, to rest.

    Args:
        stretches: in order.
        intervals: of each.
        limits: of the joints.
        rests: whether the arm is at rest before them, too.
    """
    ends = np.array([stretch.ends for stretch in stretches])
    times_s = [_from_rest_s(ends - ends[-1, 1], limits)[:, ::-1]]
    times_s += [_from_rest_s(ends - ends[0, 0], limits)] * rests
    durations_s = np.max([np.diff(each, axis=1)[:, 0] for each in times_s], axis=0)
    for number, stretch in enumerate(stretches, 1):
        duration_s = SLOWER * max(stretch.duration_s, float(durations_s[number - 1]))
        yield stretch.sketch(intervals, duration_s, stops=number == len(stretches))


def _from_rest_s(displacement: FloatArray, limits: JointLimits) -> FloatArray:
    """Times after which the arm, accelerating from rest, is so far away, shape (...,), s."""
    return 0.5 * rest_to_rest_s(2.0 * displacement, limits)


def _stretches(path: Trajectory, play_rad: float) -> list[_Stretch]:
    """The stretches of a motion, in order; none for an arm that stands still.

    Where the arm is slow, recorded time runs faster, so that pauses disappear and creeping does
    not. Stretches end where the arm nearly stops, since there the path may turn sharply.

    Args:
        path: the motion.
        play_rad: back and forth by less is no motion.
    """
    times_s = np.arange(0.0, path.duration, SAMPLE_S)
    q = path.sample(times_s).q
    followed = q.copy()
    for i in range(1, len(q)):
        followed[i] = followed[i - 1].clip(q[i] - play_rad, q[i] + play_rad)
    steps = np.abs(np.diff(followed, axis=0, prepend=q[:1])).max(axis=1)
    moving_s = np.minimum(steps / STILL_RAD_S, SAMPLE_S).cumsum() + 1e-9 * times_s
    count = int(moving_s[-1] / SAMPLE_S)
    if count < MIN_SAMPLES:
        return []
    times_s = np.interp(SAMPLE_S * np.arange(count), moving_s, times_s)
    q, v, _ = path.sample(times_s)
    speeds = np.abs(v).max(axis=1)
    travel = np.concatenate([[0.0], np.abs(np.diff(q, axis=0)).max(axis=1).cumsum()])
    size = np.maximum(travel / STRETCH_RAD, np.arange(count) / STRETCH_SAMPLES)
    edges = [0, *_slow_places(speeds), count - 1]
    found = []
    for first, last in pairwise(edges):
        parts = math.ceil(size[last] - size[first])
        inner = np.linspace(size[first], size[last], parts + 1)[1:-1]
        places = [first, *np.searchsorted(size, inner).tolist(), last]
        found += [_stretch(path, times_s[i : j + 1]) for i, j in pairwise(places)]
    return found


def _slow_places(speeds: FloatArray) -> Iterator[int]:
    """Samples where the arm is slowest and slow, some samples apart."""
    previous, last = 0, len(speeds) - 1
    for i in np.flatnonzero(speeds < SLOW_RAD_S).tolist():
        around = speeds[max(0, i - MIN_SAMPLES) : i + MIN_SAMPLES + 1]
        if min(i - previous, last - i) >= MIN_SAMPLES and speeds[i] == around.min():
            yield i
            previous = i


def _stretch(path: Trajectory, times_s: FloatArray) -> _Stretch:
    at = np.interp(np.linspace(0, len(times_s) - 1, FIT_POINTS), np.arange(len(times_s)), times_s)
    q, v, a = path.sample(at)
    powers = np.vander(np.linspace(0.0, 1.0, FIT_POINTS), DEGREE + 1, increasing=True)
    coefficients: FloatArray = np.linalg.lstsq(powers, q)[0].astype(np.float64)
    limits, duration_s = path.limits, SAMPLE_S * (len(times_s) - 1)
    too_fast = max((np.abs(v) / limits.v_max).max(), np.sqrt((np.abs(a) / limits.a_max).max()), 1.0)
    return _Stretch(coefficients, duration_s * float(too_fast), float(times_s[-1]))


class _State(NamedTuple):
    """Position, velocity and acceleration at the start of a window, shape (joints,) each."""

    q: FloatArray
    v: FloatArray
    a: FloatArray


class _Piece(NamedTuple):
    """The motion along a stretch: a spline, and its duration."""

    controls: FloatArray
    duration_s: float

    @property
    def end(self) -> _State:
        """The state at the end."""
        step_s = self.duration_s / (len(self.controls) - 3)
        return _State(*(w @ self.controls[-3:] / step_s**i for i, w in enumerate(AT_KNOT)))

    def from_state(self, state: _State) -> _Piece:
        """The same from a state that it starts in up to rounding; its end does not change."""
        step_s = self.duration_s / (len(self.controls) - 3)
        weights = [w / step_s**i for i, w in enumerate(AT_KNOT)]
        first = np.linalg.solve(np.array(weights), np.array(state))
        return _Piece(np.concatenate([first, self.controls[3:]]), self.duration_s)


def _path(
    times_s: FloatArray,
    q: FloatArray,
    limits: JointLimits,
    tolerance_rad: float,
    q_start: FloatArray | None,
) -> Trajectory:
    """The smoothed recording, without limits of its rates; arguments as of `at_recorded_speed`."""
    for share in FITS:
        path = smoothed(times_s, q, limits, share * tolerance_rad, q_start, is_limited=False)
        if np.abs(path.sample(times_s).q - q).max() <= tolerance_rad:
            break
    return path


def _pieces(
    stretches: Sequence[_Stretch],
    q_start: FloatArray,
    limits: JointLimits,
    tolerance_rad: float,
    intervals: int,
) -> Iterator[_Piece]:
    """The motions along all stretches, window by window."""
    state, at = _State(q_start, np.zeros_like(q_start), np.zeros_like(q_start)), 0
    tail: list[_Piece] = []
    while at < len(stretches):
        left = len(stretches) - at
        found = None
        for size in range(min(WINDOW, left), len(tail), -1):
            window = stretches[at : at + size]
            found = _window(size, intervals, len(q_start)).solve(
                window, tail, state, limits, tolerance_rad
            )
            if found is not None:
                break
        if found is None and not tail:
            raise MotionError("no fast motion along the recording was found")
        solved: list[_Piece] = tail if found is None else found
        kept = len(solved) if found is None or len(solved) in (left, 1) else min(KEPT, len(solved))
        for piece in solved[:kept]:
            exact = piece.from_state(state)
            yield exact
            state = exact.end
        at, tail = at + kept, solved[kept:]


class _Window:
    """The nonlinear program of the stretches of a window.

    Attributes:
        intervals: of the spline of each.
    """

    def __init__(self, stretches: int, intervals: int, joints: int) -> None:
        self.intervals, self._joints = intervals, joints
        self._rows: list[tuple[ca.SX, float, float]] = []
        state, bounds = ca.SX.sym("state", 3, joints), ca.SX.sym("bounds", 3, joints)
        tolerance = ca.SX.sym("tolerance")
        unknowns, numbers, durations, before = [], [state, bounds], [], state
        for number in range(stretches):
            is_last = number == stretches - 1
            free = ca.SX.sym("controls", intervals + 3 - 2 * is_last, joints)
            controls = ca.vertcat(free, *[free[-1, :]] * (2 * is_last))  # at rest at the end
            duration, s = ca.SX.sym("duration"), ca.SX.sym("s", intervals)
            coefficients = ca.SX.sym("coefficients", DEGREE + 1, joints)
            unknowns += [ca.vec(free.T), duration, s]
            numbers.append(coefficients)
            rate = intervals / duration
            self._limit(controls, rate, bounds, is_last=is_last)
            self._add(_state_at(controls, 0, rate) - before, 0.0)
            before = _state_at(controls, intervals, rate)
            for i in range(intervals):
                there = _state_at(controls, i + 1, rate)[0, :]
                self._add((there - _polynomial(coefficients, s[i])) / tolerance, 1.0)
            durations.append(duration)
        p = ca.vertcat(*(ca.vec(each.T) for each in numbers), tolerance)
        problem = {"x": ca.vertcat(*unknowns), "p": p, "f": ca.sum1(ca.vertcat(*durations))}
        self._solver = Solver("fastest", problem, self._rows, _FAST)

    def solve(
        self,
        window: Sequence[_Stretch],
        tail: Sequence[_Piece],
        state: _State,
        limits: JointLimits,
        tolerance_rad: float,
    ) -> list[_Piece] | None:
        """The fastest motions along the stretches, to rest; None where none is found.

        Args:
            window: the stretches.
            tail: motions along the first of them, from a previous window.
            state: at the start.
            limits: of the joints.
            tolerance_rad: maximum distance of each joint from the stretch at the knots.
        """
        n, last = self.intervals, len(window) - 1
        sketches = _sketches(window[len(tail) :], n, limits, rests=not tail)
        guess = [*tail, *(_Piece(each.controls, each.duration_s) for each in sketches)]
        unit_s = max(each.duration_s for each in guess)
        x0, low, high = (list[FloatArray]() for _ in range(3))
        for number, piece in enumerate(guess):
            controls = piece.controls[: n + 1] if number == last else piece.controls
            duration, fractions = piece.duration_s / unit_s, np.linspace(0.0, 1.0, n + 1)[1:]
            x0 += [controls.ravel(), np.array([duration]), fractions]
            low += [np.tile(limits.q_min, len(controls)), np.array([MIN_DURATION]), fractions // 1]
            high += [np.tile(limits.q_max, len(controls)), np.array([MAX_DURATION]), np.ones(n)]
        units = unit_s ** np.arange(4)[:, None]
        bounds = WITHIN * np.array([limits.v_max, limits.a_max, limits.j_max]) * units[1:]
        parts = np.array(state) * units[:3], bounds, *(each.coefficients for each in window)
        numbers = np.concatenate([*(each.ravel() for each in parts), [tolerance_rad]])
        lbx, ubx = np.concatenate(low), np.concatenate(high)
        x = self._solver.solution(x0=np.concatenate(x0).clip(lbx, ubx), p=numbers, lbx=lbx, ubx=ubx)
        return None if x is None else list(self._found(x, last, unit_s))

    def _found(self, x: FloatArray, last: int, unit_s: float) -> Iterator[_Piece]:
        n, at = self.intervals, 0
        for number in range(last + 1):
            size = (n + 3 - 2 * (number == last)) * self._joints
            controls = x[at : at + size].reshape(-1, self._joints)
            whole = np.concatenate([controls, np.repeat(controls[-1:], n + 3 - len(controls), 0)])
            yield _Piece(whole, float(x[at + size]) * unit_s)
            at += size + 1 + n

    def _limit(self, controls: ca.SX, rate: ca.SX, bounds: ca.SX, *, is_last: bool) -> None:
        """Rows for shares of the limits of v, a and j; those that are zero are left out."""
        for order, weights in enumerate(DIFFERENCES, 1):
            count = controls.shape[0] - order
            terms = (w * controls[i : i + count, :] for i, w in enumerate(weights.tolist()))
            moving = count - (3 - order) * is_last
            share = sum(terms) * rate**order / ca.repmat(bounds[order - 1, :], count, 1)
            self._add(share[:moving, :], 1.0)

    def _add(self, rows: ca.SX, bound: float) -> None:
        self._rows.append((ca.vec(rows), -bound, bound))


_window = lru_cache(maxsize=32)(_Window)


def _state_at(controls: ca.SX, knot: int, rate: ca.SX) -> ca.SX:
    """Position, velocity and acceleration at a knot, 3 x joints."""
    here = controls[knot : knot + 3, :]
    return ca.vertcat(*(ca.DM(w).T @ here * rate**i for i, w in enumerate(AT_KNOT)))


def _polynomial(coefficients: ca.SX, s: ca.SX) -> ca.SX:
    """Its value at s, by Horner's rule, 1 x joints."""
    value = coefficients[DEGREE, :]
    for power in reversed(range(DEGREE)):
        value = value * s + coefficients[power, :]
    return value


def _differences(
    times_s: FloatArray, q: FloatArray, ends_s: Sequence[float], pieces: Sequence[Trajectory]
) -> FloatArray:
    """For each sample, its difference from the nearest point of the motion around its stretch.

    Args:
        times_s: of the samples, shape (m,).
        q: the samples, shape (m, joints), rad.
        ends_s: where each stretch ends.
        pieces: the motion along each.
    """
    points = [_points(piece) for piece in pieces]
    stretch = np.searchsorted(np.array(ends_s[:-1]), times_s)
    off = np.empty_like(q)
    for number in np.unique(stretch).tolist():
        own = np.flatnonzero(stretch == number)
        near = np.concatenate(points[max(0, number - 1) : number + 2])
        away = q[own][:, None] - near
        nearest = np.abs(away).max(axis=2).argmin(axis=1)
        off[own] = -away[np.arange(len(own)), nearest]
    return off


def _points(piece: Trajectory) -> FloatArray:
    """Points of a motion that are at most `APART_RAD` apart, shape (n, joints)."""
    fastest = float(np.abs(piece.v).max()) + 1e-9
    count = max(2, math.ceil(1.5 * fastest * piece.duration / APART_RAD))
    sampled: FloatArray = piece.sample(np.linspace(0.0, piece.duration, count)).q
    return sampled
