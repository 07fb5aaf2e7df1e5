"""Which arm."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, pose_from_quaternion
from baxter_kin.errors import PoseError
from planner.atlas import ArmChoice, ReachMap, which_arm
from planner.atlas.checking.pose_finder import PoseFinder

DOWN = (0.0, 1.0, 0.0, 0.0)
MIRROR = np.diag([1.0, -1.0, 1.0])


def test_an_independent_solver_agrees(
    robot: Baxter, table_map: ReachMap, finders: dict[str, PoseFinder]
) -> None:
    rng = np.random.default_rng(6)
    poses = [robot.arm("left").T_base_tip(robot.arm("left").random_configuration(rng))]
    for _ in range(10):
        p = rng.uniform((0.3, -0.9, -0.3), (1.1, 0.9, 0.5))
        poses.append(pin.SE3(pin.exp3(rng.normal(size=3)), p))
    choice = which_arm(table_map, poses)
    statuses = set()
    for side, answers in choice.answers.items():
        for T, answer in zip(poses, answers, strict=True):
            statuses.add(answer.status)
            if answer.q is not None:
                assert finders[side].holds(T, answer.q)
            elif answer.is_proven_unreachable:
                assert finders[side].find(T) is None
    assert {"reachable", "unreachable"} <= statuses
    assert "left" in choice.arms_by_pose[0]


def test_mirrored_poses_exchange_the_arms(table_map: ReachMap) -> None:
    T = pose_from_quaternion((0.75, 0.25, -0.1), DOWN)
    y = T.translation * (1.0, -1.0, 1.0)
    mirrored = pin.SE3(MIRROR @ T.rotation @ MIRROR, y)
    one, other = (which_arm(table_map, pose) for pose in (T, mirrored))
    assert one.margins_rad["left"] == pytest.approx(other.margins_rad["right"], abs=1e-3)
    assert (one.best, other.best) == ("left", "right")


def test_the_reason_is_made_of_what_was_found(table_map: ReachMap) -> None:
    named = {
        "pick": pose_from_quaternion((0.7, 0.2, -0.1), DOWN),
        "place": pose_from_quaternion((0.7, 0.65, -0.1), DOWN),
    }
    choice = which_arm(table_map, named)
    assert choice.best == "left"
    assert choice.reason.startswith("the left arm: it reaches all 2 poses, ")
    assert f"{choice.margins_rad['left']:.3f} rad from left_" in choice.reason
    assert "the right arm reaches 1 of 2, not 'place': the pose at (0.700, 0.650" in choice.reason


def test_no_arm_is_an_answer(table_map: ReachMap) -> None:
    choice = which_arm(table_map, pose_from_quaternion((2.0, 0.0, 0.0), DOWN))
    assert choice.best is None
    assert choice.arms_by_pose == ((),)
    assert choice.reason.startswith("no arm does it all; the left arm reaches 0 of 1")


def test_arms_that_are_equal_are_told_in_the_order_of_the_map(table_map: ReachMap) -> None:
    answers = which_arm(table_map, pose_from_quaternion((0.7, 0.2, -0.1), DOWN)).answers["left"]
    assert ArmChoice({"left": answers, "right": answers}).best == "left"


def test_no_pose_is_refused(table_map: ReachMap) -> None:
    with pytest.raises(PoseError, match="there must be a pose"):
        which_arm(table_map, [])
