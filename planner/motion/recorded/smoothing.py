"""Motions near recorded samples at their times: smooth, within all limits, from rest to rest.

Each joint is a uniform cubic B-spline over the recorded time, at rest at both ends, and the
solution of a quadratic program:

```
minimise    mean (jerk / j_max)^2 + mean (distance / tolerance)^2 + 1000 slack
subject to  |distance| <= tolerance (1 + slack) at every sample, and the limits of q, v, a and j
```

A slack above zero shows that the limits forbid the tolerance at this speed. The rows of the samples
are left out at first, since the mean alone mostly keeps the tolerance. IPOPT solves the program
with the predictor and corrector of Mehrotra ("On the implementation of a primal-dual interior point
method", SIAM J. Optimization 2, 1992). A recording that begins or ends in motion is run more slowly
there, as from rest, where this brings the motion much nearer.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from baxter_kin import JointLimits
from baxter_kin.validation import FloatArray, Indices
from planner.errors import MotionError
from planner.motion.program.rows import constant
from planner.splines import DIFFERENCES, trajectory_of, weights_at
from planner.trajectory import Trajectory

INTERVAL_S, SHORT_S, FEW, MIN_INTERVALS = 0.05, 0.01, 16, 4
"""Length of an interval of the spline at the recorded speed; the length down to which there are at
least so many; and their minimum number. With twice the length, motions that use the limits fully
are followed only within 9 mrad."""

SLACK_COST = 1e3
"""Cost of one tolerance of slack, far above what the means gain by it."""

NEAR, ROUNDING = 0.5, 1e-3
"""Share of the tolerance from which on a sample gets a row once another one is too far, and share
by which it may be too far by rounding."""

EASY, NEAR_END_S, LATER = 0.6, 1.0, 0.8
"""Share of the tolerance that is used at most by a motion that keeps the recorded times at its ends
with ease; time from an end within which its greatest deviation else is; and the share of that
deviation that a motion with later times must stay below."""

END_S, MIN_RAD_S, SHARE = 0.2, 0.1, 0.3
"""Time from which the speed at an end is estimated, by a parabola; the minimum of that estimate,
which noise would make too low; and share of the limits that a start from rest may use."""

WITHIN = 1.0 - 1e-6
"""Share of the limits that is used; the rest is for rounding."""

OPTIONS: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "show_eval_warnings": False,
    "calc_lam_p": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.constr_viol_tol": 1e-9,
    "ipopt.acceptable_iter": 0,  # nothing less is acceptable
}

_QUADRATIC: dict[str, Any] = OPTIONS | {
    "ipopt.tol": 1e-6,
    "ipopt.max_iter": 200,
    "ipopt.mehrotra_algorithm": "yes",
    "ipopt.jac_c_constant": "yes",
    "ipopt.jac_d_constant": "yes",
    "ipopt.hessian_constant": "yes",
}


class NearMotion(NamedTuple):
    """A motion near recorded samples.

    Attributes:
        trajectory: the motion.
        off_rad: for each of m samples, its difference from the motion: at its time, or from the
            nearest point of its surroundings where the timing is free; shape (m, joints), rad.
    """

    trajectory: Trajectory
    off_rad: FloatArray

    @property
    def deviation_rad(self) -> float:
        """Greatest difference of any joint."""
        return float(np.abs(self.off_rad).max())


def at_recorded_speed(
    times_s: FloatArray,
    q: FloatArray,
    limits: JointLimits,
    tolerance_rad: float,
    q_start: FloatArray | None = None,
) -> NearMotion:
    """The smooth motion near samples at their times, from rest to rest.

    Where samples begin or end in motion, they may have to be passed later, by a constant time in
    between (`from_rest_to_rest`).

    Args:
        times_s: from 0, increasing, at least two, shape (m,).
        q: shape (m, joints), rad.
        limits: of the joints.
        tolerance_rad: allowed distance of each joint from each sample. It is exceeded where the
            limits forbid it.
        q_start: where the motion starts, if it is given, shape (joints,), rad.

    Raises:
        MotionError: when no solution is found.
    """
    found = _near(times_s, q, limits, tolerance_rad, q_start)
    worst_s = float(times_s[np.abs(found.off_rad).max(axis=1).argmax()])
    is_inside = NEAR_END_S < worst_s < times_s[-1] - NEAR_END_S
    if is_inside or found.deviation_rad <= EASY * tolerance_rad:
        return found
    later_s = from_rest_to_rest(times_s, q, limits)
    later = _near(later_s, q, limits, tolerance_rad, q_start)
    return later if later.deviation_rad < LATER * found.deviation_rad else found


def _near(
    times_s: FloatArray,
    q: FloatArray,
    limits: JointLimits,
    tolerance_rad: float,
    q_start: FloatArray | None,
) -> NearMotion:
    trajectory = smoothed(times_s, q, limits, tolerance_rad, q_start)
    return NearMotion(trajectory, trajectory.sample(times_s).q - q)


def from_rest_to_rest(times_s: FloatArray, q: FloatArray, limits: JointLimits) -> FloatArray:
    """Times of samples that begin and end at rest, shape (m,).

    At both ends, recorded time starts to run smoothly, from standstill: its rate is u^2 (3 - 2 u),
    u from 0 to 1. So the path stays as it is, and the arm is at rest at both ends.
    """
    begun = times_s + _delays(times_s, q, limits)
    delays = _delays(begun[-1] - begun[::-1], q[::-1], limits)[::-1]
    eased_s: FloatArray = begun - delays + delays[0]
    return eased_s


def _delays(times_s: FloatArray, q: FloatArray, limits: JointLimits) -> FloatArray:
    """By how much later than in `times_s` samples are reached from rest."""
    first = times_s <= max(END_S, times_s[min(2, len(times_s) - 1)])
    degree = min(2, int(first.sum()) - 1)
    speeds = np.abs(np.polyfit(times_s[first], q[first], degree)[-2]).clip(min=MIN_RAD_S)
    by_acceleration = 1.5 * speeds / (SHARE * limits.a_max)  # greatest slopes of the rate
    ramp_s = max(by_acceleration.max(), np.sqrt(6.0 * speeds / (SHARE * limits.j_max)).max())
    u = np.linspace(0.0, 1.0, 200)
    recorded_s, real_s = ramp_s * u**3 * (1.0 - 0.5 * u), ramp_s * u
    later_s: FloatArray = np.interp(times_s, recorded_s, real_s - recorded_s)
    return later_s


def smoothed(
    times_s: FloatArray,
    q: FloatArray,
    limits: JointLimits,
    tolerance_rad: float,
    q_start: FloatArray | None,
    *,
    is_limited: bool = True,
) -> Trajectory:
    """The spline of the quadratic programs of all joints.

    Args:
        times_s: as of `at_recorded_speed`, as the next four.
        q: likewise.
        limits: likewise.
        tolerance_rad: likewise.
        q_start: likewise.
        is_limited: whether the limits of v, a and j, and the tolerance of each sample, are rows.
    """
    program = _Smoothing(times_s, tolerance_rad, is_limited)
    starts = [None] * q.shape[1] if q_start is None else q_start.tolist()
    each = (program.controls(q[:, i], limits, i, start) for i, start in enumerate(starts))
    return trajectory_of(np.array(list(each)).T, float(times_s[-1]), limits)


class _Smoothing:
    """The quadratic program of a joint; the same for all joints of a recording.

    Its unknowns are all controls but the first two and the last two: each of these equals the next
    one, so that the arm rests there.
    """

    def __init__(self, times_s: FloatArray, tolerance_rad: float, is_limited: bool) -> None:
        duration_s, samples = float(times_s[-1]), len(times_s)
        few = min(FEW, math.ceil(duration_s / SHORT_S))
        intervals = max(MIN_INTERVALS, few, math.ceil(duration_s / INTERVAL_S))
        step_s = duration_s / intervals
        self._count = intervals - 1
        self._tolerance, self._is_limited = tolerance_rad, is_limited
        self._middle_s = step_s * np.arange(self._count) + step_s
        self._times_s = times_s
        k = np.clip((times_s / step_s).astype(int), 0, intervals - 1)
        row, column = np.repeat(np.arange(samples), 4), (k[:, None] + np.arange(4)).ravel()
        weights = weights_at(times_s / step_s - k).ravel()
        self._positions = self._matrix(row, column, weights, samples)
        self._derivatives = []
        for order, difference in enumerate(DIFFERENCES, 1):
            first = np.arange(3 - order, self._count + 1)  # the others are zero
            row = np.repeat(np.arange(len(first)), order + 1)
            column = (first[:, None] + np.arange(order + 1)).ravel()
            weights = np.tile(difference / step_s**order, len(first))
            self._derivatives.append(self._matrix(row, column, weights, len(first)))

    def controls(
        self, q: FloatArray, limits: JointLimits, joint: int, q_start: float | None
    ) -> FloatArray:
        """The controls of one joint, shape (n + 3,), rad.

        Args:
            q: its samples, shape (m,), rad.
            limits: of all joints.
            joint: its number.
            q_start: where it starts, if that is given, rad.
        """
        bounds = WITHIN * np.array([each[joint] for each in (limits.v_max, limits.a_max)])
        numbers = np.concatenate([q, bounds, [WITHIN * limits.j_max[joint]]])
        low, high = (np.full(self._count, each[joint]) for each in (limits.q_min, limits.q_max))
        if q_start is not None:
            low[0] = high[0] = q_start
        guess = np.interp(self._middle_s, self._times_s, q).clip(low, high)
        found = self._without_rows.solution(x0=guess, p=numbers, lbx=low, ubx=high)
        low, high, slack = np.append(low, 0.0), np.append(high, np.inf), 0.0
        rows = np.zeros(len(q), dtype=np.bool_)
        while found is not None and self._is_limited:
            controls = found[: self._count]
            shares = np.abs(np.array(self._positions @ controls).ravel() - q) / self._tolerance
            if not (shares[~rows] > 1.0 + slack + ROUNDING).any():
                break
            rows |= shares > NEAR
            guess = np.append(controls, shares.max())
            found = self._program(rows).solution(x0=guess, p=numbers, lbx=low, ubx=high)
            slack = 0.0 if found is None else float(found[-1])
        if found is None:
            raise MotionError("no smooth motion along the recording was found")
        ends = np.clip(np.arange(self._count + 4) - 2, 0, self._count - 1)
        spline: FloatArray = found[ends]
        return spline

    def _matrix(self, rows: Indices, columns: Indices, weights: FloatArray, count: int) -> ca.DM:
        """Weights of all controls, by which the unknowns are weighted."""
        unknown = np.clip(columns - 2, 0, self._count - 1)
        return constant(rows, unknown, weights, (count, self._count))

    @cached_property
    def _without_rows(self) -> Solver:
        return self._program(np.zeros(len(self._times_s), dtype=np.bool_))

    def _program(self, rows: NDArray[np.bool_]) -> Solver:
        """The program with rows for some of the samples, shape (m,), and with slack for any."""
        samples, chosen = len(rows), np.flatnonzero(rows).tolist()
        x, p = (
            ca.MX.sym("x", self._count + bool(chosen)),
            ca.MX.sym("p", samples + len(DIFFERENCES)),
        )
        controls, bounds = x[: self._count], p[samples:]
        off = (self._positions @ controls - p[:samples]) / self._tolerance
        shares = [each @ controls / bounds[i] for i, each in enumerate(self._derivatives)]
        f = ca.sumsqr(shares[-1]) / self._count + ca.sumsqr(off) / samples
        bounded = [(each, -1.0, 1.0) for each in shares] if self._is_limited else []
        if chosen:
            slack = x[self._count]
            near = (self._positions[chosen, :] @ controls - p[chosen]) / self._tolerance
            f += SLACK_COST * slack
            bounded += [(near - slack, -np.inf, 1.0), (near + slack, -1.0, np.inf)]
        return Solver("smooth", {"x": x, "p": p, "f": f}, bounded, _QUADRATIC)


class Solver:
    """A solver whose rows have constant bounds."""

    def __init__(
        self,
        name: str,
        problem: Mapping[str, Any],
        rows: Sequence[tuple[Any, float, float]],
        options: dict[str, Any],
    ) -> None:
        """Build the solver.

        Args:
            name: of the solver.
            problem: unknowns, parameters and objective, of one of CasADi's types.
            rows: columns of rows, of the same type, and the bounds of each.
            options: of IPOPT.
        """
        g = ca.vertcat(*(each for each, _, _ in rows))
        self._solver = ca.nlpsol(name, "ipopt", {**problem, "g": g}, options)
        sizes = [each.shape[0] for each, _, _ in rows]
        self._bounds = {
            "lbg": np.repeat([low for _, low, _ in rows], sizes),
            "ubg": np.repeat([high for _, _, high in rows], sizes),
        }

    def solution(self, **inputs: FloatArray) -> FloatArray | None:
        """The solution; None where the solver fails."""
        answer = self._solver(**inputs, **self._bounds)
        x: FloatArray = np.array(answer["x"]).ravel()
        return x if self._solver.stats()["success"] else None
