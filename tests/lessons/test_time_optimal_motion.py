"""The checks of notebook 3: every right answer passes, typical mistakes get their sentence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter, IKService, pose_from_quaternion
from baxter_kin.fields import evolve
from lessons.time_optimal_motion import (
    DOWN,
    GOAL_BASE,
    START_BASE,
    check_down,
    check_slow,
    check_tip_speed,
)
from planner import Trajectory, plan_joint_move, plan_straight_move
from tests.lessons.told import assert_told

ARM = Baxter.load().arm("left")
IK, LIMITS = IKService(ARM), ARM.limits
SLOW = evolve(LIMITS, v_max=np.full(7, np.radians(30)))
X, Y, Z = START_BASE
Q_START = IK.solve(pose_from_quaternion(START_BASE, DOWN), current=ARM.start).q
Q_GOAL = IK.solve(pose_from_quaternion(GOAL_BASE, DOWN), current=Q_START).q
MOVE = plan_joint_move(Q_START, Q_GOAL, LIMITS)
STATE = MOVE.sample(np.linspace(0.0, MOVE.duration, 2000))
TWISTS = np.array([ARM.jacobian(q) @ v for q, v in zip(STATE.q, STATE.v, strict=True)])
SPEEDS = np.linalg.norm(TWISTS[:, :3], axis=1)


def straight(depth_m: float) -> Trajectory:
    below = pose_from_quaternion((X, Y, Z - depth_m), DOWN)
    return plan_straight_move(ARM, Q_START, below, LIMITS)


def test_slow_moves_between_any_solutions_are_right() -> None:
    assert check_slow(plan_joint_move(Q_START, Q_GOAL, SLOW)).is_right
    other = IK.solve(pose_from_quaternion(GOAL_BASE, DOWN), seed=ARM.neutral).q
    assert check_slow(plan_joint_move(Q_START, other, SLOW)).is_right


@pytest.mark.parametrize(
    ("limits", "told"),
    [
        (LIMITS, "a joint turns at 75.9 degrees a second"),
        (evolve(LIMITS, v_max=np.full(7, 30.0)), "v_max is in rad/s, not degrees"),
        (LIMITS.scaled(0.1), "are enough: change nothing but v_max"),
        (evolve(SLOW, j_max=100.0 * LIMITS.j_max), "a_max or j_max"),
    ],
)
def test_moves_with_wrong_limits_are_explained(limits: Any, told: str) -> None:
    assert_told(check_slow(plan_joint_move(Q_START, Q_GOAL, limits)), told)


def test_a_move_the_other_way_is_told() -> None:
    back = plan_joint_move(Q_GOAL, Q_START, SLOW)
    assert_told(check_slow(back), r"starts with the tip at \(0\.750, 0\.000, -0\.100\)")


def test_what_is_no_trajectory_is_told() -> None:
    assert_told(check_slow(2.3), "should be a Trajectory")
    assert_told(check_down(MOVE.q_goal), "should be a Trajectory")


def test_straight_down_is_right() -> None:
    assert check_down(straight(0.10)).is_right


@pytest.mark.parametrize(
    ("depth_m", "told"), [(-0.10, r"in base, down is -z"), (0.05, r"ends with the tip at")]
)
def test_a_line_that_ends_elsewhere_is_explained(depth_m: float, told: str) -> None:
    assert_told(check_down(straight(depth_m)), told)


def test_a_joint_move_is_not_straight() -> None:
    below = IK.solve(pose_from_quaternion((X, Y, Z - 0.1), DOWN), current=Q_START).q
    assert_told(check_down(plan_joint_move(Q_START, below, LIMITS)), "that is a joint move")


def test_the_tip_speed_may_be_rounded() -> None:
    assert check_tip_speed(SPEEDS.max()).is_right
    assert check_tip_speed(round(SPEEDS.max(), 2)).is_right


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (1e3 * SPEEDS.max(), "millimetres per second"),
        (SPEEDS.mean(), "the mean speed"),
        (
            np.linalg.norm(np.subtract(GOAL_BASE, START_BASE)) / MOVE.duration,
            "distance of start and goal",
        ),
        (np.linalg.norm(TWISTS, axis=1).max(), "all six rows"),
        (np.linalg.norm(TWISTS[:, 3:], axis=1).max(), "how fast the tip turns"),
        (np.abs(STATE.v).max(), "a speed of joints"),
        (np.abs(TWISTS[:, :3]).max(), "along one axis"),
        (0.1, "take the norm of the first three rows"),
    ],
)
def test_a_wrong_tip_speed_is_explained(answer: Any, told: str) -> None:
    assert_told(check_tip_speed(answer), told)
