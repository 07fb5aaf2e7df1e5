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


@pytest.fixture(scope="module")
def arm(executed: Recording, robot: Baxter) -> dict[str, Any]:
    """The only arm that moves."""
    assert moving_arms(executed) == ("left",)
    arms = recorded_arms(executed, robot)
    assert list(arms) == ["left"]
    return arms["left"]


def test_no_arm_has_curves_where_none_moves(executed: Recording, robot: Baxter) -> None:
    still = evolve(executed, q=np.tile(executed.q[0], (len(executed.q), 1)), moves=())
    assert recorded_arms(still, robot) == {}


def test_rows_are_those_of_the_recording_at_increasing_times(
    arm: dict[str, Any], executed: Recording
) -> None:
    times = np.asarray(arm["times"], dtype=np.float64)
    assert times[[0, -1]] == pytest.approx([0.0, executed.duration_s], abs=SINGLE)
    assert (np.diff(times) > 0.0).all()
    index = [executed.joint_names.index(name) for name in arm["joints"]]
    at = np.abs(executed.times_s[None] - executed.times_s[0] - times[:, None])
    shared = at.min(axis=1) < SINGLE
    assert shared.sum() > 20
    off = np.abs(rows_of(arm, "q") - executed.q[at.argmin(axis=1)][:, index])[shared]
    assert off.max() <= POSITION_STEP / 2 + SINGLE


@pytest.mark.parametrize("name", ["q", "v", "a"])
def test_peaks_are_kept_and_rows_left_out_lie_between_those_kept(
    arm: dict[str, Any], executed: Recording, name: str
) -> None:
    motion = executed.motion("left", with_knots=True)
    values, rows = getattr(motion, name), rows_of(arm, name)
    if name != "q":
        peaks, kept = np.abs(values).max(axis=0), np.abs(rows).max(axis=0)
        assert np.abs(kept - peaks).max() <= 4 * POSITION_STEP + SINGLE
    scale = {"q": np.subtract(arm["q_max"], arm["q_min"]), "v": arm["v_max"], "a": arm["a_max"]}
    times = np.asarray(arm["times"], dtype=np.float64)
    at = motion.times_s - executed.times_s[0]
    between = np.column_stack([np.interp(at, times, column) for column in rows.T])
    off = np.abs(between - values)[at <= executed.duration_s] / scale[name]
    assert off.max() <= ROW_TOLERANCE + 16 * POSITION_STEP


def test_limits_are_those_that_the_moves_were_planned_with(
    arm: dict[str, Any], executed: Recording
) -> None:
    assert (np.abs(rows_of(arm, "a")) <= np.array(arm["a_max"]) + 8 * POSITION_STEP).all()
    assert arm["v_max"] == executed.moves[0].trajectory.limits.v_max.tolist()


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


def test_each_move_has_a_waypoint_with_what_inverse_kinematics_answered(
    executed: Recording,
) -> None:
    listed = waypoints_of(executed)
    assert [each["label"] for each in listed] == [move.label for move in executed.moves]
    ends = [min(move.end_s, float(executed.times_s[-1])) for move in executed.moves]
    assert [each["end"] for each in listed] == pytest.approx(ends)
    for waypoint, move in zip(listed, executed.moves, strict=True):
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
