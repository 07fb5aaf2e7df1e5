"""The fastest motions along recorded samples; and what is true at the recorded speed, too."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from baxter_kin import Arm
from planner.motion.recorded.fastest import as_fast_as_possible
from planner.motion.recorded.smoothing import NearMotion, at_recorded_speed
from tests.planner.motion.recorded.samples import (
    MAKERS,
    NOISE_RAD,
    STEP_S,
    TOLERANCE_RAD,
    assert_within_limits,
    guided,
    noisy,
    times_of,
)

Make = Callable[..., NearMotion]


@pytest.mark.parametrize("kind", MAKERS)
def test_the_fastest_motion_passes_every_sample_and_leaves_pauses_out(left: Arm, kind: str) -> None:
    """Distances are measured here to a denser sample of the whole motion than in the code."""
    rng = np.random.default_rng(3)
    q = noisy(MAKERS[kind](left, rng), rng)
    times_s = times_of(q)
    found = as_fast_as_possible(times_s, q, left.limits, TOLERANCE_RAD)
    assert_within_limits(found.trajectory)
    assert found.deviation_rad <= TOLERANCE_RAD
    assert found.trajectory.duration < 0.9 * times_s[-1]
    points = found.trajectory.sample(np.linspace(0.0, found.trajectory.duration, 20_000)).q
    away = [np.abs(points - each).max(axis=1).min() for each in q[::7]]
    assert max(away) <= TOLERANCE_RAD


def test_tiny_parts_between_pauses_are_kept(left: Arm) -> None:
    """Steps of 5 mrad, each followed by half a second of rest."""
    levels = np.cumsum(np.r_[np.zeros(1), np.full(6, 0.005)])
    q = np.repeat(left.start[None], 7 * 50, axis=0)
    q[:, 1] += np.repeat(levels, 50)
    found = as_fast_as_possible(times_of(q), q, left.limits, TOLERANCE_RAD)
    assert_within_limits(found.trajectory)
    assert found.deviation_rad <= TOLERANCE_RAD
    assert abs(found.trajectory.q_goal[1] - q[-1, 1]) <= TOLERANCE_RAD


@pytest.mark.parametrize("make", [at_recorded_speed, as_fast_as_possible])
def test_a_motion_starts_where_the_last_one_ended(left: Arm, make: Make) -> None:
    q = guided(left, np.random.default_rng(1))[:200]
    start = q[0] + 0.002
    found = make(times_of(q), q, left.limits, TOLERANCE_RAD, start)
    np.testing.assert_allclose(found.trajectory.q_start, start, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("make", [at_recorded_speed, as_fast_as_possible])
@pytest.mark.parametrize("rows", [2, 3, 10, 300])
def test_an_arm_that_stands_still_stays_where_it_is(left: Arm, make: Make, rows: int) -> None:
    q = noisy(np.tile(left.start, (rows, 1)), np.random.default_rng(2))
    found = make(times_of(q), q, left.limits, TOLERANCE_RAD)
    assert_within_limits(found.trajectory)
    assert np.abs(found.trajectory.q - left.start).max() <= 5.0 * NOISE_RAD


def test_samples_may_be_rare_and_irregular(left: Arm) -> None:
    rng = np.random.default_rng(4)
    q = guided(left, rng)
    rows = np.sort(rng.choice(len(q), 150, replace=False))
    times_s = STEP_S * (rows - rows[0])
    for make in (at_recorded_speed, as_fast_as_possible):
        found = make(times_s, q[rows], left.limits, TOLERANCE_RAD)
        assert_within_limits(found.trajectory)
        assert found.deviation_rad <= TOLERANCE_RAD
