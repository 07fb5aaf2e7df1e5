"""Readers of the .npz and .jsonl files that earlier versions wrote (deprecated).

They are kept for one release; `save_recording(read_recording("old.npz").recording, "new.mcap")`
moves such a file to MCAP. Reading makes nothing but the values of a recording: no pickle is read.

An npz file is a zip archive of arrays, float64 where not said otherwise: `times_s` (n,), `q` (n,
joints), `gripper_percent` (n, 2), `body_poses` (bodies, n, 7), in the order of `tracks` in the
document, and `document`, JSON as bytes of UTF-8 (uint8). Where a robot was driven,
`added_commands_left` and `added_commands_right` (k, 15) have times, set-points and measured
positions. Other arrays whose names begin with `ADDED` are passed over.

A log is JSON Lines: first format, version and joint names, then one entry to a line: a body, event,
move, snapshot (`poses` and `caption` where they changed, null for a body that is gone), sample, and
last the number of snapshots, which is missing when the run was cut short.
"""

from __future__ import annotations

import lzma
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from baxter_kin.description import RobotIdentity
from baxter_kin.display import shown_path
from baxter_kin.files.json_data import from_json, shown
from baxter_kin.files.json_text import Json, from_text
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray
from planner import Body
from sim.errors import RecordingError
from sim.files import Line, opened, read_lines
from sim.recording.formats.mcap_file import StoredEvent, unknown_bodies
from sim.recording.recorded_motion import RecordedMove
from sim.recording.recorder import RecordingBuilder
from sim.recording.recording import Caption, NotedRecording, RecordedSample, Recording, Row

NPZ_FORMAT, NPZ_VERSIONS = "baxter-kin recording", (1, 2, 3, 4, 5)
LOG_FORMAT, LOG_VERSIONS = "baxter-kin log", (1, 2, 3, 4)

ADDED = "added_"
"""Beginning of the names of further arrays."""

MAX_FILE_BYTES = 4 * 2**30
"""Unpacked; an hour at 100 Hz takes 0.1 GB."""

_ARRAYS = {"times_s": 1, "q": 2, "gripper_percent": 2, "body_poses": 3}
_COMMANDS = {limb: f"{ADDED}commands_{limb}" for limb in LIMBS}
_KINDS = {**{name: ("float64", axes) for name, axes in _ARRAYS.items()}, "document": ("uint8", 1)}

_DAMAGE = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, NotImplementedError, RuntimeError),
    *(ValueError, TypeError, IndexError, SyntaxError, TokenError, OverflowError, MemoryError),
)
"""Exceptions to which damage leads in archives, and in array headers."""


@dataclass(frozen=True, slots=True, eq=False)
class _Document:
    """What an npz file has as text."""

    format: str
    version: int
    joint_names: tuple[str, ...]
    bodies: tuple[Body, ...]
    tracks: tuple[str, ...]
    captions: tuple[tuple[float, str], ...]
    events: tuple[StoredEvent, ...]
    moves: tuple[RecordedMove, ...]
    robot: RobotIdentity | None = None
    limbs: tuple[str, ...] = LIMBS


@dataclass(frozen=True, slots=True, eq=False)
class _Snapshot:
    """The entries of a snapshot's line in a log."""

    time_s: float
    q: FloatArray
    gripper_percent: FloatArray
    poses: Mapping[str, FloatArray | None] = field(default_factory=dict)
    caption: str | None = None


_ENTRIES: Mapping[str, Any] = {
    "body": Body,
    "event": StoredEvent,
    "move": RecordedMove,
    "snapshot": _Snapshot,
    "sample": RecordedSample,
    "end": int,
}


def read_npz(path: Path) -> NotedRecording:
    """Read an npz file; one that is truncated or damaged is refused."""
    with opened(path) as stream:
        try:
            return NotedRecording(_recording(_arrays_in(stream)), ())
        except RecordingError as cause:
            raise RecordingError(f"{shown_path(path)}: {cause}") from cause


def _recording(arrays: Mapping[str, NDArray[Any]]) -> Recording:
    data = from_text(arrays["document"].tobytes(), RecordingError)
    stated: dict[str, Any] = data if isinstance(data, dict) else {}
    if stated.get("format") != NPZ_FORMAT:
        raise RecordingError(f"is no recording: its format is {shown(stated.get('format'))}")
    _check_version(stated, NPZ_VERSIONS)
    document: _Document = from_json(data, _Document, "recording", RecordingError)
    bodies = {body.name: body for body in document.bodies}
    poses = arrays["body_poses"]
    if len(poses) != len(document.tracks):
        raise RecordingError(f"has {len(poses)} tracks under {len(document.tracks)} names")
    return Recording(
        joint_names=document.joint_names,
        times_s=arrays["times_s"],
        q=arrays["q"],
        gripper_percent=arrays["gripper_percent"],
        bodies=bodies,
        body_poses=dict(zip(document.tracks, poses, strict=True)),
        captions=document.captions,
        events=tuple(stored.original(bodies) for stored in document.events),
        moves=document.moves,
        robot=document.robot,
        limbs=document.limbs,
        samples=tuple(
            RecordedSample(limb, row[0], np.array(row[1:8]), np.array(row[8:]))
            for limb, name in _COMMANDS.items()
            for row in arrays.get(name, np.empty((0, 15))).tolist()
        ),
    )


def _check_version(stated: Mapping[str, Any], readable: tuple[int, ...]) -> None:
    if stated.get("version") not in readable:
        raise RecordingError(
            f"has version {shown(stated.get('version'))}, but only {readable} are read here"
        )


def _arrays_in(stream: IO[bytes]) -> dict[str, NDArray[Any]]:
    """The arrays of a recording by name."""
    try:
        with zipfile.ZipFile(stream) as archive:
            _check_entries(archive)
            there = {entry.filename.removesuffix(".npy") for entry in archive.infolist()}
            names = [*_KINDS, *there.intersection(_COMMANDS.values())]
            arrays = {name: _array_in(archive, name) for name in names}
    except _DAMAGE as cause:
        raise RecordingError(f"is no npz file, or a truncated or damaged one: {cause}") from cause
    for name, array in arrays.items():
        kind, axes = _KINDS.get(name, ("float64", 2))
        if array.dtype.name != kind or array.ndim != axes:
            raise RecordingError(
                f"has an entry {name} of {array.dtype} and {array.ndim} axes, where it must be of "
                f"{kind} and have {axes}"
            )
    return arrays


def _array_in(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    with archive.open(f"{name}.npy") as entry:
        array: NDArray[Any] = np.lib.format.read_array(entry, allow_pickle=False)
        return array


def _check_entries(archive: zipfile.ZipFile) -> None:
    names = {entry.filename for entry in archive.infolist()} - {"sha256.npy"}
    entries = {name for name in names if not name.startswith(ADDED)}
    wanted = {f"{name}.npy" for name in _KINDS}
    if entries != wanted:
        raise RecordingError(
            f"is no recording: it has the entries {shown(sorted(entries))}; a recording has "
            f"{sorted(wanted)}"
        )
    size = sum(entry.file_size for entry in archive.infolist())
    if size > MAX_FILE_BYTES:
        raise RecordingError(f"unpacks to more than {MAX_FILE_BYTES >> 30} GB")


def read_log(path: Path) -> NotedRecording:
    """Read a log, up to where it was cut short; a line before the last that is damaged is refused.

    Noted are a missing end, as of a run that was killed, a last line that is half written, and
    bodies without shapes, which are left out.
    """
    reader: _LogReader | None = None
    notes = []
    for line in read_lines(path):
        if not line.is_complete:
            notes.append(f"line {line.number} is half written: left out")
        elif reader is None:
            reader = _begun(path, line)
        else:
            _read_line(path, line, reader)
    if reader is None:
        raise RecordingError(f"{shown_path(path)} is empty, or was cut in its first line")
    if not reader.builder.rows:
        raise RecordingError(f"{shown_path(path)} has no snapshot: no snapshot was recorded")
    notes += [*unknown_bodies(reader.builder), *reader.end_notes()]
    return NotedRecording(reader.builder.build(), tuple(notes))


class _LogReader:
    """The content of the lines so far."""

    def __init__(self, joint_names: tuple[str, ...], robot: RobotIdentity | None) -> None:
        self.builder = RecordingBuilder(joint_names, robot)
        self._stated: int | None = None
        self._poses: dict[str, FloatArray] = {}

    def add(self, kind: str, data: Json) -> None:
        """Add one more line."""
        if kind not in _ENTRIES:
            raise RecordingError(f"has the entry {shown(kind)}; known are {', '.join(_ENTRIES)}")
        if self._stated is not None:
            raise RecordingError("comes after the end")
        value = from_json(data, _ENTRIES[kind], kind, RecordingError)
        if isinstance(value, _Snapshot):
            self._add_snapshot(value)
        elif isinstance(value, int):
            self._stated = value
        else:
            is_event = isinstance(value, StoredEvent)
            self.builder.add(value.original(self.builder.bodies) if is_event else value)

    def end_notes(self) -> Iterator[str]:
        """Notes on snapshots that are missing."""
        rows = self.builder.rows
        if self._stated is None:
            yield f"the log has no end: the run was cut short after {rows[-1].time_s:.6g} s"
        elif self._stated != len(rows):
            yield f"{self._stated - len(rows)} of {self._stated} snapshots are missing"

    def _add_snapshot(self, shot: _Snapshot) -> None:
        rows, joints = self.builder.rows, len(self.builder.joint_names)
        if rows and shot.time_s <= rows[-1].time_s:
            raise RecordingError(f"is at {shot.time_s:g} s, after one at {rows[-1].time_s:g} s")
        sizes = [("q", shot.q, joints), ("gripper_percent", shot.gripper_percent, 2)]
        sizes += [(name, row, 7) for name, row in shot.poses.items() if row is not None]
        for name, row, size in sizes:
            if row.shape != (size,):
                raise RecordingError(f"{name} has shape {row.shape}; it must have {(size,)}")
        if shot.poses:
            poses = {**self._poses, **shot.poses}
            self._poses = {name: row for name, row in poses.items() if row is not None}
        if shot.caption is not None or not rows:
            self.builder.add(Caption(shot.time_s, shot.caption or ""))
        self.builder.add(Row(shot.time_s, shot.q, shot.gripper_percent, self._poses))


def _begun(file: object, line: Line) -> _LogReader:
    try:
        data = from_text(line.text, RecordingError)
    except RecordingError:
        data = None
    first: dict[str, Any] = data if isinstance(data, dict) else {}
    if first.get("format") != LOG_FORMAT:
        raise RecordingError(f"{shown_path(file)} is no log: it does not begin with its format")
    try:
        _check_version(first, LOG_VERSIONS)
    except RecordingError as cause:
        raise RecordingError(f"{shown_path(file)} {cause}") from cause
    names = from_json(first.get("joint_names"), tuple[str, ...], "joint_names", RecordingError)
    robot = from_json(first.get("robot"), RobotIdentity | None, "robot", RecordingError)
    return _LogReader(names, robot)


def _read_line(file: object, line: Line, reader: _LogReader) -> None:
    try:
        data = from_text(line.text, RecordingError)
        if not isinstance(data, dict) or len(data) != 1:
            raise RecordingError(f"must be an object of one entry, got {shown(data)}")
        ((kind, value),) = data.items()
        reader.add(kind, value)
    except RecordingError as cause:
        raise RecordingError(f"{shown_path(file)}, line {line.number}: {cause}") from cause
