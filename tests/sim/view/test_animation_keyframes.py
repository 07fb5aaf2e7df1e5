from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from sim.view.animation import FRAMES_PER_S, frame_samples, telling_samples

TOLERANCE = 0.05

motions = st.integers(1, 60).flatmap(
    lambda n: arrays(np.float64, (n, 2), elements=st.floats(-3.0, 3.0, width=32))
)


@given(motions)
def test_interpolation_gives_the_samples_left_out(values: NDArray[np.float64]) -> None:
    times = np.linspace(0.0, 1.0, len(values)) if len(values) > 1 else np.zeros(1)
    kept = telling_samples(times, values, TOLERANCE)
    for column in values.T:
        shown = np.interp(times, times[kept], column[kept])
        assert np.abs(shown - column).max() <= TOLERANCE + 1e-12


@given(motions)
def test_keeps_both_ends(values: NDArray[np.float64]) -> None:
    kept = telling_samples(np.arange(len(values), dtype=float), values, TOLERANCE)
    assert (kept[0], kept[-1]) == (0, len(values) - 1)


def test_a_straight_line_needs_two_samples() -> None:
    times = np.linspace(0.0, 5.0, 501)
    assert telling_samples(times, 0.3 * times[:, None], 1e-9).tolist() == [0, 500]


def test_takes_no_more_frames_than_promised() -> None:
    times = np.arange(1001) / 100.0
    assert len(frame_samples(times)) <= 10 * FRAMES_PER_S + 2


def test_takes_the_last_moment_too() -> None:
    assert frame_samples(np.arange(100) / 100.0)[-1] == 99


def test_takes_all_of_a_slow_recording() -> None:
    assert frame_samples(np.arange(10) / 10.0).tolist() == list(range(10))
