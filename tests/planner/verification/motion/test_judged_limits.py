"""Whose limits a plan is judged by: the robot's or the caller's, never those of its file."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.errors import LimitsError
from baxter_kin.limits import DEFAULT_ACCELERATION_RAD_S2, DEFAULT_JERK_RAD_S3
from planner import Manipulator, Plan, plan_joint_move, verify
from planner.errors import TaskError
from planner.verification.motion.judged_limits import described, judged_by, robot_limits
from planner.verification.urdf_robot import UrdfRobot
from tests.planner.verification.conftest import failed, move_of, spoiled, with_moves

CLAIMS = {"stated limits of those judged by", "acceleration of limit", "jerk of limit"}
"""What fails when a plan moves harder than the robot, as it says."""


def test_the_urdfs_velocity_counts_where_a_plan_claims_more(
    stopping: Plan, manipulator: Manipulator
) -> None:
    generous = replace(
        manipulator.limits,
        v_max=2 * manipulator.limits.v_max,
        a_max=np.full(7, 50.0),
        j_max=np.full(7, 1e3),
    )
    far = move_of(stopping, "pick: approach").trajectory
    fast = plan_joint_move(far.q_start, far.q_goal, generous)
    found = verify(with_moves(stopping, {"pick: approach": fast}))
    assert failed(found) == {"velocity of limit", *CLAIMS}
    assert found["stated limits of those judged by"].value == 50.0
    generously = verify(with_moves(stopping, {"pick: approach": fast}), limits=generous)
    assert generously.is_valid, generously.verdict
    assert "judged by 50 rad/s^2 and 1000 rad/s^3" in generously.verdict


def test_limits_that_a_file_states_are_not_believed(
    stopping: Plan, manipulator: Manipulator
) -> None:
    harder = replace(manipulator.limits, a_max=np.full(7, 2.2), j_max=np.full(7, 22.0))
    far = move_of(stopping, "pick: approach").trajectory
    fast = plan_joint_move(far.q_start, far.q_goal, harder)
    found = verify(with_moves(stopping, {"pick: approach": fast}))
    assert failed(found) == CLAIMS
    assert "2.2 rad/s^2 stated, judged by 2 rad/s^2" in found.verdict
    assert verify(with_moves(stopping, {"pick: approach": fast}), limits=harder).is_valid


def test_a_claim_alone_is_named(plan: Plan) -> None:
    limits = move_of(plan, "pick: descend").trajectory.limits
    claimed = replace(limits, j_max=np.full(7, 21.0))
    found = verify(spoiled(plan, "pick: descend", limits=claimed))
    assert failed(found) == {"stated limits of those judged by"}


def test_limits_of_other_joints_are_refused(plan: Plan, robot: Baxter) -> None:
    with pytest.raises(TaskError, match="the left arm has: left_s0"):
        verify(plan, limits=robot.arm("right").limits)


def test_without_a_callers_wish_the_limits_are_the_urdfs_and_the_stated_defaults(
    urdf: UrdfRobot,
) -> None:
    found = judged_by(None, urdf)
    low, high = urdf.q_range
    assert np.array_equal(found.q_min, low)
    assert np.array_equal(found.q_max, high)
    assert np.array_equal(found.v_max, urdf.v_max)
    assert set(found.a_max) == {DEFAULT_ACCELERATION_RAD_S2}
    assert set(found.j_max) == {DEFAULT_JERK_RAD_S3}


def test_a_number_of_the_callers_says_that_it_is(urdf: UrdfRobot) -> None:
    found = robot_limits(urdf, jerk=7.0)
    assert set(found.j_max) == {7.0}
    assert set(found.a_max) == {DEFAULT_ACCELERATION_RAD_S2}
    assert found.origins["jerk"] == "the caller"
    assert "the caller" not in {found.origins["acceleration"], *robot_limits(urdf).origins.values()}


@pytest.mark.parametrize("wrong", [0.0, -1.0, np.nan])
def test_a_limit_that_lets_nothing_move_is_refused(urdf: UrdfRobot, wrong: float) -> None:
    with pytest.raises(LimitsError):
        robot_limits(urdf, acceleration=wrong)


@pytest.mark.parametrize("wrong", ["fast", 2.0, {}])
def test_what_is_no_limits_is_refused(urdf: UrdfRobot, wrong: Any) -> None:
    with pytest.raises(TaskError, match="limits must be of class JointLimits"):
        judged_by(wrong, urdf)


def test_the_smallest_and_greatest_are_told_where_joints_differ(urdf: UrdfRobot) -> None:
    same = robot_limits(urdf, acceleration=2.0, jerk=20.0)
    assert described(same) == "2 rad/s^2 and 20 rad/s^3"
    uneven = replace(same, a_max=np.linspace(1.5, 4.5, 7))
    assert described(uneven) == "1.5 .. 4.5 rad/s^2 and 20 rad/s^3"
