"""Files of rotations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from planner.atlas import RotationGrid
from planner.atlas.commands.rotation_files import read_rotations
from planner.errors import AtlasError

QUATS = RotationGrid.hopf(0).quats_xyzw


@pytest.mark.parametrize("header", ["", "x,y,z,w\n", "# x, y, z, w\n\n"])
@pytest.mark.parametrize("between", [",", " ", "\t", ", "])
def test_text_reads_as_it_was_written(header: str, between: str, tmp_path: Path) -> None:
    file = tmp_path / "rotations.csv"
    lines = (between.join(map(repr, quat)) for quat in QUATS.tolist())
    file.write_text(header + "".join(f"{line}  # a remark\n" for line in lines))
    read = read_rotations(file)
    assert np.abs(read.matrices - RotationGrid.hopf(0).matrices).max() < 1e-12


def test_arrays_read_as_they_were_written(tmp_path: Path) -> None:
    np.save(tmp_path / "rotations.npy", QUATS * 1.0005)
    read = read_rotations(tmp_path / "rotations.npy")
    assert np.abs(read.matrices - RotationGrid.hopf(0).matrices).max() < 1e-12


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "has no rotation; write x, y, z, w on each line"),
        (b"x y z w\n# nothing\n", "has no rotation"),
        (b"0 0 0 1\n0 0 1\n", "line 2 of .* must be x, y, z, w, got '0 0 1'"),
        (b"0 0 0 one\n", "line 1 of .* must be x, y, z, w"),
        (b"0 0 0 1\n0 0 0 nan\n", "quaternion 2 of .* is nan long"),
        (b"0 0 0 2\n", "quaternion 1 of .* is 2 long, and must be 1 within 0.001"),
        (b"\xff\xfe\x00", "is neither text nor a NumPy array"),
        (b"\x93NUMPY...", "is damaged: "),
    ],
)
def test_what_is_no_list_of_rotations_is_refused(content: bytes, said: str, tmp_path: Path) -> None:
    file = tmp_path / "rotations"
    file.write_bytes(content)
    with pytest.raises(AtlasError, match=said):
        read_rotations(file)


def test_arrays_of_other_shapes_and_objects_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "rotations.npy"
    np.save(file, np.zeros((4, 3)))
    with pytest.raises(AtlasError, match=r"must hold an array \(n, 4\).* has float64 \(4, 3\)"):
        read_rotations(file)
    np.save(file, np.array([[{}]], dtype=object), allow_pickle=True)
    with pytest.raises(AtlasError, match="is damaged"):
        read_rotations(file)


def test_files_that_are_not_there_and_folders_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "none.csv"):
        with pytest.raises(AtlasError, match="cannot read"):
            read_rotations(path)
