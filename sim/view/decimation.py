"""Few keyframes instead of many samples: what a replay needs of a recorded motion.

Samples are first taken at no more than `FRAMES_PER_S`; then those that their neighbours already say
by straight interpolation are left out (Ramer 1972; Douglas and Peucker 1973, with the deviation
measured at equal time instead of across the line).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from baxter_kin.arrays import Vector

FRAMES_PER_S = 30.0


def frame_samples(times_s: Vector) -> NDArray[np.intp]:
    """Indices of at most `FRAMES_PER_S` samples a second, with the first and the last.

    Args:
        times_s: shape (n,), strictly increasing.
    """
    frames = np.floor((times_s - times_s[0]) * FRAMES_PER_S + 1e-6)
    first_of_frame = np.flatnonzero(np.diff(frames, prepend=-1.0) > 0)
    return np.union1d(first_of_frame, [len(times_s) - 1])


def telling_samples(times_s: Vector, values: Vector, tolerance: float) -> NDArray[np.intp]:
    """Indices of the samples from which straight interpolation gives all the others.

    Args:
        times_s: shape (n,), strictly increasing.
        values: shape (n, k).
        tolerance: how far a value left out may be off, in the unit of `values`.

    Returns:
        The first and the last sample, and what is needed between them, in order.
    """
    kept = np.zeros(len(times_s), dtype=bool)
    kept[[0, -1]] = True
    open_spans = [(0, len(times_s) - 1)]
    while open_spans:
        start, end = open_spans.pop()
        if end - start < 2:
            continue
        worst, deviation = _worst(times_s[start : end + 1], values[start : end + 1])
        if deviation > tolerance:
            kept[start + worst] = True
            open_spans += [(start, start + worst), (start + worst, end)]
    return np.flatnonzero(kept)


def _worst(times_s: Vector, values: Vector) -> tuple[int, float]:
    """The sample farthest from the straight line between the ends, and how far it is."""
    share = ((times_s - times_s[0]) / (times_s[-1] - times_s[0]))[:, None]
    deviations = np.abs(values[0] + share * (values[-1] - values[0]) - values).max(axis=1)
    worst = int(deviations.argmax())
    return worst, float(deviations[worst])
