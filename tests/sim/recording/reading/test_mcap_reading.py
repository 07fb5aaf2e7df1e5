"""Reading MCAP: our own files come back, what was cut short is read as far as it goes."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import Writer

from baxter_kin import Baxter
from sim import McapRecorder, Recording, Simulation, World, read_mcap, write_mcap
from sim.errors import RecordingError
from sim.recording.reading import mcap_reading
from tests.sim.recording.reading import bags
from tests.sim.recording.reading.test_joint_merging import of_baxter

STAMP_S = 1.1e-9


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


def test_a_run_comes_back(robot: Baxter, picked: Recording, path: Path) -> None:
    write_mcap(picked, path)
    found, notes = read_mcap(path, robot)
    assert notes == ()
    assert found.q.tolist() == picked.q.tolist()
    assert found.times_s == pytest.approx(picked.times_s, abs=STAMP_S)
    assert found.gripper_percent == pytest.approx(picked.gripper_percent, abs=1e-9)
    told = [(event.kind, event.text) for event in picked.events]
    assert [(event.kind, event.text) for event in found.events] == told


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_compressed_chunks_are_read(robot: Baxter, path: Path, compression: str) -> None:
    found = read_mcap(bags.write_mcap(path, of_baxter(), compression), robot).recording
    assert len(found.times_s) == 100


def test_a_run_that_was_killed_gives_what_is_there(robot: Baxter, path: Path) -> None:
    recorder = McapRecorder(path, robot)
    Simulation(World(robot), [recorder]).wait(3.0)
    killed = path.with_name("killed.mcap")
    killed.write_bytes(path.read_bytes())
    recorder.close()
    found, notes = read_mcap(killed, robot)
    assert 200 <= len(found.times_s) < 301
    assert notes == ("the file was cut short: what follows is missing",)


@given(st.integers(8, 100_000))
def test_one_cut_anywhere_gives_the_chunks_before(
    robot: Baxter, tmp_path_factory: pytest.TempPathFactory, size: int
) -> None:
    path = tmp_path_factory.getbasetemp() / "cut.mcap"
    content = path.read_bytes() if path.exists() else b""
    if len(content) < 100_000:
        content = bags.write_mcap(path, of_baxter(4.0)).read_bytes()
    cut = path.with_name("cut off.mcap")
    cut.write_bytes(content[:size])
    failure = bags.failure_of(read_mcap, cut, robot)
    told = failure or "; ".join(read_mcap(cut, robot).notes)
    assert "the file was cut short: what follows is missing" in told


@given(data=st.data())
@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_any_damage_is_refused_or_harmless(
    robot: Baxter,
    tmp_path_factory: pytest.TempPathFactory,
    data: st.DataObject,
    compression: str,
) -> None:
    path = tmp_path_factory.getbasetemp() / f"damaged {compression}.mcap"
    content = bytearray(bags.write_mcap(path, of_baxter(0.2), compression).read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(bytes(content))
    failure = bags.failure_of(read_mcap, path, robot)
    assert not failure or path.name in failure
    assert "\n" not in failure


@pytest.mark.parametrize("content", [b"", b"#ROSBAG V2.0\n", b"time,left_s0\n", bytes(100)])
def test_what_is_no_mcap_file(robot: Baxter, path: Path, content: bytes) -> None:
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"run\.mcap is no MCAP file, or a damaged"):
        read_mcap(path, robot)


@pytest.mark.parametrize(
    ("encoding", "definition", "words"),
    [
        ("cdr", None, "/joint_states is left out: its messages are cdr, and only ROS 1's are read"),
        ("ros1", b"float64 position\n", "is left out: its sensor_msgs/JointState has other fields"),
    ],
)
def test_messages_that_are_not_ros_1s_are_named(
    robot: Baxter, path: Path, encoding: str, definition: bytes | None, words: str
) -> None:
    text = bags.STORE.generate_msgdef(bags.JOINT_STATE)[0].encode()
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("sensor_msgs/JointState", "ros1msg", definition or text)
        channel = writer.register_channel("/joint_states", encoding, schema)
        writer.add_message(channel, 0, b"abc", 0)
        writer.finish()  # type: ignore[no-untyped-call]  # of the library
    with pytest.raises(RecordingError, match=f"has no joint states .*{words}"):
        read_mcap(path, robot)


def test_a_chunk_that_unpacks_to_more_than_it_may(
    robot: Baxter, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bags.write_mcap(path, of_baxter(1.0), "zstd")
    monkeypatch.setattr(mcap_reading, "LARGEST_CHUNK_BYTES", 40_000)
    with pytest.raises(RecordingError, match="unpacks to more than 0 MB"):
        read_mcap(path, robot)


def test_without_the_package_the_error_says_what_to_install(
    robot: Baxter, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mcap.exceptions", None)
    with pytest.raises(RecordingError, match=r"run: .* -m pip install mcap rosbags$"):
        read_mcap(path, robot)


@pytest.mark.parametrize("bad", [None, 3, b"run.mcap"])
def test_what_is_no_path_or_no_robot(robot: Baxter, path: Path, bad: Any) -> None:
    with pytest.raises(RecordingError, match="path"):
        read_mcap(bad, robot)
    with pytest.raises(RecordingError, match="robot"):
        read_mcap(bags.write_mcap(path, of_baxter(0.1)), bad)
