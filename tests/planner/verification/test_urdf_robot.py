"""The robot straight from its URDF is the one that planning uses."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import given, settings

from baxter_kin import Baxter
from planner import Manipulator
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
