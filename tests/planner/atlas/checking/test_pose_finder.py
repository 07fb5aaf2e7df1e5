"""The solver that checks maps: what it finds is right, and it finds what there is."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from planner.atlas.checking.pose_finder import PoseFinder

LEAST_POWER = 0.99


@pytest.mark.slow
@pytest.mark.parametrize("side", ["left", "right"])
def test_it_finds_poses_that_are_within_reach(robot: Baxter, side: str) -> None:
    arm, finder, rng = robot.arm(side), PoseFinder(robot, side), np.random.default_rng(3)
    poses = [arm.T_base_tip(arm.random_configuration(rng)) for _ in range(200)]
    found = [finder.find(T) for T in poses]
    for T, q in zip(poses, found, strict=True):
        if q is not None:
            assert (arm.limits.q_min <= q).all()
            assert (q <= arm.limits.q_max).all()
            assert np.abs(pin.log6(T.actInv(arm.T_base_tip(q))).vector).max() < 1e-6
    assert sum(q is not None for q in found) >= LEAST_POWER * len(poses)


def test_it_finds_poses_at_joint_limits(robot: Baxter) -> None:
    """Configurations of which two joints are at their limits."""
    arm, finder, rng = robot.arm("left"), PoseFinder(robot, "left"), np.random.default_rng(4)
    reached = 0
    for _ in range(100):
        q = arm.random_configuration(rng)
        at = rng.choice(7, 2, replace=False)
        q[at] = np.where(rng.random(2) < 0.5, arm.limits.q_min[at], arm.limits.q_max[at])
        reached += finder.find(arm.T_base_tip(q)) is not None
    assert reached >= LEAST_POWER * 100


def test_it_finds_nothing_beyond_the_arms_length(robot: Baxter) -> None:
    finder = PoseFinder(robot, "left")
    assert finder.find(pin.SE3(np.eye(3), np.array([2.0, 0.3, 0.3]))) is None


def test_what_holds_is_at_the_pose_and_inside_the_limits(robot: Baxter) -> None:
    arm, finder = robot.arm("left"), PoseFinder(robot, "left")
    T = arm.T_base_tip(arm.start)
    assert finder.holds(T, arm.start)
    assert not finder.holds(T, arm.start + 1e-5)
    outside = arm.limits.q_max + 1e-6
    assert not finder.holds(arm.T_base_tip(outside), outside)


def test_the_same_pose_has_the_same_answer_whatever_was_asked_before(robot: Baxter) -> None:
    arm, rng = robot.arm("left"), np.random.default_rng(6)
    poses = [arm.T_base_tip(arm.random_configuration(rng)) for _ in range(5)]
    one, other = (PoseFinder(robot, "left") for _ in range(2))
    forward = [one.find(T) for T in poses]
    backward = [other.find(T) for T in poses[::-1]][::-1]
    for q, same in zip(forward, backward, strict=True):
        assert np.array_equal(q, same)  # type: ignore[arg-type]


def test_margins_are_to_the_limits_of_the_urdf(robot: Baxter) -> None:
    arm, finder = robot.arm("right"), PoseFinder(robot, "right")
    q = arm.limits.q_max - 0.3
    q[4] = arm.limits.q_min[4] + 0.01
    assert finder.margin_rad(q) == pytest.approx(0.01)
    q[2] = arm.limits.q_max[2] + 0.2
    assert finder.margin_rad(q) == pytest.approx(-0.2)
