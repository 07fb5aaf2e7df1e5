"""The suffix of a file states its format."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from sim import Recorder, Recording, read_recording, save_recording
from sim.errors import RecordingError


@pytest.mark.parametrize("name", ["run.bag", "RUN.BAG", "run.csv", "run.mcap", "run.MCAP"])
def test_each_format_is_written_and_read(
    robot: Baxter, picked: Recording, tmp_path: Path, name: str
) -> None:
    save_recording(picked, tmp_path / name)
    found = read_recording(tmp_path / name, robot)
    np.testing.assert_allclose(found.recording.q, picked.q, atol=1e-11)
    assert found.notes == ()


@pytest.mark.parametrize("name", ["run", "run.txt", "run.csv.gz", ".bag", "run.npz", "run.jsonl"])
def test_other_suffixes_are_refused_with_those_that_are_known(
    robot: Baxter, picked: Recording, tmp_path: Path, name: str
) -> None:
    for write in (lambda path: save_recording(picked, path), lambda path: Recorder(robot, path)):
        with pytest.raises(RecordingError, match=r"one of \.bag, \.csv, \.mcap,"):
            write(tmp_path / name)
    if name not in ("run.npz", "run.jsonl"):
        with pytest.raises(RecordingError, match=r"\.jsonl, \.mcap, \.npz"):
            read_recording(tmp_path / name, robot)


@pytest.mark.parametrize("bad", [None, 3, b"run.mcap", ["run.mcap"]])
def test_what_is_no_path_robot_recording_or_topic(
    robot: Baxter, picked: Recording, tmp_path: Path, bad: Any
) -> None:
    with pytest.raises(RecordingError, match="path"):
        read_recording(bad)
    with pytest.raises(RecordingError, match="path"):
        save_recording(picked, bad)
    with pytest.raises(RecordingError, match="recording"):
        save_recording(bad, tmp_path / "run.mcap")
    if bad is not None:
        with pytest.raises(RecordingError, match="path"):
            Recorder(robot, bad)
        with pytest.raises(RecordingError, match="robot"):
            read_recording("run.bag", bad)
        with pytest.raises(RecordingError, match="topic"):
            read_recording("run.bag", robot, topic=bad)


def test_a_topic_is_for_messages(robot: Baxter) -> None:
    with pytest.raises(RecordingError, match="topic"):
        read_recording("run.csv", robot, topic="/joint_states")


@pytest.mark.parametrize("suffix", [".bag", ".csv", ".mcap", ".npz", ".jsonl"])
def test_a_path_that_leads_nowhere_or_to_a_folder(
    robot: Baxter, picked: Recording, tmp_path: Path, suffix: str
) -> None:
    (tmp_path / f"folder{suffix}").mkdir()
    for name in ("missing/run", "a\0b", "x" * 5000, "folder"):
        path = f"{tmp_path}/{name}{suffix}"
        with pytest.raises(RecordingError, match=r"cannot read|not a regular file"):
            read_recording(path, robot)
        if suffix in (".bag", ".csv", ".mcap"):
            with pytest.raises(RecordingError, match="cannot write"):
                save_recording(picked, path)
