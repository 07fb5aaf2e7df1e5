"""The demo as a process: signals in any phase, and nothing left behind."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from sim import EventKind, read_recording

DEMO = [sys.executable, "-m", "baxter_kin.demo"]
DEADLINE_S = 300.0

MEASURED = """
import os, subprocess, sys
process = subprocess.Popen(sys.argv[1:])
_, status, usage = os.wait4(process.pid, 0)
process.returncode = os.waitstatus_to_exitcode(status)
print(process.returncode, usage.ru_maxrss / 1024)
"""
"""Runs a program, then prints its exit status and its greatest memory in MB. A process counts as
having had the memory of the one that started it, so a small one must: the tests' own is larger."""


@pytest.fixture
def forever(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A headless demo that goes on until stopped."""
    command = [*DEMO, "--headless", "--forever", "--csv", str(tmp_path / "run.csv")]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        yield process
        process.kill()


def read_until(process: subprocess.Popen[str], word: str) -> None:
    """Follow the program's output up to a line with that word."""
    assert process.stdout is not None
    for line in process.stdout:
        if word in line:
            return
    raise AssertionError(f"the program ended without saying {word!r}")


@pytest.mark.parametrize("phase", ["move to start", "cycle 1", "descend", "grasped", "cycle 3"])
def test_ctrl_c_while_it_works_is_status_130(forever: subprocess.Popen[str], phase: str) -> None:
    read_until(forever, phase)
    forever.send_signal(signal.SIGINT)
    said, complained = forever.communicate(timeout=DEADLINE_S)
    assert forever.returncode == 130
    warning, *told = complained.splitlines()  # of set-points for the robot as it is drawn
    assert "run.csv has set-points for Baxter as it is drawn" in warning
    assert told == ["stopped by Ctrl-C"]
    assert "Traceback" not in said


@pytest.mark.parametrize("library", ["numpy", "pinocchio", "casadi", "ruckig", "coal"])
def test_ctrl_c_while_it_loads_is_status_130(forever: subprocess.Popen[str], library: str) -> None:
    mapped, give_up_s = Path(f"/proc/{forever.pid}/maps"), time.monotonic() + DEADLINE_S
    while f"/{library}" not in mapped.read_text() and time.monotonic() < give_up_s:
        time.sleep(1e-3)
    forever.send_signal(signal.SIGINT)
    _, complained = forever.communicate(timeout=DEADLINE_S)
    assert forever.returncode == 130
    assert "Traceback" not in complained


def test_ctrl_c_removes_the_scene(tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    command = [*DEMO, "--headless", "--forever", "--report", str(report)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        read_until(process, "grasped")
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=DEADLINE_S)
    text = report.read_text()
    assert '"text": "block deleted"' in text
    assert '"text": "table deleted"' in text
    assert '"success": false' in text
    assert '"failure": "stopped by Ctrl-C"' in text


def test_a_second_ctrl_c_does_not_spoil_the_outputs(tmp_path: Path) -> None:
    report, page = tmp_path / "report.json", tmp_path / "replay.html"
    command = [*DEMO, "--headless", "--forever", "--report", str(report), "--html", str(page)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        read_until(process, "cycle 3")
        process.send_signal(signal.SIGINT)
        time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 130
    assert '"failure": "stopped by Ctrl-C"' in report.read_text()
    assert page.read_text().rstrip().endswith("</html>")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_being_killed_leaves_no_process(number: signal.Signals) -> None:
    """The live view lives in the program's own process, so it cannot outlive it."""
    with subprocess.Popen(
        [*DEMO, "--forever", "--no-browser"], stdout=subprocess.PIPE, text=True
    ) as process:
        read_until(process, "http://127.0.0.1")
        family = psutil.Process(process.pid).children(recursive=True)
        assert family == []
        process.send_signal(number)
        process.communicate(timeout=DEADLINE_S)
    assert process.returncode == -number


def test_being_killed_leaves_the_recording_up_to_then(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    command = [*DEMO, "--headless", "--forever", "--record", str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        read_until(process, "cycle 2")
        process.kill()
        process.communicate(timeout=DEADLINE_S)
    found, notes = read_recording(path)
    assert "the file was cut short" in notes[-1]
    assert any(event.kind is EventKind.RELEASED for event in found.events)


def test_reader_of_a_pipe_may_leave_early() -> None:
    with subprocess.Popen(
        [*DEMO, "--headless", "--cycles", "20"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        assert "Traceback" not in process.stderr.read()
        process.wait(DEADLINE_S)


def test_default_run_is_light() -> None:
    """One process of at most 400 MB."""
    command = [sys.executable, "-c", MEASURED, *DEMO, "--headless", "-q"]
    status, memory_mb = subprocess.check_output(command, text=True).split()
    assert int(status) == 0
    assert float(memory_mb) <= 400
