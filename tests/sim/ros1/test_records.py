"""Records: what was sent and measured, in every format, read back by others' code."""

from __future__ import annotations

import json
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
from mcap_ros1.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from baxter_kin import Baxter
from sim import Event, EventKind, Observer, Snapshot, load_recording, read_log
from sim.errors import RecordingError
from sim.ros1.records import SUFFIXES, record_to
from sim.samples import Sample, SampleObserver
from sim.world.gripper import NO_GRIPPER

COUNT = 40
COMMAND = "/robot/limb/left/joint_command"


def sample(number: int) -> Sample:
    q = 0.01 * number + np.arange(7.0)
    return Sample(
        time_s=0.01 * number,
        limb="left",
        q_path=q,
        q_sent=q + 0.1,
        q_measured=q - 0.1,
        v_measured=np.full(7, 0.5),
        age_s=0.004,
        lateness_s=0.001,
        is_enabled=True,
        is_stopped=False,
        has_error=False,
    )


def tell(observer: Observer, robot: Baxter, count: int = COUNT) -> None:
    assert isinstance(observer, SampleObserver)
    observer.on_event(Event(0.0, EventKind.ENABLED, "robot enabled"))
    grippers = {"left": NO_GRIPPER, "right": NO_GRIPPER}
    for number in range(count):
        observer.on_sample(sample(number))
        q = robot.configuration()
        observer.on_snapshot(Snapshot(0.01 * number, q, {}, grippers, "a move"))


def recorded(path: Path, robot: Baxter) -> Path:
    with ExitStack() as stack:
        tell(record_to(path, robot, stack), robot)
    return path


def test_a_bag_has_every_message(tmp_path: Path, robot: Baxter) -> None:
    with AnyReader([recorded(tmp_path / "a.bag", robot)]) as reader:
        counts = {each.topic: each.msgcount for each in reader.connections}
        sent: list[Any] = [
            reader.deserialize(content, connection.msgtype)
            for connection, _, content in reader.messages()
            if connection.topic == COMMAND
        ]
    assert counts == dict.fromkeys(
        [
            *(COMMAND, "/robot/ref_joint_states", "/robot/joint_states", "/robot/state"),
            *("/baxter_kin/age", "/joint_states", "/tf"),
        ],
        COUNT,
    ) | {"/events": 1}
    for number, message in enumerate(sent):
        assert np.array_equal(message.command, sample(number).q_sent)
        assert list(message.names) == [
            f"left_{j}" for j in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")
        ]


def test_mcap_has_every_message(tmp_path: Path, robot: Baxter) -> None:
    measured = []
    with recorded(tmp_path / "a.mcap", robot).open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            if channel.topic == "/robot/joint_states":
                measured.append(message.position)
    assert np.allclose(measured, [sample(number).q_measured for number in range(COUNT)])


def test_an_npz_is_a_recording_with_arrays_added(tmp_path: Path, robot: Baxter) -> None:
    path = recorded(tmp_path / "a.npz", robot)
    assert len(load_recording(path).times_s) == COUNT
    arrays = np.load(path)
    assert np.array_equal(arrays["added_q_sent"], [sample(n).q_sent for n in range(COUNT)])
    assert arrays["added_is_enabled"].all()


def test_a_log_is_a_recording_with_lines_for_samples(tmp_path: Path, robot: Baxter) -> None:
    path = recorded(tmp_path / "a.jsonl", robot)
    noted = read_log(path)
    assert len(noted.recording.times_s) == COUNT
    assert noted.notes == ()
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    samples = [line["sample"] for line in lines if "sample" in line]
    assert [each["q_measured"] for each in samples] == [
        sample(number).q_measured.tolist() for number in range(COUNT)
    ]


def set_points_in(path: Path) -> int:
    """How many are in a file that was not finished, by the simplest reading of its format."""
    content = path.read_bytes()
    if path.suffix == ".jsonl":
        return content.count(b'"sample"')
    if path.suffix == ".bag":  # four messages of a tick have the names of all joints
        return content.count(b"left_w0\x07\x00\x00\x00left_w1\x07\x00\x00\x00left_w2") // 4
    count, names = 0, dict[int, str]()
    with path.open("rb") as stream, suppress(EndOfFile):
        for record in StreamReader(stream).records:
            if isinstance(record, Channel):
                names[record.id] = record.topic
            count += isinstance(record, Message) and names[record.channel_id] == COMMAND
    return count


@pytest.mark.parametrize(("suffix", "least"), [(".jsonl", 500), (".bag", 350), (".mcap", 350)])
def test_a_record_that_is_not_finished_keeps_what_came_before(
    tmp_path: Path, robot: Baxter, suffix: str, least: int
) -> None:
    """As when the process is killed: nothing is closed, and the file is read as it is."""
    path, stack = tmp_path / f"a{suffix}", ExitStack()
    tell(record_to(path, robot, stack), robot, 500)
    kept = tmp_path / f"kept{suffix}"
    kept.write_bytes(path.read_bytes())
    stack.close()
    assert least <= set_points_in(kept) <= 500


def test_a_suffix_that_nobody_knows_is_refused(tmp_path: Path, robot: Baxter) -> None:
    with ExitStack() as stack, pytest.raises(RecordingError, match=r"\.jsonl, \.mcap, \.bag"):
        record_to(tmp_path / "a.txt", robot, stack)
    assert set(SUFFIXES) == {".jsonl", ".mcap", ".bag", ".npz"}


@pytest.mark.parametrize("suffix", [".jsonl", ".bag", ".mcap"])
def test_what_cannot_be_written_is_told(tmp_path: Path, robot: Baxter, suffix: str) -> None:
    with ExitStack() as stack, pytest.raises(RecordingError, match="cannot"):
        record_to(tmp_path / "nowhere" / f"a{suffix}", robot, stack)
