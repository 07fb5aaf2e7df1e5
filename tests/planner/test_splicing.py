"""Motions taken apart and put together are the same motions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm
from planner import Trajectory, TrajectoryError, plan_joint_move
from planner.splicing import NEAREST_KNOT_S, joined, nearest_cut, section
from tests.planner.toy_world import LEFT, LIMITS, RIGHT

ROUNDING = 1e-9
"""Of rad, rad/s and rad/s^2."""

MOVE = plan_joint_move(LEFT, RIGHT, LIMITS)

seeds = st.integers(0, 2**32 - 1)
fractions = st.floats(0.0, 1.0)


def random_move(arm: Arm, seed: int) -> Trajectory:
    rng = np.random.default_rng(seed)
    start, goal = (arm.random_configuration(rng) for _ in range(2))
    return plan_joint_move(start, goal, arm.limits)


@given(seeds, fractions, fractions)
def test_a_section_passes_the_same_states_at_the_same_times(
    left: Arm, seed: int, first: float, second: float
) -> None:
    move = random_move(left, seed)
    start, end = sorted([first * move.duration, second * move.duration])
    part = section(move, start, end)

    assert part.duration == pytest.approx(end - start, abs=1e-12)
    times = np.linspace(0.0, part.duration, 50)
    for mine, whole in zip(part.sample(times), move.sample(start + times), strict=True):
        assert mine == pytest.approx(whole, abs=ROUNDING)


@given(seeds, fractions)
def test_a_motion_cut_in_two_and_joined_is_the_same_motion(
    left: Arm, seed: int, fraction: float
) -> None:
    move = random_move(left, seed)
    cut = nearest_cut(move, fraction * move.duration)
    whole = joined([section(move, 0.0, cut), section(move, cut, move.duration)])

    assert whole.duration == pytest.approx(move.duration, abs=1e-12)
    times = np.linspace(0.0, move.duration, 50)
    times = np.minimum(times, whole.duration)
    for mine, before in zip(whole.sample(times), move.sample(times), strict=True):
        assert mine == pytest.approx(before, abs=ROUNDING)


@given(seeds)
def test_joining_keeps_the_extrema(left: Arm, seed: int) -> None:
    there = random_move(left, seed)
    back = plan_joint_move(there.q_goal, there.q_start, left.limits)
    both = joined([there, back])

    assert both.duration == there.duration + back.duration
    assert max(both.peak_ratios()) == max(*there.peak_ratios(), *back.peak_ratios())
    lows = [move.position_extrema()[0] for move in (there, back)]
    assert both.position_extrema()[0] == pytest.approx(np.min(lows, axis=0), abs=ROUNDING)


def test_motions_of_no_duration_leave_no_trace() -> None:
    stay = Trajectory.stay(LEFT, LIMITS)

    assert np.array_equal(joined([stay, MOVE]).q, MOVE.q)
    assert joined([stay, stay]).duration == 0.0


def test_a_cut_beside_a_knot_is_made_at_the_knot() -> None:
    knot = float(MOVE.knots_s[1])

    assert nearest_cut(MOVE, knot + NEAREST_KNOT_S / 2) == knot
    assert nearest_cut(MOVE, knot + 2 * NEAREST_KNOT_S) == knot + 2 * NEAREST_KNOT_S


def test_refuses_to_join_what_does_not_meet() -> None:
    with pytest.raises(TrajectoryError, match="q jumps"):
        joined([MOVE, MOVE])


@pytest.mark.parametrize("motions", [[], [None], None, "ab"])
def test_refuses_to_join_what_is_no_motion(motions: Any) -> None:
    with pytest.raises(TrajectoryError):
        joined(motions)


@pytest.mark.parametrize("t", [-0.1, MOVE.duration + 0.1, float("nan"), "1"])
def test_refuses_a_time_outside_the_motion(t: Any) -> None:
    with pytest.raises(TrajectoryError):
        section(MOVE, 0.0, t)
    with pytest.raises(TrajectoryError):
        section(MOVE, t, MOVE.duration)
    with pytest.raises(TrajectoryError):
        nearest_cut(MOVE, t)


def test_refuses_a_section_that_ends_before_it_starts() -> None:
    with pytest.raises(TrajectoryError, match="before it starts"):
        section(MOVE, 0.5, 0.4)
