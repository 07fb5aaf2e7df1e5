"""Bags: written ones are read by others, and damaged and hostile ones are refused."""

from __future__ import annotations

import bz2
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag1 import Reader, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import arm_joints
from sim import (
    Recorder,
    Recording,
    Simulation,
    World,
    read_recording,
    save_recording,
)
from sim.errors import RecordingError
from sim.recording.formats import bag_file
from sim.recording.formats.bag_file import nanoseconds
from sim.recording.formats.joint_states import GRIPPER_STATE, message_type
from sim.recording.recording import RecordedSample
from sim.ros1_messages import MessageTypes
from tests.sim.recording import bags
from tests.sim.recording.bags import NEUTRAL, of_baxter
from tests.sim.ros1 import debian

STAMP_S = 1.1e-9

BY_ROSBAG = """
import sys, rosbag, rospy
from sensor_msgs.msg import JointState
with rosbag.Bag(sys.argv[1], "w", compression=sys.argv[2]) as bag:
    for i in range(200):
        at = rospy.Time(1469000000, 10000000 * (i % 100))
        state = JointState(name=sys.argv[3].split(), position=[0.001 * i] * 14)
        state.header.stamp = rospy.Time.from_sec(1469000000 + 0.01 * i)
        bag.write("/robot/joint_states", state, state.header.stamp)
"""


MD5_SUMS = {
    "/joint_states": "3066dcd76a6cfaef579bd0f34173e9fd",
    "/tf": "94810edda583a504dfda3829e70d7eec",
    "/events": "992ce8a1687cec8c8bd883ec73ca41d1",
}
"""As ROS prints them."""

READ_BY_ROSBAG = """
import json, sys, rosbag
rows = {}
for topic, message, time in rosbag.Bag(sys.argv[1]).read_messages():
    if topic == "/joint_states":
        rows[time.to_nsec()] = [message.header.stamp.to_nsec(), message.name, message.position]
print(json.dumps(list(rows.values())))
"""


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory, picked: Recording) -> Path:
    path = tmp_path_factory.mktemp("bag") / "run.bag"
    save_recording(picked, path)
    return path


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.bag"


def messages(file: Path, topic: str) -> list[Any]:
    store = get_typestore(Stores.ROS1_NOETIC)
    transforms = "geometry_msgs/TransformStamped[] transforms"
    store.register(get_types_from_msg(transforms, "tf2_msgs/msg/TFMessage"))
    with Reader(file) as reader:
        wanted = [each for each in reader.connections if each.topic == topic]
        return [
            store.deserialize_ros1(data, connection.msgtype)
            for connection, _, data in reader.messages(wanted)
        ]


def test_topics_types_sums_snapshots_and_events_are_those_of_ros_1(
    file: Path, picked: Recording
) -> None:
    with Reader(file) as reader:
        found = {each.topic: (each.msgtype, each.digest) for each in reader.connections}
        assert all(each.msgdef.data for each in reader.connections)
        assert reader.topics["/tf"].msgcount == len(picked.times_s)
    kinds = ["sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage", "std_msgs/msg/String"]
    assert found == dict(zip(MD5_SUMS, zip(kinds, MD5_SUMS.values(), strict=True), strict=True))
    assert message_type(GRIPPER_STATE).md5 == "ade777f069d738595bc19e246b8ec7a0"
    states = messages(file, "/joint_states")
    assert np.array([state.position for state in states]).tolist() == picked.q.tolist()
    stamps = [state.header.stamp.sec + 1e-9 * state.header.stamp.nanosec for state in states]
    assert stamps == pytest.approx(picked.times_s, abs=STAMP_S)
    told = [message.data for message in messages(file, "/events")]
    assert told == [f"{event.kind.value}: {event.text}" for event in picked.events]


def test_debians_rosbag_reads_it(file: Path, picked: Recording) -> None:
    missing = debian.find_ros()
    if missing:
        pytest.skip(f"ROS 1 of Debian is not installed: {missing}")
    command = [debian.PYTHON, "-c", READ_BY_ROSBAG, str(file)]
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(command, capture_output=True, timeout=120, check=True, env=clean)
    rows = json.loads(done.stdout)
    assert [row[2] for row in rows] == picked.q.tolist()
    assert {tuple(row[1]) for row in rows} == {picked.joint_names}
    assert [1e-9 * row[0] for row in rows] == pytest.approx(picked.times_s, abs=STAMP_S)


def test_the_same_recording_gives_the_same_bytes_in_place_of_an_older_file(
    file: Path, picked: Recording, tmp_path: Path
) -> None:
    (tmp_path / "again.bag").write_bytes(b"older")
    save_recording(picked, str(tmp_path / "again.bag"))
    assert (tmp_path / "again.bag").read_bytes() == file.read_bytes()


def test_velocities_are_those_of_the_moves(file: Path, picked: Recording) -> None:
    found = np.array([state.velocity for state in messages(file, "/joint_states")])
    arm = [picked.joint_names.index(name) for name in arm_joints("left")]
    assert found[:, arm].tolist() == picked.motion("left").v.tolist()
    finger = picked.joint_names.index("l_gripper_l_finger_joint")
    slopes = np.diff(picked.q[:, finger]) / np.diff(picked.times_s)
    assert found[1:, finger] == pytest.approx(slopes)


def test_bodies_are_transforms_from_base_while_they_are_there(
    file: Path, picked: Recording
) -> None:
    frames = messages(file, "/tf")
    for row in (0, 100, len(frames) - 1):
        found = {each.child_frame_id: each for each in frames[row].transforms}
        assert set(found) == {n for n, x in picked.body_poses.items() if np.isfinite(x[row]).all()}
        for name, each in found.items():
            p = each.transform.translation
            assert [p.x, p.y, p.z] == picked.body_poses[name][row, :3].tolist()
            assert each.header.frame_id == "base"


def test_an_execution_has_its_set_points(picked: Recording, path: Path) -> None:
    arrays = [np.arange(7.0) + i for i in range(4)]
    sent, measured_q, path_q, measured_v = arrays
    sample = RecordedSample("left", 0.5, sent, measured_q, path_q, measured_v, 0.004)
    save_recording(evolve(picked, samples=(sample,)), path)
    (command,) = bags.commands(path)
    assert list(command.names) == list(arm_joints("left"))
    assert command.command.tolist() == arrays[0].tolist()
    measured = messages(path, "/robot/joint_states")[0]
    assert (measured.position.tolist(), measured.velocity.tolist()) == (
        arrays[1].tolist(),
        arrays[3].tolist(),
    )
    assert messages(path, "/robot/ref_joint_states")[0].position.tolist() == arrays[2].tolist()


def test_a_recorder_writes_it_when_it_is_closed(robot: Baxter, path: Path) -> None:
    with Recorder(robot, path) as recorder:
        Simulation(World(robot), [recorder]).wait(0.1)
        assert not path.exists()
    assert len(read_recording(path, robot).recording.times_s) == 11


def test_times_that_ros_does_not_have_are_refused_before_a_file_is_made(
    picked: Recording, path: Path
) -> None:
    time_s: Any
    for time_s in (-1e-6, 2.0**32, np.nan, np.inf, "1", None, 10**400):
        with pytest.raises(RecordingError):
            nanoseconds(time_s)
    early = evolve(picked, times_s=picked.times_s - 1.0)
    with pytest.raises(RecordingError, match="times from 0"):
        save_recording(early, path)
    assert not path.exists()


def test_half_a_surrogate_pair_is_written_as_an_escape(picked: Recording, path: Path) -> None:
    names = ("a\ud800", *picked.joint_names[1:])
    try:
        odd = evolve(picked, joint_names=names)
    except RecordingError:
        return  # it never comes that far
    save_recording(odd, path)
    assert messages(path, "/joint_states")[0].name[0] == "a\\ud800"


def test_without_the_package_the_error_says_what_to_install(
    robot: Baxter, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    monkeypatch.setattr("sim.recording.formats.joint_states._TYPES", MessageTypes())
    with pytest.raises(RecordingError, match="pip install rosbags"):
        Recorder(robot, path)
    assert not path.exists()


def test_a_run_comes_back(robot: Baxter, picked: Recording, file: Path) -> None:
    found, notes = read_recording(file, robot)
    assert notes == ()
    assert found.q.tolist() == picked.q.tolist()
    assert found.times_s == pytest.approx(picked.times_s, abs=STAMP_S)
    assert found.gripper_percent == pytest.approx(picked.gripper_percent, abs=1e-9)
    told = [(event.kind, event.text) for event in picked.events]
    assert [(event.kind, event.text) for event in found.events] == told


@pytest.mark.parametrize("compression", ["bz2", "lz4"])
def test_compressed_chunks_are_read(robot: Baxter, path: Path, compression: str) -> None:
    found = read_recording(bags.write_bag(path, of_baxter(), compression), robot).recording
    assert len(found.times_s) == 100


@pytest.mark.slow
@pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
def test_bags_of_debians_rosbag_are_read(robot: Baxter, path: Path, compression: str) -> None:
    missing = debian.find_ros()
    if missing:
        pytest.skip(f"ROS 1 of Debian is not installed: {missing}")
    names = " ".join(bags.ARMS)
    command = [debian.PYTHON, "-c", BY_ROSBAG, str(path), compression, names]
    subprocess.run(command, check=True, capture_output=True, timeout=120, cwd="/")
    found = read_recording(path, robot).recording
    for side in ("left", "right"):
        expected = np.tile(0.001 * np.arange(200), (7, 1)).T
        np.testing.assert_allclose(found.motion(side).q, expected, atol=1e-12)


def test_types_of_another_definition_are_left_out_and_no_code_is_made_of_them(
    robot: Baxter, path: Path
) -> None:
    bags.write_bag(path, of_baxter(0.1))
    content = path.read_bytes().replace(b"3066dcd76a6cfaef579bd0f34173e9fd", b"0" * 32)
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="another md5 sum: /robot/joint_states"):
        read_recording(path, robot)


class TestDamaged:
    """Every damage is one sentence that names the file."""

    @pytest.mark.parametrize(
        "content", [b"", b"#ROSBAG V2.0\n", b"#ROSBAG V1.2\n", b"\x89MCAP0\r\n", b"time,left\n"]
    )
    def test_what_is_no_bag(self, robot: Baxter, path: Path, content: bytes) -> None:
        path.write_bytes(content)
        with pytest.raises(RecordingError, match=r"no bag of format 2\.0"):
            read_recording(path, robot)

    @settings(max_examples=25)
    @given(data=st.data())
    @pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
    def test_any_damage_is_refused_or_harmless(
        self,
        robot: Baxter,
        tmp_path_factory: pytest.TempPathFactory,
        data: st.DataObject,
        compression: str,
    ) -> None:
        path = tmp_path_factory.getbasetemp() / f"damaged {compression}.bag"
        whole = path.with_name(f"{compression}.bag")
        if not whole.exists():
            bags.write_bag(whole, of_baxter(0.2), compression)
        content = bytearray(whole.read_bytes())
        for _ in range(data.draw(st.integers(1, 4))):
            place = data.draw(st.integers(0, len(content) - 1))
            if 110 < place < 4096:  # spaces that fill the header up
                place += 4096
            content[place % len(content)] = data.draw(st.integers(0, 255))
        cut = data.draw(st.none() | st.integers(0, len(content)))
        path.write_bytes(bytes(content[:cut]))
        failure = bags.failure_of(read_recording, path, robot)
        assert not failure or path.name in failure
        assert "\n" not in failure

    def test_a_chunk_that_unpacks_to_more_than_it_may(
        self, robot: Baxter, path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(bag_file, "MAX_CHUNK_BYTES", 10_000)
        bags.write_bag(path, of_baxter(1.0), "bz2")
        with pytest.raises(RecordingError, match="unpacks to more than"):
            read_recording(path, robot)


def test_an_own_topic_with_other_text_is_no_event(robot: Baxter, path: Path) -> None:
    writer = Writer(path)
    with writer:
        kind = "std_msgs/msg/String"
        connection = writer.add_connection("/events", kind, typestore=bags.STORE)
        for text in ("grasped: block", "nothing: else", "grasped"):
            message = bags.STORE.types[kind](text)
            writer.write(connection, 10**9, bytes(bags.STORE.serialize_ros1(message, kind)))
        joints = writer.add_connection("/joint_states", bags.JOINT_STATE, typestore=bags.STORE)
        writer.write(joints, 10**9, bags.state(1.0, NEUTRAL).data)
    events = read_recording(path, robot).recording.events
    assert [event.text for event in events] == ["block", ""]


def test_bz2_is_what_rosbag_calls_so() -> None:
    assert bag_file._unpacked(bz2.BZ2Decompressor, bz2.compress(b"abc")) == b"abc"
