"""The fastest motion along a path: against a scaled known one, at its ends, and refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter, JointLimits
from planner import MotionError, PathState, StraightPath, plan_path_move, plan_straight_path
from planner.timing import RATIO_TOLERANCE
from tests.planner.lines import above, farthest_off, q_above, random_path

NOT_SLOWER = 1.01
"""Over a motion known to be inside the limits: the segments differ."""

seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=6)


@pytest.fixture(scope="module")
def path(left: Arm) -> StraightPath:
    return plan_straight_path(left, q_above(left), above(0.0), left.limits)


def fraction_at(path: StraightPath, q: np.ndarray[Any, Any]) -> float:
    """Where on the path the tip is, by projection."""
    start, goal = path.line.T_base_start.translation, path.line.T_base_goal.translation
    way = goal - start
    there = path.arm.T_base_tip(q).translation
    return float(np.clip(way @ (there - start) / (way @ way), 0.0, 1.0))


@few
@given(st.floats(0.2, 0.95), st.floats(0.1, 0.4), st.floats(0.6, 0.9))
def test_it_is_not_slower_than_part_of_a_known_motion_in_slow_motion(
    left: Arm, path: StraightPath, slower: float, begin: float, finish: float
) -> None:
    whole = plan_path_move(path, left.limits)
    states = []
    for share in (begin, finish):
        q, v, a = whole.sample(share * whole.duration)
        s = fraction_at(path, q)
        slope = path.at(s)
        speed = float(v @ slope.dq / (slope.dq @ slope.dq))
        acceleration = float((a - slope.ddq * speed**2) @ slope.dq / (slope.dq @ slope.dq))
        states.append(PathState(s, slower * speed, slower**2 * acceleration))
    part = plan_path_move(path, left.limits, start=states[0], end=states[1])
    known_s = (finish - begin) * whole.duration / slower
    assert part.duration <= NOT_SLOWER * known_s
    assert max(part.peak_ratios()) <= 1.0 + RATIO_TOLERANCE


@few
@given(st.floats(0.1, 3.0), st.floats(0.1, 3.0), st.floats(0.5, 50.0))
def test_other_limits_are_kept_and_used(
    left: Arm, path: StraightPath, v: float, a: float, j: float
) -> None:
    ones = np.ones(7)
    limits = JointLimits(
        left.limits.names, left.limits.q_min, left.limits.q_max, v * ones, a * ones, j * ones
    )
    ratios = plan_path_move(path, limits).peak_ratios()
    assert 0.99 <= max(ratios) <= 1.0 + RATIO_TOLERANCE


@few
@given(st.floats(0.2, 0.9))
def test_all_limits_times_powers_of_a_factor_stretch_time_by_it(
    left: Arm, path: StraightPath, factor: float
) -> None:
    limits = left.limits
    slow = JointLimits(
        limits.names,
        limits.q_min,
        limits.q_max,
        factor * limits.v_max,
        factor**2 * limits.a_max,
        factor**3 * limits.j_max,
    )
    fast_s = plan_path_move(path, limits).duration
    assert plan_path_move(path, slow).duration == pytest.approx(fast_s / factor, rel=1e-3)


@few
@given(seeds)
def test_it_never_goes_backwards(left: Arm, seed: int) -> None:
    path = random_path(left, seed)
    motion = plan_path_move(path, left.limits)
    q, v, _ = motion.sample(np.linspace(0.0, motion.duration, 200))
    twists = np.array([left.jacobian(x) @ dx for x, dx in zip(q, v, strict=True)])
    along = twists @ path.line.twist / (path.line.twist @ path.line.twist)
    assert along.min() >= -1e-4 * along.max()  # the joints stray from the path by micrometres


def test_a_part_of_a_path_is_run_through_from_where_it_is_asked(
    left: Arm, path: StraightPath
) -> None:
    motion = plan_path_move(path, left.limits, start=PathState(0.25, 1.0), end=PathState(0.75))
    start, goal = path.line.at(0.25), path.line.at(0.75)
    assert left.T_base_tip(motion.q_start).isApprox(start, 1e-7)
    assert left.T_base_tip(motion.q_goal).isApprox(goal, 1e-7)
    off_m, off_rad = farthest_off(motion, left, start, goal)
    assert off_m < 1e-4
    assert off_rad < 3e-4


def test_limits_far_apart_are_kept_and_used(left: Arm, path: StraightPath) -> None:
    ones = np.ones(7)
    limits = JointLimits(
        left.limits.names, left.limits.q_min, left.limits.q_max, ones, 1e-3 * ones, 1e6 * ones
    )
    ratios = plan_path_move(path, limits).peak_ratios()
    assert 0.99 <= max(ratios) <= 1.0 + RATIO_TOLERANCE


def test_the_same_request_gives_the_same_motion(left: Arm, path: StraightPath) -> None:
    first, second = (plan_path_move(path, left.limits) for _ in range(2))
    np.testing.assert_array_equal(first.q, second.q)
    assert first.duration == second.duration


def test_no_way_takes_no_time(left: Arm, path: StraightPath) -> None:
    here = PathState(0.5)
    motion = plan_path_move(path, left.limits, start=here, end=here)
    assert motion.duration == 0.0
    np.testing.assert_array_equal(motion.q_start, path.at(0.5).q)


def test_no_way_cannot_be_gone_at_speed(left: Arm, path: StraightPath) -> None:
    with pytest.raises(MotionError, match="no way"):
        plan_path_move(path, left.limits, start=PathState(0.5, 0.1), end=PathState(0.5))


def test_refuses_an_end_before_the_start(left: Arm, path: StraightPath) -> None:
    with pytest.raises(MotionError, match="reverse the path"):
        plan_path_move(path, left.limits, start=PathState(0.5), end=PathState(0.2))


def test_says_which_joint_an_end_is_too_hard_for(left: Arm, path: StraightPath) -> None:
    with pytest.raises(MotionError, match=r"the end .* rad/s\^2 of left_\w+, whose limit is 2"):
        plan_path_move(path, left.limits, end=PathState(1.0, 0.0, 100.0))


def test_says_that_the_way_is_too_short_to_stop(left: Arm, path: StraightPath) -> None:
    with pytest.raises(MotionError, match="too short for that change of speed"):
        plan_path_move(path, left.limits, start=PathState(0.97, 1.5))


@pytest.mark.parametrize(
    "changed", [{"path": None}, {"limits": None}, {"start": 0.0}, {"end": (1.0, 0.0)}]
)
def test_refuses_what_is_of_another_kind(
    left: Arm, path: StraightPath, changed: dict[str, Any]
) -> None:
    given_: dict[str, Any] = {"path": path, "limits": left.limits, "start": None, "end": None}
    with pytest.raises(MotionError):
        plan_path_move(**given_ | changed)


def test_refuses_the_limits_of_the_other_arm(robot: Baxter, path: StraightPath) -> None:
    with pytest.raises(MotionError, match="right_s0"):
        plan_path_move(path, robot.arm("right").limits)
