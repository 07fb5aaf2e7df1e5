"""The commands as processes of their own: what they say, how they end, and what they leave."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from planner import Plan, save_plan
from sim import read_recording
from sim.ros1.node import Node
from tests.sim.ros1.execution.conftest import demo_plan  # noqa: F401 - a fixture
from tests.sim.ros1.processes import until

START_S = 30.0
SAID_S = 3.0
URI = re.compile(r"ROS_MASTER_URI=(http://\S+)")


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


@pytest.fixture
def robot_process(tmp_path: Path) -> Iterator[tuple[Command, str]]:
    """A simulated Baxter with the demo's scene, and where its master is."""
    command = Command(
        tmp_path / "robot.log",
        *("sim.ros1.robot", "--own-master", "--port", "0", "--table", "--block"),
    )
    try:
        command.says(URI.pattern)
        found = URI.search(command.said)
        assert found is not None
        yield command, found[1]
    finally:
        command.end()


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
    robot_process: tuple[Command, str], tmp_path: Path
) -> None:
    _, uri = robot_process
    urdf = tmp_path / "robot.urdf"
    check = Command(tmp_path / "check.log", "sim.ros1.check", "--urdf", str(urdf), uri=uri)
    assert check.status() == 0, check.said
    lines = check.said.splitlines()
    assert lines[-1] == "ready to carry out plans"
    assert lines[0] == f"listening to the robot of {uri}"
    assert lines[1] == "ok   version: 1.2.0"
    assert "<robot" in urdf.read_text()[:2000]


def test_a_master_that_is_not_there_is_one_sentence(tmp_path: Path, plan_file: Path) -> None:
    for number, command in enumerate(
        [["sim.ros1.check"], ["sim.ros1.execute", str(plan_file)], ["sim.ros1.mirror"]]
    ):
        run = Command(tmp_path / f"{number}.log", *command, uri="http://127.0.0.1:9")
        assert run.status() == 1
        assert len(run.said.splitlines()) == 1, run.said
        assert "cannot reach the master at 127.0.0.1:9" in run.said
        assert "ROS_MASTER_URI says where the master is" in run.said
        assert "python -m sim.ros1.robot --own-master" in run.said


def test_a_robot_without_a_master_names_the_option_that_brings_one(tmp_path: Path) -> None:
    run = Command(tmp_path / "log", "sim.ros1.robot", uri="http://127.0.0.1:9")
    assert run.status() == 1
    assert len(run.said.splitlines()) == 1, run.said
    assert run.said.endswith("; without ROS, --own-master brings one\n")


@pytest.mark.parametrize("content", [None, "{}", '{"format": "baxter-kin response"}'])
def test_a_response_that_is_none_is_wrong_usage(
    plan_file: Path, tmp_path: Path, content: str | None
) -> None:
    response = tmp_path / "left.json"
    if content is not None:
        response.write_text(content)
    run = Command(tmp_path / "log", "sim.ros1.execute", str(plan_file), "--response", str(response))
    assert run.status() == 2, run.said
    assert len(run.said.splitlines()) == 1, run.said
    assert str(response) in run.said


def test_a_condition_that_does_not_hold_is_told_once(
    robot_process: tuple[Command, str], plan_file: Path, tmp_path: Path
) -> None:
    _, uri = robot_process
    press = Command(tmp_path / "press", "sim.ros1.press", "left", "estop", uri=uri)
    assert press.status() == 0, press.said
    for number, command in enumerate([["sim.ros1.check"], ["sim.ros1.execute", str(plan_file)]]):
        run = Command(tmp_path / f"{number}.log", *command, uri=uri)
        assert run.status() == 1, run.said
        assert run.said.count("emergency stop") == 1, run.said
        assert run.said.splitlines()[-1].endswith("a condition does not hold, see FAIL above")


@pytest.mark.parametrize(
    "arguments",
    [
        ["sim.ros1.execute", "nowhere.json"],
        ["sim.ros1.execute", __file__],
        ["sim.ros1.execute", "plan.json", "--speed", "2"],
        ["sim.ros1.execute", "plan.json", "--record", "a.txt"],
        ["sim.ros1.execute", "plan.json", "--lag-s", "0.5", "0.3"],
        ["sim.ros1.execute", "plan.json", "--settled-error-rad", "0.01"],
        ["sim.ros1.execute", "plan.json", "--despite-lag"],
        ["sim.ros1.execute", "plan.json", "--dry-run", "--csv", "a.csv"],
        ["sim.ros1.execute", "plan.json", "--dry-run", "--record", "a.mcap"],
        ["sim.ros1.check", "--output", "a.json"],
        ["sim.ros1.check", "--yes"],
        ["sim.ros1.mirror", "--port", "0"],
        ["sim.ros1.mirror", "--headless", "--port", "7000"],
        ["sim.ros1.mirror", "--headless", "--no-browser"],
    ],
)
def test_wrong_usage_is_told_in_a_sentence(tmp_path: Path, arguments: list[str]) -> None:
    run = Command(tmp_path / "log", *arguments)
    assert run.status() == 2
    assert len(run.said.splitlines()) == 1, run.said


def test_a_dry_run_sends_nothing(
    robot_process: tuple[Command, str], plan_file: Path, tmp_path: Path
) -> None:
    _, uri = robot_process
    run = Command(tmp_path / "log", "sim.ros1.execute", str(plan_file), "--dry-run", uri=uri)
    assert run.status() == 0, run.said
    assert "would move: left arm, 7 moves" in run.said
    assert run.said.count("not proven: how the arm lags (--response)\n") == 1
    assert "ok   state: ready, not enabled yet" in run.said
    assert "\nverifying the plan in the state that the robot reports: some seconds" in run.said
    again = Command(tmp_path / "again", "sim.ros1.check", uri=uri)
    assert again.status() == 0
    assert "not enabled yet" in again.said


def test_a_dry_run_with_a_response_does_not_call_the_lag_unproven(
    robot_process: tuple[Command, str], plan_file: Path, tmp_path: Path
) -> None:
    _, uri = robot_process
    known = "--lag-s", "0", "0.001"
    run = Command(
        tmp_path / "log", "sim.ros1.execute", str(plan_file), "--dry-run", *known, uri=uri
    )
    assert run.status(120.0) == 0, run.said
    assert "ok   tracking: clear wherever the lag leads" in run.said
    assert "not proven" not in run.said


def test_without_a_yes_it_does_not_move(
    robot_process: tuple[Command, str], plan_file: Path, tmp_path: Path
) -> None:
    _, uri = robot_process
    run = Command(tmp_path / "log", "sim.ros1.execute", str(plan_file), uri=uri)
    assert run.status() == 1
    assert run.said.splitlines()[-1].endswith(
        "not confirmed; nothing was moved, and the robot stays enabled"
    )


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


def test_an_execution_that_is_killed_is_told_of_by_the_robot_and_kept(
    moving: tuple[Command, Command, str], tmp_path: Path
) -> None:
    robot, command, _ = moving
    command.process.kill()
    robot.says("/baxter_kin is gone without having unregistered", SAID_S)
    assert read_recording(tmp_path / "kept.mcap").recording.samples


def test_a_second_execution_is_refused_and_the_first_goes_on(
    moving: tuple[Command, Command, str], plan_file: Path, tmp_path: Path
) -> None:
    _, first, uri = moving
    second = Command(tmp_path / "second.log", "sim.ros1.execute", str(plan_file), uri=uri)
    assert second.status() == 1, second.said
    assert f"/baxter_kin runs already, as process {first.process.pid}" in second.said
    assert first.process.poll() is None, first.said


def test_the_robot_ends_without_noise(robot_process: tuple[Command, str]) -> None:
    robot, _ = robot_process
    robot.process.send_signal(signal.SIGTERM)
    assert robot.status() == 143
    assert robot.said.splitlines()[-1] == "stopped; everything is unregistered"


def test_the_mirror_records_what_it_sees(
    robot_process: tuple[Command, str], tmp_path: Path
) -> None:
    _, uri = robot_process
    csv = tmp_path / "seen.csv"
    mirror = Command(
        tmp_path / "log",
        *("sim.ros1.mirror", "--headless", "--csv", str(csv), "--duration-s", "1"),
        uri=uri,
    )
    assert mirror.status() == 0, mirror.said
    rows = csv.read_text().splitlines()
    assert 30 <= len(rows) <= 55


def test_the_mirror_is_served_where_it_is_asked_to_be(
    robot_process: tuple[Command, str], tmp_path: Path
) -> None:
    _, uri = robot_process
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    options = "--no-browser", "--port", str(port), "--duration-s", "1"
    mirror = Command(tmp_path / "log", "sim.ros1.mirror", *options, uri=uri)
    assert mirror.status() == 0, mirror.said
    assert f"open http://127.0.0.1:{port}/ in a browser to watch\n" in mirror.said
