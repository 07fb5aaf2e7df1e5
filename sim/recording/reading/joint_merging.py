"""Joint states of several publishers, merged by the names of joints to one recording.

A real Baxter has two publishers on one topic: all joints at 100 Hz, and the joints of the fingers
at 38 Hz. So a message counts for the joints that it names, and each joint keeps its last value
until it is named again. A row stands at every time at which a joint of an arm was named, from where
all of them have been.

Messages are taken in the order in which they were recorded. One whose stamp is not after that of
the message of the same joints before it is left out with a note, as a row of a CSV file is: the
clock of a simulation that was started again begins anew, and its second run must not be mixed into
the first.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baxter_kin import Baxter
from baxter_kin.display import count
from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray
from sim.errors import RecordingError
from sim.events import Event, EventKind
from sim.recording.reading.joint_messages import Heard, JointMessages
from sim.recording.reading.measurement import Measurement, limbs_in, noted_recording
from sim.recording.reading.plausibility import Rows
from sim.recording.recorded_motion import arm_joints, finger_joints
from sim.recording.recording import NotedRecording
from sim.recording.ros1_files.messages import NANOSECONDS

WALL_CLOCK_S = 1e8
"""Later stamps are of a clock that counts from 1970; nobody simulates three years."""


@dataclass(frozen=True, slots=True, eq=False)
class _Track:
    """What was told of one joint: times in ns, not decreasing, and positions, shape (n,) each."""

    times: NDArray[np.int64]
    values: FloatArray

    def held(self, times: NDArray[np.int64]) -> FloatArray:
        """The last value at or before each time; NaN before the first."""
        index = np.searchsorted(self.times, times, side="right") - 1
        held: FloatArray = np.where(index < 0, np.nan, self.values[np.maximum(index, 0)])
        return held


def merged_recording(
    messages: JointMessages, robot: Baxter, topic: str | None, notes: Iterable[str]
) -> NotedRecording:
    """The recording that the messages of a file make.

    Args:
        messages: what they told.
        robot: whose joints they are.
        topic: where these were published; found when not given.
        notes: what was odd about the file.
    """
    told = (*notes, *_not_finite_notes(messages))
    chosen, others = _topic(messages, topic, told)
    is_stamped = any(heard.stamp_ns for heard in messages.states[chosen])
    states, late_states = _in_order(messages.states[chosen], is_stamped=is_stamped)
    gripper_states, late_grippers = _in_order(messages.grippers, is_stamped=is_stamped)
    tracks = _tracks(states)
    limbs = limbs_in(tracks)
    arms = {name: tracks[name] for side in limbs for name in arm_joints(side)}
    times = np.unique(np.concatenate([track.times for track in arms.values()]))
    times = times[times >= max(int(track.times[0]) for track in arms.values())]
    origin_ns = int(times[0]) if times[0] > WALL_CLOCK_S * NANOSECONDS else 0
    times_s = (times - origin_ns) / NANOSECONDS

    def place(row: int) -> str:
        return f"{messages.file}, {chosen} at {times_s[row]:.6f} s"

    held = {name: track.held(times) for name, track in tracks.items() if name in robot.joint_names}
    rows = Rows(times_s, _joints(held, arms), place)
    percent = _finger_percent(held, robot)
    percent |= {side: track.held(times) for side, track in _tracks(gripper_states).items()}
    told = (
        *told,
        *_topic_notes(chosen, others),
        *_order_notes(late_states, chosen),
        *_order_notes(late_grippers, "the grippers"),
        *_clock_notes(origin_ns),
    )
    found = noted_recording(Measurement(rows, percent, told), robot)
    events = _events(messages.events, origin_ns)
    return found._replace(recording=evolve(found.recording, events=events))


def _topic(
    messages: JointMessages, asked: str | None, told: tuple[str, ...]
) -> tuple[str, tuple[str, ...]]:
    """The topic to read; where there is none, what was odd about the file may be the reason."""
    try:
        return messages.topic(asked)
    except RecordingError as cause:
        raise RecordingError("; ".join([str(cause), *told])) from cause


class _Dated(NamedTuple):
    """A message and the time that counts for it, ns: its stamp, or when it was recorded."""

    at_ns: int
    heard: Heard


def _in_order(messages: list[Heard], *, is_stamped: bool) -> tuple[list[_Dated], list[_Dated]]:
    """The messages by time, and those left out because time jumped back.

    Each is compared with the last one of the same joints: publishers have clocks of their own.
    """
    kept: list[_Dated] = []
    late: list[_Dated] = []
    last_ns: dict[frozenset[str], int] = {}
    for heard in sorted(messages, key=lambda each: each.time_ns):
        dated = _Dated(heard.stamp_ns if is_stamped else heard.time_ns, heard)
        names = frozenset(heard.names)
        if names in last_ns and dated.at_ns <= last_ns[names]:
            late.append(dated)
        else:
            last_ns[names] = dated.at_ns
            kept.append(dated)
    return sorted(kept, key=lambda each: each.at_ns), late


def _tracks(messages: Iterable[_Dated]) -> dict[str, _Track]:
    """What was told of each joint, of messages in order of time."""
    columns: dict[str, tuple[list[int], list[float]]] = {}
    for at_ns, heard in messages:
        for name, value in zip(heard.names, heard.values, strict=True):
            times, values = columns.setdefault(name, ([], []))
            times.append(at_ns)
            values.append(value)
    return {
        name: _Track(np.array(times, dtype=np.int64), np.array(values))
        for name, (times, values) in columns.items()
    }


def _joints(held: Mapping[str, FloatArray], arms: Mapping[str, object]) -> dict[str, FloatArray]:
    """Joints of whole arms, and others that are known from the first row on."""
    parts = {name for side in LIMBS for name in arm_joints(side)} - arms.keys()
    return {
        name: values
        for name, values in held.items()
        if name not in parts and not np.isnan(values).any()
    }


def _finger_percent(held: Mapping[str, FloatArray], robot: Baxter) -> dict[str, FloatArray]:
    """How far the fingers are open, of hands whose joints are told."""
    first = {side: finger_joints(side)[0] for side in LIMBS}
    return {
        side: 100.0 * held[name] / robot.model.upperPositionLimit[robot.indices((name,))[0]]
        for side, name in first.items()
        if name in held
    }


def _events(told: list[tuple[int, str]], origin_ns: int) -> tuple[Event, ...]:
    """What happened, of a file that is written here: "kind: text"."""
    kinds = {kind.value: kind for kind in EventKind}
    events = []
    for time_ns, line in told:
        kind, _, text = line.partition(": ")
        if kind in kinds:
            events.append(Event((time_ns - origin_ns) / NANOSECONDS, kinds[kind], text))
    return tuple(events)


def _order_notes(late: list[_Dated], source: str) -> list[str]:
    if not late:
        return []
    first_s = late[0].at_ns / NANOSECONDS
    return [
        f"{count(len(late), 'message')} of {source} did not come after the one before in time, "
        f"the first stamped {first_s:.6f} s: left out"
    ]


def _not_finite_notes(messages: JointMessages) -> list[str]:
    if not messages.not_finite:
        return []
    topic, time_ns = messages.not_finite[0]
    return [
        f"{count(len(messages.not_finite), 'message')} with a position that is not finite, the "
        f"first on {topic}, recorded at {time_ns / NANOSECONDS:.6f} s: left out"
    ]


def _topic_notes(chosen: str, others: tuple[str, ...]) -> list[str]:
    if not others:
        return []
    left = count(len(others), "other topic")
    return [f"{chosen} was read, and {left} with arms left out: {', '.join(others)}"]


def _clock_notes(origin_ns: int) -> list[str]:
    return [f"time zero is {origin_ns / NANOSECONDS:.3f} s since 1970"] if origin_ns else []
