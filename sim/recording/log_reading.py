"""Logs read back, also of a run that was killed; `sim.recording.log_recorder` has the format."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from baxter_kin.description import RobotIdentity
from baxter_kin.errors import shown_path
from baxter_kin.files import PathLike
from baxter_kin.json_data import from_json, shown
from baxter_kin.json_text import Json, from_text
from baxter_kin.validation import FloatArray
from planner import Body
from sim.errors import RecordingError
from sim.events import Event
from sim.files import Line, checked_path, read_lines
from sim.recording.log_recorder import FORMAT, READABLE
from sim.recording.recorded_motion import RecordedMove
from sim.recording.recorder import StoredEvent
from sim.recording.recording import NotedRecording, Recording


@dataclass(frozen=True, slots=True, eq=False)
class _Snapshot:
    """The entries of a line that tells a snapshot."""

    time_s: float
    q: FloatArray
    gripper_percent: FloatArray
    poses: Mapping[str, FloatArray | None] = field(default_factory=dict)
    caption: str | None = None


@dataclass(slots=True)
class _Story:
    """All that was read so far.

    Attributes:
        joint_names: the joints.
        robot: which robot it was, if that is told.
        snapshots: in order.
        bodies: by name, as last told.
        events: in order.
        moves: in order.
        captions: where it changed.
        stated: the number of snapshots that the end states; None before it.
    """

    joint_names: tuple[str, ...]
    robot: RobotIdentity | None = None
    snapshots: list[_Snapshot] = field(default_factory=list)
    bodies: dict[str, Body] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)
    moves: list[RecordedMove] = field(default_factory=list)
    captions: list[tuple[float, str]] = field(default_factory=list)
    stated: int | None = None

    def hear(self, kind: str, data: Json) -> None:
        """One more line.

        Raises:
            RecordingError: when it makes no sense here.
        """
        if kind not in _KINDS:
            raise RecordingError(f"has the entry {shown(kind)}; known are {', '.join(_KINDS)}")
        if self.stated is not None:
            raise RecordingError("comes after the end")
        value = from_json(data, _KINDS[kind], kind, RecordingError)
        if isinstance(value, _Snapshot):
            self._add(value)
        elif isinstance(value, Body):
            self.bodies[value.name] = value
        elif isinstance(value, StoredEvent):
            self.events.append(value.event(self.bodies))
        elif isinstance(value, RecordedMove):
            self.moves.append(value)
        else:
            self.stated = value

    def recording(self) -> Recording:
        """All of it.

        Raises:
            RecordingError: when there is no snapshot.
        """
        shots = self.snapshots
        return Recording(
            joint_names=self.joint_names,
            times_s=np.array([shot.time_s for shot in shots]),
            q=np.array([shot.q for shot in shots]),
            gripper_percent=np.array([shot.gripper_percent for shot in shots]),
            bodies=self.bodies,
            body_poses={name: self._track(name) for name in self.bodies},
            captions=tuple(self.captions),
            events=tuple(self.events),
            moves=tuple(self.moves),
            robot=self.robot,
        )

    def _add(self, shot: _Snapshot) -> None:
        if self.snapshots and shot.time_s <= self.snapshots[-1].time_s:
            raise RecordingError(
                f"is at {shot.time_s:g} s, after one at {self.snapshots[-1].time_s:g} s"
            )
        sizes = [("q", shot.q, len(self.joint_names)), ("gripper_percent", shot.gripper_percent, 2)]
        sizes += [(name, row, 7) for name, row in shot.poses.items() if row is not None]
        for name, row, size in sizes:
            if row.shape != (size,):
                raise RecordingError(f"{name} has shape {row.shape}; it must have {(size,)}")
        self.snapshots.append(shot)
        if shot.caption is not None:
            self.captions.append((shot.time_s, shot.caption))

    def _track(self, name: str) -> FloatArray:
        absent = np.full(7, np.nan)
        track, now = np.empty((len(self.snapshots), 7)), absent
        for row, shot in enumerate(self.snapshots):
            if name in shot.poses:
                told = shot.poses[name]
                now = absent if told is None else told
            track[row] = now
        return track


_KINDS: Mapping[str, Any] = {
    "body": Body,
    "event": StoredEvent,
    "move": RecordedMove,
    "snapshot": _Snapshot,
    "end": int,
}


def read_log(path: PathLike) -> NotedRecording:
    """The recording in a log, up to where it was cut short.

    Noted are: a missing end, as of a run that was killed; a last line that is half written, which
    is left out; bodies whose shapes are not told, as they were there before, left out too.

    Raises:
        RecordingError: when the file cannot be read, is no log, has no snapshot, or a line before
            the last is damaged; says which.
    """
    file = checked_path(path)
    story: _Story | None = None
    notes = []
    for line in read_lines(file):
        if not line.is_complete:
            notes.append(f"line {line.number} is half written: left out")
        elif story is None:
            story = _begun(file, line)
        else:
            _hear(file, line, story)
    if story is None:
        raise RecordingError(f"{shown_path(file)} is empty, or was cut in its first line")
    if not story.snapshots:
        raise RecordingError(f"{shown_path(file)} has no snapshot: nothing was simulated")
    notes += _end_notes(story)
    return NotedRecording(story.recording(), tuple(notes))


def _begun(file: object, line: Line) -> _Story:
    try:
        data = from_text(line.text, RecordingError)
    except RecordingError:
        data = None
    first: dict[str, Any] = data if isinstance(data, dict) else {}
    if first.get("format") != FORMAT:
        raise RecordingError(f"{shown_path(file)} is no log: it does not begin with its format")
    if first.get("version") not in READABLE:
        raise RecordingError(
            f"{shown_path(file)} has version {shown(first.get('version'))}, but only {READABLE} "
            "are read here"
        )
    names = from_json(first.get("joint_names"), tuple[str, ...], "joint_names", RecordingError)
    return _Story(
        names, from_json(first.get("robot"), RobotIdentity | None, "robot", RecordingError)
    )


def _hear(file: object, line: Line, story: _Story) -> None:
    try:
        data = from_text(line.text, RecordingError)
        if not isinstance(data, dict) or len(data) != 1:
            raise RecordingError(f"must be an object of one entry, got {shown(data)}")
        ((kind, value),) = data.items()
        story.hear(kind, value)
    except RecordingError as cause:
        raise RecordingError(f"{shown_path(file)}, line {line.number}: {cause}") from cause


def _end_notes(story: _Story) -> Iterator[str]:
    told = dict.fromkeys(name for shot in story.snapshots for name in shot.poses)
    unknown = [name for name in told if name not in story.bodies]
    if unknown:
        yield f"left out, as their shapes are not in the log: {shown(unknown)}"
    if story.stated is None:
        last = story.snapshots[-1].time_s
        yield f"the log has no end: the run was cut short after {last:.6g} s"
    elif story.stated != len(story.snapshots):
        missing = story.stated - len(story.snapshots)
        yield f"{missing} of {story.stated} snapshots are missing"
