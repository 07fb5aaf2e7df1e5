"""The commands: what they print, how they end, and what they leave.

Signals and kills are of processes; everything else runs in this one, against a robot in a process
that the tests share.
"""

from __future__ import annotations

import io
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import pytest

from planner import Manipulator, Plan, Scene, plan_start_move, save_plan
from sim import read_recording
from sim.ros1 import check as checking
from sim.ros1 import execute as executing
from sim.ros1 import mirror as mirroring
from sim.ros1 import press as pressing
from sim.ros1.node import Node
from sim.ros1.robot import __main__ as serving
from tests.sim.ros1.execution.conftest import demo_plan  # noqa: F401 - a fixture
from tests.sim.ros1.processes import free_port, until

START_S = 120.0
SAID_S = 3.0
URI = re.compile(r"ROS_MASTER_URI=(http://\S+)")
NOWHERE = "http://127.0.0.1:9"
Run: TypeAlias = Callable[..., "Ended"]


class Command:
    """A command of ours, with its output in a file."""

    def __init__(self, log: Path, *arguments: str, uri: str = "") -> None:
        self._log, surroundings = log, dict(os.environ, ROS_IP="127.0.0.1", PYTHONUNBUFFERED="1")
        if uri:
            surroundings["ROS_MASTER_URI"] = uri
        with log.open("wb") as stream:
            self.process = subprocess.Popen(
                [sys.executable, "-m", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                env=surroundings,
            )

    @property
    def said(self) -> str:
        return self._log.read_text(errors="replace")

    def says(self, text: str, within_s: float = START_S) -> None:
        until(lambda: re.search(text, self.said), within_s)

    def status(self, within_s: float = START_S) -> int:
        return self.process.wait(within_s)

    def end(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()


@contextmanager
def served(log: Path) -> Iterator[tuple[Command, str]]:
    """A simulated Baxter with the demo's scene, and where its master is."""
    scene = "--own-master", "--port", "0", "--table", "--block"
    command = Command(log, "sim.ros1.robot", *scene)
    try:
        command.says(URI.pattern)
        found = URI.search(command.said)
        assert found is not None
        yield command, found[1]
    finally:
        command.end()


@pytest.fixture
def robot_process(tmp_path: Path) -> Iterator[tuple[Command, str]]:
    """A robot of one test alone."""
    with served(tmp_path / "robot.log") as robot:
        yield robot


@pytest.fixture(scope="module")
def shared_uri(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Where the master of a robot is whose state nobody changes."""
    with served(tmp_path_factory.mktemp("shared") / "robot.log") as (_, uri):
        yield uri


@dataclass(frozen=True)
class Ended:
    """What a command printed, and its exit status."""

    status: int
    printed: str


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Run:
    """Runs a command in this process."""

    def run(main: Callable[[list[str]], int], *arguments: object, uri: str = NOWHERE) -> Ended:
        monkeypatch.setenv("ROS_MASTER_URI", uri)
        monkeypatch.setattr("sys.stdin", io.StringIO())
        try:
            status: Any = main([str(each) for each in arguments])
        except SystemExit as stopped:
            status = stopped.code
        return Ended(status, "".join(capfd.readouterr()))

    return run


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory: pytest.TempPathFactory, demo_plan: Plan) -> Path:  # noqa: F811
    path = tmp_path_factory.mktemp("plan") / "demo.json"
    save_plan(demo_plan, path)
    return path


@pytest.fixture
def moving(
    robot_process: tuple[Command, str], plan_file: Path, tmp_path: Path
) -> Iterator[tuple[Command, Command, str]]:
    """The robot, an execution that has begun to move, and where the master is."""
    robot, uri = robot_process
    command = Command(
        tmp_path / "execute.log",
        *("sim.ros1.execute", str(plan_file), "--yes", "--record", str(tmp_path / "kept.mcap")),
        uri=uri,
    )
    try:
        command.says("speed ratio")
        time.sleep(1.5)
        yield robot, command, uri
    finally:
        command.end()


def test_check_says_each_condition_and_the_verdict_last(
    shared_uri: str, tmp_path: Path, run: Run
) -> None:
    urdf = tmp_path / "robot.urdf"
    check = run(checking.main, "--urdf", urdf, uri=shared_uri)
    assert check.status == 0, check.printed
    lines = check.printed.splitlines()
    assert lines[-1] == "ready to carry out plans"
    assert lines[0] == f"listening to the robot of {shared_uri}"
    assert lines[1] == "ok   version: 1.2.0"
    assert "<robot" in urdf.read_text()[:2000]


def test_a_master_that_is_not_there_is_one_sentence(plan_file: Path, run: Run) -> None:
    for main, arguments in (
        (checking.main, []),
        (executing.main, [plan_file]),
        (mirroring.main, []),
        (serving.main, []),
    ):
        ended = run(main, *arguments)
        assert ended.status == 1
        assert len(ended.printed.splitlines()) == 1, ended.printed
        assert "cannot reach the master at 127.0.0.1:9" in ended.printed
        assert "--own-master" in ended.printed


@pytest.mark.parametrize("content", [None, "{}", '{"format": "baxter-kin response"}'])
def test_a_response_that_is_none_is_wrong_usage(
    plan_file: Path, tmp_path: Path, content: str | None, run: Run
) -> None:
    response = tmp_path / "left.json"
    if content is not None:
        response.write_text(content)
    ended = run(executing.main, plan_file, "--response", response)
    assert ended.status == 2, ended.printed
    assert len(ended.printed.splitlines()) == 1, ended.printed
    assert str(response) in ended.printed


@pytest.mark.slow
def test_a_condition_that_does_not_hold_is_told_once(
    robot_process: tuple[Command, str], plan_file: Path, run: Run
) -> None:
    _, uri = robot_process
    press = run(pressing.main, "left", "estop", uri=uri)
    assert press.status == 0, press.printed
    for main, arguments in ((checking.main, []), (executing.main, [plan_file])):
        ended = run(main, *arguments, uri=uri)
        assert ended.status == 1, ended.printed
        assert ended.printed.count("emergency stop") == 1, ended.printed
        last = ended.printed.splitlines()[-1]
        assert last.endswith("a condition does not hold, see FAIL above")


@pytest.mark.parametrize(
    ("main", "line"),
    [
        (executing.main, "nowhere.json"),
        (executing.main, __file__),
        (executing.main, "plan.json --speed 2"),
        (executing.main, "plan.json --record a.txt"),
        (executing.main, "plan.json --lag-s 0.5 0.3"),
        (executing.main, "plan.json --settled-error-rad 0.01"),
        (executing.main, "plan.json --despite-lag"),
        (executing.main, "plan.json --dry-run --csv a.csv"),
        (executing.main, "plan.json --dry-run --record a.mcap"),
        (checking.main, "--output a.json"),
        (checking.main, "--yes"),
        (mirroring.main, "--port 0"),
        (mirroring.main, "--headless --port 7000"),
        (mirroring.main, "--headless --no-browser"),
    ],
)
def test_wrong_usage_is_told_in_a_sentence(
    main: Callable[[list[str]], int], line: str, run: Run
) -> None:
    ended = run(main, *line.split())
    assert ended.status == 2
    assert len(ended.printed.splitlines()) == 1, ended.printed


def test_a_dry_run_sends_nothing(
    shared_uri: str,
    manipulator: Manipulator,
    scene: Scene,
    tmp_path: Path,
    run: Run,
) -> None:
    """A plan that is soon verified: from the start to neutral."""
    short, arm = tmp_path / "short.json", manipulator.arm
    save_plan(plan_start_move(manipulator, scene, arm.start, arm.neutral), short)
    unknown = run(executing.main, short, "--dry-run", uri=shared_uri)
    assert unknown.status == 0, unknown.printed
    assert "would move: left arm, 2 moves" in unknown.printed
    assert unknown.printed.count("not proven: how the arm lags (--response)\n") == 1
    assert "ok   state: ready, not enabled yet" in unknown.printed
    assert "\nverifying the plan in the state that the robot reports" in unknown.printed
    known = run(executing.main, short, "--dry-run", "--lag-s", "0", "0.001", uri=shared_uri)
    assert known.status == 0, known.printed
    assert "ok   tracking: clear wherever the lag leads" in known.printed
    assert "not proven" not in known.printed
    assert "not enabled yet" in run(checking.main, uri=shared_uri).printed


def test_without_a_yes_it_does_not_move(
    robot_process: tuple[Command, str], plan_file: Path, run: Run
) -> None:
    ended = run(executing.main, plan_file, uri=robot_process[1])
    assert ended.status == 1
    assert ended.printed.splitlines()[-1].endswith(
        "not confirmed; nothing was moved, and the robot stays enabled"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "status", "text"),
    [(signal.SIGINT, 130, "stopped by Ctrl-C"), (signal.SIGTERM, 143, "stopped by SIGTERM")],
)
def test_a_signal_leaves_the_arm_holding_and_nothing_registered(
    moving: tuple[Command, Command, str], number: int, status: int, text: str
) -> None:
    _, command, uri = moving
    command.process.send_signal(number)
    assert command.status() == status, command.said
    assert text in command.said.splitlines()[-1]
    with Node("/looker", master_uri=uri, host="127.0.0.1") as node:
        assert "/baxter_kin" not in node.nodes()
        heard = []
        node.subscribe(
            "/robot/joint_states", "sensor_msgs/JointState", lambda got: heard.append(got.message)
        )
        until(lambda: len(heard) > 100)
        assert abs(heard[0].position - heard[-1].position).max() < 1e-3


@pytest.mark.slow
def test_a_robot_that_is_killed_is_told_of_within_seconds(
    moving: tuple[Command, Command, str], tmp_path: Path
) -> None:
    robot, command, _ = moving
    robot.process.kill()
    killed_s = time.monotonic()
    command.says("connection to the robot is lost|ms old", SAID_S)
    assert time.monotonic() - killed_s < SAID_S
    assert command.status() == 1
    assert read_recording(tmp_path / "kept.mcap").recording.samples


@pytest.mark.slow
def test_an_execution_that_is_killed_is_told_of_by_the_robot_and_kept(
    moving: tuple[Command, Command, str], tmp_path: Path
) -> None:
    robot, command, _ = moving
    command.process.kill()
    robot.says("/baxter_kin is gone without having unregistered", SAID_S)
    assert read_recording(tmp_path / "kept.mcap").recording.samples


@pytest.mark.slow
def test_a_second_execution_is_refused_and_the_first_goes_on(
    moving: tuple[Command, Command, str], plan_file: Path, tmp_path: Path
) -> None:
    _, first, uri = moving
    second = Command(tmp_path / "second.log", "sim.ros1.execute", str(plan_file), uri=uri)
    assert second.status() == 1, second.said
    assert f"/baxter_kin runs already, as process {first.process.pid}" in second.said
    assert first.process.poll() is None, first.said


@pytest.mark.slow
def test_the_robot_ends_without_noise(robot_process: tuple[Command, str]) -> None:
    robot, _ = robot_process
    robot.process.send_signal(signal.SIGTERM)
    assert robot.status() == 143
    assert robot.said.splitlines()[-1] == "stopped; everything is unregistered"


def test_the_mirror_records_what_it_sees(shared_uri: str, tmp_path: Path, run: Run) -> None:
    csv = tmp_path / "seen.csv"
    mirror = run(mirroring.main, "--headless", "--duration-s", "1", "--csv", csv, uri=shared_uri)
    assert mirror.status == 0, mirror.printed
    assert 30 <= len(csv.read_text().splitlines()) <= 55


@pytest.mark.slow
def test_the_mirror_is_served_where_it_is_asked_to_be(shared_uri: str, run: Run) -> None:
    port = free_port()
    options = "--no-browser", "--port", port, "--duration-s", "1"
    mirror = run(mirroring.main, *options, uri=shared_uri)
    assert mirror.status == 0, mirror.printed
    assert f"open http://127.0.0.1:{port}/ in a browser to watch\n" in mirror.printed
