"""Samples of a motion: near enough to each other, and in an order that finds contacts early."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import Arm
from planner import Trajectory, plan_joint_move
from planner.collision.sampling import bisecting, looks_clear, sample_times
from planner.errors import MotionError, TrajectoryError
from tests.planner.toy_world import AROUND_DISC, DISC, LEFT, LIMITS, RIGHT

FloatArray = NDArray[np.float64]
seeds = st.integers(0, 2**32 - 1)

MOVE = plan_joint_move(LEFT, RIGHT, LIMITS)


def everywhere(_q: FloatArray) -> bool:
    return True


def nowhere(_q: FloatArray) -> bool:
    return False


def moving_move(arm: Arm, seed: int) -> Trajectory:
    """Between two states that are not at rest, if there is one; else from rest to rest."""
    rng = np.random.default_rng(seed)
    start, goal = (arm.random_configuration(rng) for _ in range(2))
    v = [0.3 * rng.uniform(-1, 1, 7) * arm.limits.v_max for _ in range(2)]
    try:
        return plan_joint_move(start, goal, arm.limits, v_start=v[0], v_goal=v[1])
    except MotionError:
        return plan_joint_move(start, goal, arm.limits)


@settings(max_examples=25)
@given(seeds, st.floats(0.02, 0.5))
def test_no_joint_moves_farther_than_a_step_between_two_samples(
    left: Arm, seed: int, step_rad: float
) -> None:
    move = moving_move(left, seed)
    times = sample_times(move, step_rad)

    for start, end in pairwise(times):
        qs = move.sample(np.linspace(start, end, 10)).q
        assert np.ptp(qs, axis=0).max() <= step_rad * (1 + 1e-9)


@given(seeds)
def test_both_ends_are_sampled(left: Arm, seed: int) -> None:
    move = moving_move(left, seed)
    times = sample_times(move, 0.1)

    assert times[0] == 0.0
    assert times[-1] == move.duration


def test_a_motion_that_stays_is_one_sample() -> None:
    assert sample_times(Trajectory.stay(LEFT, LIMITS), 0.1).tolist() == [0.0]


def test_a_motion_that_stays_for_a_while_is_sampled_too() -> None:
    none = np.zeros((2, 2))
    wait = Trajectory(LIMITS, np.array([0.0, 1.0]), none, none, none, np.zeros((1, 2)))

    assert looks_clear(wait, everywhere, 0.1)
    assert not looks_clear(wait, nowhere, 0.1)


@given(st.integers(0, 200))
def test_bisection_names_every_number_once(count: int) -> None:
    assert sorted(bisecting(count)) == list(range(count))


def test_bisection_takes_the_ends_then_the_middle_then_the_quarters() -> None:
    assert bisecting(9)[:5] == (0, 8, 4, 2, 6)


def test_a_motion_through_an_obstacle_does_not_look_clear() -> None:
    assert not looks_clear(MOVE, AROUND_DISC.is_free, 0.01)


def test_the_middle_of_an_obstacle_is_found_with_the_third_sample() -> None:
    asked: list[float] = []

    def is_free(q: FloatArray) -> bool:
        asked.append(DISC.distance(q))
        return asked[-1] > 0.0

    looks_clear(MOVE, is_free, 0.01)
    assert len(asked) == 3


@pytest.mark.parametrize("end", [LEFT, RIGHT])
def test_an_end_in_collision_does_not_look_clear(end: FloatArray) -> None:
    def elsewhere(q: FloatArray) -> bool:
        return not np.array_equal(q, end)

    assert not looks_clear(MOVE, elsewhere, 0.01)


@pytest.mark.parametrize("step", [0.0, -1.0, float("nan"), "1", None])
def test_refuses_a_step_that_is_none(step: Any) -> None:
    with pytest.raises(TrajectoryError):
        sample_times(MOVE, step)


def test_refuses_what_is_no_motion() -> None:
    motion: Any = None
    with pytest.raises(TrajectoryError):
        looks_clear(motion, everywhere, 0.1)
