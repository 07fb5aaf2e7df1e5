"""Recordings in npz files: `save_recording` and `load_recording`.

An npz file is a zip archive of arrays; `numpy.load` opens it too. This one holds, float64 where not
said otherwise:

- `times_s` (n,), `q` (n, joints), `gripper_percent` (n, 2) and `body_poses` (bodies, n, 7), as in
  `Recording`, the bodies in the order of `tracks` in the document,
- `document`: JSON as bytes of UTF-8 (uint8): `format` "baxter-kin recording"; `version` 5, or an
  earlier one; `joint_names`, `bodies` with their shapes, `tracks`, `captions`, `events`, `moves`
  with their exact trajectories, `robot`, which one it was, where that is known, and `limbs`, the
  arms that were recorded,
- `added_commands_left` and `added_commands_right` (k, 15), where a robot was driven: the times, the
  set-points that were sent and what was measured, as in `Commands`,
- and other arrays whose names begin with `ADDED`, which are no part of the recording.

Kept is everything but the moves that events carry; a loaded event has the body of its name, as it
is in `bodies`. Reading makes nothing but these values: no pickle is read, and a file that was
truncated, or damaged so that its entries do not fit their CRC-32, is refused.
The same recording gives the same bytes. A file is replaced at once or not at all.
"""

from __future__ import annotations

import io
import lzma
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from tokenize import TokenError
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baxter_kin.description import RobotIdentity
from baxter_kin.display import shown_path
from baxter_kin.files import PathLike
from baxter_kin.json_data import from_json, shown, to_json
from baxter_kin.json_text import as_text, from_text
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray, expect
from planner import Body
from sim.errors import RecordingError
from sim.files import checked_path, opened, replace_file
from sim.recording.recorded_motion import RecordedMove
from sim.recording.recorder import StoredEvent
from sim.recording.recording import Commands, Recording

FORMAT = "baxter-kin recording"
VERSION = 5
READABLE = (1, 2, 3, 4, 5)
"""In the first one events named no side, and moves not what inverse kinematics answered; the first
two had an entry `sha256`, the SHA-256 of the others, which is not read any more. Before the fourth
all recordings had both arms; before the fifth moves did not name the contacts that were meant."""

ADDED = "added_"
"""What the names of further arrays begin with: what an execution on a robot has sent, say."""

LARGEST_FILE_BYTES = 4 * 2**30
"""Unpacked; an hour at 100 Hz takes 0.1 GB."""

_ARRAYS = {"times_s": 1, "q": 2, "gripper_percent": 2, "body_poses": 3}
_COMMANDS = {limb: f"{ADDED}commands_{limb}" for limb in LIMBS}
_KINDS = {**{name: ("float64", axes) for name, axes in _ARRAYS.items()}, "document": ("uint8", 1)}


@dataclass(frozen=True, slots=True, eq=False)
class _Document:
    """What is kept as text."""

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


def save_recording(
    recording: Recording, path: PathLike, *, added: Mapping[str, ArrayLike] | None = None
) -> None:
    """Write a recording to a file, which is replaced when it exists.

    Args:
        recording: what to write.
        path: the file, by convention ending in ".npz".
        added: further arrays by name, for `numpy.load`; `load_recording` passes over them.

    Raises:
        RecordingError: when it has the wrong type, holds something that has no place in the file,
            or cannot be written.
    """
    expect(recording, Recording, "recording", RecordingError)
    file = checked_path(path)
    document, content = np.frombuffer(_document(recording).encode(), np.uint8), io.BytesIO()
    given = {} if added is None else expect(added, Mapping, "added", RecordingError)  # type: ignore[type-abstract]
    further = {f"{ADDED}{name}": array for name, array in given.items()}
    arrays: dict[str, Any] = {**_arrays(recording), "document": document, **further}
    np.savez_compressed(content, **arrays)
    replace_file(file, content.getvalue())


def load_recording(path: PathLike) -> Recording:
    """The recording in a file.

    Raises:
        RecordingError: when the file cannot be read, is truncated or damaged, or holds no
            recording; says which.
    """
    file = checked_path(path)
    with opened(file) as stream:
        try:
            return _recording(_arrays_in(stream))
        except RecordingError as cause:
            raise RecordingError(f"{shown_path(file)}: {cause}") from cause


def _arrays(recording: Recording) -> dict[str, FloatArray]:
    count = len(recording.times_s)
    poses = list(recording.body_poses.values())
    tracks = np.array(poses).reshape(len(poses), count, 7)
    arrays = recording.times_s, recording.q, recording.gripper_percent, tracks
    commands = {
        _COMMANDS[limb]: np.column_stack([sent.times_s, sent.q_sent, sent.q_measured])
        for limb, sent in recording.commands.items()
    }
    return dict(zip(_ARRAYS, arrays, strict=True)) | commands


def _document(recording: Recording) -> str:
    document = _Document(
        format=FORMAT,
        version=VERSION,
        joint_names=recording.joint_names,
        bodies=tuple(recording.bodies.values()),
        tracks=tuple(recording.body_poses),
        captions=recording.captions,
        events=tuple(StoredEvent.of(event) for event in recording.events),
        moves=recording.moves,
        robot=recording.robot,
        limbs=recording.limbs,
    )
    data = to_json(document, _Document, "recording", RecordingError)
    return as_text(data, RecordingError)


def _recording(arrays: Mapping[str, NDArray[Any]]) -> Recording:
    document = _read_document(arrays["document"].tobytes())
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
        events=tuple(stored.event(bodies) for stored in document.events),
        moves=document.moves,
        robot=document.robot,
        limbs=document.limbs,
        commands={
            limb: Commands(arrays[name][:, 0], arrays[name][:, 1:8], arrays[name][:, 8:])
            for limb, name in _COMMANDS.items()
            if name in arrays
        },
    )


def _read_document(content: bytes) -> _Document:
    data = from_text(content, RecordingError)
    stated: dict[str, Any] = data if isinstance(data, dict) else {}
    if stated.get("format") != FORMAT:
        raise RecordingError(f"is no recording: its format is {shown(stated.get('format'))}")
    if stated.get("version") not in READABLE:
        raise RecordingError(
            f"has version {shown(stated.get('version'))}, but only {READABLE} are read here"
        )
    document: _Document = from_json(data, _Document, "recording", RecordingError)
    return document


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


_DAMAGE = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, NotImplementedError, RuntimeError),
    *(ValueError, TypeError, IndexError, SyntaxError, TokenError, OverflowError, MemoryError),
)
"""What damage leads to in archives, and in what NumPy reads as Python: the headers of arrays."""


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
    if size > LARGEST_FILE_BYTES:
        raise RecordingError(f"unpacks to more than {LARGEST_FILE_BYTES >> 30} GB")
