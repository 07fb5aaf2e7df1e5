"""Bags and MCAP files as a real Baxter's recorder makes them, written by the libraries alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Reader, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from baxter_kin import Baxter
from sim.errors import RecordingError
from sim.recording import NotedRecording

JOINTS = ("s0", "s1", "e0", "e1", "w0", "w1", "w2")
ARMS = tuple(f"{side}_{joint}" for side in ("left", "right") for joint in JOINTS)
EPOCH_S = 1_469_000_000
"""Some day of 2016."""

NEUTRAL = dict(zip(ARMS, 2 * (0.0, -0.55, 0.0, 0.75, 0.0, 1.26, 0.0), strict=True))
FINGERS = ("l_gripper_l_finger_joint", "l_gripper_r_finger_joint")

JOINT_STATE, GRIPPER_STATE = "sensor_msgs/msg/JointState", "baxter_core_msgs/msg/EndEffectorState"
JOINT_COMMAND = "baxter_core_msgs/msg/JointCommand"

GRIPPER_TEXT = """
uint8 STATE_FALSE=0
uint8 STATE_TRUE=1
uint8 STATE_UNKNOWN=2
float32 POSITION_CLOSED=0.0
float32 POSITION_OPEN=100.0
float32 FORCE_MIN=0.0
float32 FORCE_MAX=100.0
time timestamp
uint32 id
uint8 enabled
uint8 calibrated
uint8 ready
uint8 moving
uint8 gripping
uint8 missed
uint8 error
uint8 reverse
float32 position
float32 force
string state
string command
string command_sender
uint32 command_sequence
"""

STORE = get_typestore(Stores.ROS1_NOETIC)
STORE.register(get_types_from_msg(GRIPPER_TEXT, GRIPPER_STATE))
STORE.register(get_types_from_msg("int32 mode\nfloat64[] command\nstring[] names\n", JOINT_COMMAND))


class Sent(NamedTuple):
    """A message: when it was recorded, where, of which type, and serialised."""

    time_ns: int
    topic: str
    kind: str
    data: bytes


def failure_of(read: Callable[[Path, Baxter], NotedRecording], path: Path, robot: Baxter) -> str:
    """Why a file is not read; empty when it is."""
    return tried(read, path, robot)[0]


def tried(
    read: Callable[[Path, Baxter], NotedRecording], path: Path, robot: Baxter
) -> tuple[str, NotedRecording | None]:
    """Why a file is not read, or what is read."""
    try:
        return "", read(path, robot)
    except RecordingError as error:
        return str(error), None


def state(
    time_s: float,
    positions: Mapping[str, float],
    *,
    topic: str = "/robot/joint_states",
    stamp_s: float | None = None,
) -> Sent:
    """A joint state; its stamp is when it was recorded unless said otherwise."""
    stamp_ns = round(1e9 * (time_s if stamp_s is None else stamp_s))
    types = STORE.types
    stamp = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 1_000_000_000))
    header = types["std_msgs/msg/Header"](seq=0, stamp=stamp, frame_id="")
    values = np.array(list(positions.values()), dtype=np.float64)
    message = types[JOINT_STATE](header, list(positions), values, 0.0 * values, 0.0 * values)
    data = bytes(STORE.serialize_ros1(message, JOINT_STATE))
    return Sent(round(1e9 * time_s), topic, JOINT_STATE, data)


def gripper(time_s: float, side: str, percent: float) -> Sent:
    """A gripper's state."""
    types, stamp_ns = STORE.types, round(1e9 * time_s)
    stamp = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 1_000_000_000))
    flags: Sequence[Any] = (65538, 1, 1, 1, 0, 0, 0, 0, 0)
    message = types[GRIPPER_STATE](stamp, *flags, percent, 0.0, "", "go", "", 1)
    data = bytes(STORE.serialize_ros1(message, GRIPPER_STATE))
    return Sent(stamp_ns, f"/robot/end_effector/{side}_gripper/state", GRIPPER_STATE, data)


def of_baxter(seconds: float = 1.0, start_s: float = EPOCH_S) -> list[Sent]:
    """Joints at 100 Hz, fingers at 38 Hz, as a real Baxter has them; left_s0 goes at 0.2 rad/s."""
    sent = [
        state(start_s + 0.01 * i, {"head_pan": 0.1, **NEUTRAL, "left_s0": 0.002 * i, "torso_t0": 0})
        for i in range(round(100 * seconds))
    ]
    sent += [
        state(start_s + 0.004 + i / 38.0, {FINGERS[0]: 0.01, FINGERS[1]: -0.01})
        for i in range(round(38 * seconds))
    ]
    return sorted(sent)


def write_bag(path: Path, sent: Iterable[Sent], compression: str = "none") -> Path:
    """A bag of format 2.0."""
    path.unlink(missing_ok=True)
    writer = Writer(path)
    if compression != "none":
        writer.set_compression(Writer.CompressionFormat[compression.upper()])
    with writer:
        connections: dict[tuple[str, str], Any] = {}
        for message in sent:
            key = message.topic, message.kind
            if key not in connections:
                connections[key] = writer.add_connection(*key, typestore=STORE)
            writer.write(connections[key], message.time_ns, message.data)
    return path


def commands(path: Path) -> list[Any]:
    """The set-points in a bag."""
    with Reader(path) as reader:
        wanted = [each for each in reader.connections if each.msgtype == JOINT_COMMAND]
        return [
            STORE.deserialize_ros1(data, JOINT_COMMAND) for _, _, data in reader.messages(wanted)
        ]


def write_mcap(path: Path, sent: Iterable[Sent], compression: str = "none") -> Path:
    """An MCAP file of profile ros1, as `mcap convert` makes it of a bag."""
    with path.open("wb") as stream:
        writer = McapWriter(stream, compression=CompressionType[compression.upper()])
        writer.start(profile="ros1")
        channels: dict[tuple[str, str], int] = {}
        for message in sent:
            key = message.topic, message.kind
            if key not in channels:
                text = STORE.generate_msgdef(message.kind)[0].encode()
                name = message.kind.replace("/msg/", "/")
                schema = writer.register_schema(name, "ros1msg", b"# as published\n" + text)
                channels[key] = writer.register_channel(message.topic, "ros1", schema)
            writer.add_message(channels[key], message.time_ns, message.data, message.time_ns)
        writer.finish()  # type: ignore[no-untyped-call]  # of the library
    return path
