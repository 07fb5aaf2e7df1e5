"""Records of executions: snapshots and events as of simulations, and what was sent and measured.

By suffix: `.jsonl` (a log with samples), `.mcap`, `.bag` (rosbags writes it) and `.npz`. All but
the last are written as it happens, so an execution that is killed keeps what had happened by then:
of a bag and of MCAP all but the last chunk, which `rosbag reindex` and `mcap recover` put in
order.

A sample is five messages: the set-point as it is sent on `/robot/limb/<limb>/joint_command`, where
the plan has the arm on `/robot/ref_joint_states`, what was measured on `/robot/joint_states`, the
robot's `/robot/state`, and on `/baxter_kin/age` how old that measurement was, in seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from baxter_kin import Baxter
from baxter_kin.display import shown_path
from baxter_kin.fields import FrozenMapping
from baxter_kin.kinematics.arm import JOINTS
from sim.errors import RecordingError
from sim.events import Event, Observer, Snapshot
from sim.recording.log_recorder import LogRecorder
from sim.recording.npz_file import save_recording
from sim.recording.recorder import Recorder
from sim.recording.ros1_files.bag_file import BagRecorder
from sim.recording.ros1_files.mcap_file import McapRecorder
from sim.recording.ros1_files.topics import MessageFile
from sim.ros1.definitions import message_type
from sim.ros1_messages import MessageType
from sim.samples import Sample, SampleObserver

_JOINT_STATE, _COMMAND = "sensor_msgs/JointState", "baxter_core_msgs/JointCommand"
_STATE, _NUMBER = "baxter_core_msgs/AssemblyState", "std_msgs/Float64"


class Told(NamedTuple):
    """One message of a record."""

    topic: str
    kind: MessageType
    content: bytes


def _messages_of(sample: Sample) -> Iterator[Told]:
    """What a record tells of a sample."""
    names = [f"{sample.limb}_{joint}" for joint in JOINTS]
    header = {"stamp": sample.time_s}
    yield _told(
        f"/robot/limb/{sample.limb}/joint_command",
        _COMMAND,
        mode=1,
        command=sample.q_sent,
        names=names,
    )
    joints = {"header": header, "name": names}
    yield _told("/robot/ref_joint_states", _JOINT_STATE, **joints, position=sample.q_path)
    yield _told(
        "/robot/joint_states",
        _JOINT_STATE,
        **joints,
        position=sample.q_measured,
        velocity=sample.v_measured,
    )
    yield _told(
        "/robot/state",
        _STATE,
        ready=True,
        enabled=sample.is_enabled,
        stopped=sample.is_stopped,
        error=sample.has_error,
    )
    yield _told("/baxter_kin/age", _NUMBER, data=sample.age_s)


def _told(topic: str, type_name: str, **values: Any) -> Told:
    kind = message_type(type_name)
    return Told(topic, kind, kind.serialise(kind.make(**values)))


class _ExecutionLog(LogRecorder, SampleObserver):
    """The log, with a line for each sample."""

    def on_sample(self, sample: Sample) -> None:
        """Write it."""
        arrays = {name: getattr(sample, name).tolist() for name in _ARRAYS}
        plain = {name: getattr(sample, name) for name in _PLAIN}
        self._write({"sample": {"limb": sample.limb, **plain, **arrays}})


class _ExecutionMcap(McapRecorder, SampleObserver):
    """MCAP, with what was sent and measured."""

    def on_sample(self, sample: Sample) -> None:
        """Write it."""
        _write(self, sample)


class _ExecutionBag(BagRecorder, SampleObserver):
    """A bag of ROS 1, with what was sent and measured."""

    def on_sample(self, sample: Sample) -> None:
        """Write it."""
        _write(self, sample)


def _write(file: MessageFile, sample: Sample) -> None:
    for told in _messages_of(sample):
        file.write_message(told.topic, told.kind, sample.time_s, told.content)


class _ExecutionArrays(SampleObserver):
    """Keeps all in memory, for an npz file; use `save` at the end."""

    def __init__(self, robot: Baxter) -> None:
        self._recorder, self._samples = Recorder(robot), list[Sample]()

    def on_snapshot(self, snapshot: Snapshot) -> None:
        """Keep it."""
        self._recorder.on_snapshot(snapshot)

    def on_event(self, event: Event) -> None:
        """Keep it."""
        self._recorder.on_event(event)

    def on_sample(self, sample: Sample) -> None:
        """Keep it."""
        self._recorder.on_sample(sample)
        self._samples.append(sample)

    def save(self, path: Path) -> None:
        """Write a recording with the samples as added arrays; nothing where nothing happened."""
        if self._recorder.has_snapshots:
            samples = self._samples
            added = {
                name: np.array([getattr(s, name) for s in samples]) for name in _PLAIN + _ARRAYS
            }
            save_recording(self._recorder.recording(), path, added=added)


_PLAIN = ("time_s", "age_s", "lateness_s", "is_enabled", "is_stopped", "has_error")
_ARRAYS = ("q_path", "q_sent", "q_measured", "v_measured")


def record_to(path: Path, robot: Baxter, stack: ExitStack) -> Observer:
    """What records to a file, in the format of its suffix; the stack finishes it."""
    if path.suffix not in SUFFIXES:
        raise RecordingError(f"{shown_path(path)} ends in none of {', '.join(SUFFIXES)}")
    return _MAKERS[path.suffix](path, robot, stack)


def _arrays(path: Path, robot: Baxter, stack: ExitStack) -> Observer:
    arrays = _ExecutionArrays(robot)
    stack.callback(arrays.save, path)
    return arrays


def _streamed(make: Callable[[Path, Baxter], Any]) -> Callable[[Path, Baxter, ExitStack], Observer]:
    def made(path: Path, robot: Baxter, stack: ExitStack) -> Observer:
        recorder: Any = make(path, robot)
        stack.callback(recorder.close)
        return recorder  # type: ignore[no-any-return]

    return made


_MAKERS: Mapping[str, Callable[[Path, Baxter, ExitStack], Observer]] = FrozenMapping(
    {
        ".jsonl": _streamed(_ExecutionLog),
        ".mcap": _streamed(_ExecutionMcap),
        ".bag": _streamed(_ExecutionBag),
        ".npz": _arrays,
    }
)
SUFFIXES = tuple(_MAKERS)
