"""Motions along recorded ones: near every sample, within all limits, from rest to rest."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.validation import FloatArray
from planner import Trajectory, plan_joint_move
from planner.motion.recorded import (
    NearMotion,
    as_fast_as_possible,
    at_recorded_speed,
    from_rest_to_rest,
)

TOLERANCE_RAD = 0.01
NOISE_RAD = 1e-3
STEP_S = 0.01


def planned(arm: Arm, rng: np.random.Generator) -> FloatArray:
    """Moves from rest to rest that use the limits fully, with a pause."""
    q, samples = arm.start, []
    for _ in range(4):
        goal = (q + rng.uniform(-0.5, 0.5, 7)).clip(arm.limits.q_min, arm.limits.q_max)
        move = plan_joint_move(q, goal, arm.limits)
        samples.append(move.sample(np.arange(0.0, move.duration, STEP_S)).q)
        samples.append(np.tile(goal, (40, 1)))
        q = goal
    return np.concatenate(samples)


def guided(arm: Arm, rng: np.random.Generator, speed: float = 1.0) -> FloatArray:
    """Smooth wandering, as by a hand that guides the arm; it ends in motion."""
    t = np.arange(0.0, 6.0, STEP_S)[:, None]
    q = np.tile(arm.start, (len(t), 1))
    for hertz in (0.07, 0.15, 0.31, 0.6):
        phase, size = rng.uniform(0.0, 2.0 * np.pi, 7), 0.12 / (hertz / 0.15 + 0.5)
        q += (
            size
            * np.sin(2.0 * np.pi * hertz * speed * t + phase)
            * np.sin(0.5 * np.pi * np.minimum(1.0, t)) ** 2
        )
    return q


MAKERS = {"planned": planned, "guided": guided}


def noisy(q: FloatArray, rng: np.random.Generator) -> FloatArray:
    return np.asarray(q + NOISE_RAD * rng.normal(size=q.shape))


def times_of(q: FloatArray) -> FloatArray:
    return np.asarray(STEP_S * np.arange(len(q)))


def assert_within_limits(motion: Trajectory) -> None:
    """Exactly, at the extrema; at rest at both ends."""
    low, high = motion.position_extrema()
    assert max(motion.peak_ratios()) <= 1.0
    assert (low >= motion.limits.q_min).all()
    assert (high <= motion.limits.q_max).all()
    for ends in (motion.v[[0, -1]], motion.a[[0, -1]]):
        assert np.abs(ends).max(initial=0.0) < 1e-8


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


Make = Callable[..., NearMotion]


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


def test_tiny_parts_between_pauses_are_kept(left: Arm) -> None:
    """Steps of 5 mrad, each followed by half a second of rest."""
    levels = np.cumsum(np.r_[np.zeros(1), np.full(6, 0.005)])
    q = np.repeat(left.start[None], 7 * 50, axis=0)
    q[:, 1] += np.repeat(levels, 50)
    found = as_fast_as_possible(times_of(q), q, left.limits, TOLERANCE_RAD)
    assert_within_limits(found.trajectory)
    assert found.deviation_rad <= TOLERANCE_RAD
    assert abs(found.trajectory.q_goal[1] - q[-1, 1]) <= TOLERANCE_RAD
