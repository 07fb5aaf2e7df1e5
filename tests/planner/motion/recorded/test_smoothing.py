"""Motions near recorded samples at their times."""

from __future__ import annotations

import numpy as np
import pytest

from baxter_kin import Arm
from planner.motion.recorded.smoothing import at_recorded_speed, from_rest_to_rest
from tests.planner.motion.recorded.samples import (
    MAKERS,
    STEP_S,
    TOLERANCE_RAD,
    assert_within_limits,
    guided,
    noisy,
    planned,
    times_of,
)


@pytest.mark.parametrize("kind", MAKERS)
@pytest.mark.parametrize("seed", range(2))
def test_at_the_recorded_speed_a_motion_is_near_every_sample_and_smooth(
    any_arm: Arm, kind: str, seed: int
) -> None:
    """Noise costs less than a tenth of the jerk of the same recording without it."""
    rng = np.random.default_rng(seed)
    clean = MAKERS[kind](any_arm, rng)
    q = noisy(clean, rng)
    found, smooth = (
        at_recorded_speed(times_of(each), each, any_arm.limits, TOLERANCE_RAD)
        for each in (q, clean)
    )
    assert_within_limits(found.trajectory)
    assert found.deviation_rad <= 0.6 * TOLERANCE_RAD
    jerk, least = (np.sqrt(np.square(each.trajectory.j).mean()) for each in (found, smooth))
    assert jerk <= 1.1 * least


def test_a_speed_beyond_the_limits_costs_the_tolerance_not_the_limits(left: Arm) -> None:
    q = guided(left, np.random.default_rng(0), speed=4.0)
    found = at_recorded_speed(times_of(q), q, left.limits, TOLERANCE_RAD)
    assert_within_limits(found.trajectory)
    assert found.deviation_rad > TOLERANCE_RAD


def test_samples_are_passed_at_their_times(left: Arm) -> None:
    q = planned(left, np.random.default_rng(0))
    found = at_recorded_speed(times_of(q), q, left.limits, TOLERANCE_RAD)
    off_rad = found.trajectory.sample(times_of(q)).q - q
    assert found.trajectory.duration == times_of(q)[-1]
    np.testing.assert_array_equal(found.off_rad, off_rad)


def test_a_recording_in_motion_is_begun_and_ended_more_slowly(left: Arm) -> None:
    """In between, time runs as recorded."""
    q = guided(left, np.random.default_rng(0))[200:400]
    later_s = from_rest_to_rest(times_of(q), q, left.limits)
    gaps = np.diff(later_s)
    assert later_s[0] == 0.0
    assert (gaps >= STEP_S - 1e-9).all()
    assert min(gaps[0], gaps[-1]) > 2.0 * STEP_S
    np.testing.assert_allclose(gaps[80:120], STEP_S, rtol=0.0, atol=1e-9)
    found = at_recorded_speed(times_of(q), q, left.limits, TOLERANCE_RAD)
    assert_within_limits(found.trajectory)
    assert found.deviation_rad <= 0.6 * TOLERANCE_RAD
    assert found.trajectory.duration == later_s[-1]
