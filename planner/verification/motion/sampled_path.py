"""A motion sampled by how far it goes, not by how long it takes.

Between two moments where it turns, a joint goes one way only, so how far it goes is the difference
of its positions. Summed over the joints, each times a lever arm, that is a bound on the travel of
anything that they move, and it grows steadily with time: samples stand where it reaches the next
multiple of a step, found by bisection. Their number depends on the way alone: a motion a million
times slower has the same samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from baxter_kin.validation import FloatArray, Indices
from planner.verification.motion.cubics import Cubics

_BISECTIONS = 48
"""Halvings of a piece of motion: where a sample stands matters to no more digits."""


@dataclass(frozen=True, slots=True, eq=False)
class SampledPath:
    """Samples of one motion, the first at its start and the last at its end.

    Attributes:
        times_s: shape (k,).
        q: positions, shape (k, n).
        turned: how far each joint went since the sample before, back and forth; shape (k, n).
    """

    times_s: FloatArray
    q: FloatArray
    turned: FloatArray


def sampled_path(
    cubics: Cubics, reach_m: FloatArray, step_m: float, most: int, *, with_knots: bool = False
) -> SampledPath:
    """Samples with no more than a step of travel in between, or as many as `most`.

    Args:
        cubics: the motion.
        reach_m: lever arm of each joint, shape (n,), m.
        step_m: travel between two samples.
        most: greatest number of steps; where it does not suffice they are longer.
        with_knots: whether to stop at every knot as well.
    """
    turns = cubics.turning_times()
    q = cubics.positions(turns)
    gone = np.cumsum(np.abs(np.diff(q, axis=0, prepend=q[:1])), axis=0)
    travel = gone @ reach_m
    count = int(min(most, np.ceil(travel[-1] / step_m)))
    targets = np.linspace(0.0, travel[-1], count + 1)
    times = _times(cubics, reach_m, (turns, q, travel), targets)
    ends = np.array([0.0, cubics.duration_s])
    times = np.union1d(times[1:-1], np.concatenate([ends, cubics.knots_s if with_knots else ends]))
    return path_at(cubics, times)


def path_at(cubics: Cubics, times_s: FloatArray) -> SampledPath:
    """The samples at given times, shape (k,), increasing."""
    turns = cubics.turning_times()
    q = cubics.positions(turns)
    gone = np.cumsum(np.abs(np.diff(q, axis=0, prepend=q[:1])), axis=0)
    pieces = _pieces(turns, times_s)
    at = cubics.positions(times_s)
    so_far = gone[pieces] + np.abs(at - q[pieces])
    return SampledPath(times_s, at, np.diff(so_far, axis=0, prepend=so_far[:1]))


def _times(
    cubics: Cubics,
    reach_m: FloatArray,
    way: tuple[FloatArray, FloatArray, FloatArray],
    targets_m: FloatArray,
) -> FloatArray:
    """When the travel reaches each target."""
    turns, q, travel = way
    if len(turns) < 2:
        return np.repeat(turns[:1], len(targets_m))
    pieces = _pieces(travel, targets_m)
    low, high = turns[pieces], turns[pieces + 1]
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        gone = travel[pieces] + np.abs(cubics.positions(middle) - q[pieces]) @ reach_m
        is_before = gone < targets_m
        low, high = np.where(is_before, middle, low), np.where(is_before, high, middle)
    return high


def _pieces(starts: FloatArray, values: FloatArray) -> Indices:
    """The number of the piece that each value falls into; pieces are given by their starts."""
    numbers: Indices = np.searchsorted(starts, values, side="right") - 1
    return np.clip(numbers, 0, max(0, len(starts) - 2))
