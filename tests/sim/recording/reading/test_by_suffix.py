"""The suffix says which reader it is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from sim import (
    LogRecorder,
    Recording,
    read_recording,
    retell,
    save_recording,
    write_bag,
    write_csv,
    write_mcap,
)
from sim.errors import RecordingError


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("run.bag", write_bag),
        ("RUN.BAG", write_bag),
        ("run.csv", write_csv),
        ("run.mcap", write_mcap),
        ("run.npz", save_recording),
    ],
)
def test_each_format_is_read(
    robot: Baxter,
    picked: Recording,
    tmp_path: Path,
    name: str,
    write: Callable[[Recording, Path], None],
) -> None:
    write(picked, tmp_path / name)
    found = read_recording(tmp_path / name, robot)
    np.testing.assert_allclose(found.recording.q, picked.q, atol=1e-11)
    assert found.notes == ()


def test_logs_are_read(robot: Baxter, picked: Recording, tmp_path: Path) -> None:
    recorder = LogRecorder(tmp_path / "run.jsonl", robot)
    retell(picked, recorder)
    recorder.close()
    found = read_recording(tmp_path / "run.jsonl", robot)
    np.testing.assert_array_equal(found.recording.q, picked.q)


@pytest.mark.parametrize("name", ["run", "run.txt", "run.csv.gz", ".bag"])
def test_other_suffixes_are_refused_with_those_that_are_known(
    robot: Baxter, tmp_path: Path, name: str
) -> None:
    with pytest.raises(RecordingError, match=r"end in one of .bag, .csv, .jsonl, .mcap, .npz"):
        read_recording(tmp_path / name, robot)


@pytest.mark.parametrize("bad", [None, 3])
def test_what_is_no_path_or_no_robot(robot: Baxter, bad: Any) -> None:
    with pytest.raises(RecordingError, match="path"):
        read_recording(bad, robot)
    with pytest.raises(RecordingError, match="robot"):
        read_recording("run.bag", bad)
