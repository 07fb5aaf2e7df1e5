"""MCAP files of ROS 1's messages, read (the reader of the package `mcap` enters here).

The file is read from its beginning, so one that was cut short gives what is there.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import IO, TYPE_CHECKING

from baxter_kin import Baxter
from baxter_kin.display import quoted, shown_path
from baxter_kin.distribution.extras import run_to_install_extra
from baxter_kin.files import PathLike
from baxter_kin.validation import expect
from sim.errors import RecordingError
from sim.files import checked_path, opened
from sim.recording.reading.joint_merging import merged_recording
from sim.recording.reading.joint_messages import READ, JointMessages, Told
from sim.recording.recording import NotedRecording
from sim.recording.ros1_files.messages import message_type

if TYPE_CHECKING:  # an extra
    from mcap.records import Channel, McapRecord, Schema

LARGEST_CHUNK_BYTES = 256 * 2**20
"""Unpacked; writers make chunks of 1 MB, and ours of 64 kB."""

ENCODING, SCHEMA_ENCODING = "ros1", "ros1msg"

_DAMAGE = (
    *(ValueError, KeyError, IndexError, EOFError, RuntimeError, AssertionError, struct.error),
    *(OverflowError, MemoryError, TypeError),
)
"""What damage leads to in the library, besides its own error."""


def read_mcap(path: PathLike, robot: Baxter, *, topic: str | None = None) -> NotedRecording:
    """The joints of a Baxter in an MCAP file with messages of ROS 1, as a recording.

    What `sim.recording.reading.joint_merging` makes of it is a recording as that of a bag
    (`read_bag`). A file that was cut short gives what is there, with a note. Of a file that
    `write_mcap` wrote, joints, grippers and what happened come back; bodies do not, as their shapes
    are not in it.

    Args:
        path: the file, compressed or not.
        robot: the robot it was recorded on, whose limits count.
        topic: where the joints were published; found when not given.

    Raises:
        RecordingError: when the package `mcap` or `rosbags` is missing, the file cannot be read, is
            no MCAP file or a damaged one, has no joints of a Baxter's arm in messages of ROS 1, or
            has them on several topics; or when the numbers cannot be of a Baxter's joints.
    """
    expect(robot, Baxter, "robot", RecordingError)
    if topic is not None:
        expect(topic, str, "topic", RecordingError)
    file = checked_path(path)
    notes: list[str] = []
    messages = JointMessages(file, _told(file, notes))
    return merged_recording(messages, robot, topic, notes)


def _told(file: Path, notes: list[str]) -> Iterator[Told]:
    message_type(READ[0])  # what is missing is said before the file is read
    cut_short, damage = _library_errors()
    with opened(file) as stream:
        try:
            yield from _messages(_records(stream), notes)
        except RecordingError:
            raise
        except (*cut_short, *damage) as cause:
            is_at_end = not stream.read(1)
            if isinstance(cause, cut_short) and is_at_end and stream.tell():
                notes.append("the file was cut short: what follows is missing")
                return
            raise RecordingError(
                f"{shown_path(file)} is no MCAP file, or a damaged one: "
                f"{quoted(str(cause) or type(cause).__name__)}"
            ) from cause


def _library_errors() -> tuple[tuple[type[Exception], ...], tuple[type[Exception], ...]]:
    """What the library raises where a file is cut short, and at damage."""
    try:
        from mcap.exceptions import EndOfFile, McapError  # noqa: PLC0415 - an extra
        from zstandard import ZstdError  # noqa: PLC0415 - comes with mcap
    except ImportError:
        raise RecordingError(
            f"MCAP files need the package mcap; {run_to_install_extra('mcap')}"
        ) from None
    return (EndOfFile, struct.error), (McapError, ZstdError, *_DAMAGE)


def _records(stream: IO[bytes]) -> Iterator[McapRecord]:
    """The records of a file, those in its chunks among them."""
    from mcap.records import Chunk  # noqa: PLC0415 - an extra
    from mcap.stream_reader import StreamReader, breakup_chunk  # noqa: PLC0415 - an extra

    reader = StreamReader(
        stream, emit_chunks=True, validate_crcs=True, record_size_limit=LARGEST_CHUNK_BYTES
    )
    for record in reader.records:
        if not isinstance(record, Chunk):
            yield record
        elif record.uncompressed_size > LARGEST_CHUNK_BYTES:
            raise ValueError(f"a chunk unpacks to more than {LARGEST_CHUNK_BYTES >> 20} MB")
        else:
            yield from breakup_chunk(record, validate_crc=True)


def _messages(records: Iterator[McapRecord], notes: list[str]) -> Iterator[Told]:
    from mcap.records import Channel, Message, Schema  # noqa: PLC0415 - an extra

    schemas: dict[int, Schema] = {}
    kinds: dict[int, tuple[str, str]] = {}
    for record in records:
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            _add_channel(record, schemas.get(record.schema_id), kinds, notes)
        elif isinstance(record, Message) and record.channel_id in kinds:
            yield Told(*kinds[record.channel_id], record.log_time, record.data)


def _add_channel(
    channel: Channel, schema: Schema | None, kinds: dict[int, tuple[str, str]], notes: list[str]
) -> None:
    """Note what a channel's messages are, if they are read."""
    if schema is None or channel.id in kinds:
        return
    is_joints = schema.name.replace("/msg/", "/") in READ
    if schema.name not in READ or channel.message_encoding != ENCODING:
        if is_joints:
            told = f"{channel.topic} is left out: its messages are {channel.message_encoding}"
            notes += [] if told in notes else [f"{told}, and only ROS 1's are read here"]
        return
    own, found = message_type(schema.name).definition, schema.data.decode("utf-8", "replace")
    if _fields(own) != _fields(found):
        notes.append(f"{channel.topic} is left out: its {schema.name} has other fields")
        return
    kinds[channel.id] = channel.topic, schema.name


def _fields(definition: str) -> list[str]:
    """The fields of a type, as they are serialised: without comments, constants, other types."""
    own = definition.partition("\n===")[0]
    lines = (" ".join(line.partition("#")[0].split()) for line in own.splitlines())
    fields = [line for line in lines if line and "=" not in line]
    return [line.removeprefix("std_msgs/") for line in fields]
