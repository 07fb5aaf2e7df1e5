"""Joints that a robot reported, as a recording: from ROS 1 messages or the rows of a table.

Of ROS 1, sensor_msgs/JointState is read, and of grippers the joints of their fingers, or
baxter_core_msgs/EndEffectorState where it is present. A real Baxter has two publishers on one
topic: all joints at 100 Hz, and the fingers at 38 Hz. So a message counts for the joints that it
names, and each joint keeps its last value until it is named again. A snapshot stands at every time
at which a joint of an arm was named, once all of them have been.

Messages are taken in the order in which they were recorded. One whose stamp is not later than that
of the previous message of the same joints is left out with a note: the clock of a simulation that
was restarted begins again, and its second run must not be mixed into the first.

Files of real robots have less than a simulation: one arm alone, or no grippers. What is missing
stands still in the recording, with a note. Numbers that cannot be joints of a Baxter are refused.
Some public files have the end point's pose under the joints' names: x, y, z and a quaternion. Their
numbers are mostly within the joints' limits, but they wrap and change sign as no joint does, and
the quaternion has length one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from baxter_kin import Baxter
from baxter_kin.description.hands import finger_joints
from baxter_kin.display import count, quoted, shown_path
from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import JOINTS, LIMBS, MAX_SPEED_RAD_S, arm_joints
from baxter_kin.validation import FloatArray
from sim.errors import RecordingError, RosError, RosMessageError
from sim.events import Event, EventKind
from sim.recording.recording import NotedRecording, Recording
from sim.ros1_messages import MessageType, MessageTypes

NANOSECONDS = 1_000_000_000

JOINT_STATE, TEXT = "sensor_msgs/JointState", "std_msgs/String"
GRIPPER_STATE, JOINT_COMMAND = "baxter_core_msgs/EndEffectorState", "baxter_core_msgs/JointCommand"
ROBOT_MESSAGES = {
    GRIPPER_STATE: """
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
""",
    JOINT_COMMAND: """
int32 POSITION_MODE=1
int32 VELOCITY_MODE=2
int32 TORQUE_MODE=3
int32 RAW_POSITION_MODE=4
int32 mode
float64[] command
string[] names
""",
}
"""Definitions of Rethink's messages in the files of robots."""

READ = (JOINT_STATE, GRIPPER_STATE, TEXT)
"""Types of messages that are read."""

EVENTS = "/events"
"""Topic of events in files that are written here, as "kind: text"."""

PREFERRED = ("/robot/joint_states", "/joint_states")
"""Topics of measured joints: a real Baxter's, and those of files that are written here."""

MAX_SIMULATED_S = 1e8
"""Later stamps are of a clock that counts from 1970; nobody simulates three years."""

GAP_TICKS = 5.0
"""A pause of more than so many times the usual one is a gap."""

MISSING_GRIPPER_PERCENT = 100.0
"""Shown for a gripper that was not recorded: open, as a hand that holds nothing."""

LIMIT_SLACK_RAD = 0.04
"""Maximum distance of a recorded joint outside its limits. Real ones were up to 0.034 rad outside,
s1 of a tucked arm; a value farther outside is no angle of this robot."""

LIMIT_ROUNDING_RAD = 1e-11
"""A limit written with twelve digits may be exceeded by so much."""

SPEED_FACTOR = 2.0
"""Of the maximum in position mode, since a guiding hand may be faster. Driven by torques, real
Baxters kept 99.9 % of the time below 1.9 rad/s, wrists below 2.3."""

MAX_LATENESS_S = 0.1
"""Maximum lateness of a row's stamp: ten rows of the recorder, which stamps as it writes."""

UNIT_TOLERANCE = 1e-4
"""A quaternion's squared length differs from one by its digits alone."""

MIN_TURN = 0.01
"""A quaternion whose parts stay within this proves nothing; joints may stand anywhere."""

_TYPES = MessageTypes(ROBOT_MESSAGES)


def message_type(name: str) -> MessageType:
    """One of ROS 1's standard types, or of `ROBOT_MESSAGES`."""
    try:
        return _TYPES.message(name)
    except RosError as cause:
        raise RecordingError(str(cause)) from cause


class RecordedMessage(NamedTuple):
    """A message in a file: topic and type, when it was recorded, and its serialised content."""

    topic: str
    kind: str
    time_ns: int
    data: bytes


class JointPositions(NamedTuple):
    """A message that was read.

    Attributes:
        stamp_ns: its own stamp; zero if it has none.
        time_ns: when it was recorded.
        names: of joints; of a gripper its side.
        values: their positions, rad or m; of a gripper its per cent.
    """

    stamp_ns: int
    time_ns: int
    names: list[str]
    values: list[float]


class JointMessages:
    """The joints, grippers and events in the messages of a file.

    Attributes:
        file: the file, as messages show it.
        states: joint states by topic.
        grippers: states of grippers.
        events: times in ns and texts, of files that are written here.
        not_finite: topic and time in ns of joint states left out for a position that is not finite.
    """

    def __init__(self, file: object, messages: Iterable[RecordedMessage]) -> None:
        """Read all messages."""
        self.file = shown_path(file)
        self.states: dict[str, list[JointPositions]] = {}
        self.grippers: list[JointPositions] = []
        self.events: list[tuple[int, str]] = []
        self.not_finite: list[tuple[str, int]] = []
        for message in messages:
            if message.kind != TEXT or message.topic == EVENTS:
                try:
                    self._read(message)
                except (RosMessageError, RecordingError) as cause:
                    at = f"{message.topic} at {message.time_ns / NANOSECONDS:.6f} s"
                    raise RecordingError(f"{self.file}, {at}: {cause}") from cause

    def topic(self, wanted: str | None) -> tuple[str, tuple[str, ...]]:
        """The topic to read, and the other topics that have arms."""
        found = [topic for topic, states in self.states.items() if _has_arm(states)]
        if wanted is not None and wanted not in found:
            those = f"those that have: {', '.join(found)}" if found else "no topic has"
            raise RecordingError(
                f"{self.file}: {quoted(wanted)} has no joint states of an arm; {those}"
            )
        if not found:
            raise RecordingError(
                f"{self.file} has no joint states (sensor_msgs/JointState) with the seven joints "
                "of a Baxter's arm, such as left_s0"
            )
        candidates = (wanted,) if wanted is not None else PREFERRED
        chosen = next((topic for topic in candidates if topic in found), None)
        if chosen is None and len(found) > 1:
            raise RecordingError(
                f"{self.file} has arms on several topics: {', '.join(found)}; give one as topic"
            )
        topic = chosen or found[0]
        return topic, tuple(each for each in found if each != topic)

    def _read(self, recorded: RecordedMessage) -> None:
        message: Any = message_type(recorded.kind).deserialise(recorded.data)
        if recorded.kind == JOINT_STATE:
            self._read_joints(recorded, message)
        elif recorded.kind == TEXT:
            self.events.append((recorded.time_ns, message.data))
        else:
            side = next((side for side in LIMBS if side in recorded.topic), None)
            if side is not None and np.isfinite(message.position):
                stamp_ns, percent = _ns(message.timestamp), float(message.position)
                self.grippers.append(JointPositions(stamp_ns, recorded.time_ns, [side], [percent]))

    def _read_joints(self, recorded: RecordedMessage, message: Any) -> None:
        values, names = message.position, list(message.name)
        if not len(values):
            return
        if len(values) != len(names):
            raise RecordingError(f"has {len(values)} positions of {len(names)} joints")
        if not np.isfinite(values).all():
            self.not_finite.append((recorded.topic, recorded.time_ns))
            return
        stamp_ns = _ns(message.header.stamp)
        self.states.setdefault(recorded.topic, []).append(
            JointPositions(stamp_ns, recorded.time_ns, names, values.tolist())
        )


def _has_arm(states: list[JointPositions]) -> bool:
    return bool(limbs_in(dict.fromkeys(name for each in states for name in each.names)))


def _ns(stamp: Any) -> int:
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


_Track: TypeAlias = tuple[NDArray[np.int64], FloatArray]
"""Times of a joint in ns, not decreasing, and its positions, shape (n,) each."""


def _held(track: _Track, times: NDArray[np.int64]) -> FloatArray:
    """The last value at or before each time; NaN before the first."""
    index = np.searchsorted(track[0], times, side="right") - 1
    held: FloatArray = np.where(index < 0, np.nan, track[1][np.maximum(index, 0)])
    return held


def merged_recording(
    messages: JointMessages, robot: Baxter, topic: str | None, notes: Iterable[str]
) -> NotedRecording:
    """The recording that the messages of a file make.

    Args:
        messages: the messages.
        robot: the robot whose joints they are.
        topic: where these were published; found when not given.
        notes: what was odd about the file.
    """
    odd = (*notes, *_not_finite_notes(messages))
    try:
        chosen, others = messages.topic(topic)
    except RecordingError as cause:  # what was odd about the file may be the reason
        raise RecordingError("; ".join([str(cause), *odd])) from cause
    is_stamped = any(each.stamp_ns for each in messages.states[chosen])
    states, late_states = _in_order(messages.states[chosen], is_stamped=is_stamped)
    gripper_states, late_grippers = _in_order(messages.grippers, is_stamped=is_stamped)
    tracks = _tracks(states)
    arms = {name: tracks[name] for side in limbs_in(tracks) for name in arm_joints(side)}
    times = np.unique(np.concatenate([track[0] for track in arms.values()]))
    times = times[times >= max(int(track[0][0]) for track in arms.values())]
    origin_ns = int(times[0]) if times[0] > MAX_SIMULATED_S * NANOSECONDS else 0
    times_s = (times - origin_ns) / NANOSECONDS

    def place(row: int) -> str:
        return f"{messages.file}, {chosen} at {times_s[row]:.6f} s"

    held = {
        name: _held(track, times) for name, track in tracks.items() if name in robot.joint_names
    }
    percent = _finger_percent(held, robot)
    percent |= {side: _held(track, times) for side, track in _tracks(gripper_states).items()}
    odd += tuple(_topic_notes(chosen, others))
    odd += tuple(_order_notes(late_states, chosen))
    odd += tuple(_order_notes(late_grippers, "the grippers"))
    if origin_ns:
        odd += (f"time zero is {origin_ns / NANOSECONDS:.3f} s since 1970",)
    rows = Rows(times_s, _whole_joints(held, arms), place)
    found = noted_recording(rows, percent, odd, robot)
    events = _events(messages.events, origin_ns)
    return found._replace(recording=evolve(found.recording, events=events))


def _in_order(
    messages: list[JointPositions], *, is_stamped: bool
) -> tuple[list[JointPositions], list[JointPositions]]:
    """The messages by their time, and those left out because time jumped back.

    That is the stamp, if there is one. Each is compared with the last one of the same joints, since
    publishers have clocks of their own.
    """
    kept: list[JointPositions] = []
    late: list[JointPositions] = []
    last_ns: dict[frozenset[str], int] = {}
    for each in sorted(messages, key=lambda each: each.time_ns):
        dated = each._replace(time_ns=each.stamp_ns) if is_stamped else each
        names = frozenset(dated.names)
        if names in last_ns and dated.time_ns <= last_ns[names]:
            late.append(dated)
        else:
            last_ns[names] = dated.time_ns
            kept.append(dated)
    return sorted(kept, key=lambda each: each.time_ns), late


def _tracks(messages: Iterable[JointPositions]) -> dict[str, _Track]:
    """The values of each joint, from messages in order of time."""
    columns: dict[str, tuple[list[int], list[float]]] = {}
    for each in messages:
        for name, value in zip(each.names, each.values, strict=True):
            times, values = columns.setdefault(name, ([], []))
            times.append(each.time_ns)
            values.append(value)
    return {
        name: (np.array(times, dtype=np.int64), np.array(values))
        for name, (times, values) in columns.items()
    }


def _whole_joints(
    held: Mapping[str, FloatArray], arms: Mapping[str, object]
) -> dict[str, FloatArray]:
    """Joints of whole arms, and others that are known from the first row on."""
    parts = {name for side in LIMBS for name in arm_joints(side)} - arms.keys()
    return {
        name: values
        for name, values in held.items()
        if name not in parts and not np.isnan(values).any()
    }


def _finger_percent(held: Mapping[str, FloatArray], robot: Baxter) -> dict[str, FloatArray]:
    """Openings of the hands whose finger joints are known."""
    first = {side: finger_joints(side)[0] for side in LIMBS}
    return {
        side: 100.0 * held[name] / robot.model.upperPositionLimit[robot.indices((name,))[0]]
        for side, name in first.items()
        if name in held
    }


def _events(texts: list[tuple[int, str]], origin_ns: int) -> tuple[Event, ...]:
    """The events of a file that is written here."""
    kinds = {kind.value: kind for kind in EventKind}
    events = []
    for time_ns, content in texts:
        kind, _, text = content.partition(": ")
        if kind in kinds:
            events.append(Event((time_ns - origin_ns) / NANOSECONDS, kinds[kind], text))
    return tuple(events)


def _order_notes(late: list[JointPositions], source: str) -> Iterator[str]:
    if late:
        yield (
            f"{count(len(late), 'message')} of {source} did not come after the one before in time, "
            f"the first stamped {late[0].time_ns / NANOSECONDS:.6f} s: left out"
        )


def _not_finite_notes(messages: JointMessages) -> Iterator[str]:
    if messages.not_finite:
        topic, time_ns = messages.not_finite[0]
        yield (
            f"{count(len(messages.not_finite), 'message')} with a position that is not finite, the "
            f"first on {topic}, recorded at {time_ns / NANOSECONDS:.6f} s: left out"
        )


def _topic_notes(chosen: str, others: tuple[str, ...]) -> Iterator[str]:
    if others:
        left = count(len(others), "other topic")
        yield f"{chosen} was read, and {left} with arms left out: {', '.join(others)}"


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Joints at n times.

    Attributes:
        times_s: increasing, shape (n,).
        joints: positions by name, shape (n,) each, rad; of an arm all seven or none.
        place: names the row of an index, such as "run.csv, line 12".
    """

    times_s: FloatArray
    joints: Mapping[str, FloatArray]
    place: Callable[[int], str]


def limbs_in(names: Mapping[str, object]) -> tuple[str, ...]:
    """The arms of which all joints are there."""
    return tuple(side for side in LIMBS if set(arm_joints(side)) <= names.keys())


def noted_recording(
    rows: Rows, percents: Mapping[str, FloatArray], notes: Iterable[str], robot: Baxter
) -> NotedRecording:
    """The recording of measured joints; a joint that was not measured stands in neutral.

    Args:
        rows: the joints.
        percents: by side, the opening of a gripper, shape (n,), NaN where it was not recorded.
        notes: what was odd about the file.
        robot: the robot whose joints they are.
    """
    limbs = limbs_in(rows.joints)
    odd = [*notes, *_gap_notes(rows.times_s), *_check_rows(rows, robot)]
    odd += [
        f"the {side} arm was not recorded: shown in neutral" for side in LIMBS if side not in limbs
    ]
    percent = np.empty((len(rows.times_s), len(LIMBS)))
    for i, side in enumerate(LIMBS):
        absent = np.full(len(rows.times_s), np.nan)
        percent[:, i], about = _gripper(percents.get(side, absent), side)
        odd += about if side in limbs or side in percents else ()
    recording = Recording(
        joint_names=robot.joint_names,
        times_s=rows.times_s,
        q=_configurations(robot, rows.joints, percent),
        gripper_percent=percent,
        bodies={},
        body_poses={},
        captions=((float(rows.times_s[0]), ""),),
        events=(),
        limbs=limbs,
    )
    return NotedRecording(recording, tuple(odd))


def _gap_notes(times: FloatArray) -> Iterator[str]:
    """A note for all gaps, with the first and the longest."""
    pauses = np.diff(times)
    usual = float(np.median(pauses)) if pauses.size else 0.0
    gaps = np.flatnonzero(pauses > GAP_TICKS * usual)
    if gaps.size:
        longest = gaps[pauses[gaps].argmax()]
        yield (
            f"{count(gaps.size, 'gap')} in time, {pauses[gaps].sum():.3f} s in all, the longest of "
            f"{pauses[longest]:.3f} s at {times[longest]:.3f} s, where a row usually follows after "
            f"{usual:.4g} s"
        )


def _gripper(percent: FloatArray, side: str) -> tuple[FloatArray, list[str]]:
    """Positions inside 0 .. 100, and what was odd about them."""
    notes = []
    absent = np.isnan(percent)
    if absent.any():
        where = "" if absent.all() else f" in {count(int(absent.sum()), 'row')}"
        notes.append(f"the {side} gripper was not recorded{where}: shown open")
    filled = np.where(absent, MISSING_GRIPPER_PERCENT, percent)
    clipped = np.clip(filled, 0.0, 100.0)
    odd = clipped != filled
    if odd.any():
        notes.append(
            f"the {side} gripper was outside 0 .. 100 % in {count(int(odd.sum()), 'row')}, "
            f"from {filled.min():.6g} to {filled.max():.6g} %: taken as the nearer end"
        )
    return clipped, notes


def _configurations(
    robot: Baxter, joints: Mapping[str, FloatArray], percent: FloatArray
) -> FloatArray:
    """Full configurations, shape (n, 19): joints as measured, the rest in neutral."""
    q = np.tile(robot.configuration(), (len(percent), 1))
    for i, side in enumerate(LIMBS):
        if finger_joints(side)[0] in robot.joint_names:
            first, second = robot.indices(finger_joints(side))
            q[:, first] = percent[:, i] / 100.0 * robot.model.upperPositionLimit[first]
            q[:, second] = -q[:, first]
    for name, values in joints.items():
        if name in robot.joint_names:
            q[:, robot.indices((name,))[0]] = values
    return q


def _check_rows(rows: Rows, robot: Baxter) -> list[str]:
    """A note for each joint that was outside its limits; numbers that are no joints are refused."""
    notes: list[str] = []
    for side in limbs_in(rows.joints):
        arm = robot.arms[side]
        bounds = zip(arm.limits.q_min.tolist(), arm.limits.q_max.tolist(), strict=True)
        for name, (low, high) in zip(arm.joint_names, bounds, strict=True):
            notes += _limit_notes(rows, name, low, high)
        _check_unlike_poses(rows, side)
        for name in arm.joint_names:
            _check_continuity(rows, name)
    return notes


def _limit_notes(rows: Rows, name: str, low: float, high: float) -> Iterator[str]:
    values = rows.joints[name]
    outside = np.maximum(low - values, values - high)
    beyond = np.flatnonzero(outside > LIMIT_SLACK_RAD)
    if beyond.size:
        row = int(beyond[0])
        raise RecordingError(
            f"{rows.place(row)}: {name} = {values[row]:.6g} rad is outside {low:.6g} .. {high:.6g} "
            f"by {outside[row]:.3g} rad; up to {LIMIT_SLACK_RAD:g} rad is accepted: are these "
            "joint angles, in rad?"
        )
    odd = outside > LIMIT_ROUNDING_RAD
    if odd.any():
        yield (
            f"{name} was outside its limits {low:.6g} .. {high:.6g} rad in "
            f"{count(int(odd.sum()), 'row')}, by up to {outside.max():.3g} rad"
        )


def _check_continuity(rows: Rows, name: str) -> None:
    speed = SPEED_FACTOR * MAX_SPEED_RAD_S[JOINTS.index(name.partition("_")[2])]
    jumps, pauses = np.abs(np.diff(rows.joints[name])), np.diff(rows.times_s)
    torn = np.flatnonzero(jumps > speed * (pauses + MAX_LATENESS_S))
    if torn.size:
        row = int(torn[0])
        raise RecordingError(
            f"{rows.place(row + 1)}: {name} moves by {jumps[row]:.3g} rad in {pauses[row]:.3g} s, "
            f"and no Baxter at more than {speed:g} rad/s, with {MAX_LATENESS_S:g} s for late "
            "stamps: are these joint angles, of one recording?"
        )


def _check_unlike_poses(rows: Rows, side: str) -> None:
    names = arm_joints(side)[3:]
    parts = np.array([rows.joints[name] for name in names])
    is_unit = np.abs((parts**2).sum(axis=0) - 1.0).max() < UNIT_TOLERANCE
    if is_unit and np.ptp(parts, axis=1).max() > MIN_TURN:
        raise RecordingError(
            f"{rows.place(0)} and all other rows: {', '.join(names)} are a quaternion of length "
            f"one, so the columns of the {side} arm are poses of its end point, no joint angles"
        )
