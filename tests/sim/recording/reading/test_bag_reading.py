"""Reading bags: our own come back, compressed ones are read, damaged and hostile ones refused."""

from __future__ import annotations

import bz2
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.rosbag1 import Writer

from baxter_kin import Baxter
from sim import BagRecorder, Recording, Simulation, World, read_bag, write_bag
from sim.errors import RecordingError
from sim.recording.reading import bag_reading
from sim.recording.ros1_files.messages import GRIPPER_STATE, message_type
from tests.sim.recording.reading import bags
from tests.sim.recording.reading.test_joint_merging import NEUTRAL, of_baxter
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


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.bag"


def test_a_run_comes_back(robot: Baxter, picked: Recording, path: Path) -> None:
    write_bag(picked, path)
    found, notes = read_bag(path, robot)
    assert notes == ()
    assert found.q.tolist() == picked.q.tolist()
    assert found.times_s == pytest.approx(picked.times_s, abs=STAMP_S)
    assert found.gripper_percent == pytest.approx(picked.gripper_percent, abs=1e-9)
    told = [(event.kind, event.text) for event in picked.events]
    assert [(event.kind, event.text) for event in found.events] == told


@pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
def test_compressed_chunks_are_read(robot: Baxter, path: Path, compression: str) -> None:
    found = read_bag(bags.write_bag(path, of_baxter(), compression), robot).recording
    assert len(found.times_s) == 100


@pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
def test_bags_of_debians_rosbag_are_read(robot: Baxter, path: Path, compression: str) -> None:
    missing = debian.find_ros()
    if missing:
        pytest.skip(f"ROS 1 of Debian is not installed: {missing}")
    names = " ".join(bags.ARMS)
    command = [debian.PYTHON, "-c", BY_ROSBAG, str(path), compression, names]
    subprocess.run(command, check=True, capture_output=True, timeout=120, cwd="/")
    found = read_bag(path, robot).recording
    for side in ("left", "right"):
        expected = np.tile(0.001 * np.arange(200), (7, 1)).T
        np.testing.assert_allclose(found.motion(side).q, expected, atol=1e-12)


def test_the_grippers_type_has_the_robots_sum() -> None:
    assert message_type(GRIPPER_STATE).md5 == "ade777f069d738595bc19e246b8ec7a0"


def test_types_of_another_definition_are_left_out_and_no_code_is_made_of_them(
    robot: Baxter, path: Path
) -> None:
    bags.write_bag(path, of_baxter(0.1))
    content = path.read_bytes().replace(b"3066dcd76a6cfaef579bd0f34173e9fd", b"0" * 32)
    path.write_bytes(content)
    words = (
        r"no joint states .*; left out, as their types have another md5 sum: /robot/joint_states"
    )
    with pytest.raises(RecordingError, match=words):
        read_bag(path, robot)


class TestDamaged:
    """Every damage is one sentence that names the file."""

    @pytest.mark.parametrize(
        "content", [b"", b"#ROSBAG V2.0\n", b"#ROSBAG V1.2\n", b"\x89MCAP0\r\n", b"time,left\n"]
    )
    def test_what_is_no_bag(self, robot: Baxter, path: Path, content: bytes) -> None:
        path.write_bytes(content)
        with pytest.raises(
            RecordingError, match=r"run\.bag is no bag of format 2\.0, or a damaged"
        ):
            read_bag(path, robot)

    def test_one_that_was_killed_says_what_to_do(self, robot: Baxter, path: Path) -> None:
        recorder = BagRecorder(path, robot)
        Simulation(World(robot), [recorder]).wait(3.0)
        killed = path.with_name("killed.bag")
        killed.write_bytes(path.read_bytes())
        recorder.close()
        with pytest.raises(RecordingError, match=r"not indexed.*run: rosbag reindex"):
            read_bag(killed, robot)

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
        content = bytearray(bags.write_bag(path, of_baxter(0.2), compression).read_bytes())
        for _ in range(data.draw(st.integers(1, 4))):
            place = data.draw(st.integers(0, len(content) - 1))
            if 110 < place < 4096:  # spaces that fill the header up
                place += 4096
            content[place % len(content)] = data.draw(st.integers(0, 255))
        cut = data.draw(st.none() | st.integers(0, len(content)))
        path.write_bytes(bytes(content[:cut]))
        failure = bags.failure_of(read_bag, path, robot)
        assert not failure or path.name in failure
        assert "\n" not in failure

    def test_a_chunk_that_unpacks_to_more_than_it_may(
        self, robot: Baxter, path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(bag_reading, "LARGEST_CHUNK_BYTES", 10_000)
        bags.write_bag(path, of_baxter(1.0), "bz2")
        with pytest.raises(RecordingError, match="unpacks to more than"):
            read_bag(path, robot)

    def test_what_cannot_be_read(self, robot: Baxter, tmp_path: Path) -> None:
        for name, words in (("no.bag", "No such file"), ("", "not a regular file|directory")):
            with pytest.raises(RecordingError, match=words):
                read_bag(tmp_path / name, robot)

    @pytest.mark.parametrize("bad", [None, 3, b"run.bag"])
    def test_what_is_no_path_or_no_robot(self, robot: Baxter, path: Path, bad: Any) -> None:
        with pytest.raises(RecordingError, match="path"):
            read_bag(bad, robot)
        with pytest.raises(RecordingError, match="robot"):
            read_bag(bags.write_bag(path, of_baxter(0.1)), bad)


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
    events = read_bag(path, robot).recording.events
    assert [event.text for event in events] == ["block", ""]


def test_bz2_is_what_rosbag_calls_so() -> None:
    assert bag_reading._unpacked(bz2.BZ2Decompressor, bz2.compress(b"abc")) == b"abc"
