"""Files of rotations: quaternions, one for each rotation of a map.

Text or CSV: a line has the four numbers x, y, z, w, separated by commas or spaces; empty lines,
comments after `#` and a first line of words are skipped. NumPy's `.npy`: an array (n, 4) of
the same. The length of a quaternion may differ from one by `MAX_LENGTH_ERROR`; it is normalised.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

from baxter_kin.display import quoted, shown_path
from baxter_kin.errors import FileError
from baxter_kin.files import open_to_read
from baxter_kin.validation import FloatArray
from planner.atlas.rotations import MOST_ROTATIONS, RotationGrid
from planner.errors import AtlasError

MAX_LENGTH_ERROR = 1e-3

MAX_BYTES = 300 * MOST_ROTATIONS
"""Size of a file with the greatest number of rotations."""


def read_rotations(path: Path) -> RotationGrid:
    """The rotations of a file, in their order."""
    try:
        with open_to_read(path) as file:
            content = file.read(MAX_BYTES + 1)
    except FileError as cause:
        raise AtlasError(f"cannot read {shown_path(path)}: {cause.reason}") from cause
    if len(content) > MAX_BYTES:
        raise AtlasError(f"{shown_path(path)} is too large; a map has {MOST_ROTATIONS:,} rotations")
    quats = _of_array(path) if content.startswith(b"\x93NUMPY") else _of_text(path, content)
    if not len(quats):
        raise AtlasError(f"{shown_path(path)} has no rotation; write x, y, z, w on each line")
    lengths = np.linalg.norm(quats, axis=1)
    off = ~(np.abs(lengths - 1.0) <= MAX_LENGTH_ERROR)
    if off.any():
        at = int(np.argmax(off))
        raise AtlasError(
            f"quaternion {at + 1} of {shown_path(path)} is {lengths[at]:.6g} long, and must be 1 "
            f"within {MAX_LENGTH_ERROR:g}: {quats[at].tolist()}"
        )
    xyzw = quats / lengths[:, None]
    return RotationGrid.of([pin.Quaternion(w, x, y, z).matrix() for x, y, z, w in xyzw.tolist()])


def _of_array(path: Path) -> FloatArray:
    try:
        quats = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as cause:
        raise AtlasError(f"{shown_path(path)} is damaged: {cause}") from cause
    if quats.ndim != 2 or quats.shape[1] != 4 or quats.dtype.kind not in "fiu":
        raise AtlasError(
            f"{shown_path(path)} must hold an array (n, 4) of x, y, z, w, has {quats.dtype} "
            f"{quats.shape}"
        )
    return np.asarray(quats, dtype=np.float64)


def _of_text(path: Path, content: bytes) -> FloatArray:
    try:
        lines = content.decode().splitlines()
    except UnicodeDecodeError:
        raise AtlasError(f"{shown_path(path)} is neither text nor a NumPy array") from None
    rows = list[list[float]]()
    for number, line in enumerate(lines, 1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words or (number == 1 and not any(map(_is_number, words))):
            continue
        if len(words) != 4 or not all(map(_is_number, words)):
            raise AtlasError(
                f"line {number} of {shown_path(path)} must be x, y, z, w, got {quoted(line, 60)}"
            )
        rows.append([float(word) for word in words])
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
