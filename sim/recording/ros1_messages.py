"""The three ROS 1 messages of a recording, serialised as ROS 1 does.

Little-endian, fields in the order of the definition; text and arrays begin with their length as
uint32 (ROS wiki, "msg" and "Message serialization"). The definitions are those of common_msgs and
std_msgs, with those they are made of below them, as a bag file holds them.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from baxter_kin.validation import FloatArray
from sim.errors import RecordingError

NANOSECONDS = 1_000_000_000

LATEST_S = 2**32 - 1
"""A stamp's seconds are a uint32."""

_RULE = 80 * "="

_HEADER = f"""{_RULE}
MSG: std_msgs/Header
uint32 seq
time stamp
string frame_id
"""


@dataclass(frozen=True, slots=True)
class MessageType:
    """A type of message.

    Attributes:
        name: such as "sensor_msgs/JointState".
        definition: its fields, and those of the types it is made of.
    """

    name: str
    definition: str


JOINT_STATE = MessageType(
    "sensor_msgs/JointState",
    f"""Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{_HEADER}""",
)

TRANSFORMS = MessageType(
    "tf2_msgs/TFMessage",
    f"""geometry_msgs/TransformStamped[] transforms
{_RULE}
MSG: geometry_msgs/TransformStamped
Header header
string child_frame_id
Transform transform
{_HEADER}{_RULE}
MSG: geometry_msgs/Transform
Vector3 translation
Quaternion rotation
{_RULE}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
{_RULE}
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
""",
)

TEXT = MessageType("std_msgs/String", "string data\n")


def nanoseconds(time_s: float) -> int:
    """A time as ROS keeps it.

    Raises:
        RecordingError: when it is negative or too late for a stamp.
    """
    if not 0.0 <= time_s < LATEST_S:
        raise RecordingError(f"ROS 1 has times from 0 to {LATEST_S} s, got {time_s:g} s")
    return round(time_s * NANOSECONDS)


def joint_state(
    number: int, time_ns: int, names: tuple[str, ...], position: FloatArray, velocity: FloatArray
) -> bytes:
    """A `JOINT_STATE`: rad and rad/s, or m and m/s; it says nothing of efforts."""
    return b"".join(
        [
            _header(number, time_ns, ""),
            _texts(names),
            _floats(position),
            _floats(velocity),
            struct.pack("<I", 0),
        ]
    )


def transforms(number: int, time_ns: int, parent: str, poses: Mapping[str, list[float]]) -> bytes:
    """A `TRANSFORMS`: for each child frame x, y, z, quaternion x, y, z, w, seen from its parent."""
    items = (
        _header(number, time_ns, parent) + _text(child) + struct.pack("<7d", *row)
        for child, row in poses.items()
    )
    return struct.pack("<I", len(poses)) + b"".join(items)


def text(data: str) -> bytes:
    """A `TEXT`."""
    return _text(data)


def _header(number: int, time_ns: int, frame: str) -> bytes:
    seconds, rest = divmod(time_ns, NANOSECONDS)
    return struct.pack("<III", number % 2**32, seconds, rest) + _text(frame)


def _text(data: str) -> bytes:
    content = data.encode("utf-8", "backslashreplace")  # half a surrogate pair is no UTF-8
    return struct.pack("<I", len(content)) + content


@lru_cache(maxsize=8)
def _texts(items: tuple[str, ...]) -> bytes:
    return struct.pack("<I", len(items)) + b"".join(_text(item) for item in items)


def _floats(values: FloatArray) -> bytes:
    return struct.pack("<I", len(values)) + np.asarray(values, "<f8").tobytes()
