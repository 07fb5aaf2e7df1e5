"""Recorder: from snapshots and events to data."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import Baxter, quaternion_xyzw
from baxter_kin.json_data import from_json, to_json
from baxter_kin.json_text import as_text, from_text
from planner import Body, Manipulator, plan_start_move
from sim import (
    CsvRecorder,
    Event,
    EventKind,
    LogRecorder,
    McapRecorder,
    Recorder,
    Recording,
    Simulation,
    World,
)
from sim.errors import RecordingError
from sim.recording.recorder import StoredEvent


@pytest.fixture
def world(robot: Baxter, table: Body, block: Body) -> World:
    world = World(robot)
    world.spawn(table)
    world.spawn(block)
    return world


@pytest.fixture(scope="module")
def recording(robot: Baxter, manipulator: Manipulator, table: Body, block: Body) -> Recording:
    """The block there for 0.1 s, then gone for 0.1 s, then the start move."""
    world, recorder = World(robot), Recorder(robot)
    simulation = Simulation(world, [recorder])
    simulation.spawn(table)
    simulation.spawn(block)
    simulation.wait(0.1)
    simulation.delete("block")
    simulation.wait(0.1)
    simulation.execute(
        plan_start_move(manipulator, world.scene, world.arm_q("left"), manipulator.arm.start),
        "demo, ",
    )
    return recorder.recording()


def test_times_and_configurations_are_those_of_the_snapshots(
    recording: Recording, manipulator: Manipulator
) -> None:
    assert recording.times_s[:3].tolist() == [0.0, 0.01, 0.02]
    arm = manipulator.arm
    where = [recording.joint_names.index(name) for name in arm.joint_names]
    assert recording.q[0, where].tolist() == arm.neutral.tolist()


def test_duration_is_from_first_to_last_snapshot(recording: Recording) -> None:
    assert recording.duration_s == recording.times_s[-1] - recording.times_s[0]


def test_a_body_has_poses_while_it_is_there_and_nan_while_it_is_not(recording: Recording) -> None:
    there = np.isfinite(recording.body_poses["block"])
    rows: NDArray[np.bool_] = np.any(there, axis=1)
    assert (there == np.stack([rows] * 7, axis=1)).all()
    assert rows.tolist() == (recording.times_s <= 0.1).tolist()
    assert np.isfinite(recording.body_poses["table"]).all()


def test_a_pose_is_position_and_quaternion_in_base(recording: Recording, block: Body) -> None:
    row = recording.body_poses["block"][0]
    assert row[:3] == pytest.approx(block.T_base_body.translation, abs=1e-7)
    assert row[3:] == pytest.approx(quaternion_xyzw(block.T_base_body), abs=1e-9)


def test_captions_are_noted_when_they_change(recording: Recording) -> None:
    assert [text for _, text in recording.captions] == ["", "demo, move to start"]
    assert recording.captions[1][0] == pytest.approx(0.21)


def test_events_are_kept_in_order(recording: Recording) -> None:
    assert [event.kind for event in recording.events] == [
        EventKind.SPAWNED,
        EventKind.SPAWNED,
        EventKind.DELETED,
        EventKind.MOVE_STARTED,
        EventKind.OPENED,
    ]


def test_a_body_removed_later_is_remembered(recording: Recording) -> None:
    assert set(recording.bodies) == {"table", "block"}


def test_nothing_simulated_is_no_recording(robot: Baxter) -> None:
    recorder = Recorder(robot)
    assert not recorder.has_snapshots
    with pytest.raises(RecordingError, match="nothing was simulated"):
        recorder.recording()


def test_only_the_last_snapshots_are_kept_when_asked(robot: Baxter, world: World) -> None:
    recorder = Recorder(robot, keep=5)
    Simulation(world, [recorder]).wait(0.2)
    assert recorder.has_snapshots
    assert recorder.recording().times_s == pytest.approx([0.16, 0.17, 0.18, 0.19, 0.20])


def test_moves_are_kept_with_their_exact_motion(
    recording: Recording, manipulator: Manipulator
) -> None:
    (move,) = recording.moves
    assert move.limb == "left"
    assert move.label == "demo, move to start"
    assert move.start_s == pytest.approx(0.2)
    assert move.trajectory.q_goal.tolist() == manipulator.arm.start.tolist()
    assert move.end_s == pytest.approx(recording.times_s[-1], abs=0.01)


def test_moves_from_before_the_kept_snapshots_are_forgotten(
    robot: Baxter, world: World, manipulator: Manipulator
) -> None:
    recorder = Recorder(robot, keep=5)
    simulation = Simulation(world, [recorder])
    arm = manipulator.arm
    for goal in (arm.start, arm.neutral, arm.start):
        q = world.arm_q("left")
        simulation.execute(plan_start_move(manipulator, world.scene, q, goal))
    assert len(recorder.recording().moves) == 1
    simulation.wait(0.1)
    assert recorder.recording().moves == ()


def test_a_recording_does_not_change_when_the_simulation_goes_on(
    robot: Baxter, world: World
) -> None:
    recorder = Recorder(robot)
    simulation = Simulation(world, [recorder])
    simulation.wait(0.1)
    before = recorder.recording()
    simulation.wait(0.1)
    assert len(before.times_s) == 11
    assert len(recorder.recording().times_s) == 21


@pytest.mark.parametrize("keep", [0, -1, 0.5, "all", np.nan, []])
def test_a_number_to_keep_that_is_none_is_refused(robot: Baxter, keep: Any) -> None:
    with pytest.raises(RecordingError, match="keep"):
        Recorder(robot, keep=keep)


@pytest.mark.parametrize("bad", [None, "robot", 5])
def test_what_is_no_robot_or_scene_is_refused(robot: Baxter, tmp_path: Path, bad: Any) -> None:
    with pytest.raises(RecordingError, match="robot"):
        Recorder(bad)
    with pytest.raises(RecordingError, match="robot"):
        CsvRecorder(tmp_path / "run.csv", bad)
    with pytest.raises(RecordingError, match="scene"):
        Recorder(robot).remember(bad)


@pytest.mark.parametrize("told", [None, 5, "event", {}], ids=str)
@pytest.mark.parametrize("kind", [Recorder, CsvRecorder, LogRecorder, McapRecorder])
def test_what_is_no_event_and_no_snapshot_is_refused(
    robot: Baxter, tmp_path: Path, kind: Any, told: Any
) -> None:
    recorder: Any = kind(robot) if kind is Recorder else kind(tmp_path / "file", robot)
    with pytest.raises(RecordingError, match="snapshot must be of class Snapshot"):
        recorder.on_snapshot(told)
    if kind is not CsvRecorder:  # it has no place for events
        with pytest.raises(RecordingError, match="event must be of class Event"):
            recorder.on_event(told)
    if kind is not Recorder:
        recorder.close()


@given(
    st.floats(-1e30, 1e30),
    st.sampled_from(EventKind),
    st.text(),
    st.none() | st.text(),
    st.sampled_from([None, "left", "right"]),
)
def test_an_event_comes_back_to_the_bit(
    time_s: float, kind: EventKind, text: str, body: str | None, side: str | None
) -> None:
    event = StoredEvent(time_s, kind, text, body, side)
    line = as_text(to_json(event, StoredEvent, "event", RecordingError), RecordingError)
    assert line.isascii()
    assert "\n" not in line
    data = from_text(line, RecordingError)
    assert from_json(data, StoredEvent, "event", RecordingError) == event


def test_of_a_body_the_name_is_kept(block: Body) -> None:
    event = Event(1.0, EventKind.GRASPED, "block grasped", "right", body=block)
    stored = StoredEvent.of(event)
    assert (stored.body, stored.side) == ("block", "right")
    assert stored.event({"block": block}).body is block


def test_an_event_kept_without_a_side_is_read() -> None:
    data: Any = {"time_s": 1.0, "kind": "GRASPED", "text": "block grasped", "body": None}
    read = from_json(data, StoredEvent, "event", RecordingError)
    assert (read.side, read.body) == (None, None)


@pytest.mark.parametrize("time_s", [float("nan"), float("inf"), "1", None, True])
def test_what_has_no_place_in_a_file_is_refused(time_s: Any) -> None:
    with pytest.raises(RecordingError, match=r"cannot be saved: event\.time_s"):
        to_json(StoredEvent(time_s, EventKind.ENABLED, ""), StoredEvent, "event", RecordingError)
