"""Uniform cubic B-splines: motions with constant jerk in each of n equal intervals.

Such a motion has n + 3 controls for every joint, four of which determine an interval. Position,
velocity and acceleration at knot i follow from the controls i, i + 1, i + 2, and so do bounds in
between: a spline and each of its derivatives stay within the convex hull of the controls involved
(de Boor, "A Practical Guide to Splines", 1978, ch. IX to XI). Derivatives are with respect to the
fraction of the duration; the n-th divided by the n-th power of the duration is the one by time.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from baxter_kin import JointLimits
from baxter_kin.validation import FloatArray
from planner.trajectory import Trajectory

AT_KNOT = (
    np.array([1.0, 4.0, 1.0]) / 6.0,
    np.array([-1.0, 0.0, 1.0]) / 2.0,
    np.array([1.0, -2.0, 1.0]),
)
"""Weights of three controls for position, velocity and acceleration at a knot, per interval."""

DIFFERENCES = (
    np.array([-1.0, 1.0]),
    np.array([1.0, -2.0, 1.0]),
    np.array([-1.0, 3.0, -3.0, 1.0]),
)
"""Weights of neighbouring controls for those of the first to third derivative, per interval."""


def weights_at(fractions: FloatArray) -> FloatArray:
    """Weights of the four controls of an interval at fractions of it, (m,): (m, 4)."""
    u = np.asarray(fractions)[:, None]
    powers = u ** np.arange(4)
    weights: FloatArray = powers @ _IN_INTERVAL
    return weights


def rates_at(fractions: FloatArray) -> FloatArray:
    """Weights of the four controls for the velocity, per interval, as `weights_at`: (m, 4)."""
    u = np.asarray(fractions)[:, None]
    powers = np.arange(4)
    rates: FloatArray = (powers * u ** np.maximum(powers - 1, 0)) @ _IN_INTERVAL
    return rates


_IN_INTERVAL = (
    np.array(
        [
            [1.0, 4.0, 1.0, 0.0],
            [-3.0, 0.0, 3.0, 0.0],
            [3.0, -6.0, 3.0, 0.0],
            [-1.0, 3.0, -3.0, 1.0],
        ]
    )
    / 6.0
)
"""Coefficients of the powers of the fraction, for each of the four controls."""


class Sketch(NamedTuple):
    """A motion given by some of its states, whether or not it keeps any limits.

    Attributes:
        q: at n + 1 equally spaced times, shape (n + 1, joints), rad.
        v_ends: at its start and its end, shape (2, joints), rad/s.
        duration_s: zero for a single configuration.
    """

    q: FloatArray
    v_ends: FloatArray
    duration_s: float

    @classmethod
    def of(cls, trajectory: Trajectory, intervals: int) -> Sketch:
        """Sample a motion over n intervals."""
        q, v, _ = trajectory.sample(np.linspace(0.0, trajectory.duration, intervals + 1))
        return cls(q, v[[0, -1]], trajectory.duration)

    @classmethod
    def of_each(cls, trajectories: Iterable[Trajectory], intervals: Iterable[int]) -> list[Sketch]:
        """Sample several motions, each over its own number of intervals."""
        return [cls.of(*pair) for pair in zip(trajectories, intervals, strict=True)]

    @property
    def intervals(self) -> int:
        """Number of intervals, n."""
        return len(self.q) - 1

    def towards(self, other: Sketch, share: float) -> Sketch:
        """A sketch between this one and another of as many intervals; its controls are, too."""
        own, others = 1.0 - share, share
        q = own * self.q + others * other.q
        duration_s = own * self.duration_s + others * other.duration_s
        ends = own * self.duration_s * self.v_ends + others * other.duration_s * other.v_ends
        return Sketch(q, ends / duration_s, duration_s)

    @property
    def controls(self) -> FloatArray:
        """Controls of the spline through all states, shape (n + 3, joints), rad."""
        count = len(self.q) + 2
        weights = np.zeros((count, count))
        for k in range(count - 2):
            weights[k, k : k + 3] = AT_KNOT[0]
        weights[-2, :3] = weights[-1, -3:] = AT_KNOT[1] * (count - 3)
        states = np.concatenate([self.q, self.v_ends * self.duration_s])
        controls: FloatArray = np.linalg.solve(weights, states)
        return controls


def trajectory_of(controls: FloatArray, duration_s: float, limits: JointLimits) -> Trajectory:
    """Convert a spline to a trajectory.

    Args:
        controls: shape (n + 3, joints), rad.
        duration_s: above zero.
        limits: of the joints.
    """
    intervals = len(controls) - 3
    step_s = duration_s / intervals
    windows = np.lib.stride_tricks.sliding_window_view(controls, 3, axis=0)
    v, a = (windows @ AT_KNOT[order] / step_s**order for order in (1, 2))
    q = windows[..., 1] + windows @ AT_KNOT[2] / 6.0  # exact where the arm rests
    knots_s = np.linspace(0.0, duration_s, intervals + 1)
    return Trajectory(limits, knots_s, q, v, a, np.diff(a, axis=0) / step_s)
