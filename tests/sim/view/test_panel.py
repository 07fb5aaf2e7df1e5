from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from sim.recording.recording import Recording
from sim.view.panel import (
    MAX_ROWS,
    POSITION_STEP,
    ROW_TOLERANCE,
    key_rows,
    moving_arms,
    recorded_arms,
    waypoints,
)

SINGLE = 1e-6
"""What is left of a number of the recording's size in 32 bits."""


def rows_of(arm: dict[str, Any], name: str) -> FloatArray:
    return np.asarray(arm[name], dtype=np.float64).reshape(-1, 7)


def test_tells_of_the_moving_arms(executed: Recording, robot: Baxter) -> None:
    assert moving_arms(executed) == ("left",)
    assert list(recorded_arms(executed, robot)) == ["left"]


def test_tells_of_no_arm_where_none_moves(executed: Recording, robot: Baxter) -> None:
    still = evolve(executed, q=np.tile(executed.q[0], (len(executed.q), 1)), moves=())
    assert recorded_arms(still, robot) == {}


def test_rows_are_those_of_the_recording(executed: Recording, robot: Baxter) -> None:
    arm = recorded_arms(executed, robot)["left"]
    times = np.asarray(arm["times"], dtype=np.float64)
    index = [executed.joint_names.index(name) for name in arm["joints"]]
    at = np.abs(executed.times_s[None] - executed.times_s[0] - times[:, None])
    shared = at.min(axis=1) < SINGLE
    assert shared.sum() > 20
    wanted = executed.q[at.argmin(axis=1)][:, index]
    off = np.abs(rows_of(arm, "q") - wanted)[shared]
    assert off.max() <= POSITION_STEP / 2 + SINGLE


def test_times_begin_at_zero_and_increase(executed: Recording, robot: Baxter) -> None:
    times = np.asarray(recorded_arms(executed, robot)["left"]["times"])
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(executed.duration_s, abs=SINGLE)
    assert (np.diff(times) > 0.0).all()


@pytest.mark.parametrize("name", ["v", "a"])
def test_peaks_of_every_joint_are_kept(executed: Recording, robot: Baxter, name: str) -> None:
    motion = executed.motion("left", with_knots=True)
    arm = recorded_arms(executed, robot)["left"]
    peaks, kept = np.abs(getattr(motion, name)).max(axis=0), np.abs(rows_of(arm, name)).max(axis=0)
    assert np.abs(kept - peaks).max() <= 4 * POSITION_STEP + SINGLE


@pytest.mark.parametrize("name", ["q", "v", "a"])
def test_rows_left_out_lie_between_those_kept(
    executed: Recording, robot: Baxter, name: str
) -> None:
    motion, arm = executed.motion("left", with_knots=True), recorded_arms(executed, robot)["left"]
    scale = {"q": np.subtract(arm["q_max"], arm["q_min"]), "v": arm["v_max"], "a": arm["a_max"]}
    times = np.asarray(arm["times"], dtype=np.float64)
    rows, at = rows_of(arm, name), motion.times_s - executed.times_s[0]
    between = np.column_stack([np.interp(at, times, column) for column in rows.T])
    off = np.abs(between - getattr(motion, name))[at <= executed.duration_s] / scale[name]
    assert off.max() <= ROW_TOLERANCE + 16 * POSITION_STEP


def test_accelerations_are_within_the_limits_the_moves_were_planned_with(
    executed: Recording, robot: Baxter
) -> None:
    arm = recorded_arms(executed, robot)["left"]
    assert (np.abs(rows_of(arm, "a")) <= np.array(arm["a_max"]) + 8 * POSITION_STEP).all()
    limits = executed.moves[0].trajectory.limits
    assert arm["v_max"] == limits.v_max.tolist()


def test_a_long_recording_has_no_more_rows_than_allowed(robot: Baxter, executed: Recording) -> None:
    rng, n = np.random.default_rng(0), 4000
    q = np.tile(executed.q[0], (n, 1))
    index = [executed.joint_names.index(name) for name in robot.arm("left").joint_names]
    q[:, index] += np.cumsum(rng.normal(0.0, 1e-3, (n, 7)), axis=0)
    times = np.array([0.01 * row for row in range(n)])
    long = Recording(executed.joint_names, times, q, np.zeros((n, 2)), {}, {}, (), ())
    arm = recorded_arms(long, robot)["left"]
    assert len(arm["times"]) <= MAX_ROWS
    motion = long.motion("left")
    rows = key_rows(motion, arm)
    for values in (motion.v, motion.a):
        assert np.abs(values[rows]).max(axis=0) == pytest.approx(np.abs(values).max(axis=0))


def waypoints_of(recording: Recording) -> list[dict[str, Any]]:
    return waypoints(recording.moves, *recording.times_s[[0, -1]].tolist())


def test_there_is_one_waypoint_for_each_move(executed: Recording) -> None:
    listed = waypoints_of(executed)
    assert [each["label"] for each in listed] == [move.label for move in executed.moves]
    ends = [min(move.end_s, float(executed.times_s[-1])) for move in executed.moves]
    assert [each["end"] for each in listed] == pytest.approx(ends)


def test_they_say_what_inverse_kinematics_answered(executed: Recording) -> None:
    for waypoint, move in zip(waypoints_of(executed), executed.moves, strict=True):
        if move.ik is None:
            assert waypoint["position_error_m"] is None
            assert waypoint["seed"] == ""
        else:
            assert waypoint["position_error_m"] == move.ik.position_error_m
            assert waypoint["orientation_error_rad"] == move.ik.orientation_error_rad
            assert waypoint["seed"] == move.move.seed_label


def test_a_move_that_was_cut_off_ends_with_the_recording(executed: Recording) -> None:
    half = np.flatnonzero(executed.times_s > executed.moves[2].start_s)[1]
    cut = evolve(
        executed,
        times_s=executed.times_s[:half],
        q=executed.q[:half],
        gripper_percent=executed.gripper_percent[:half],
        body_poses={name: poses[:half] for name, poses in executed.body_poses.items()},
        moves=executed.moves[:3],
    )
    assert waypoints_of(cut)[-1]["end"] == pytest.approx(cut.duration_s)
