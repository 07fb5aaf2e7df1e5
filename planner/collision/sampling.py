"""Motions looked at in samples: quick to reject one, never a proof that it is clear."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from baxter_kin.validation import FloatArray, expect, positive_scalar
from planner.errors import TrajectoryError
from planner.trajectory import Trajectory

IsFree: TypeAlias = Callable[[FloatArray], bool]
"""Whether an arm touches nothing at a configuration, shape (n,), rad."""

SCREENING_STEP_RAD = 0.03
"""Farthest that a joint moves between two looks at a motion that is proven, or not, afterwards."""


def looks_clear(trajectory: Trajectory, is_free: IsFree, step_rad: float) -> bool:
    """Whether a motion is free at samples, both ends included, the middle first.

    Args:
        trajectory: the motion.
        is_free: asked for each sample.
        step_rad: farthest that a joint moves between two samples.
    """
    times = sample_times(trajectory, step_rad)
    qs = trajectory.sample(times).q
    return all(is_free(qs[i]) for i in bisecting(len(times)))


def sample_times(trajectory: Trajectory, step_rad: float) -> FloatArray:
    """Times between which no joint moves by more than `step_rad`, both ends included."""
    expect(trajectory, Trajectory, "trajectory", TrajectoryError)
    positive_scalar(step_rad, "step_rad", TrajectoryError)
    if trajectory.duration == 0.0:
        return np.zeros(1)
    lengths = _top_speeds(trajectory) * np.diff(trajectory.knots_s)
    way = np.concatenate([[0.0], np.cumsum(lengths)])  # no joint has moved farther by that knot
    count = max(1, math.ceil(way[-1] / step_rad))
    return np.interp(np.linspace(0.0, way[-1], count + 1), way, trajectory.knots_s)


@lru_cache(maxsize=1024)
def bisecting(count: int) -> tuple[int, ...]:
    """The numbers 0 .. `count` - 1 as by bisection: both ends, the middle, the quarters.

    A collision in the middle of a motion is then found after few samples.
    """
    inner = sorted(range(1, count - 1), key=lambda number: -(number & -number))
    return tuple(dict.fromkeys([0, count - 1, *inner])) if count else ()


def _top_speeds(trajectory: Trajectory) -> FloatArray:
    """The speed of the fastest joint in every segment, exact, shape (m,), rad/s."""
    v = trajectory.v
    speeds: FloatArray = np.abs([v[:-1], v[1:], trajectory.turning_velocities]).max(axis=(0, 2))
    return speeds
