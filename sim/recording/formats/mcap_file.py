"""MCAP: recordings in files that keep everything to the bit (the package `mcap` enters here).

The messages are JSON with schemas that Foxglove knows or can read; floats are written by `repr`,
the shortest text that reads back as the same number. Topics:

| topic | schema | what |
|---|---|---|
| `/tf` | `foxglove.FrameTransforms` | poses of all bodies at a snapshot, seen from base |
| `/joint_states` | `foxglove.JointStates` | all joints then; also `time_s`, `gripper_percent` |
| `/start` | `baxter_kin.Start` | joints, poses and attachments before the first snapshot |
| `/bodies` | `baxter_kin.Body` | shapes of a body, before it appears |
| `/captions` | `baxter_kin.Caption` | what is going on, where it changes |
| `/events` | `baxter_kin.Event` | what happened, with its details and the planned move |
| `/moves` | `baxter_kin.Move` | label, exact trajectory, IK result and contacts of a move |
| `/samples` | `baxter_kin.Sample` | what a robot was sent and measured (`sim.events.Sample`) |

Times of messages are whole nanoseconds, and `time_s` is exact. A metadata record named `FORMAT` has
version, joint names, recorded limbs and the robot's identity. Chunks reach the system when they are
full, after `MAX_UNWRITTEN_S`, and at every event: so much is readable when the writer is killed.

MCAP files with messages of ROS 1 (profile "ros1", as `mcap convert` makes them of bags, and as
earlier versions wrote them) are read as bags are.
"""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
import pinocchio as pin
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import Writer
from zstandard import ZstdError

from baxter_kin import Baxter
from baxter_kin.description import RobotIdentity
from baxter_kin.display import quoted, shown_path
from baxter_kin.fields import evolve
from baxter_kin.files import PathLike
from baxter_kin.files.json_data import from_json, shown, to_json
from baxter_kin.files.json_text import Json, as_text, from_text
from baxter_kin.frames import Frame
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray, finite_array
from planner import Body, Move, Scene, State
from planner.scene.bodies import Attachment
from sim.errors import RecordingError
from sim.events import Detail, Event, EventKind
from sim.files import Output, opened
from sim.recording.formats.joint_states import (
    NANOSECONDS,
    READ,
    JointMessages,
    RecordedMessage,
    merged_recording,
    message_type,
)
from sim.recording.recorded_motion import RecordedMove
from sim.recording.recorder import RecordFile, RecordingBuilder
from sim.recording.recording import (
    Caption,
    Entry,
    NotedRecording,
    RecordedSample,
    Recording,
    Row,
    entries_of,
)

FORMAT, VERSION = "baxter-kin recording", "1"

CHUNK_BYTES = 2**16
"""Uncompressed size from which on a chunk is written: half a second at 100 Hz."""

MAX_UNWRITTEN_S = 0.5
"""Wall time after which a chunk is written even if it is small."""

MAX_CHUNK_BYTES = 256 * 2**20
"""Largest chunk that is read, unpacked; other writers make chunks of 1 MB."""

MAX_TIME_NS = 2**63 - 1

ROS1_ENCODING = "ros1"

_CUT_SHORT = (EndOfFile, struct.error)
_DAMAGE = (
    *(McapError, ZstdError, ValueError, KeyError, IndexError, EOFError, RuntimeError),
    *(AssertionError, struct.error, OverflowError, MemoryError, TypeError),
)
"""Exceptions to which damage leads in the library."""


@dataclass(frozen=True, slots=True, eq=False)
class StoredState:
    """A `State` whose bodies have the shapes that were recorded before, except for `others`."""

    joints: Mapping[str, float]
    T_base_bodies: Mapping[str, pin.SE3]
    attachments: tuple[Attachment, ...] = ()
    others: tuple[Body, ...] = ()

    @classmethod
    def of(cls, state: State, bodies: Mapping[str, Body]) -> StoredState:
        """Store a state."""
        poses = {body.name: body.T_base_body for body in state.scene}
        others = (body for body in state.scene if not _is_same(body, bodies.get(body.name)))
        return cls(state.joints, poses, state.attachments, tuple(others))

    def original(self, bodies: Mapping[str, Body]) -> State:
        """The state, with bodies of these shapes."""
        known = {**bodies, **{body.name: body for body in self.others}}
        missing = [name for name in self.T_base_bodies if name not in known]
        if missing:
            raise RecordingError(f"a state has {shown(missing)}, whose shapes are missing")
        scene = Scene({name: known[name].at(T) for name, T in self.T_base_bodies.items()})
        return State(scene, self.joints, self.attachments)


@dataclass(frozen=True, slots=True, eq=False)
class StoredEvent:
    """An `Event` as files have it; those of earlier versions have its first five values only.

    Its body has the shapes that were recorded before, at `T_base_body`, unless it is `other`.
    """

    time_s: float
    kind: EventKind
    text: str
    body: str | None = None
    side: str | None = None
    T_base_body: pin.SE3 | None = None
    other: Body | None = None
    detail: Detail | None = None
    move: Move | None = None
    state: StoredState | None = None

    @classmethod
    def of(cls, event: Event, bodies: Mapping[str, Body]) -> StoredEvent:
        """Store an event."""
        body, move, state = event.body, event.move, None
        if move is not None and move.state is not None:
            state, move = StoredState.of(move.state, bodies), evolve(move, state=None)
        return cls(
            event.time_s,
            event.kind,
            event.text,
            None if body is None else body.name,
            event.side,
            None if body is None else body.T_base_body,
            None if body is None or _is_same(body, bodies.get(body.name)) else body,
            event.detail,
            move,
            state,
        )

    def original(self, bodies: Mapping[str, Body]) -> Event:
        """The event, with a body of these shapes."""
        body = self.other or bodies.get(self.body or "")
        if body is not None and self.T_base_body is not None:
            body = body.at(self.T_base_body)
        move = self.move
        if move is not None and self.state is not None:
            move = evolve(move, state=self.state.original(bodies))
        return Event(self.time_s, self.kind, self.text, self.side, move, body, self.detail)


def _is_same(body: Body, known: Body | None) -> bool:
    """Whether a body is another one at another pose."""
    return (
        known is not None
        and body.is_movable == known.is_movable
        and len(body.parts) == len(known.parts)
        and all(one is other for one, other in zip(body.parts, known.parts, strict=True))
    )


def _object(**properties: Json) -> dict[str, Json]:
    return {"type": "object", "properties": properties}


def _list(items: Json) -> Json:
    return {"type": "array", "items": items}


_NUMBER: Json = {"type": "number"}
_TEXT: Json = {"type": "string"}
_TEXT_OR_NULL: Json = {"type": ["string", "null"]}
_INTEGER: Json = {"type": "integer", "minimum": 0}
_TIME: Json = {**_object(sec=_INTEGER, nsec=_INTEGER), "title": "time"}
_VECTOR: Json = {**_object(x=_NUMBER, y=_NUMBER, z=_NUMBER), "title": "foxglove.Vector3"}
_QUATERNION: Json = {
    **_object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER),
    "title": "foxglove.Quaternion",
}
_TRANSFORM: Json = _object(
    timestamp=_TIME,
    parent_frame_id=_TEXT,
    child_frame_id=_TEXT,
    translation=_VECTOR,
    rotation=_QUATERNION,
)
STATES, POSES, EVENTS = "/joint_states", "/tf", "/events"
START, BODIES, CAPTIONS, MOVES, SAMPLES = "/start", "/bodies", "/captions", "/moves", "/samples"
SCHEMAS: Mapping[str, tuple[str, dict[str, Json]]] = {
    STATES: (
        "foxglove.JointStates",
        _object(
            timestamp=_TIME,
            joints=_list(_object(name=_TEXT, position=_NUMBER)),
            time_s=_NUMBER,
            gripper_percent=_list(_NUMBER),
        ),
    ),
    POSES: ("foxglove.FrameTransforms", _object(transforms=_list(_TRANSFORM))),
    START: ("baxter_kin.Start", _object()),
    BODIES: ("baxter_kin.Body", _object(name=_TEXT)),
    CAPTIONS: ("baxter_kin.Caption", _object(time_s=_NUMBER, text=_TEXT)),
    EVENTS: (
        "baxter_kin.Event",
        _object(time_s=_NUMBER, kind=_TEXT, text=_TEXT, side=_TEXT_OR_NULL, body=_TEXT_OR_NULL),
    ),
    MOVES: ("baxter_kin.Move", _object(start_s=_NUMBER, label=_TEXT)),
    SAMPLES: (
        "baxter_kin.Sample",
        _object(
            limb=_TEXT,
            time_s=_NUMBER,
            **dict.fromkeys(("q_sent", "q_measured", "q_path", "v_measured"), _list(_NUMBER)),
            **dict.fromkeys(("age_s", "lateness_s"), _NUMBER),
        ),
    ),
}
"""Name and JSON schema of the messages, by topic."""

_STORED: Mapping[str, Any] = {
    START: StoredState,
    BODIES: Body,
    CAPTIONS: Caption,
    EVENTS: StoredEvent,
    MOVES: RecordedMove,
    SAMPLES: RecordedSample,
}
"""Classes that messages are read as, by topic."""


class McapFile(RecordFile):
    """An MCAP file while it is being written."""

    def __init__(
        self,
        path: PathLike,
        joint_names: tuple[str, ...],
        robot: RobotIdentity | None,
        limbs: tuple[str, ...] = LIMBS,
        begin_s: float | None = None,
    ) -> None:
        """Open the file and write what it begins with.

        Args:
            path: the file; an older one is replaced.
            joint_names: the joints of full configurations.
            robot: the robot, if known.
            limbs: the arms that are recorded.
            begin_s: begin of a recording that is finished; None for one that is going on.
        """
        head: dict[str, Json] = {"joint_names": list(joint_names), "limbs": list(limbs)}
        head["robot"] = to_json(robot, RobotIdentity | None, "robot", RecordingError)
        texts = {name: as_text(value, RecordingError) for name, value in head.items()}
        self._names, self._bodies = joint_names, dict[str, Body]()
        self._is_live, self._time_s = begin_s is None, begin_s or 0.0
        self._count, self._written_s = 0, time.monotonic()
        self._output = Output(path)
        with self._output.writing() as stream:
            self._writer = Writer(stream, chunk_size=CHUNK_BYTES)
            self._writer.start(library="baxter-kin")
            self._writer.add_metadata(FORMAT, {"version": VERSION, **texts})
            self._channels = {topic: self._channel(topic) for topic in SCHEMAS}
            stream.flush()

    def add(self, entry: Entry) -> None:
        """Write an entry."""
        if not isinstance(entry, (Body, State)):
            self._time_s = entry.start_s if isinstance(entry, RecordedMove) else entry.time_s
        if isinstance(entry, Row):
            self._add_row(entry)
        elif isinstance(entry, RecordedSample):
            self._write(SAMPLES, _sample_data(entry))
        elif isinstance(entry, Caption):
            self._write_as(CAPTIONS, entry, Caption)
        elif isinstance(entry, Event):
            self._write_as(EVENTS, StoredEvent.of(entry, self._bodies), StoredEvent)
        elif isinstance(entry, RecordedMove):
            self._write_as(MOVES, entry, RecordedMove)
        elif isinstance(entry, State):
            self._write_as(START, StoredState.of(entry, self._bodies), StoredState)
        elif self._bodies.get(entry.name) is not entry:
            self._bodies[entry.name] = entry
            self._write_as(BODIES, entry, Body)
        is_due = time.monotonic() - self._written_s > MAX_UNWRITTEN_S
        if self._is_live and (is_due or isinstance(entry, (Event, RecordedMove))):
            with self._output.writing():
                self._writer.flush()  # type: ignore[no-untyped-call]  # of the library
            self._written_s = time.monotonic()

    def close(self) -> None:
        """Write what is left and the index, and close; a second call does nothing."""
        if not self._output.is_closed:
            with self._output.writing():
                self._writer.finish()  # type: ignore[no-untyped-call]  # of the library
            self._output.close()

    def _add_row(self, row: Row) -> None:
        seconds, nanoseconds = divmod(_nanoseconds(row.time_s), NANOSECONDS)
        stamp: Json = {"sec": seconds, "nsec": nanoseconds}
        transforms: Json = [
            {
                "timestamp": stamp,
                "parent_frame_id": Frame.BASE.value,
                "child_frame_id": name,
                "translation": dict(zip("xyz", map(float, pose[:3]), strict=True)),
                "rotation": dict(zip("xyzw", map(float, pose[3:]), strict=True)),
            }
            for name, pose in row.poses.items()
        ]
        joints: Json = [
            {"name": name, "position": x}
            for name, x in zip(self._names, row.q.tolist(), strict=True)
        ]
        percent: Json = [float(x) for x in row.gripper_percent]
        states: dict[str, Json] = {"timestamp": stamp, "joints": joints}
        self._write(POSES, {"transforms": transforms})  # first: a snapshot is there with its poses
        self._write(STATES, states | {"time_s": row.time_s, "gripper_percent": percent})

    def _channel(self, topic: str) -> int:
        name, schema = SCHEMAS[topic]
        titled = json.dumps({"title": name, **schema}).encode()
        kind = self._writer.register_schema(name, "jsonschema", titled)
        return self._writer.register_channel(topic, "json", kind)

    def _write_as(self, topic: str, value: object, kind: type) -> None:
        self._write(topic, to_json(value, kind, topic.strip("/"), RecordingError))

    def _write(self, topic: str, data: Json) -> None:
        content, time_ns = as_text(data, RecordingError).encode(), _nanoseconds(self._time_s)
        with self._output.writing() as stream:
            if stream.closed:
                raise ValueError("write to closed file")
            self._writer.add_message(
                self._channels[topic], time_ns, content, time_ns, self._count % 2**32
            )
            self._count += 1
            stream.flush()  # a complete chunk reaches the system at once

    def _facts(self) -> tuple[str, ...]:
        return self._output._facts()


def write_mcap(recording: Recording, path: PathLike) -> None:
    """Write a recording to a file; the same recording gives the same bytes."""
    head = recording.joint_names, recording.robot, recording.limbs, float(recording.times_s[0])
    file = McapFile(path, *head)
    try:
        for entry in entries_of(recording):
            file.add(entry)
    finally:
        file.close()


def _sample_data(sample: RecordedSample) -> dict[str, Json]:
    values = {name: getattr(sample, name) for name in RecordedSample.__dataclass_fields__}
    return {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in values.items()
        if value is not None
    }


def read_mcap(path: Path, robot: Baxter, topic: str | None) -> NotedRecording:
    """Read a recording from a file, up to where it was cut short.

    Args:
        path: the file, compressed or not.
        robot: the robot whose limits count for messages of ROS 1.
        topic: where joints were published, in messages of ROS 1; found if there is one topic.
    """
    notes: list[str] = []
    with opened(path) as stream:
        try:
            return _read(path, _records(stream, notes), robot, topic, notes)
        except RecordingError:
            raise
        except _DAMAGE as cause:
            raise RecordingError(
                f"{shown_path(path)} is no MCAP file, or a damaged one: "
                f"{quoted(str(cause) or type(cause).__name__)}"
            ) from cause


def _records(stream: IO[bytes], notes: list[str]) -> Iterator[McapRecord]:
    """The records of a file and of its chunks; a note where it was cut short."""
    reader = StreamReader(
        stream, emit_chunks=True, validate_crcs=True, record_size_limit=MAX_CHUNK_BYTES
    )
    try:
        for record in reader.records:
            if not isinstance(record, Chunk):
                yield record
            elif record.uncompressed_size > MAX_CHUNK_BYTES:
                raise ValueError(f"a chunk unpacks to more than {MAX_CHUNK_BYTES >> 20} MB")
            else:
                yield from breakup_chunk(record, validate_crc=True)
    except _CUT_SHORT:
        if stream.read(1) or not stream.tell():
            raise
        notes.append("the file was cut short: what follows is missing")


def _read(
    path: Path, records: Iterator[McapRecord], robot: Baxter, topic: str | None, notes: list[str]
) -> NotedRecording:
    """Read a file by what it begins with."""
    before: list[McapRecord] = []
    for record in records:
        if isinstance(record, Metadata) and record.name == FORMAT:
            return _read_own(path, record.metadata, records, notes)
        before.append(record)
        if isinstance(record, (Channel, Message)):
            break
    messages = JointMessages(path, _ros1_messages(before, records, notes))
    return merged_recording(messages, robot, topic, notes)


def _read_own(
    path: Path, head: Mapping[str, str], records: Iterator[McapRecord], notes: list[str]
) -> NotedRecording:
    """Read a file that was written here."""
    try:
        builder = _begun(head)
        topics: dict[int, str] = {}
        poses: dict[str, FloatArray] = {}
        for record in records:
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message) and topics.get(record.channel_id) in SCHEMAS:
                entry = _entry(builder, poses, topics[record.channel_id], record.data)
                if entry is not None:
                    builder.add(entry)
        notes += unknown_bodies(builder)
        recording = builder.build()
    except RecordingError as cause:
        raise RecordingError("; ".join([f"{shown_path(path)}: {cause}", *notes])) from cause
    return NotedRecording(recording, tuple(notes))


def _begun(head: Mapping[str, str]) -> RecordingBuilder:
    if head.get("version") != VERSION:
        raise RecordingError(
            f"has version {shown(head.get('version'))}; only {VERSION} is read here"
        )
    hints = {
        "joint_names": tuple[str, ...],
        "limbs": tuple[str, ...],
        "robot": RobotIdentity | None,
    }
    read = {
        name: from_json(from_text(head.get(name, ""), RecordingError), hint, name, RecordingError)
        for name, hint in hints.items()
    }
    return RecordingBuilder(read["joint_names"], read["robot"], limbs=read["limbs"])


def _entry(
    builder: RecordingBuilder, poses: dict[str, FloatArray], topic: str, content: bytes
) -> Entry | None:
    """The entry in a message; `poses` are those of the snapshot that follows."""
    if topic == POSES:
        poses.clear()
        poses.update(_poses(json.loads(content)))
        return None
    if topic == STATES:
        return _row(builder, json.loads(content), dict(poses))
    data = from_text(content, RecordingError)
    entry: Any = from_json(data, _STORED[topic], topic.strip("/"), RecordingError)
    original: Entry = entry.original(builder.bodies) if topic in (START, EVENTS) else entry
    return original


def _row(builder: RecordingBuilder, data: Any, poses: dict[str, FloatArray]) -> Row:
    """The snapshot in joint states."""
    try:
        names = tuple(joint["name"] for joint in data["joints"])
        if names != builder.joint_names:
            raise RecordingError(f"joint states are of other joints: {shown(names)}")
        q = [joint["position"] for joint in data["joints"]]
        row = [data["time_s"], *q, *data["gripper_percent"]]
        values = finite_array(row, (len(q) + 1 + len(LIMBS),), "a snapshot", RecordingError)
    except (KeyError, TypeError) as cause:
        raise RecordingError(f"has malformed joint states: {shown(data)}") from cause
    time_s = float(values[0])
    if builder.rows and time_s <= builder.rows[-1].time_s:
        raise RecordingError(
            f"has a snapshot at {time_s:g} s after one at {builder.rows[-1].time_s:g} s"
        )
    return Row(time_s, values[1 : len(q) + 1], values[len(q) + 1 :], poses)


def _poses(data: Any) -> dict[str, FloatArray]:
    """The poses of bodies in transforms."""
    try:
        rows = {
            each["child_frame_id"]: [
                *(each["translation"][axis] for axis in "xyz"),
                *(each["rotation"][axis] for axis in "xyzw"),
            ]
            for each in data["transforms"]
        }
        return {n: finite_array(row, (7,), "a pose", RecordingError) for n, row in rows.items()}
    except (KeyError, TypeError) as cause:
        raise RecordingError(f"has malformed transforms: {shown(data)}") from cause


def unknown_bodies(builder: RecordingBuilder) -> list[str]:
    """A note on bodies that have poses but no shapes."""
    posed = dict.fromkeys(name for row in builder.rows for name in row.poses)
    unknown = [name for name in posed if name not in builder.bodies]
    return [f"left out, as their shapes are not in the file: {shown(unknown)}"] if unknown else []


def _ros1_messages(
    before: list[McapRecord], records: Iterator[McapRecord], notes: list[str]
) -> Iterator[RecordedMessage]:
    schemas: dict[int, Schema] = {}
    kinds: dict[int, tuple[str, str]] = {}
    for record in (*before, *records):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel) and record.id not in kinds:
            kind = _ros1_kind(record, schemas.get(record.schema_id), notes)
            if kind is not None:
                kinds[record.id] = record.topic, kind
        elif isinstance(record, Message) and record.channel_id in kinds:
            yield RecordedMessage(*kinds[record.channel_id], record.log_time, record.data)


def _ros1_kind(channel: Channel, schema: Schema | None, notes: list[str]) -> str | None:
    """The type of a channel's messages, if they are read; a note on joint states that are not."""
    if schema is None or schema.name.replace("/msg/", "/") not in READ:
        return None
    if schema.name not in READ or channel.message_encoding != ROS1_ENCODING:
        note = (
            f"{channel.topic} is left out: its messages are {channel.message_encoding}, and only "
            "ROS 1's are read here"
        )
        notes += [] if note in notes else [note]
        return None
    own, found = message_type(schema.name).definition, schema.data.decode("utf-8", "replace")
    if _fields(own) != _fields(found):
        notes.append(f"{channel.topic} is left out: its {schema.name} has other fields")
        return None
    return schema.name


def _fields(definition: str) -> list[str]:
    """The fields of a type, as they are serialised: without comments, constants, other types."""
    own = definition.partition("\n===")[0]
    lines = (" ".join(line.partition("#")[0].split()) for line in own.splitlines())
    fields = [line for line in lines if line and "=" not in line]
    return [line.removeprefix("std_msgs/") for line in fields]


def _nanoseconds(time_s: float) -> int:
    """The time of a message; it has no negative ones."""
    return min(max(0, round(time_s * NANOSECONDS)), MAX_TIME_NS)
