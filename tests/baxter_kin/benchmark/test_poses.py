"""The pose sets are what they claim to be."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, Baxter
from baxter_kin.benchmark.measurement import Verifier
from baxter_kin.benchmark.poses import (
    E1,
    NEAR_RAD,
    SINGULAR,
    STRETCHED_E1_RAD,
    W1,
    WINDOW_RAD,
    PoseSet,
    Scenario,
    draw_poses,
    smallest_singular_value,
)

COUNT = 12
FULL_RANK = 1e-4
"""No uniform configuration of a few thousand has a smaller singular value."""


def drawn(arm: Arm, scenario: Scenario, seed: int = 3) -> PoseSet:
    return draw_poses(arm, scenario, count=COUNT, seed=seed)


@pytest.mark.parametrize("scenario", Scenario)
def test_goals_and_seeds_are_inside_the_limits(arm: Arm, scenario: Scenario) -> None:
    poses = drawn(arm, scenario)
    for q in (poses.q_goals, poses.q_seeds):
        assert q.shape == (COUNT, 7)
        assert np.all(q >= arm.limits.q_min)
        assert np.all(q <= arm.limits.q_max)


@pytest.mark.parametrize("scenario", Scenario)
def test_goals_reach_the_poses_on_the_whole_robot(
    robot: Baxter, arm: Arm, scenario: Scenario
) -> None:
    poses, verifier = drawn(arm, scenario), Verifier(robot, arm)
    for q, target in zip(poses.q_goals, poses.T_base_tips, strict=True):
        assert verifier.verdict(target, q).is_solved


@pytest.mark.parametrize("scenario", Scenario)
def test_same_seed_draws_the_same_poses(left: Arm, scenario: Scenario) -> None:
    first, again, other = (drawn(left, scenario, seed) for seed in (3, 3, 4))
    assert np.array_equal(first.q_goals, again.q_goals)
    assert np.array_equal(first.q_seeds, again.q_seeds)
    assert not np.array_equal(first.q_goals, other.q_goals)


def test_longer_set_begins_with_the_shorter_one(left: Arm) -> None:
    longer = draw_poses(left, Scenario.AT_LIMITS, count=2 * COUNT, seed=3)
    assert np.array_equal(longer.q_goals[:COUNT], drawn(left, Scenario.AT_LIMITS).q_goals)


def test_near_and_mid_range_share_their_poses(arm: Arm) -> None:
    near, mid = drawn(arm, Scenario.NEAR), drawn(arm, Scenario.MID_RANGE)
    assert np.array_equal(near.q_goals, mid.q_goals)
    assert np.all(np.abs(near.q_seeds - near.q_goals) <= NEAR_RAD)
    assert np.all(mid.q_seeds == (arm.limits.q_min + arm.limits.q_max) / 2.0)


def test_one_to_three_joints_are_exactly_on_a_limit(arm: Arm) -> None:
    q = drawn(arm, Scenario.AT_LIMITS).q_goals
    on_limit = (q == arm.limits.q_min) | (q == arm.limits.q_max)
    assert set(on_limit.sum(axis=1)) == {1, 2, 3}


def test_uniform_poses_are_not_singular(arm: Arm) -> None:
    goals = drawn(arm, Scenario.MID_RANGE).q_goals
    assert min(smallest_singular_value(arm, q) for q in goals) > FULL_RANK


@pytest.mark.parametrize("scenario", [Scenario.ELBOW_STRAIGHT, Scenario.WRIST_SINGULAR])
def test_singular_sets_have_a_jacobian_of_rank_five(arm: Arm, scenario: Scenario) -> None:
    for q in drawn(arm, scenario).q_goals:
        values = np.linalg.svd(arm.jacobian(q), compute_uv=False)
        assert values[-1] <= SINGULAR
        assert values[-2] > FULL_RANK


def test_straight_elbow_is_stretched(arm: Arm) -> None:
    goals = drawn(arm, Scenario.ELBOW_STRAIGHT).q_goals
    assert np.all(np.abs(goals[:, E1] - STRETCHED_E1_RAD) <= WINDOW_RAD)


def test_singular_wrist_is_straight(arm: Arm) -> None:
    goals = drawn(arm, Scenario.WRIST_SINGULAR).q_goals
    assert np.all(np.abs(goals[:, W1]) <= WINDOW_RAD)


def test_stretched_angle_puts_the_wrist_farthest_from_the_shoulder(arm: Arm) -> None:
    angles = STRETCHED_E1_RAD + np.linspace(-0.05, 0.05, 101)
    distances = [_shoulder_to_wrist_m(arm, angle) for angle in angles]
    step = angles[1] - angles[0]
    assert angles[np.argmax(distances)] == pytest.approx(STRETCHED_E1_RAD, abs=step)


def _shoulder_to_wrist_m(arm: Arm, e1: float) -> float:
    """Distance between the origins of s1, where the upper arm begins, and w1."""
    model = arm.model
    q = np.zeros(7)
    q[E1] = e1
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    shoulder, wrist = (data.oMi[model.getJointId(f"{arm.side}_{j}")] for j in ("s1", "w1"))
    return float(np.linalg.norm(wrist.translation - shoulder.translation))
