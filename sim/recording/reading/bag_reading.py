"""Bags of ROS 1, read (rosbags' reader enters here).

Only messages of types that are known here are read, which their md5 sums say; no code is made of
the definitions that a bag holds, so a hostile one cannot bring any.
"""

from __future__ import annotations

import bz2
import struct
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from baxter_kin import Baxter
from baxter_kin.display import quoted, shown_path
from baxter_kin.files import PathLike
from baxter_kin.validation import expect
from sim.errors import RecordingError
from sim.files import checked_path, explained, opened
from sim.recording.reading.joint_merging import merged_recording
from sim.recording.reading.joint_messages import READ, JointMessages, Told
from sim.recording.recording import NotedRecording
from sim.recording.ros1_files.messages import message_type

if TYPE_CHECKING:  # an extra
    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Reader

LARGEST_CHUNK_BYTES = 256 * 2**20
"""Unpacked; rosbag makes chunks of 0.75 MB."""

_DAMAGE = (
    *(ValueError, KeyError, IndexError, EOFError, RuntimeError, AssertionError, struct.error),
    *(OverflowError, MemoryError, OSError),
)
"""What damage leads to in the library, besides its own error."""


def read_bag(path: PathLike, robot: Baxter, *, topic: str | None = None) -> NotedRecording:
    """The joints of a Baxter in a bag, as a recording.

    What `sim.recording.reading.joint_merging` makes of it is as what a CSV file gives: kept with a
    note are one arm without the other, grippers that are missing, gaps, and joints slightly
    outside their limits. Times are those of the messages' stamps, and of the bag where there are
    none; where they count from 1970, the recording begins at zero. Bodies are not read.

    Args:
        path: the file, of format 2.0, compressed or not.
        robot: the robot it was recorded on, whose limits count.
        topic: where the joints were published; found when not given.

    Raises:
        RecordingError: when the package `rosbags` is missing, the file cannot be read, is no bag,
            not indexed or damaged, has no joints of a Baxter's arm, or has them on several topics;
            or when the numbers cannot be of a Baxter's joints.
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
                yield Told(connection.topic, kinds[connection.id], time_ns, data)
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
    """Unpack no chunk to more than `LARGEST_CHUNK_BYTES`, whatever it claims."""
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
    content: bytes = unpacker.decompress(data, max_length=LARGEST_CHUNK_BYTES)
    if not unpacker.eof:
        most = LARGEST_CHUNK_BYTES >> 20
        raise ValueError(f"a chunk is cut off, or unpacks to more than {most} MB")
    return content
