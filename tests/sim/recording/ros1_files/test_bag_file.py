"""Bags: read back by the library's own reader, and by Debian's rosbag."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_typestore

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from sim import BagRecorder, Recording, Simulation, World, write_bag
from sim.errors import RecordingError
from sim.ros1_messages import MessageTypes
from tests.sim.ros1 import debian

STAMP_S = 1e-9
"""Times are kept to the nanosecond."""

MD5_SUMS = {
    "/joint_states": "3066dcd76a6cfaef579bd0f34173e9fd",
    "/tf": "94810edda583a504dfda3829e70d7eec",
    "/events": "992ce8a1687cec8c8bd883ec73ca41d1",
}
"""As ROS prints them."""

BY_ROSBAG = """
import json, sys, rosbag
rows = {}
for topic, message, time in rosbag.Bag(sys.argv[1]).read_messages():
    if topic == "/joint_states":
        rows[time.to_nsec()] = [message.header.stamp.to_nsec(), message.name, message.position]
print(json.dumps(list(rows.values())))
"""


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory, picked: Recording) -> Path:
    path = tmp_path_factory.mktemp("bag") / "run.bag"
    write_bag(picked, path)
    return path


def messages(path: Path, topic: str) -> list[Any]:
    store = get_typestore(Stores.ROS1_NOETIC)
    with Reader(path) as reader:
        wanted = [each for each in reader.connections if each.topic == topic]
        return [
            store.deserialize_ros1(data, connection.msgtype)
            for connection, _, data in reader.messages(wanted)
        ]


def test_topics_types_and_sums_are_those_of_ros_1(path: Path) -> None:
    with Reader(path) as reader:
        found = {each.topic: (each.msgtype, each.digest) for each in reader.connections}
        assert all(each.msgdef.data for each in reader.connections)
    kinds = ["sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage", "std_msgs/msg/String"]
    assert found == dict(zip(MD5_SUMS, zip(kinds, MD5_SUMS.values(), strict=True), strict=True))


def test_every_snapshot_and_event_is_there(path: Path, picked: Recording) -> None:
    states = messages(path, "/joint_states")
    assert np.array([state.position for state in states]).tolist() == picked.q.tolist()
    stamps = [state.header.stamp.sec + 1e-9 * state.header.stamp.nanosec for state in states]
    assert stamps == pytest.approx(picked.times_s, abs=STAMP_S)
    with Reader(path) as reader:
        assert reader.topics["/tf"].msgcount == len(picked.times_s)
    told = [message.data for message in messages(path, "/events")]
    assert told == [f"{event.kind.value}: {event.text}" for event in picked.events]


def test_debians_rosbag_reads_it(path: Path, picked: Recording) -> None:
    missing = debian.find_ros()
    if missing:
        pytest.skip(f"ROS 1 of Debian is not installed: {missing}")
    command = [debian.PYTHON, "-c", BY_ROSBAG, str(path)]
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(command, capture_output=True, timeout=120, check=True, env=clean)
    rows = json.loads(done.stdout)
    assert [row[2] for row in rows] == picked.q.tolist()
    assert {tuple(row[1]) for row in rows} == {picked.joint_names}
    assert [1e-9 * row[0] for row in rows] == pytest.approx(picked.times_s, abs=STAMP_S)


def test_the_same_recording_gives_the_same_bytes_in_place_of_an_older_file(
    path: Path, picked: Recording, tmp_path: Path
) -> None:
    (tmp_path / "again.bag").write_bytes(b"older")
    write_bag(picked, str(tmp_path / "again.bag"))
    assert (tmp_path / "again.bag").read_bytes() == path.read_bytes()


def test_chunks_are_on_disk_while_the_simulation_runs(robot: Baxter, tmp_path: Path) -> None:
    recorder = BagRecorder(tmp_path / "run.bag", robot)
    Simulation(World(robot), [recorder]).wait(3.0)
    size = (tmp_path / "run.bag").stat().st_size
    recorder.close()
    assert size > 3 * 65_536
    assert len(messages(tmp_path / "run.bag", "/joint_states")) == 301


def test_memory_does_not_grow_with_the_messages(robot: Baxter, tmp_path: Path) -> None:
    recorder = BagRecorder(tmp_path / "run.bag", robot)
    simulation = Simulation(World(robot), [recorder])
    simulation.wait(5.0)
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    simulation.wait(20.0)
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    recorder.close()
    each_chunk, chunk_bytes = 2_000, 65_536
    assert after - before < 2 * chunk_bytes + each_chunk * 40


def test_closing_twice_is_no_trouble_and_writing_afterwards_is_said(
    robot: Baxter, tmp_path: Path
) -> None:
    recorder = BagRecorder(tmp_path / "run.bag", robot)
    recorder.close()
    recorder.close()
    with pytest.raises(RecordingError, match="closed file"):
        Simulation(World(robot), [recorder]).wait(0.01)


@pytest.mark.usefixtures("full_disk")
def test_a_full_disk_is_said(robot: Baxter, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"cannot write .*run.bag: No space left"):
        BagRecorder(tmp_path / "run.bag", robot)


def test_a_disk_that_fills_up_is_said_each_time(
    robot: Baxter, tmp_path: Path, small_disk: Callable[[int], None]
) -> None:
    small_disk(200_000)
    recorder = BagRecorder(tmp_path / "run.bag", robot)
    simulation = Simulation(World(robot), [recorder])
    for _ in ("when it happens", "whatever comes later"):
        with pytest.raises(RecordingError, match=r"cannot write .*run.bag: No space left"):
            simulation.wait(5.0)
    recorder.close()


def test_times_before_zero_are_refused_before_a_file_is_made(
    picked: Recording, tmp_path: Path
) -> None:
    early = evolve(picked, times_s=picked.times_s - 1.0)
    with pytest.raises(RecordingError, match="times from 0"):
        write_bag(early, tmp_path / "run.bag")
    assert not list(tmp_path.iterdir())


def test_without_the_package_the_error_says_what_to_install(
    robot: Baxter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    monkeypatch.setattr("sim.recording.ros1_files.messages._TYPES", MessageTypes())
    with pytest.raises(RecordingError, match=r"run: .* -m pip install rosbags$"):
        BagRecorder(tmp_path / "run.bag", robot)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("bad", [None, 3, b"x"])
def test_other_types_are_refused(
    robot: Baxter, picked: Recording, tmp_path: Path, bad: Any
) -> None:
    with pytest.raises(RecordingError, match="path"):
        BagRecorder(bad, robot)
    with pytest.raises(RecordingError, match="path"):
        write_bag(picked, bad)
    with pytest.raises(RecordingError, match="robot"):
        BagRecorder(tmp_path / "run.bag", bad)
    with pytest.raises(RecordingError, match="recording"):
        write_bag(bad, tmp_path / "run.bag")
