"""The robot straight from its URDF is the one that planning uses."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Baxter
from baxter_kin.description import RobotDescription
from baxter_kin.errors import DescriptionError
from planner import Manipulator
from planner.errors import TaskError
from planner.verification.urdf_robot import UrdfRobot
from tests.planner.verification.conftest import configurations, inside


@given(share=configurations())
@settings(max_examples=20)
def test_the_tip_by_the_full_urdf_is_the_arms(
    urdf: UrdfRobot, manipulator: Manipulator, share: Any
) -> None:
    q = inside(manipulator, share)
    standing = np.array(manipulator.robot.configuration())
    theirs = manipulator.arm.T_base_tip(q).homogeneous
    assert np.abs(urdf.T_base_tip(standing, q).homogeneous - theirs).max() < 1e-12


def test_the_urdfs_limits_are_the_arms(urdf: UrdfRobot, manipulator: Manipulator) -> None:
    low, high = urdf.q_range
    assert urdf.arm_names == manipulator.arm.joint_names
    assert np.array_equal(low, manipulator.limits.q_min)
    assert np.array_equal(high, manipulator.limits.q_max)
    assert np.array_equal(urdf.v_max, manipulator.limits.v_max)


def test_the_robot_is_read_from_the_files_that_are_given(robot: Baxter) -> None:
    assert UrdfRobot(robot.description, "right").arm_names == robot.arm("right").joint_names


@given(share=configurations())
@settings(max_examples=20)
def test_no_joint_is_farther_from_the_tip_than_its_reach(
    urdf: UrdfRobot, manipulator: Manipulator, share: Any
) -> None:
    standing = np.array(manipulator.robot.configuration())
    q = inside(manipulator, share)
    full = urdf.configurations(standing, q[None], 0.0)[0]
    data = urdf.model.createData()
    pin.forwardKinematics(urdf.model, data, full)
    tip = urdf.T_base_tip(standing, q).translation
    joints = np.array([data.oMi[joint].translation for joint in urdf.arm_joints])
    assert (np.linalg.norm(joints - tip, axis=1) <= urdf.tip_reach_m + 1e-12).all()


@given(share=configurations())
@settings(max_examples=10)
def test_the_other_arms_tip_is_where_that_arm_has_it(
    urdf: UrdfRobot, robot: Baxter, share: Any
) -> None:
    right = robot.arm("right")
    q = (
        right.limits.q_min + right.limits.q_max + share * (right.limits.q_max - right.limits.q_min)
    ) / 2
    standing = urdf.standing(
        dict(zip(robot.joint_names, robot.configuration(right.joints(q)), strict=True))
    )
    found = urdf.T_base_other_tip(standing, "right").homogeneous
    assert np.abs(found - right.T_base_tip(q).homogeneous).max() < 1e-12


@given(st.floats(0.0, 0.02))
def test_an_opening_that_is_set_is_read_again_and_both_fingers_share_it(
    urdf: UrdfRobot, finger_m: float
) -> None:
    q = urdf.configurations(np.zeros(urdf.model.nq), np.zeros((1, 7)), finger_m)[0]
    assert urdf.opening(q) == pytest.approx(finger_m, abs=1e-15)
    assert urdf.finger_skew_m(q) == pytest.approx(0.0, abs=1e-15)


def test_a_finger_outside_its_stroke_says_by_how_much(urdf: UrdfRobot, robot: Baxter) -> None:
    wide = {"l_gripper_l_finger_joint": urdf.stroke_m + 1e-3, "r_gripper_r_finger_joint": 2e-3}
    joints = {**dict.fromkeys(robot.joint_names, 0.0), **wide}
    outside = {name: out_m for name, _, out_m in urdf.finger_positions(urdf.standing(joints))}
    assert outside["l_gripper_l_finger_joint"] == pytest.approx(1e-3)
    assert outside["r_gripper_r_finger_joint"] == pytest.approx(2e-3)
    assert max(outside[name] for name in outside if name not in wide) <= 0.0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"head_pan": None}, "lacks joint 'head_pan'"),
        ({"head_nod": 0.0}, "has an unknown joint 'head_nod'"),
    ],
)
def test_a_situation_has_just_the_robots_joints(
    urdf: UrdfRobot, robot: Baxter, change: Any, said: str
) -> None:
    joints = {**dict.fromkeys(robot.joint_names, 0.0), **change}
    with pytest.raises(TaskError, match=re.escape(said)):
        urdf.standing({name: at for name, at in joints.items() if at is not None})


def test_a_hand_without_fingers_is_refused() -> None:
    bare = RobotDescription.of(hands={"left": None})
    with pytest.raises(DescriptionError, match="the left hand of this robot has no fingers"):
        UrdfRobot(bare, "left")


def test_a_robot_without_such_an_arm_is_refused(robot: Baxter) -> None:
    with pytest.raises(DescriptionError, match="it lacks the link middle_gripper"):
        UrdfRobot(robot.description, "middle")
