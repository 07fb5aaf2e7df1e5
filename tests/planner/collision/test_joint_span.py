"""The range of joint positions over an interval, against dense sampling."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm
from planner import Trajectory, plan_joint_move
from planner.collision.continuous.motion_bounds import JointSpan
from planner.errors import MotionError, TrajectoryError
from planner.trajectory import CONTINUITY_TOLERANCE

seeds = st.integers(0, 2**32 - 1)

RAD_PER_SAMPLE = 1e-3
"""Two samples of 4000 in a motion of a few seconds at up to 4 rad/s are not farther apart."""


def motion(arm: Arm, seed: int) -> Trajectory:
    """Between random states, most of them moving, so that joints turn on the way."""
    rng, limits = np.random.default_rng(seed), arm.limits
    for _ in range(100):
        q = rng.uniform(0.4 * limits.q_min, 0.4 * limits.q_max, size=(2, 7))
        v = rng.uniform(-0.5, 0.5, size=(2, 7)) * limits.v_max
        try:
            return plan_joint_move(q[0], q[1], limits, v_start=v[0], v_goal=v[1])
        except MotionError:
            continue
    raise AssertionError("no motion found")


@given(seeds)
def test_no_sample_of_an_interval_is_farther_from_its_middle(left: Arm, seed: int) -> None:
    trajectory = motion(left, seed)
    start, end = np.sort(np.random.default_rng(seed).uniform(0, trajectory.duration, size=2))
    q, reach = JointSpan(trajectory).around_middle(np.array([start]), np.array([end]))
    sampled = trajectory.sample(np.linspace(start, end, 4000)).q
    assert (np.abs(sampled - q[0]) <= reach[0]).all()


@given(seeds)
def test_some_sample_gets_as_far(left: Arm, seed: int) -> None:
    trajectory = motion(left, seed)
    ends = np.array([trajectory.duration])
    q, reach = JointSpan(trajectory).around_middle(np.zeros(1), ends)
    sampled = trajectory.sample(np.linspace(0.0, trajectory.duration, 4000)).q
    assert (np.abs(sampled - q[0]).max(axis=0) >= reach[0] - RAD_PER_SAMPLE).all()


@given(seeds)
def test_many_intervals_are_as_one_after_the_other(left: Arm, seed: int) -> None:
    trajectory = motion(left, seed)
    times = np.sort(np.random.default_rng(seed).uniform(0, trajectory.duration, size=(6, 2)))
    span = JointSpan(trajectory)
    _, together = span.around_middle(times[:, 0], times[:, 1])
    alone = [span.around_middle(times[i : i + 1, 0], times[i : i + 1, 1])[1][0] for i in range(6)]
    assert np.array_equal(together, alone)


def test_an_instant_has_no_width(left: Arm) -> None:
    trajectory = motion(left, 0)
    instant = np.array([trajectory.duration / 3])
    _, reach = JointSpan(trajectory).around_middle(instant, instant)
    assert (reach == CONTINUITY_TOLERANCE).all()


def test_a_motion_of_no_duration_stays(left: Arm) -> None:
    trajectory = Trajectory.stay(left.neutral, left.limits)
    q, reach = JointSpan(trajectory).around_middle(np.zeros(1), np.zeros(1))
    assert np.array_equal(q[0], left.neutral)
    assert (reach == CONTINUITY_TOLERANCE).all()


@pytest.mark.parametrize("trajectory", [None, 1.0, np.zeros(7)])
def test_refuses_what_is_no_motion(trajectory: Any) -> None:
    with pytest.raises(TrajectoryError, match="Trajectory"):
        JointSpan(trajectory)
