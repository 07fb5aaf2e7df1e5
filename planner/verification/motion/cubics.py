"""A motion of constant jerks, taken from its knots alone, and its exact extrema.

Between the zeros of its derivative a polynomial is monotone, so a change of sign there brackets
exactly one root, which bisection finds to the last bit. Applied from acceleration, which is linear,
to velocity this gives every moment where a joint turns, without a formula for roots.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from baxter_kin.validation import FloatArray, Indices
from planner.trajectory import Trajectory

_BISECTIONS = 64
"""Halvings after which an interval of floats cannot shrink any further."""


@dataclass(frozen=True, slots=True, eq=False)
class States:
    """Moments of each joint for itself; every array of shape (k, n)."""

    time_s: FloatArray
    q: FloatArray
    v: FloatArray
    a: FloatArray


class Cubics:
    """A trajectory as the polynomials that its knots and jerks stand for."""

    def __init__(self, trajectory: Trajectory) -> None:
        self.knots_s = np.array(trajectory.knots_s)
        self.knots = tuple(np.array(x) for x in (trajectory.q, trajectory.v, trajectory.a))
        self.jerks = np.array(trajectory.j)
        self.lengths_s = np.diff(self.knots_s)
        self.duration_s = float(self.knots_s[-1])

    def after(self, segments: Indices, dt: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """q, v, a a time `dt`, broadcast to (k, n), after the start of segments, shape (k,)."""
        q, v, a = (x[segments] for x in self.knots)
        j = self.jerks[segments]
        return (
            q + v * dt + a * dt**2 / 2 + j * dt**3 / 6,
            v + a * dt + j * dt**2 / 2,
            a + j * dt,
        )

    def positions(self, times_s: FloatArray) -> FloatArray:
        """Positions at times within the motion, shape (k,); shape (k, n)."""
        if not len(self.jerks):
            return np.repeat(self.knots[0], len(times_s), axis=0)
        last = len(self.jerks) - 1
        segments = np.clip(np.searchsorted(self.knots_s, times_s, side="right") - 1, 0, last)
        return self.after(segments, (times_s - self.knots_s[segments])[:, None])[0]

    def fastest_change(self, times_s: FloatArray) -> FloatArray:
        """Greatest acceleration of each joint between one time and the next, shape (k - 1, n).

        No knot lies between two times, so acceleration is linear there.
        """
        if not len(self.jerks):
            return np.zeros((max(0, len(times_s) - 1), self.jerks.shape[1]))
        middle = (times_s[:-1] + times_s[1:]) / 2
        segments = np.searchsorted(self.knots_s[1:-1], middle, side="right")
        ends = (
            self.after(segments, (t - self.knots_s[segments])[:, None])[2]
            for t in (times_s[:-1], times_s[1:])
        )
        first, last = ends
        return np.maximum(np.abs(first), np.abs(last))

    def jumps(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """How far q, v and a at each knot are from what the segment before leads to; (m, n)."""
        segments = np.arange(len(self.jerks))
        reached = self.after(segments, self.lengths_s[:, None])
        q, v, a = (abs(end - x[1:]) for end, x in zip(reached, self.knots, strict=True))
        return q, v, a

    def critical_states(self) -> States:
        """All states in which q, v or a of a joint can be extreme: at knots, and where it turns.

        The state that a segment leads to counts as the knot at its end; `jumps` compares the two.
        """
        segments = np.arange(len(self.jerks))
        at_knots = np.broadcast_to(self.knots_s[:, None], self.knots[0].shape)
        parts = [(at_knots, *self.knots)]
        parts += [(self.knots_s[:-1, None] + dt, *self.after(segments, dt)) for dt in self._turns]
        return States(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def turning_times(self) -> FloatArray:
        """Knots, and moments where a joint turns or speeds up no more; sorted, each once."""
        inside = [(self.knots_s[:-1, None] + dt).ravel() for dt in self._turns]
        return np.unique(np.concatenate([self.knots_s, *inside]))

    @cached_property
    def _turns(self) -> list[FloatArray]:
        """Times after the start of each segment where a, then v twice, pass zero; (m, n) each."""
        segments, begin = np.arange(len(self.jerks)), np.zeros_like(self.jerks)
        end = np.broadcast_to(self.lengths_s[:, None], self.jerks.shape)
        steady = _root(lambda dt: self.after(segments, dt)[2], begin, end)
        return [
            steady,
            _root(lambda dt: self.after(segments, dt)[1], begin, steady),
            _root(lambda dt: self.after(segments, dt)[1], steady, end),
        ]


def _root(f: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray) -> FloatArray:
    """Where a monotone function passes zero between `low` and `high`; `low` where it does not."""
    sign = np.sign(f(low))
    crosses = sign * np.sign(f(high)) < 0.0
    begin, end = np.array(low), np.where(crosses, high, low)
    if not crosses.any():
        return begin
    for _ in range(_BISECTIONS):
        middle = (begin + end) / 2
        is_before = np.sign(f(middle)) == sign
        begin, end = np.where(is_before, middle, begin), np.where(is_before, end, middle)
    return begin
