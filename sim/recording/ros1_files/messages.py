"""The three ROS 1 messages of a recording, and a gripper's, which is read."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

from baxter_kin.validation import FloatArray, finite_scalar
from sim.errors import RecordingError, RosError
from sim.ros1_messages import MessageType, MessageTypes

NANOSECONDS = 1_000_000_000

LATEST_S = 2**32 - 1
"""A stamp's seconds are a uint32."""

JOINT_STATE = "sensor_msgs/JointState"
TRANSFORMS = "tf2_msgs/TFMessage"
TEXT = "std_msgs/String"

GRIPPER_STATE = "baxter_core_msgs/EndEffectorState"

GRIPPER_FIELDS = """
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
"""Rethink's; the bags of real robots have it."""

_TYPES = MessageTypes({GRIPPER_STATE: GRIPPER_FIELDS})


def message_type(name: str) -> MessageType:
    """One of ROS 1's standard types, or `GRIPPER_STATE`."""
    try:
        return _TYPES.message(name)
    except RosError as cause:
        raise RecordingError(str(cause)) from cause


def nanoseconds(time_s: float) -> int:
    """A time as ROS keeps it."""
    time_s = finite_scalar(time_s, "time_s", RecordingError)
    if not 0.0 <= time_s < LATEST_S:
        raise RecordingError(f"ROS 1 has times from 0 to {LATEST_S} s, got {time_s:g} s")
    return round(time_s * NANOSECONDS)


def joint_state(
    number: int, time_ns: int, names: tuple[str, ...], position: FloatArray, velocity: FloatArray
) -> bytes:
    """A `JOINT_STATE`: rad and rad/s, or m and m/s; it says nothing of efforts."""
    kind = message_type(JOINT_STATE)
    header = _header(number, time_ns, "")
    shown = _showable_names(names)
    state = kind.make(header=header, name=shown, position=position, velocity=velocity)
    return kind.serialise(state)


def transforms(number: int, time_ns: int, parent: str, poses: Mapping[str, list[float]]) -> bytes:
    """A `TRANSFORMS`: for each child frame x, y, z, quaternion x, y, z, w, seen from its parent."""
    kind = message_type(TRANSFORMS)
    header = _header(number, time_ns, parent)
    items = [
        {"header": header, "child_frame_id": _showable(child), "transform": _transform(row)}
        for child, row in poses.items()
    ]
    return kind.serialise(kind.make(transforms=items))


def text(data: str) -> bytes:
    """A `TEXT`."""
    kind = message_type(TEXT)
    return kind.serialise(kind.make(data=_showable(data)))


def _header(number: int, time_ns: int, frame: str) -> dict[str, object]:
    seconds, rest = divmod(time_ns, NANOSECONDS)
    stamp = {"sec": seconds, "nanosec": rest}
    return {"seq": number % 2**32, "stamp": stamp, "frame_id": frame}


def _transform(row: list[float]) -> dict[str, object]:
    return {
        "translation": dict(zip("xyz", row[:3], strict=True)),
        "rotation": dict(zip("xyzw", row[3:], strict=True)),
    }


@lru_cache(maxsize=8)
def _showable_names(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(map(_showable, names))


def _showable(data: str) -> str:
    """Half a surrogate pair is no UTF-8."""
    return data.encode("utf-8", "backslashreplace").decode("utf-8")
