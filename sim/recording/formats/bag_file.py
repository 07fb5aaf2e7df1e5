"""Bags of ROS 1, format 2.0 (the reader and the writer of `rosbags` enter here).

Written for rosbag, rqt and PlotJuggler, stamped with the recording's time:

- `/joint_states`, sensor_msgs/JointState: all joints at every snapshot, and velocities of the arms;
- `/tf`, tf2_msgs/TFMessage: the pose of every body, seen from `base`;
- `/events`, std_msgs/String: what happened, as "kind: text";
- `/robot/limb/<limb>/joint_command`, baxter_core_msgs/JointCommand, `/robot/joint_states` and
  `/robot/ref_joint_states`: what a robot was sent, what was measured, and where the plan was.

No converter does this: `rosbags-convert` reads MCAP files of ROS 2 alone.

Of a bag that is read, only messages of types that are known here count, by their md5 sums; no code
is made of the definitions that a bag holds, so a hostile one cannot bring any.
"""

from __future__ import annotations

import bz2
import struct
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from baxter_kin import Baxter
from baxter_kin.display import quoted, shown_path
from baxter_kin.frames import Frame
from baxter_kin.kinematics.arm import LIMBS, arm_joints
from baxter_kin.validation import FloatArray, finite_scalar
from sim.errors import RecordingError
from sim.events import Event
from sim.files import explained, opened, replace_file
from sim.recording.formats.joint_states import (
    EVENTS,
    JOINT_COMMAND,
    JOINT_STATE,
    NANOSECONDS,
    READ,
    TEXT,
    JointMessages,
    RecordedMessage,
    merged_recording,
    message_type,
)
from sim.recording.recorder import RecordFile, RecordingBuilder
from sim.recording.recording import (
    Entry,
    NotedRecording,
    RecordedSample,
    Recording,
    Row,
    entries_of,
)
from sim.ros1_messages import MessageType

if TYPE_CHECKING:  # an extra
    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Reader

MAX_CHUNK_BYTES = 256 * 2**20
"""Largest chunk that is read, unpacked; rosbag makes chunks of 0.75 MB."""

MAX_TIME_S = 2**32 - 1
"""A stamp's seconds are a uint32."""

TRANSFORMS = "tf2_msgs/TFMessage"
CALLER = "/baxter_kin"
"""The publisher that a bag names."""

_DAMAGE = (
    *(ValueError, KeyError, IndexError, EOFError, RuntimeError, AssertionError, struct.error),
    *(OverflowError, MemoryError, OSError),
)
"""Exceptions to which damage leads in the library, besides its own."""


class BagAtEnd(RecordFile):
    """A bag that is made of what a recorder kept, when it is closed."""

    def __init__(self, path: Path, builder: RecordingBuilder) -> None:
        """Check that `rosbags` is installed, and write nothing yet."""
        message_type(TEXT)
        self._path, self._builder = path, builder
        self._is_open = True

    def add(self, entry: Entry) -> None:
        """Leave the entry to the builder."""

    def close(self) -> None:
        """Write the bag, unless nothing was recorded; a second call does nothing."""
        if self._is_open and self._builder.rows:
            write_bag(self._builder.build(), self._path)
        self._is_open = False


def write_bag(recording: Recording, path: Path) -> None:
    """Write a recording to a bag; the same recording gives the same bytes."""
    message_type(TEXT)  # says what is missing
    from rosbags.rosbag1 import Writer  # noqa: PLC0415 - an extra

    messages = list(_messages(recording))
    with explained(f"cannot write {shown_path(path)}"), TemporaryDirectory() as folder:
        file = Path(folder) / "run.bag"
        with Writer(file) as writer:
            connections: dict[str, Connection] = {}
            for time_ns, topic, kind, data in messages:
                if topic not in connections:
                    connections[topic] = writer.add_connection(
                        topic,
                        kind.name.replace("/", "/msg/"),
                        msgdef=kind.definition,
                        md5sum=kind.md5,
                        callerid=CALLER,
                    )
                writer.write(connections[topic], time_ns, data)
        replace_file(path, file.read_bytes())


def _messages(recording: Recording) -> Iterator[tuple[int, str, MessageType, bytes]]:
    """Time in ns, topic, type and content of every message."""
    velocities = dict(zip(recording.times_s.tolist(), _velocities(recording), strict=True))
    for entry in entries_of(recording):
        if isinstance(entry, Event):
            text = f"{entry.kind.value}: {entry.text}"
            yield _message(entry.time_s, EVENTS, TEXT, data=_showable(text))
        elif isinstance(entry, Row):
            names = tuple(map(_showable, recording.joint_names))
            states = {"name": names, "position": entry.q, "velocity": velocities[entry.time_s]}
            yield _states(entry.time_s, "/joint_states", **states)
            transforms = [_transform(entry.time_s, *pose) for pose in entry.poses.items()]
            yield _message(entry.time_s, "/tf", TRANSFORMS, transforms=transforms)
        elif isinstance(entry, RecordedSample):
            yield from _sample_messages(entry)


def _sample_messages(
    sample: RecordedSample,
) -> Iterator[tuple[int, str, MessageType, bytes]]:
    time_s, names = sample.time_s, arm_joints(sample.limb)
    topic = f"/robot/limb/{sample.limb}/joint_command"
    yield _message(time_s, topic, JOINT_COMMAND, mode=1, command=sample.q_sent, names=names)
    v = () if sample.v_measured is None else sample.v_measured
    yield _states(time_s, "/robot/joint_states", name=names, position=sample.q_measured, velocity=v)
    if sample.q_path is not None:
        yield _states(time_s, "/robot/ref_joint_states", name=names, position=sample.q_path)


def _states(time_s: float, topic: str, **states: Any) -> tuple[int, str, MessageType, bytes]:
    return _message(time_s, topic, JOINT_STATE, header=_header(time_s), **states)


def _message(
    time_s: float, topic: str, type_name: str, **values: Any
) -> tuple[int, str, MessageType, bytes]:
    kind = message_type(type_name)
    return nanoseconds(time_s), topic, kind, kind.serialise(kind.make(**values))


def _velocities(recording: Recording) -> FloatArray:
    """Differences of the positions; of the arms velocities of their moves, shape (n, joints)."""
    velocities = np.zeros_like(recording.q)
    if len(recording.times_s) > 1:
        velocities[1:] = np.diff(recording.q, axis=0) / np.diff(recording.times_s)[:, None]
    for side in LIMBS:
        names = arm_joints(side)
        if set(names) <= set(recording.joint_names):
            at = [recording.joint_names.index(name) for name in names]
            velocities[:, at] = recording.motion(side).v
    return velocities


def nanoseconds(time_s: float) -> int:
    """A time as ROS has it."""
    time_s = finite_scalar(time_s, "time_s", RecordingError)
    if not 0.0 <= time_s < MAX_TIME_S:
        raise RecordingError(f"ROS 1 has times from 0 to {MAX_TIME_S} s, got {time_s:g} s")
    return round(time_s * NANOSECONDS)


def _header(time_s: float, frame: str = "") -> dict[str, object]:
    return {"stamp": nanoseconds(time_s) / NANOSECONDS, "frame_id": frame}


def _transform(time_s: float, name: str, pose: Sequence[float] | FloatArray) -> dict[str, object]:
    axes = dict(zip("xyz", pose[:3], strict=True)), dict(zip("xyzw", pose[3:], strict=True))
    return {
        "header": _header(time_s, Frame.BASE.value),
        "child_frame_id": _showable(name),
        "transform": dict(zip(("translation", "rotation"), axes, strict=True)),
    }


def _showable(text: str) -> str:
    """Half a surrogate pair is no UTF-8."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def read_bag(path: Path, robot: Baxter, topic: str | None) -> NotedRecording:
    """Read joints, grippers and events from a bag; bodies are not read.

    Args:
        path: the file, compressed or not.
        robot: the robot that it was recorded on, whose limits count.
        topic: where the joints were published; found when not given.
    """
    notes: list[str] = []
    messages = JointMessages(path, _recorded(path, notes))
    return merged_recording(messages, robot, topic, notes)


def _recorded(file: Path, notes: list[str]) -> Iterator[RecordedMessage]:
    message_type(JOINT_STATE)  # says what is missing before the file is read
    from rosbags.rosbag1 import Reader, ReaderError  # noqa: PLC0415 - an extra

    with opened(file):  # no pipe, no folder
        pass
    with explained(f"cannot read {shown_path(file)}"):
        reader = Reader(file)
    try:
        with reader:
            _bound(reader)
            known = _known(reader.connections, notes)
            kinds = {connection.id: kind for connection, kind in known}
            connections = [connection for connection, _ in known]
            for connection, time_ns, data in reader.messages(connections) if known else ():
                yield RecordedMessage(connection.topic, kinds[connection.id], time_ns, data)
    except RecordingError:
        raise
    except (ReaderError, *_DAMAGE) as cause:
        reason = str(cause) or type(cause).__name__
        hint = "; run: rosbag reindex" if "reindex" in reason else ""
        raise RecordingError(
            f"{shown_path(file)} is no bag of format 2.0, or a damaged one: {quoted(reason)}{hint}"
        ) from cause


def _known(connections: list[Connection], notes: list[str]) -> list[tuple[Connection, str]]:
    """Those whose messages are read, with their types; a note on types of another definition."""
    found, other = [], set()
    for connection in connections:
        name = connection.msgtype.replace("/msg/", "/")
        if name in READ and connection.digest == message_type(name).md5:
            found.append((connection, name))
        elif name in READ:
            other.add(connection.topic)
    if other:
        notes.append(f"left out, as their types have another md5 sum: {', '.join(sorted(other))}")
    return found


def _bound(reader: Reader) -> None:
    """Unpack no chunk to more than `MAX_CHUNK_BYTES`, whatever it claims."""
    from lz4.frame import (  # type: ignore[import-untyped]  # noqa: PLC0415 - comes with rosbags
        LZ4FrameDecompressor,
    )
    from rosbags.rosbag1.reader import decompressors  # noqa: PLC0415 - an extra

    makers = {decompressors["bz2"]: bz2.BZ2Decompressor, decompressors["lz4"]: LZ4FrameDecompressor}
    for position, chunk in reader.chunks.items():
        make = makers.get(chunk.decompressor)
        if make is not None:
            reader.chunks[position] = chunk._replace(decompressor=partial(_unpacked, make))


def _unpacked(make: Callable[[], Any], data: bytes) -> bytes:
    unpacker = make()
    content: bytes = unpacker.decompress(data, max_length=MAX_CHUNK_BYTES)
    if not unpacker.eof:
        raise ValueError(f"a chunk is cut off, or unpacks to more than {MAX_CHUNK_BYTES >> 20} MB")
    return content
