"""Guesses for motion programs: on their lines, within the limits, and joined where they meet."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm
from baxter_kin.frames import raised
from baxter_kin.validation import FloatArray
from planner import StraightLine
from planner.motion.program.guess import (
    ACCURACY,
    MAX_STRIDE_RAD,
    LineFollowed,
    bent_to,
    follow,
    guess_along,
    guess_between,
    reversed_sketch,
)
from planner.splines import Sketch, trajectory_of
from tests.planner.lines import above, q_above

INTERVALS = 10

ROUNDING = 1e-9

ARC_COSINE_RAD = 1e-7
"""What an arc cosine near one is good for."""

FITTED, FITTED_RATE = 1e-8, 1e-6
"""What a fitted or solved cubic of values around 1 is good for, and its derivative."""

seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def q(left: Arm) -> FloatArray:
    """15 cm above the demo's grasp."""
    return q_above(left)


@pytest.fixture(scope="module")
def down(left: Arm, q: FloatArray) -> StraightLine:
    return StraightLine(left.T_base_tip(q), above(0.0))


def up(left: Arm, q: FloatArray, height_m: float) -> StraightLine:
    T = left.T_base_tip(q)
    return StraightLine(T, raised(T, height_m))


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=6).map(sorted))
def test_the_tip_is_where_the_line_is_at_each_fraction(
    left: Arm, q: FloatArray, down: StraightLine, fractions: list[float]
) -> None:
    found = follow(left, left.limits, q, down, fractions)
    assert len(found.qs) == len(fractions)
    for s, there in zip(fractions, found.qs, strict=True):
        assert np.linalg.norm(down.error(s, left.T_base_tip(there))) <= ACCURACY
        assert not left.limits.violations(there)


def test_the_way_hardly_depends_on_how_often_it_is_asked_for(
    left: Arm, q: FloatArray, down: StraightLine
) -> None:
    """One long step is made of as many strides as are needed."""
    far = follow(left, left.limits, q, down, [1.0]).q
    near = follow(left, left.limits, q, down, np.linspace(0.0, 1.0, 200).tolist()).q
    assert np.abs(far - near).max() <= MAX_STRIDE_RAD


def test_where_the_arm_ends_the_line_is_followed_so_far(left: Arm, q: FloatArray) -> None:
    line, fractions = up(left, q, 1.0), np.linspace(0.0, 1.0, 21).tolist()
    found = follow(left, left.limits, q, line, fractions)
    assert 0.0 < found.fraction < 1.0
    assert len(found.qs) == sum(s <= found.fraction for s in fractions)
    assert np.linalg.norm(line.error(found.fraction, left.T_base_tip(found.q))) <= ACCURACY
    guess = guess_along(left, left.limits, q, line, INTERVALS)
    assert isinstance(guess, LineFollowed)
    assert guess.fraction < 1.0


@pytest.mark.parametrize("ends_at_rest", [True, False])
def test_a_sketch_along_a_line_is_on_it_from_one_end_to_the_other(
    left: Arm, q: FloatArray, down: StraightLine, ends_at_rest: bool
) -> None:
    found = guess_along(left, left.limits, q, down, INTERVALS, ends_at_rest=ends_at_rest)
    assert isinstance(found, Sketch)
    assert found.intervals == INTERVALS
    off_m, off_rad = down.deviations(left.T_base_tips(found.q))
    assert off_m.max() <= ROUNDING
    assert off_rad.max() <= ARC_COSINE_RAD
    np.testing.assert_array_equal(found.q[0], q)
    assert np.linalg.norm(down.error(1.0, left.T_base_tip(found.q[-1]))) <= ACCURACY


def test_at_rest_at_both_ends_it_keeps_the_limits_of_speed_and_acceleration(
    left: Arm, q: FloatArray, down: StraightLine
) -> None:
    found = guess_along(left, left.limits, q, down, INTERVALS, ends_at_rest=True)
    assert isinstance(found, Sketch)
    assert not found.v_ends.any()
    peaks = trajectory_of(found.controls, found.duration_s, left.limits).peak_ratios()
    assert max(peaks.velocity, peaks.acceleration) <= 1.0 + ROUNDING


def test_left_at_speed_it_leaves_along_the_line(
    left: Arm, q: FloatArray, down: StraightLine
) -> None:
    found = guess_along(left, left.limits, q, down, INTERVALS)
    assert isinstance(found, Sketch)
    assert not found.v_ends[0].any()
    v_tip = (left.jacobian(found.q[-1]) @ found.v_ends[1])[:3]
    way = down.T_base_goal.translation - down.T_base_start.translation
    assert v_tip @ way > 0.99 * np.linalg.norm(v_tip) * np.linalg.norm(way) > 0.0


def random_sketch(seed: int, intervals: int = INTERVALS) -> Sketch:
    rng = np.random.default_rng(seed)
    q, v_ends = rng.normal(size=(intervals + 1, 7)), rng.normal(size=(2, 7))
    return Sketch(q, v_ends, float(rng.uniform(0.1, 3.0)))


@given(seeds)
def test_drawn_elsewhere_a_sketch_begins_as_before_and_ends_there(seed: int) -> None:
    sketch, q_end = random_sketch(seed), np.random.default_rng(seed).normal(size=7)
    drawn = bent_to(sketch, q_end, 2.0)
    np.testing.assert_array_equal(drawn.q[0], sketch.q[0])
    np.testing.assert_allclose(drawn.q[-1], q_end, atol=ROUNDING)
    assert drawn.duration_s == 2.0


@given(seeds)
def test_between_two_motions_it_is_one_cubic_of_these_speeds(left: Arm, seed: int) -> None:
    before, after = random_sketch(seed), random_sketch(seed + 1)
    found = guess_between(before, after, left.limits, INTERVALS)
    np.testing.assert_allclose(found.q[[0, -1]], [before.q[-1], after.q[0]], atol=ROUNDING)
    np.testing.assert_array_equal(found.v_ends, [before.v_ends[1], after.v_ends[0]])
    times = np.linspace(0.0, found.duration_s, INTERVALS + 1)
    cubic = np.polynomial.polynomial.Polynomial
    for joint in range(7):
        fitted = cubic.fit(times, found.q[:, joint], 3)
        np.testing.assert_allclose(fitted(times), found.q[:, joint], atol=FITTED)
        ends = fitted.deriv()(times[[0, -1]])
        np.testing.assert_allclose(ends, found.v_ends[:, joint], atol=FITTED_RATE)


@given(seeds)
def test_the_way_back_passes_the_same_places_at_the_opposite_speed(left: Arm, seed: int) -> None:
    sketch = random_sketch(seed)
    there, back = (
        trajectory_of(each.controls, each.duration_s, left.limits)
        for each in (sketch, reversed_sketch(sketch))
    )
    times = np.linspace(0.0, sketch.duration_s, 20)
    here, reverse = there.sample(times), back.sample(sketch.duration_s - times)
    np.testing.assert_allclose(reverse.q, here.q, atol=FITTED)
    np.testing.assert_allclose(reverse.v, -here.v, atol=FITTED_RATE)
