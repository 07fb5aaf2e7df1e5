"""The demo as a process: signals in any phase, and nothing left behind."""

from __future__ import annotations

import json
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
SLOWLY = ("--speed", "0.3")
"""Ten times as fast to plan."""

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
    outputs = {"csv": "run.csv", "report": "report.json", "html": "replay.html"}
    files = [word for name, file in outputs.items() for word in (f"--{name}", tmp_path / file)]
    command = [*DEMO, "--headless", "--forever", *SLOWLY, *map(str, files)]
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


@pytest.mark.slow
@pytest.mark.parametrize("phase", ["move to start", "grasped"])
def test_ctrl_c_while_it_works_is_status_130_and_removes_the_scene(
    forever: subprocess.Popen[str], tmp_path: Path, phase: str
) -> None:
    """A second Ctrl-C, while it writes, does not spoil the outputs."""
    read_until(forever, phase)
    forever.send_signal(signal.SIGINT)
    time.sleep(0.02)
    forever.send_signal(signal.SIGINT)
    printed, complained = forever.communicate(timeout=DEADLINE_S)
    assert forever.returncode == 130
    warning, *rest = complained.splitlines()  # of set-points for the robot as it is drawn
    assert "run.csv has set-points for Baxter as it is drawn" in warning
    assert rest == ["stopped by Ctrl-C"]
    assert "Traceback" not in printed
    report = json.loads((tmp_path / "report.json").read_text())
    assert [event["text"] for event in report["events"][-2:]] == ["block deleted", "table deleted"]
    assert (report["success"], report["failure"]) == (False, "stopped by Ctrl-C")
    if phase == "grasped":  # before anything was shown there is no page
        assert (tmp_path / "replay.html").read_text().rstrip().endswith("</html>")


@pytest.mark.slow
@pytest.mark.parametrize("library", ["numpy", "casadi", "coal"])
def test_ctrl_c_while_it_loads_is_status_130(forever: subprocess.Popen[str], library: str) -> None:
    mapped, give_up_s = Path(f"/proc/{forever.pid}/maps"), time.monotonic() + DEADLINE_S
    while f"/{library}" not in mapped.read_text() and time.monotonic() < give_up_s:
        time.sleep(1e-3)
    forever.send_signal(signal.SIGINT)
    _, complained = forever.communicate(timeout=DEADLINE_S)
    assert forever.returncode == 130
    assert "Traceback" not in complained


@pytest.mark.slow
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


@pytest.mark.slow
def test_being_killed_leaves_the_recording_up_to_then(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    command = [*DEMO, "--headless", "--forever", *SLOWLY, "--record", str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        read_until(process, "cycle 2")
        process.kill()
        process.communicate(timeout=DEADLINE_S)
    found, notes = read_recording(path)
    assert "the file was cut short" in notes[-1]
    assert any(event.kind is EventKind.RELEASED for event in found.events)


@pytest.mark.slow
def test_reader_of_a_pipe_may_leave_early() -> None:
    with subprocess.Popen(
        [*DEMO, "--headless", *SLOWLY, "--cycles", "20"],
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
