from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from sim.recording.recording import Recording
from sim.view.telemetry.waypoints import recorded_waypoints

TIP_M = 1e-9


def test_there_is_one_for_each_move(executed: Recording, robot: Baxter) -> None:
    told = recorded_waypoints(executed, robot)
    assert [each["label"] for each in told] == [move.label for move in executed.moves]
    ends = [min(move.end_s, float(executed.times_s[-1])) for move in executed.moves]
    assert [each["end"] for each in told] == pytest.approx(ends)


def test_they_say_what_inverse_kinematics_answered(executed: Recording, robot: Baxter) -> None:
    for told, move in zip(recorded_waypoints(executed, robot), executed.moves, strict=True):
        if move.ik is None:
            assert told["position_error_m"] is None
            assert told["seed"] == ""
        else:
            assert told["position_error_m"] == move.ik.position_error_m
            assert told["orientation_error_rad"] == move.ik.orientation_error_rad
            assert told["seed"] == move.move.seed_label


def test_a_goal_is_where_the_tip_is_in_the_end(executed: Recording, robot: Baxter) -> None:
    arm = robot.arm("left")
    for told, move in zip(recorded_waypoints(executed, robot), executed.moves, strict=True):
        T_base_tip = arm.T_base_tip(move.trajectory.q_goal)
        assert pin.XYZQUATToSE3(np.array(told["goal"])).isApprox(T_base_tip, TIP_M)


def test_a_move_that_was_cut_off_ends_with_the_recording(
    executed: Recording, robot: Baxter
) -> None:
    half = np.flatnonzero(executed.times_s > executed.moves[2].start_s)[1]
    cut = evolve(
        executed,
        times_s=executed.times_s[:half],
        q=executed.q[:half],
        gripper_percent=executed.gripper_percent[:half],
        body_poses={name: poses[:half] for name, poses in executed.body_poses.items()},
        moves=executed.moves[:3],
    )
    assert recorded_waypoints(cut, robot)[-1]["end"] == pytest.approx(cut.duration_s)
