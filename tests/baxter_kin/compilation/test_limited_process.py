from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from baxter_kin.compilation.limited_process import run_within

LONG_S = 30.0
"""More than any of these programs takes."""

SHORT_S = 1.0
"""Enough for a shell to start."""

WITH_A_CHILD = "sleep 1000 & echo $! > child; wait"


def is_running(process: int) -> bool:
    """Whether it is there, and no zombie that waits for its parent to ask."""
    try:
        status = Path(f"/proc/{process}/stat").read_text("ascii")
    except (FileNotFoundError, ProcessLookupError):
        return False
    return status.rpartition(")")[2].split()[0] != "Z"


def ends(process: int) -> bool:
    """Whether it does soon; a signal takes a moment to arrive."""
    for _ in range(100):
        if not is_running(process):
            return True
        time.sleep(0.05)
    return False


def test_it_runs_in_that_folder_with_those_variables(tmp_path: Path) -> None:
    command = "sh", "-c", "echo $WORD > here"
    run_within(LONG_S, command, tmp_path, {**os.environ, "WORD": "said"})
    assert (tmp_path / "here").read_text() == "said\n"


def test_failure_raises_with_the_exit_status(tmp_path: Path) -> None:
    with pytest.raises(subprocess.CalledProcessError) as failure:
        run_within(LONG_S, ("sh", "-c", "exit 3"), tmp_path)
    assert failure.value.returncode == 3


def test_what_it_says_is_not_heard_and_it_hears_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    run_within(LONG_S, ("sh", "-c", "cat; echo out; echo err >&2"), tmp_path)
    assert tuple(capfd.readouterr()) == ("", "")


def test_a_program_that_hangs_is_ended_with_its_children(tmp_path: Path) -> None:
    with pytest.raises(subprocess.TimeoutExpired):
        run_within(SHORT_S, ("sh", "-c", WITH_A_CHILD), tmp_path)
    assert ends(int((tmp_path / "child").read_text()))


def test_ctrl_c_ends_it_with_its_children(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(process: subprocess.Popen[bytes], timeout: float | None = None) -> int:
        while not (child := tmp_path / "child").exists() or not child.read_text():
            time.sleep(0.05)
        monkeypatch.undo()
        raise KeyboardInterrupt

    monkeypatch.setattr(subprocess.Popen, "wait", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_within(LONG_S, ("sh", "-c", WITH_A_CHILD), tmp_path)
    assert ends(int((tmp_path / "child").read_text()))


def test_a_program_that_is_not_there_raises(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        run_within(LONG_S, (str(tmp_path / "nothing"),), tmp_path)


def test_python_does_not_import_from_where_it_was_called(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Called in `/tmp`, it would import what other users have put there."""
    (tmp_path / "shared").mkdir()
    (tmp_path / "own").mkdir()
    (tmp_path / "shared" / "planted.py").write_text("")
    monkeypatch.chdir(tmp_path / "shared")
    with pytest.raises(subprocess.CalledProcessError):
        run_within(LONG_S, (sys.executable, "-m", "planted"), tmp_path / "own")
