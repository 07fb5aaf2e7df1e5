"""The three topics of a recording, as a stream of ROS 1 messages.

Stamped with simulated time from 0:

- `/joint_states`, sensor_msgs/JointState: all 19 joints at every snapshot. An arm's velocity within
  a move is that of its exact trajectory; others are differences from the snapshot before. Efforts
  are empty: nothing is known of forces.
- `/tf`, tf2_msgs/TFMessage: the pose of every body, seen from `base`.
- `/events`, std_msgs/String: what happened, as "kind: text".

Grippers are told by the joints of their fingers, and captions not at all.
"""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from baxter_kin.fields import NotCopied
from baxter_kin.files import PathLike
from baxter_kin.frames import Frame
from baxter_kin.validation import FloatArray, expect
from sim.errors import RecordingError
from sim.events import Event, Observer, Snapshot
from sim.files import Output
from sim.recording.recorded_motion import RecordedMove, recorded_move
from sim.recording.recorder import pose_row
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
from sim.ros1_messages import MessageType

STATES, POSES, EVENTS = "/joint_states", "/tf", "/events"

TOPICS = {STATES: JOINT_STATE, POSES: TRANSFORMS, EVENTS: TEXT}
"""The types of messages, by topic."""


class MessageFile(NotCopied, Observer):
    """A file of these topics while it is being written; what kind of file, subclasses know."""

    def __init__(self, path: PathLike, joint_names: tuple[str, ...]) -> None:
        """Open the file, in place of an older one."""
        message_type(TEXT)  # what is missing is said before there is a file
        self._names = joint_names
        self._velocities = _Velocities(joint_names)
        self._number = 0
        self._others: set[str] = set()
        self._output = Output(path)

    def on_snapshot(self, snapshot: Snapshot) -> None:
        """Write joints and bodies."""
        expect(snapshot, Snapshot, "snapshot", RecordingError)
        time_ns = nanoseconds(snapshot.time_s)
        velocity = self._velocities.at(snapshot.time_s, snapshot.q)
        poses = {name: pose_row(T) for name, T in snapshot.T_base_bodies.items()}
        number = self._number
        self._write(
            STATES, time_ns, joint_state(number, time_ns, self._names, snapshot.q, velocity)
        )
        self._write(POSES, time_ns, transforms(number, time_ns, Frame.BASE.value, poses))
        self._number += 1

    def on_event(self, event: Event) -> None:
        """Write it."""
        expect(event, Event, "event", RecordingError)
        move = recorded_move(event)
        if move is not None:
            self._velocities.begin(move)
        told = text(f"{event.kind.value}: {event.text}")
        self._write(EVENTS, nanoseconds(event.time_s), told)

    def close(self) -> None:
        """Write what is left and the index, and close; twice is no trouble."""
        if not self._output.is_closed:
            with self._output.writing():
                self._finish()
            self._output.close()

    def write_message(self, topic: str, kind: MessageType, time_s: float, data: bytes) -> None:
        """Write a message of any other topic, as of what was sent to a robot."""
        expect(topic, str, "topic", RecordingError)
        expect(kind, MessageType, "kind", RecordingError)
        expect(data, bytes, "data", RecordingError)
        time_ns = nanoseconds(time_s)
        if topic not in self._others:
            with self._output.writing() as stream:
                if stream.closed:
                    raise ValueError("write to closed file")
                self._open(topic, kind)
            self._others.add(topic)
        self._write(topic, time_ns, data)

    @abstractmethod
    def _open(self, topic: str, kind: MessageType) -> None:
        """Say what type the messages of a topic are of."""

    @abstractmethod
    def _write(self, topic: str, time_ns: int, data: bytes) -> None:
        """Write one message."""

    @abstractmethod
    def _finish(self) -> None:
        """Write what a complete file ends with."""

    def _facts(self) -> tuple[str, ...]:
        return self._output._facts()


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
