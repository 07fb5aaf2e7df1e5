"""Logs read back, also of a run that was killed; `sim.recording.log_recorder` has the format."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from baxter_kin.description import RobotIdentity
from baxter_kin.display import shown_path
from baxter_kin.files import PathLike
from baxter_kin.json_data import from_json, shown
from baxter_kin.json_text import Json, from_text
from baxter_kin.validation import FloatArray
from planner import Body
from sim.errors import RecordingError
from sim.files import Line, checked_path, read_lines
from sim.recording.log_recorder import FORMAT, READABLE
from sim.recording.recorded_motion import RecordedMove
from sim.recording.recorder import CommandSample, RecordingMemory, Row, StoredEvent
from sim.recording.recording import NotedRecording
from sim.samples import Sample


@dataclass(frozen=True, slots=True, eq=False)
class _Snapshot:
    """The entries of a line that tells a snapshot."""

    time_s: float
    q: FloatArray
    gripper_percent: FloatArray
    poses: Mapping[str, FloatArray | None] = field(default_factory=dict)
    caption: str | None = None


class _LogReader:
    """What the lines so far told.

    Attributes:
        story: all of it.
        told: names of all bodies that had a pose.
        stated: the number of snapshots that the end states; None before it.
    """

    def __init__(self, joint_names: tuple[str, ...], robot: RobotIdentity | None) -> None:
        self.story = RecordingMemory(joint_names, robot)
        self.told: dict[str, None] = {}
        self.stated: int | None = None
        self._poses: dict[str, FloatArray] = {}

    def hear(self, kind: str, data: Json) -> None:
        """One more line."""
        if kind not in _KINDS:
            raise RecordingError(f"has the entry {shown(kind)}; known are {', '.join(_KINDS)}")
        if self.stated is not None:
            raise RecordingError("comes after the end")
        value = from_json(data, _KINDS[kind], kind, RecordingError)
        if isinstance(value, _Snapshot):
            self._add(value)
        elif isinstance(value, Body):
            self.story.bodies[value.name] = value
        elif isinstance(value, StoredEvent):
            self.story.events.append(value.event(self.story.bodies))
        elif isinstance(value, RecordedMove):
            self.story.moves.append(value)
        elif isinstance(value, Sample):
            self.story.samples.append(CommandSample.of(value))
        else:
            self.stated = value

    def _add(self, shot: _Snapshot) -> None:
        rows, joints = self.story.rows, len(self.story.joint_names)
        if rows and shot.time_s <= rows[-1].time_s:
            raise RecordingError(f"is at {shot.time_s:g} s, after one at {rows[-1].time_s:g} s")
        sizes = [("q", shot.q, joints), ("gripper_percent", shot.gripper_percent, 2)]
        sizes += [(name, row, 7) for name, row in shot.poses.items() if row is not None]
        for name, row, size in sizes:
            if row.shape != (size,):
                raise RecordingError(f"{name} has shape {row.shape}; it must have {(size,)}")
        if shot.poses:
            self.told.update(dict.fromkeys(shot.poses))
            poses = {**self._poses, **shot.poses}
            self._poses = {name: row for name, row in poses.items() if row is not None}
        caption = shot.caption if shot.caption is not None else rows[-1].caption if rows else ""
        rows.append(Row(shot.time_s, shot.q, shot.gripper_percent, self._poses, caption))


_KINDS: Mapping[str, Any] = {
    "body": Body,
    "event": StoredEvent,
    "move": RecordedMove,
    "snapshot": _Snapshot,
    "sample": Sample,
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
    reader: _LogReader | None = None
    notes = []
    for line in read_lines(file):
        if not line.is_complete:
            notes.append(f"line {line.number} is half written: left out")
        elif reader is None:
            reader = _begun(file, line)
        else:
            _hear(file, line, reader)
    if reader is None:
        raise RecordingError(f"{shown_path(file)} is empty, or was cut in its first line")
    if not reader.story.rows:
        raise RecordingError(f"{shown_path(file)} has no snapshot: nothing was simulated")
    notes += _end_notes(reader)
    return NotedRecording(reader.story.recording(), tuple(notes))


def _begun(file: object, line: Line) -> _LogReader:
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
    return _LogReader(
        names, from_json(first.get("robot"), RobotIdentity | None, "robot", RecordingError)
    )


def _hear(file: object, line: Line, reader: _LogReader) -> None:
    try:
        data = from_text(line.text, RecordingError)
        if not isinstance(data, dict) or len(data) != 1:
            raise RecordingError(f"must be an object of one entry, got {shown(data)}")
        ((kind, value),) = data.items()
        reader.hear(kind, value)
    except RecordingError as cause:
        raise RecordingError(f"{shown_path(file)}, line {line.number}: {cause}") from cause


def _end_notes(reader: _LogReader) -> Iterator[str]:
    rows, unknown = reader.story.rows, [x for x in reader.told if x not in reader.story.bodies]
    if unknown:
        yield f"left out, as their shapes are not in the log: {shown(unknown)}"
    if reader.stated is None:
        yield f"the log has no end: the run was cut short after {rows[-1].time_s:.6g} s"
    elif reader.stated != len(rows):
        missing = reader.stated - len(rows)
        yield f"{missing} of {reader.stated} snapshots are missing"
