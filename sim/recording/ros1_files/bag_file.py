"""Bags of ROS 1: recordings for rosbag, rqt and PlotJuggler (rosbags' writer enters here).

The file is of format 2.0, uncompressed, with the topics of `sim.recording.ros1_files.topics`.
`sim.recording.reading.bag_reading` reads it.
"""

from __future__ import annotations

from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from baxter_kin import Baxter
from baxter_kin.files import PathLike
from baxter_kin.validation import expect
from sim.errors import RecordingError
from sim.recording.playback import retell
from sim.recording.recording import Recording
from sim.recording.ros1_files.messages import message_type, nanoseconds
from sim.recording.ros1_files.topics import TOPICS, MessageFile
from sim.ros1_messages import MessageType

if TYPE_CHECKING:  # an extra
    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Writer

CHUNK_BYTES = 65_536
"""A chunk is written when it has so many bytes: 0.6 s at 100 Hz."""

CALLER = "/baxter_kin"
"""Who published the messages, as a bag says it."""


class _BagFile(MessageFile):
    """A bag while it is being written."""

    def __init__(self, path: PathLike, joint_names: tuple[str, ...]) -> None:
        """Open the file, in place of an older one."""
        super().__init__(path, joint_names)
        with self._output.writing() as stream:
            self._writer = _writer_to(stream)
            self._forgotten = 0
            self._writer.chunk_threshold = CHUNK_BYTES
            self._writer.open()
            self._connections: dict[str, Connection] = {}
            for topic, type_name in TOPICS.items():
                self._open(topic, message_type(type_name))
            stream.flush()

    def _open(self, topic: str, kind: MessageType) -> None:
        library_name = kind.name.replace("/", "/msg/")
        self._connections[topic] = self._writer.add_connection(
            topic, library_name, msgdef=kind.definition, md5sum=kind.md5, callerid=CALLER
        )

    def _write(self, topic: str, time_ns: int, data: bytes) -> None:
        with self._output.writing() as stream:
            if stream.closed:
                raise ValueError("write to closed file")
            self._writer.write(self._connections[topic], time_ns, data)
            self._forget_written()
            stream.flush()  # a chunk that is complete reaches the system at once

    def _finish(self) -> None:
        self._writer.close()

    def _forget_written(self) -> None:
        """Keep of chunks on disk how many messages they have; the library keeps all their times."""
        while self._forgotten < len(self._writer.chunks) - 1:
            counts: dict[int, Any] = self._writer.chunks[self._forgotten].connections
            counts.update({key: range(len(items)) for key, items in counts.items()})
            self._forgotten += 1


class BagRecorder(_BagFile):
    """Writes a bag while the simulation runs.

    A run that is killed leaves all but the last chunk of `CHUNK_BYTES`, without an index; `rosbag
    reindex` makes a whole file of it. Memory grows only by the index of the chunks.
    """

    def __init__(self, path: PathLike, robot: Baxter) -> None:
        """Open the file.

        Raises:
            RecordingError: when the package `rosbags` is missing, or the file cannot be written.
        """
        super().__init__(path, expect(robot, Baxter, "robot", RecordingError).joint_names)


def write_bag(recording: Recording, path: PathLike) -> None:
    """Write a recording to a bag.

    Raises:
        RecordingError: when the package `rosbags` is missing, a time is negative, or the file
            cannot be written.
    """
    names = expect(recording, Recording, "recording", RecordingError).joint_names
    nanoseconds(float(recording.times_s[0]))
    file = _BagFile(path, names)
    try:
        retell(recording, file)
    finally:
        file.close()


class _Opened:
    """Stands for the path that the library's writer opens: a file that is open already."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream

    def open(self, _: str) -> IO[bytes]:
        return self._stream


def _writer_to(stream: IO[bytes]) -> Writer:
    from rosbags.rosbag1 import Writer  # noqa: PLC0415 - an extra

    writer = Writer(Path(f"{stream.name} is open"))
    opened: Any = _Opened(stream)
    writer.path = opened
    return writer
