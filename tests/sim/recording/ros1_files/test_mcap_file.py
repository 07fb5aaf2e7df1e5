"""MCAP: read back by the format's own reader and ROS's own message classes."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader
from mcap_ros1.decoder import DecoderFactory

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from sim import McapRecorder, Recording, Simulation, World, write_mcap
from sim.errors import RecordingError
from sim.recording.recorded_motion import arm_joints
from sim.ros1_messages import MessageTypes

STAMP_S = 1e-9
VELOCITY = 1e-9
"""Times are kept to the nanosecond, velocities as they are."""


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory, picked: Recording) -> Path:
    path = tmp_path_factory.mktemp("mcap") / "run.mcap"
    write_mcap(picked, path)
    return path


def messages(path: Path, topic: str) -> list[Any]:
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        return [found.decoded_message for found in reader.iter_decoded_messages(topics=[topic])]


def test_topics_and_types_are_those_of_ros_1(path: Path) -> None:
    with path.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros1"
    assert summary is not None
    kinds = {
        channel.topic: (summary.schemas[channel.schema_id].name, channel.message_encoding)
        for channel in summary.channels.values()
    }
    assert kinds == {
        "/joint_states": ("sensor_msgs/JointState", "ros1"),
        "/tf": ("tf2_msgs/TFMessage", "ros1"),
        "/events": ("std_msgs/String", "ros1"),
    }
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros1msg"}


def test_every_snapshot_is_a_joint_state_with_all_joints(path: Path, picked: Recording) -> None:
    states = messages(path, "/joint_states")
    assert {tuple(state.name) for state in states} == {picked.joint_names}
    assert np.array([state.position for state in states]).tolist() == picked.q.tolist()
    stamps = [state.header.stamp.to_sec() for state in states]
    assert stamps == pytest.approx(picked.times_s, abs=STAMP_S)
    assert [state.header.seq for state in states] == list(range(len(states)))
    assert not any(len(state.effort) for state in states)


def test_velocities_of_moves_are_exact(path: Path, picked: Recording) -> None:
    motion = picked.motion("left")
    found = np.array([state.velocity for state in messages(path, "/joint_states")])
    found = found[:, [picked.joint_names.index(name) for name in arm_joints("left")]]
    inside = np.zeros(len(found), dtype=bool)
    for move in picked.moves:
        inside |= (motion.times_s > move.start_s) & (motion.times_s < move.end_s)
    assert inside.mean() > 0.9
    assert np.abs(found[inside] - motion.v[inside]).max() < VELOCITY


def test_fingers_have_the_velocity_of_their_differences(path: Path, picked: Recording) -> None:
    finger = picked.joint_names.index("l_gripper_l_finger_joint")
    found = np.array([state.velocity[finger] for state in messages(path, "/joint_states")])
    slopes = np.diff(picked.q[:, finger]) / np.diff(picked.times_s)
    assert found[1:] == pytest.approx(slopes)


def test_bodies_are_transforms_from_base_while_they_are_there(
    path: Path, picked: Recording
) -> None:
    frames = messages(path, "/tf")
    for row in (0, 100, len(frames) - 1):
        found = {item.child_frame_id: item for item in frames[row].transforms}
        there = {n for n, track in picked.body_poses.items() if np.isfinite(track[row]).all()}
        assert set(found) == there
        for name, item in found.items():
            p = item.transform.translation
            assert [p.x, p.y, p.z] == picked.body_poses[name][row, :3].tolist()
            assert item.header.frame_id == "base"


def test_events_are_text(path: Path, picked: Recording) -> None:
    found = [message.data for message in messages(path, "/events")]
    assert found == [f"{event.kind.value}: {event.text}" for event in picked.events]
    assert any(text.startswith("grasped: block") for text in found)


def test_the_same_recording_gives_the_same_bytes(
    path: Path, picked: Recording, tmp_path: Path
) -> None:
    write_mcap(picked, str(tmp_path / "again.mcap"))
    assert (tmp_path / "again.mcap").read_bytes() == path.read_bytes()


def test_chunks_are_on_disk_while_the_simulation_runs(robot: Baxter, tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path / "run.mcap", robot)
    Simulation(World(robot), [recorder]).wait(3.0)
    found = 0
    with (tmp_path / "run.mcap").open("rb") as stream, suppress(EndOfFile):
        reader = NonSeekingReader(stream)
        for _ in reader.iter_messages(topics=["/joint_states"], log_time_order=False):
            found += 1
    recorder.close()
    assert 200 <= found < 301


def test_closing_twice_is_no_trouble_and_writing_afterwards_is_said(
    robot: Baxter, tmp_path: Path
) -> None:
    recorder = McapRecorder(tmp_path / "run.mcap", robot)
    recorder.close()
    recorder.close()
    with pytest.raises(RecordingError, match="closed file"):
        Simulation(World(robot), [recorder]).wait(0.01)


@pytest.mark.usefixtures("full_disk")
def test_a_full_disk_is_said_each_time(robot: Baxter, tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path / "run.mcap", robot)
    simulation = Simulation(World(robot), [recorder])
    for _ in ("when it happens", "whatever comes later"):
        with pytest.raises(RecordingError, match=r"cannot write .*run.mcap: No space left"):
            simulation.wait(5.0)
    recorder.close()


def test_times_before_zero_are_refused_before_a_file_is_made(
    picked: Recording, tmp_path: Path
) -> None:
    early = evolve(picked, times_s=picked.times_s - 1.0)
    with pytest.raises(RecordingError, match="times from 0"):
        write_mcap(early, tmp_path / "run.mcap")
    assert not list(tmp_path.iterdir())


def test_joints_of_other_names_have_the_velocity_of_their_differences(
    picked: Recording, tmp_path: Path
) -> None:
    names = tuple(f"other_{name}" for name in picked.joint_names)
    write_mcap(evolve(picked, joint_names=names), tmp_path / "run.mcap")
    states = messages(tmp_path / "run.mcap", "/joint_states")
    slopes = (picked.q[100] - picked.q[99]) / (picked.times_s[100] - picked.times_s[99])
    assert list(states[100].velocity) == pytest.approx(slopes.tolist())


def test_without_the_package_the_error_says_what_to_install(
    robot: Baxter, picked: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    words = r"run: .* -m pip install mcap rosbags$"
    with pytest.raises(RecordingError, match=words):
        McapRecorder(tmp_path / "run.mcap", robot)
    with pytest.raises(RecordingError, match=words):
        write_mcap(picked, tmp_path / "run.mcap")


def test_without_the_package_for_messages_no_file_is_made(
    robot: Baxter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    monkeypatch.setattr("sim.recording.ros1_files.messages._TYPES", MessageTypes())
    with pytest.raises(RecordingError, match="need the package rosbags"):
        McapRecorder(tmp_path / "run.mcap", robot)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("bad", [None, 3, b"x"])
def test_other_types_are_refused(
    robot: Baxter, picked: Recording, tmp_path: Path, bad: Any
) -> None:
    with pytest.raises(RecordingError, match="path"):
        McapRecorder(bad, robot)
    with pytest.raises(RecordingError, match="path"):
        write_mcap(picked, bad)
    with pytest.raises(RecordingError, match="robot"):
        McapRecorder(tmp_path / "run.mcap", bad)
