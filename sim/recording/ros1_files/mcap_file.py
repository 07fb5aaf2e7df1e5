"""MCAP: recordings for Foxglove and the tools of ROS (the package `mcap` enters here).

The file has the profile "ros1" and three topics, stamped with simulated time from 0:

- `/joint_states`, sensor_msgs/JointState: all 19 joints at every snapshot. An arm's velocity within
  a move is that of its exact trajectory; others are differences from the snapshot before. Efforts
  are empty: nothing is known of forces.
- `/tf`, tf2_msgs/TFMessage: the pose of every body, seen from `base`.
- `/events`, std_msgs/String: what happened, as "kind: text".

With Baxter's URDF as a layer, Foxglove's 3D panel shows the robot from `/joint_states`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from baxter_kin import Baxter
from baxter_kin.errors import expect
from baxter_kin.files import PathLike
from baxter_kin.frames import Frame
from baxter_kin.validation import FloatArray
from baxter_kin.value_objects import NotCopied
from sim.errors import RecordingError
from sim.events import Event, Observer, Snapshot
from sim.files import Output
from sim.recording.playback import retell
from sim.recording.recorded_motion import RecordedMove, recorded_move
from sim.recording.recorder import pose_row
from sim.recording.recording import Recording
from sim.recording.ros1_files.messages import (
    JOINT_STATE,
    TEXT,
    TRANSFORMS,
    joint_state,
    message_type,
    nanoseconds,
    text,
    transforms,
)

if TYPE_CHECKING:  # an extra
    from mcap.writer import Writer

CHUNK_BYTES = 65_536
"""A chunk is written when it has so many bytes: 0.6 s at 100 Hz. Smaller ones compress less."""

TOPICS = {"/joint_states": JOINT_STATE, "/tf": TRANSFORMS, "/events": TEXT}


class McapFile(NotCopied, Observer):
    """An MCAP file while it is being written."""

    def __init__(self, path: PathLike, joint_names: tuple[str, ...]) -> None:
        """Open the file, in place of an older one.

        Raises:
            RecordingError: when the package `mcap` or `rosbags` is missing, or the file cannot be
                written.
        """
        make_writer = _writer_class()
        message_type(TEXT)  # what is missing is said before there is a file
        self._names = joint_names
        self._velocities = _Velocities(joint_names)
        self._number = 0
        self._output = Output(path)
        with self._output.writing() as stream:
            self._writer = make_writer(stream, chunk_size=CHUNK_BYTES)
            self._writer.start(profile="ros1")
            self._channels = {topic: self._channel(topic) for topic in TOPICS}

    def on_snapshot(self, snapshot: Snapshot) -> None:
        """Write joints and bodies.

        Raises:
            RecordingError: when it is no snapshot, or the file cannot be written; it is closed
                then.
        """
        expect(snapshot, Snapshot, "snapshot", RecordingError)
        time_ns = nanoseconds(snapshot.time_s)
        velocity = self._velocities.at(snapshot.time_s, snapshot.q)
        poses = {name: pose_row(T) for name, T in snapshot.T_base_bodies.items()}
        number = self._number
        state = joint_state(number, time_ns, self._names, snapshot.q, velocity)
        self._write("/joint_states", time_ns, state)
        self._write("/tf", time_ns, transforms(number, time_ns, Frame.BASE.value, poses))
        self._number += 1

    def on_event(self, event: Event) -> None:
        """Write it.

        Raises:
            RecordingError: when it is no event, or the file cannot be written; it is closed then.
        """
        expect(event, Event, "event", RecordingError)
        move = recorded_move(event)
        if move is not None:
            self._velocities.begin(move)
        told = text(f"{event.kind.value}: {event.text}")
        self._write("/events", nanoseconds(event.time_s), told)

    def close(self) -> None:
        """Write what is left and the index, and close; twice is no trouble.

        Raises:
            RecordingError: when the file cannot be written.
        """
        if not self._output.is_closed:
            with self._output.writing():
                self._writer.finish()  # type: ignore[no-untyped-call]  # of the library
            self._output.close()

    def _facts(self) -> tuple[str, ...]:
        return self._output._facts()

    def _channel(self, topic: str) -> int:
        kind = message_type(TOPICS[topic])
        schema = self._writer.register_schema(kind.name, "ros1msg", kind.definition.encode())
        return self._writer.register_channel(topic, "ros1", schema)

    def _write(self, topic: str, time_ns: int, data: bytes) -> None:
        with self._output.writing() as stream:
            self._writer.add_message(self._channels[topic], time_ns, data, time_ns, self._number)
            stream.flush()  # a chunk that is complete reaches the system at once


class McapRecorder(McapFile):
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
    file = McapFile(path, names)
    try:
        retell(recording, file)
    finally:
        file.close()


class _Velocities:
    """What the joints do, as far as it is known while the simulation runs."""

    def __init__(self, joint_names: tuple[str, ...]) -> None:
        self._names = joint_names
        self._moves: dict[str, RecordedMove] = {}
        self._last: tuple[float, FloatArray] | None = None

    def begin(self, move: RecordedMove) -> None:
        """From now on that arm follows this move, if its joints are recorded."""
        if set(move.joint_names) <= set(self._names):
            self._moves[move.limb] = move

    def at(self, time_s: float, q: FloatArray) -> FloatArray:
        """Velocities, shape (n,), rad/s and m/s."""
        velocity = np.zeros_like(q)
        if self._last is not None and time_s > self._last[0]:
            velocity = (q - self._last[1]) / (time_s - self._last[0])
        self._last = time_s, q
        for move in self._moves.values():
            if move.start_s <= time_s <= move.end_s:
                where = [self._names.index(name) for name in move.joint_names]
                t = min(time_s - move.start_s, move.trajectory.duration)
                velocity[where] = move.trajectory.sample(t).v
        return velocity


def _writer_class() -> type[Writer]:
    try:
        from mcap.writer import Writer  # noqa: PLC0415 - an extra
    except ImportError:
        raise RecordingError(
            "MCAP files need the package mcap; run: pip install 'baxter-kin[mcap]'"
        ) from None
    return Writer
