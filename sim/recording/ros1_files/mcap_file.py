"""MCAP: recordings for Foxglove and the tools of ROS (the package `mcap` enters here).

The file has the profile "ros1" and the topics of `sim.recording.ros1_files.topics`. With Baxter's
URDF as a layer, Foxglove's 3D panel shows the robot from `/joint_states`.
`sim.recording.reading.mcap_reading` reads it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from baxter_kin import Baxter
from baxter_kin.distribution.extras import run_to_install_extra
from baxter_kin.files import PathLike
from baxter_kin.validation import expect
from sim.errors import RecordingError
from sim.recording.playback import retell
from sim.recording.recording import Recording
from sim.recording.ros1_files.messages import message_type, nanoseconds
from sim.recording.ros1_files.topics import TOPICS, MessageFile
from sim.ros1_messages import MessageType

if TYPE_CHECKING:  # an extra
    from mcap.writer import Writer

CHUNK_BYTES = 65_536
"""A chunk is written when it has so many bytes: 0.6 s at 100 Hz. Smaller ones compress less."""


class _McapFile(MessageFile):
    """An MCAP file while it is being written."""

    def __init__(self, path: PathLike, joint_names: tuple[str, ...]) -> None:
        """Open the file, in place of an older one."""
        make_writer = _writer_class()
        super().__init__(path, joint_names)
        with self._output.writing() as stream:
            self._writer = make_writer(stream, chunk_size=CHUNK_BYTES)
            self._writer.start(profile="ros1")
            self._channels: dict[str, int] = {}
            for topic, type_name in TOPICS.items():
                self._open(topic, message_type(type_name))

    def _open(self, topic: str, kind: MessageType) -> None:
        schema = self._writer.register_schema(kind.name, "ros1msg", kind.definition.encode())
        self._channels[topic] = self._writer.register_channel(topic, "ros1", schema)

    def _write(self, topic: str, time_ns: int, data: bytes) -> None:
        with self._output.writing() as stream:
            self._writer.add_message(self._channels[topic], time_ns, data, time_ns, self._number)
            stream.flush()  # a chunk that is complete reaches the system at once

    def _finish(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]  # of the library


class McapRecorder(_McapFile):
    """Writes MCAP while the simulation runs.

    A run that is killed leaves all but the last chunk of `CHUNK_BYTES`; `mcap recover` makes a
    whole file of it. Memory grows only by the index of the chunks.
    """

    def __init__(self, path: PathLike, robot: Baxter) -> None:
        """Open the file.

        Raises:
            RecordingError: when the package `mcap` or `rosbags` is missing, or the file cannot be
                written.
        """
        super().__init__(path, expect(robot, Baxter, "robot", RecordingError).joint_names)


def write_mcap(recording: Recording, path: PathLike) -> None:
    """Write a recording to a file.

    Raises:
        RecordingError: when the package `mcap` or `rosbags` is missing, a time is negative, or the
            file cannot be written.
    """
    names = expect(recording, Recording, "recording", RecordingError).joint_names
    nanoseconds(float(recording.times_s[0]))
    file = _McapFile(path, names)
    try:
        retell(recording, file)
    finally:
        file.close()


def _writer_class() -> type[Writer]:
    try:
        from mcap.writer import Writer  # noqa: PLC0415 - an extra
    except ImportError:
        raise RecordingError(
            f"MCAP files need the package mcap; {run_to_install_extra('mcap')}"
        ) from None
    return Writer
