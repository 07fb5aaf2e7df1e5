"""Recordings in npz files: `save_recording` and `load_recording`.

An npz file is a zip archive of arrays; `numpy.load` opens it too. This one holds, float64 where not
said otherwise:

- `times_s` (n,), `q` (n, joints), `gripper_percent` (n, 2) and `body_poses` (bodies, n, 7), as in
  `Recording`, the bodies in the order of `tracks` in the document,
- `document`: JSON as bytes of UTF-8 (uint8): `format` "baxter-kin recording"; `version` 2, or 1;
  `joint_names`, `bodies` with their shapes, `tracks`, `captions`, `events`, `moves` with their
  exact trajectories, and `robot`, which one it was, where that is known,
- `sha256`: 32 bytes (uint8), the SHA-256 of the other entries' bytes in the order above.

Kept is everything but the moves that events carry; a loaded event has the body of its name, as it
is in `bodies`. Reading makes nothing but these values: no pickle is read, a file that
was truncated or edited is refused, and one array is never made larger than its bytes in the file.
The same recording gives the same bytes. A file is replaced at once or not at all.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from baxter_kin.description import RobotIdentity
from baxter_kin.errors import expect, shown_path
from baxter_kin.files import PathLike
from baxter_kin.json_data import from_json, shown, to_json
from baxter_kin.json_text import as_text, from_text
from baxter_kin.validation import FloatArray
from planner import Body
from sim.errors import RecordingError
from sim.files import checked_path, opened, replace_file
from sim.recording.recorded_motion import RecordedMove
from sim.recording.recorder import StoredEvent
from sim.recording.recording import Recording

FORMAT = "baxter-kin recording"
VERSION = 2
READABLE = (1, 2)
"""In the first one events named no side, and moves not what inverse kinematics answered."""

LARGEST_FILE_BYTES = 4 * 2**30
"""Unpacked; an hour at 100 Hz takes 0.1 GB."""

_ARRAYS = ("times_s", "q", "gripper_percent", "body_poses")
_ENTRIES = (*_ARRAYS, "document", "sha256")


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


def save_recording(recording: Recording, path: PathLike) -> None:
    """Write a recording to a file, which is replaced when it exists.

    Raises:
        RecordingError: when it is of another class, holds something that has no place in the file,
            or cannot be written.
    """
    expect(recording, Recording, "recording", RecordingError)
    file = checked_path(path)
    arrays = {name: _npy(array) for name, array in _arrays(recording).items()}
    arrays["document"] = _npy(np.frombuffer(_document(recording).encode(), np.uint8))
    arrays["sha256"] = _npy(np.frombuffer(_checksum(arrays), np.uint8))
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name, data in arrays.items():
            entry = zipfile.ZipInfo(f"{name}.npy")  # dated 1980, so that the bytes are the same
            archive.writestr(entry, data, zipfile.ZIP_DEFLATED)
    replace_file(file, content.getvalue())


def load_recording(path: PathLike) -> Recording:
    """The recording in a file.

    Raises:
        RecordingError: when the file cannot be read, is truncated, damaged or edited, or holds no
            recording; says which.
    """
    file = checked_path(path)
    with opened(file) as stream:
        try:
            return _recording(_contents(stream))
        except RecordingError as cause:
            raise RecordingError(f"{shown_path(file)}: {cause}") from cause


def _arrays(recording: Recording) -> dict[str, FloatArray]:
    count = len(recording.times_s)
    poses = list(recording.body_poses.values())
    return {
        "times_s": recording.times_s,
        "q": recording.q,
        "gripper_percent": recording.gripper_percent,
        "body_poses": np.array(poses).reshape(len(poses), count, 7),
    }


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
    )
    data = to_json(document, _Document, "recording", RecordingError)
    return as_text(data, RecordingError)


def _recording(contents: Mapping[str, bytes]) -> Recording:
    arrays = {name: _array(data, name) for name, data in contents.items()}
    if arrays["sha256"].tobytes() != _checksum(contents):
        raise RecordingError("was changed after it was saved: its checksum does not fit")
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


def _contents(stream: IO[bytes]) -> dict[str, bytes]:
    """The bytes of every entry by name."""
    try:
        with zipfile.ZipFile(stream) as archive:
            _check_entries(archive)
            return {name: archive.read(f"{name}.npy") for name in _ENTRIES}
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as cause:
        raise RecordingError(f"is no npz file, or a truncated or damaged one: {cause}") from cause


def _check_entries(archive: zipfile.ZipFile) -> None:
    names = sorted(entry.filename for entry in archive.infolist())
    wanted = sorted(f"{name}.npy" for name in _ENTRIES)
    if names != wanted:
        raise RecordingError(
            f"is no recording: it has the entries {shown(names)}; a recording has {wanted}"
        )
    size = sum(entry.file_size for entry in archive.infolist())
    if size > LARGEST_FILE_BYTES:
        raise RecordingError(f"unpacks to more than {LARGEST_FILE_BYTES >> 30} GB")


def _npy(array: NDArray[Any]) -> bytes:
    content = io.BytesIO()
    np.lib.format.write_array(content, np.ascontiguousarray(array), (1, 0), allow_pickle=False)
    return content.getvalue()


def _array(data: bytes, name: str) -> NDArray[Any]:
    """An array from an entry; only those that `_npy` writes, and none larger than its bytes."""
    stream = io.BytesIO(data)
    try:
        if np.lib.format.read_magic(stream) != (1, 0):
            raise ValueError("an npy version that is not written here")
        shape, is_fortran, kind = np.lib.format.read_array_header_1_0(stream)
    except ValueError as cause:
        raise RecordingError(f"has an entry {name} that is no array: {cause}") from cause
    wanted = np.dtype("u1" if name in ("document", "sha256") else "<f8")
    body = data[stream.tell() :]
    if (
        is_fortran
        or kind != wanted
        or len(body) != int(np.prod(shape, dtype=object)) * kind.itemsize
    ):
        raise RecordingError(f"has an entry {name} that is no array of {wanted.name}")
    return np.frombuffer(body, wanted).reshape(shape)


def _checksum(contents: Mapping[str, bytes]) -> bytes:
    digest = hashlib.sha256()
    for name in _ENTRIES[:-1]:
        digest.update(contents[name])
    return digest.digest()
