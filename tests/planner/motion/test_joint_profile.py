"""Profiles of one joint in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.motion.joint_profile import (
    ROUNDING,
    AxisState,
    Profile,
    Rates,
    corrected,
    direct,
    through_rest,
)

RATES = Rates(1.5, 2.0, 20.0)

seeds = st.integers(0, 2**32 - 1)


def random_rates(rng: np.random.Generator) -> Rates:
    return Rates(*np.exp(rng.uniform(np.log([0.1, 0.2, 1.0]), np.log([5.0, 20.0, 200.0]))).tolist())


def random_state(rng: np.random.Generator, rates: Rates) -> AxisState:
    """A state from which the limits can be kept, before it and after it."""
    a = float(rng.uniform(-1, 1)) * min(rates.a, (rates.v * rates.j) ** 0.5)
    v = float(rng.uniform(-1, 1)) * (rates.v - a * a / (2 * rates.j))
    return AxisState(float(rng.uniform(-1, 1)), v, a)


def assert_ends_at(profile: Profile, start: AxisState, goal: AxisState) -> None:
    assert min(profile.lengths_s) >= 0.0
    assert profile.end(start) == pytest.approx(goal, abs=1e-9)


@given(seeds, st.floats(0.0, 100.0))
def test_there_is_a_way_through_rest_of_any_greater_duration_inside_the_limits(
    seed: int, wait_s: float
) -> None:
    rng = np.random.default_rng(seed)
    rates = random_rates(rng)
    start, goal = random_state(rng, rates), random_state(rng, rates)
    shortest = through_rest(start, goal, rates)
    waiting = through_rest(start, goal, rates, shortest.duration + wait_s)
    assert waiting.duration == pytest.approx(shortest.duration + wait_s)
    for profile in (shortest, waiting):
        assert_ends_at(profile, start, goal)
        assert profile.is_within(rates, start)


@given(seeds, st.sampled_from([(1, 0), (0, 1), (1, -1), (-1, 1), (-1, 0), (0, -1), (1,), (-1,)]))
def test_what_two_phases_join_is_joined_directly_and_no_slower(
    seed: int, signs: tuple[int, ...]
) -> None:
    rng = np.random.default_rng(seed)
    rates = random_rates(rng)
    start = random_state(rng, rates)
    lengths = tuple((rng.uniform(0.01, 1.0, len(signs)) * rates.a / rates.j).tolist())
    profile = Profile(lengths, tuple(sign * rates.j for sign in signs))
    goal = profile.end(start)
    if not profile.is_within(rates, start):
        return
    found = direct(start, goal, rates)
    assert found is not None
    assert_ends_at(found, start, goal)
    assert rates.min_duration_s(start, goal) <= found.duration * (1 + ROUNDING)
    assert found.duration <= profile.duration + 1e-9


def test_states_that_are_microseconds_apart_are_joined_by_one_ramp() -> None:
    """The change of velocity is 1e-10 rad/s, of which the sixth digit is rounding."""
    start = AxisState(-9.530624779396373e-05, -1.4999999767005596, 0.0001319299184887559)
    goal = AxisState(-0.00011654892493801943, -1.499999976837758, -0.00015130578121525548)
    found = direct(start, goal, RATES)
    assert found is not None
    assert found.duration == pytest.approx((start.a - goal.a) / RATES.j, rel=1e-6)


def test_states_that_no_two_phases_join_are_not_joined_directly() -> None:
    assert direct(AxisState(0.0, 0.0, 0.0), AxisState(1.0, 0.0, 0.0), RATES) is None


def test_a_profile_is_corrected_to_end_at_its_goal_and_in_a_given_time() -> None:
    start = AxisState(0.0, 0.1, -0.2)
    profile = through_rest(start, AxisState(1.0, 0.2, 0.3), RATES)
    goal = AxisState(1.0 + 3e-9, 0.2 - 2e-9, 0.3)
    for duration in (profile.duration, profile.duration + 1e-9):
        found = corrected(profile, start, goal, duration)
        assert tuple(found.end(start)) == pytest.approx(tuple(goal), abs=1e-12)
        assert found.duration == pytest.approx(duration, abs=1e-14)
    assert corrected(profile, start, AxisState(1.1, 0.0, 0.0)) is profile  # too far


@pytest.mark.parametrize(
    ("state", "inside"),
    [
        (AxisState(0.0, 1.5 * (1 + 1e-10), 0.0), AxisState(0.0, 1.5, 0.0)),
        (AxisState(0.0, 0.0, -2.0 * (1 + 1e-10)), AxisState(0.0, 0.0, -2.0)),
        (AxisState(0.0, 1.499 + 1e-10, 0.2), AxisState(0.0, 1.499, 0.2)),
        (AxisState(0.0, 1.499 + 1e-10, -0.2), AxisState(0.0, 1.499 + 1e-10, -0.2)),
        (AxisState(0.0, 1.51, 0.0), AxisState(0.0, 1.51, 0.0)),
    ],
)
def test_a_state_is_moved_inside_its_limits_where_rounding_took_it_out(
    state: AxisState, inside: AxisState
) -> None:
    assert RATES.moved_inside(state) == pytest.approx(inside, abs=1e-15)


@pytest.mark.parametrize("tiny", [3e-158, 5e-324, -1e-200])
def test_speeds_next_to_nothing_make_no_profile_that_lasts_for_ever(tiny: float) -> None:
    moving, there = AxisState(0.0, tiny, 0.0), AxisState(0.5, tiny, 0.0)
    assert direct(moving, there, RATES) is None
    assert direct(AxisState(0.0, 0.1, tiny), AxisState(0.5, 0.2, tiny), RATES) is None
    assert_ends_at(through_rest(moving, there, RATES), moving, there)
