"""Whose limits a plan is judged by: the robot's or the caller's, never those of its file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from baxter_kin import Baxter
from planner import Manipulator, Plan, TaskError, plan_joint_move, verify
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
