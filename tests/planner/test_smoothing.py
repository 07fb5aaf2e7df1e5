"""Smooth motions along corners: inside every limit, clear of obstacles, and faster than stops."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import Arm, ConfigurationError
from planner import MotionError, TrajectoryError, plan_joint_move
from planner.screening import sample_times
from planner.smoothing import SCREENING_STEP_RAD, blended, smoothed, stopping_at
from planner.splicing import joined, section
from planner.timing import POSITION_TOLERANCE_RAD, RATIO_TOLERANCE
from tests.planner.toy_world import AROUND_DISC, DISC, LEFT, LIMITS, RIGHT, least_distance

Vector = NDArray[np.float64]
seeds = st.integers(0, 2**32 - 1)

CORNERS = np.array([LEFT, [-1.0, 1.3], [1.0, 1.3], RIGHT])
"""Around the disc, at a distance."""

CHORD_DEPTH = SCREENING_STEP_RAD**2 / DISC.radius
"""How deep a chord of the disc is inside when both joints move by a step; four times what it is to
first order, because the motion between samples is no straight line."""

TIME_TOLERANCE_S = 1e-9
"""Of Ruckig's times."""


def everywhere(_q: Vector) -> bool:
    return True


def nowhere(_q: Vector) -> bool:
    return False


def around(seed: int = 0, is_free: Any = AROUND_DISC.is_free, **options: Any) -> Any:
    return smoothed(CORNERS, LIMITS, is_free, np.random.default_rng(seed), **options)


def random_corners(arm: Arm, seed: int) -> tuple[Vector, np.random.Generator]:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 6))
    corners = np.array([arm.random_configuration(rng) for _ in range(count)])
    at_limit = rng.random(corners.shape) < 0.1
    return np.where(at_limit, arm.limits.q_max, corners), rng


@given(seeds)
@settings(max_examples=10)
def test_every_limit_holds_at_the_exact_extrema(left: Arm, seed: int) -> None:
    corners, rng = random_corners(left, seed)
    motion = smoothed(corners, left.limits, everywhere, rng, tries=30)

    assert max(motion.peak_ratios()) <= 1.0 + RATIO_TOLERANCE
    for q in motion.position_extrema():
        assert not left.limits.violations(q, POSITION_TOLERANCE_RAD)


@given(seeds)
@settings(max_examples=10)
def test_is_between_the_fastest_direct_move_and_stopping_at_every_corner(
    left: Arm, seed: int
) -> None:
    corners, rng = random_corners(left, seed)
    motion = smoothed(corners, left.limits, everywhere, rng, tries=20)

    direct = plan_joint_move(corners[0], corners[-1], left.limits)
    assert motion.duration >= direct.duration - TIME_TOLERANCE_S
    assert motion.duration <= stopping_at(corners, left.limits).duration + TIME_TOLERANCE_S


@given(seeds)
@settings(max_examples=10)
def test_starts_and_ends_at_rest_where_the_corners_do(seed: int) -> None:
    motion = around(seed)

    assert np.array_equal(motion.q_start, CORNERS[0])
    assert np.array_equal(motion.q_goal, CORNERS[-1])
    assert not np.any([motion.v[0], motion.v[-1], motion.a[0], motion.a[-1]])


@given(seeds)
@settings(max_examples=10)
def test_is_clear_of_obstacles_but_for_what_fits_between_samples(seed: int) -> None:
    motion = around(seed)
    qs = motion.sample(sample_times(motion, 1e-3)).q

    assert least_distance(AROUND_DISC, qs) > -CHORD_DEPTH


def test_closer_samples_cut_less_of_an_obstacle() -> None:
    motion = around(3, step_rad=1e-3)
    qs = motion.sample(sample_times(motion, 1e-4)).q

    assert least_distance(AROUND_DISC, qs) > -1e-6


@pytest.mark.parametrize("seed", range(5))
def test_does_not_stop_on_its_way(seed: int) -> None:
    motion = around(seed)
    inner = np.linspace(0.05, 0.95, 500) * motion.duration

    assert np.linalg.norm(motion.sample(inner).v, axis=1).min() > 0.1


@pytest.mark.parametrize("seed", range(5))
def test_saves_a_quarter_of_the_time_of_stopping_at_three_legs(seed: int) -> None:
    assert around(seed).duration < 0.75 * stopping_at(CORNERS, LIMITS).duration


def test_blending_keeps_the_states_at_both_ends() -> None:
    legs = [plan_joint_move(q, q_next, LIMITS) for q, q_next in pairwise(CORNERS)]
    whole = joined(legs)
    moving = section(whole, 0.2, whole.duration - 0.3)
    pieces = [section(moving, 0.0, 1.0), section(moving, 1.0, moving.duration)]
    rng = np.random.default_rng(1)
    motion = blended(pieces, AROUND_DISC.is_free, rng)
    for time_s, wanted_s in ((0.0, 0.0), (motion.duration, moving.duration)):
        for found, wanted in zip(motion.sample(time_s), moving.sample(wanted_s), strict=True):
            np.testing.assert_allclose(found, wanted, atol=RATIO_TOLERANCE)
    assert motion.duration <= moving.duration


def test_pieces_that_do_not_meet_are_not_blended() -> None:
    apart = [plan_joint_move(LEFT, CORNERS[1], LIMITS), plan_joint_move(LEFT, RIGHT, LIMITS)]
    for pieces in (apart, [], None, ["piece"]):
        with pytest.raises(TrajectoryError):
            blended(pieces, everywhere, np.random.default_rng(1))  # type: ignore[arg-type]


def test_stops_where_no_shortcut_is_clear() -> None:
    motion = around(is_free=nowhere)

    assert motion.duration == stopping_at(CORNERS, LIMITS).duration
    assert np.array_equal(motion.q, stopping_at(CORNERS, LIMITS).q)


def test_stopping_rests_in_every_corner() -> None:
    motion = stopping_at(CORNERS, LIMITS)
    legs = pairwise(CORNERS)
    ends = np.cumsum([plan_joint_move(q, q_next, LIMITS).duration for q, q_next in legs])

    state = motion.sample(ends)
    assert state.q == pytest.approx(CORNERS[1:], abs=1e-9)
    assert np.abs([state.v, state.a]).max() < 1e-9


def test_the_same_numbers_make_the_same_motion() -> None:
    assert np.array_equal(around(4).q, around(4).q)
    assert np.array_equal(around(4).knots_s, around(4).knots_s)


def test_two_corners_are_a_joint_move() -> None:
    motion = smoothed(CORNERS[:2], LIMITS, everywhere, np.random.default_rng(0))

    assert np.array_equal(motion.q, plan_joint_move(CORNERS[0], CORNERS[1], LIMITS).q)


def test_the_same_corner_twice_costs_nothing() -> None:
    twice = np.repeat(CORNERS, 2, axis=0)

    assert stopping_at(twice, LIMITS).duration == stopping_at(CORNERS, LIMITS).duration
    assert stopping_at(CORNERS[[0, 0]], LIMITS).duration == 0.0


@pytest.mark.parametrize("corners", [[], [[0.0, 0.0]], [0.0, 1.0], "ab", [[[0.0, 0.0]]]])
def test_refuses_fewer_than_two_corners(corners: Any) -> None:
    with pytest.raises(MotionError):
        stopping_at(corners, LIMITS)


@pytest.mark.parametrize("corner", [[0.0, 9.0], [0.0, float("nan")], [0.0, 0.0]])
def test_refuses_a_corner_that_is_no_configuration_inside_the_limits(
    left: Arm, corner: list[float]
) -> None:
    limits = LIMITS if corner != [0.0, 0.0] else left.limits
    with pytest.raises(ConfigurationError):
        stopping_at([LEFT.tolist(), corner], limits)


def test_refuses_numbers_from_no_generator() -> None:
    generator: Any = 7
    with pytest.raises(MotionError, match="rng"):
        smoothed(CORNERS, LIMITS, everywhere, generator)
