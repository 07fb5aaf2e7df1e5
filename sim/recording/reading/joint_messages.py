"""What ROS 1 messages in a file told of a Baxter's joints and grippers.

Read are sensor_msgs/JointState, and of grippers what the joints of their fingers say, or
baxter_core_msgs/EndEffectorState where it is there.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from baxter_kin.display import quoted, shown_path
from baxter_kin.kinematics.arm import LIMBS
from sim.errors import RecordingError, RosMessageError
from sim.recording.reading.measurement import limbs_in
from sim.recording.ros1_files.messages import (
    GRIPPER_STATE,
    JOINT_STATE,
    NANOSECONDS,
    TEXT,
    message_type,
)
from sim.recording.ros1_files.topics import EVENTS

READ = (JOINT_STATE, GRIPPER_STATE, TEXT)
"""Types of messages that are read."""

PREFERRED = ("/robot/joint_states", "/joint_states")
"""Topics of measured joints: a real Baxter's, and those of files that are written here."""


class Told(NamedTuple):
    """A message in a file.

    Attributes:
        topic: where it was published.
        kind: its type.
        time_ns: when it was recorded.
        data: as it was sent.
    """

    topic: str
    kind: str
    time_ns: int
    data: bytes


class Heard(NamedTuple):
    """A message that was read.

    Attributes:
        stamp_ns: what it says itself of its time; zero where it says nothing.
        time_ns: when it was recorded.
        names: of joints; of a gripper its side.
        values: their positions, rad or m; of a gripper its per cent.
    """

    stamp_ns: int
    time_ns: int
    names: list[str]
    values: list[float]


class JointMessages:
    """What the messages of a file told.

    Attributes:
        file: the file, as messages show it.
        states: joint states by topic.
        grippers: states of grippers.
        events: what happened, with times in ns; of files that are written here.
        not_finite: of joint states that are left out for a position that is not finite, the topic
            and when they were recorded, ns.
    """

    def __init__(self, file: object, told: Iterable[Told]) -> None:
        """Read all messages."""
        self.file = shown_path(file)
        self.states: dict[str, list[Heard]] = {}
        self.grippers: list[Heard] = []
        self.events: list[tuple[int, str]] = []
        self.not_finite: list[tuple[str, int]] = []
        for message in told:
            self._hear(message)

    def topic(self, asked: str | None) -> tuple[str, tuple[str, ...]]:
        """The topic to read, and others that have arms, too."""
        found = [topic for topic, states in self.states.items() if _has_arm(states)]
        if asked is not None and asked not in found:
            those = f"those that have: {', '.join(found)}" if found else "no topic has"
            raise RecordingError(
                f"{self.file}: {quoted(asked)} has no joint states of an arm; {those}"
            )
        if not found:
            raise RecordingError(
                f"{self.file} has no joint states (sensor_msgs/JointState) with the seven joints "
                "of a Baxter's arm, such as left_s0"
            )
        wanted = (asked,) if asked is not None else PREFERRED
        chosen = next((topic for topic in wanted if topic in found), None)
        if chosen is None and len(found) > 1:
            raise RecordingError(
                f"{self.file} has arms on several topics: {', '.join(found)}; give one as topic"
            )
        topic = chosen or found[0]
        return topic, tuple(each for each in found if each != topic)

    def _hear(self, told: Told) -> None:
        if told.kind == TEXT and told.topic != EVENTS:
            return
        try:
            self._understand(told)
        except (RosMessageError, RecordingError) as cause:
            at = f"{told.topic} at {told.time_ns / NANOSECONDS:.6f} s"
            raise RecordingError(f"{self.file}, {at}: {cause}") from cause

    def _understand(self, told: Told) -> None:
        message = message_type(told.kind).deserialise(told.data)
        if told.kind == JOINT_STATE:
            self._hear_joints(told, message)
        elif told.kind == TEXT:
            self.events.append((told.time_ns, message.data))
        else:
            self._hear_gripper(told, message)

    def _hear_joints(self, told: Told, message: Any) -> None:
        values, names = message.position, list(message.name)
        if not len(values):
            return
        if len(values) != len(names):
            raise RecordingError(f"has {len(values)} positions of {len(names)} joints")
        if not np.isfinite(values).all():
            self.not_finite.append((told.topic, told.time_ns))
            return
        heard = Heard(_ns(message.header.stamp), told.time_ns, names, values.tolist())
        self.states.setdefault(told.topic, []).append(heard)

    def _hear_gripper(self, told: Told, message: Any) -> None:
        side = next((side for side in LIMBS if side in told.topic), None)
        if side is not None and np.isfinite(message.position):
            stamp_ns, percent = _ns(message.timestamp), float(message.position)
            self.grippers.append(Heard(stamp_ns, told.time_ns, [side], [percent]))


def _has_arm(states: list[Heard]) -> bool:
    return bool(limbs_in(dict.fromkeys(name for heard in states for name in heard.names)))


def _ns(stamp: Any) -> int:
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)
