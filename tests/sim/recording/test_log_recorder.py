"""The log: all that happened, on disk as it happens, and read back after any end."""

from __future__ import annotations

import itertools
import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from planner import Body, Scene
from sim import LogRecorder, Recorder, Recording, Simulation, World, read_log, read_rsdk_csv, retell
from sim.errors import RecordingError
from sim.view.replay import replay_html
from tests.sim.conftest import POSE, assert_same

SAID_S = 2.0
"""How much simulated time has passed when the test kills."""

DEADLINE_S = 60.0

ENDLESS = """
import sys
from baxter_kin import Baxter
from sim import CsvRecorder, LogRecorder, Simulation, World
robot = Baxter.load()
simulation = Simulation(World(robot), [LogRecorder(sys.argv[1], robot),
                                       CsvRecorder(sys.argv[2], robot)])
while True:
    simulation.wait(0.1)
    print(simulation.time_s, flush=True)
"""


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory, robot: Baxter, picked: Recording) -> Path:
    path = tmp_path_factory.mktemp("log") / "run.jsonl"
    recorder = LogRecorder(path, robot)
    retell(picked, recorder)
    recorder.close()
    return path


def test_all_of_a_run_comes_back(path: Path, picked: Recording) -> None:
    found, notes = read_log(path)
    assert notes == ()
    assert_same(found, picked, POSE)


def test_written_live_it_comes_back_to_the_bit_and_plays_the_same(
    robot: Baxter, table: Body, block: Body, tmp_path: Path
) -> None:
    live, memory = LogRecorder(tmp_path / "live.jsonl", robot), Recorder(robot)
    simulation = Simulation(World(robot), [live, memory])
    simulation.spawn(table)
    simulation.spawn(block)
    simulation.wait(0.1)
    simulation.delete("block")
    simulation.wait(0.1)
    live.close()
    found = read_log(tmp_path / "live.jsonl").recording
    assert_same(found, memory.recording())
    assert replay_html(found, robot) == replay_html(memory.recording(), robot)


def test_every_line_is_json_of_one_entry(path: Path) -> None:
    first, *lines = [json.loads(line) for line in path.read_text("ascii").splitlines()]
    assert first["format"] == "baxter-kin log"
    assert first["version"] == 4
    assert {len(line) for line in lines} == {1}
    kinds = {kind for line in lines for kind in line}
    assert kinds == {"body", "event", "move", "snapshot", "end"}


def test_poses_and_captions_are_written_where_they_change(path: Path) -> None:
    lines = [json.loads(line) for line in path.read_text("ascii").splitlines()]
    shots = [line["snapshot"] for line in lines if "snapshot" in line]
    assert sum("table" in shot.get("poses", {}) for shot in shots) == 1
    captions = [shot["caption"] for shot in shots if "caption" in shot]
    assert all(one != other for one, other in itertools.pairwise(captions))


def test_bodies_that_were_there_before_are_given_to_it(
    robot: Baxter, table: Body, tmp_path: Path
) -> None:
    world = World(robot)
    world.spawn(table)
    recorder = LogRecorder(tmp_path / "run.jsonl", robot, scene=world.scene)
    Simulation(world, [recorder]).wait(0.02)
    recorder.close()
    found = read_log(tmp_path / "run.jsonl").recording
    assert np.isfinite(found.body_poses["table"]).all()


def test_a_killed_run_keeps_all_up_to_the_last_line(robot: Baxter, tmp_path: Path) -> None:
    log, csv = tmp_path / "run.jsonl", tmp_path / "run.csv"
    command = [sys.executable, "-c", ENDLESS, str(log), str(csv)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        said_s = 0.0
        while said_s < SAID_S:
            said_s = float(process.stdout.readline())
        process.send_signal(signal.SIGKILL)
        process.wait(DEADLINE_S)
        said_s = max([said_s, *(float(line) for line in process.stdout if line.endswith("\n"))])
    assert process.returncode == -signal.SIGKILL
    found, notes = read_log(log)
    assert found.times_s[-1] >= said_s - 1e-9
    assert "the run was cut short" in notes[-1]
    assert read_rsdk_csv(csv, robot).recording.times_s[-1] >= said_s - 1e-6


def test_a_log_without_a_snapshot_is_no_recording(robot: Baxter, tmp_path: Path) -> None:
    LogRecorder(tmp_path / "run.jsonl", robot).close()
    with pytest.raises(RecordingError, match="nothing was simulated"):
        read_log(tmp_path / "run.jsonl")


def test_a_closed_log_can_be_closed_again_but_not_written(robot: Baxter, tmp_path: Path) -> None:
    recorder = LogRecorder(tmp_path / "run.jsonl", robot)
    recorder.close()
    recorder.close()
    with pytest.raises(RecordingError, match="closed file"):
        Simulation(World(robot), [recorder]).wait(0.01)


@pytest.mark.usefixtures("full_disk")
def test_a_full_disk_is_said(robot: Baxter, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"cannot write .*run.jsonl: No space left"):
        LogRecorder(tmp_path / "run.jsonl", robot)


@pytest.mark.parametrize("bad", [None, 3, "robot"])
def test_arguments_of_other_types_are_refused(robot: Baxter, tmp_path: Path, bad: Any) -> None:
    with pytest.raises(RecordingError, match="robot"):
        LogRecorder(tmp_path / "run.jsonl", bad)
    if bad is not None:
        with pytest.raises(RecordingError, match="scene"):
            LogRecorder(tmp_path / "run.jsonl", robot, scene=bad)
    if not isinstance(bad, str):
        with pytest.raises(RecordingError, match="path"):
            LogRecorder(bad, robot, scene=Scene({}))
        with pytest.raises(RecordingError, match="path"):
            read_log(bad)
