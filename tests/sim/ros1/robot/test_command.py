"""The command, as a process of its own: begins, says so, and ends clean however it is ended."""

from __future__ import annotations

import os
import re
import selectors
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from baxter_kin.command_line import parse
from sim import read_recording
from sim.ros1 import press
from sim.ros1.master import Master
from sim.ros1.node import Node
from sim.ros1.robot.__main__ import TERMINAL, RobotOptions
from sim.ros1.robot.ros_robot import NAME
from tests.sim.ros1.processes import until
from tests.sim.ros1.robot.client import CORE, Client

READY_S, ENDED_S = 60.0, 30.0
"""How long a process may take where several tests share a slow computer."""


class Started:
    """A simulated Baxter that is ready."""

    def __init__(self, process: subprocess.Popen[str], line: str) -> None:
        self.process, self.line = process, line

    @property
    def uri(self) -> str:
        found = re.search(r"ROS_MASTER_URI=(\S+)", self.line)
        assert found is not None
        return found[1]

    def end(self, number: int) -> int:
        """Send a signal; its exit status."""
        self.process.send_signal(number)
        return self.process.wait(ENDED_S)


@contextmanager
def started(*options: str, uri: str = "", ignores_sigint: bool = False) -> Iterator[Started]:
    environment = {k: v for k, v in os.environ.items() if not k.startswith("ROS_")}
    environment |= {"ROS_MASTER_URI": uri} if uri else {}
    command = [sys.executable, "-m", "sim.ros1.robot", *options]
    if ignores_sigint:  # as a shell does to jobs in the background
        command = ["sh", "-c", 'trap "" INT; exec "$@"', "sh", *command]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )
    assert process.stdout is not None
    try:
        with selectors.DefaultSelector() as selector:
            selector.register(process.stdout, selectors.EVENT_READ)
            assert selector.select(READY_S), "it does not get ready"
        line = ""
        while not line.startswith("ready:"):
            line = process.stdout.readline()
            assert line, process.stderr and process.stderr.read()
        yield Started(process, line)
    finally:
        process.kill()
        process.communicate()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "ignores_sigint", "status"),
    [(signal.SIGINT, False, 130), (signal.SIGTERM, False, 143), (signal.SIGINT, True, 130)],
)
def test_a_signal_ends_it_with_everything_unregistered(
    number: int, ignores_sigint: bool, status: int
) -> None:
    with (
        Master(port=0) as master,
        started(uri=master.uri, ignores_sigint=ignores_sigint) as robot,
        Node("/client", master_uri=master.uri) as node,
    ):
        assert robot.uri == master.uri
        assert NAME in node.nodes()
        assert robot.end(number) == status
        assert node.nodes() == ("/client",)
        assert not node.has_parameter("/robot_description")


@pytest.mark.slow
def test_it_ends_with_status_1_when_another_takes_its_name() -> None:
    with (
        started("--own-master", "--port", "0") as robot,
        Node(NAME, master_uri=robot.uri),
    ):
        assert robot.process.wait(ENDED_S) == 1
        assert robot.process.stderr is not None
        assert "registered" in robot.process.stderr.read()


@pytest.mark.slow
def test_its_options_are_seen_on_the_network_and_in_the_record(tmp_path: Path) -> None:
    record = tmp_path / "all.mcap"
    options = ["--own-master", "--port", "0", "--follow", "lag", "--lag-s", "0.2"]
    options += ["--side-effects", "none"]
    with (
        started(*options, "--table", "--block", "--uncalibrated", "--record", str(record)) as robot,
        Node("/client", master_uri=robot.uri) as node,
    ):
        client = Client(node)
        assert "(lag 0.2 s, no Gazebo's services, cafe_table, block)" in robot.line
        assert client.gripper().calibrated == 0
        assert node.publishers_of("/robot/sim/started") == ()
        until(lambda: client.joints()["left_s1"] == 1.047)  # as Gazebo begins
        assert robot.end(signal.SIGTERM) == 143
    recording = read_recording(record).recording
    assert [event.text for event in recording.events] == [
        "cafe_table spawned",
        "block spawned, at rest on cafe_table",
    ]
    assert len(recording.times_s) > 10


@pytest.mark.slow
def test_buttons_are_pressed_by_a_command_of_its_own(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with (
        started("--own-master", "--port", "0", "--tucked") as robot,
        Node("/client", master_uri=robot.uri) as node,
    ):
        client = Client(node)
        monkeypatch.setenv("ROS_MASTER_URI", robot.uri)
        assert press.main(["left", "estop"]) == 0
        client.until("/robot/state", f"{CORE}/AssemblyState", lambda m: m.estop_button == 1)
        assert client.joints("right")["right_s1"] == -2.175
    with Master(port=0) as master:
        monkeypatch.setenv("ROS_MASTER_URI", master.uri)
        monkeypatch.setattr("sim.ros1.press.CONNECTED_S", 0.05)
        assert press.main(["left", "ok"]) == 1
        assert "no simulated Baxter listens to /robot/sim/press" in capsys.readouterr().err
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:1")
    assert press.main(["left", "ok"]) == 1
    assert "cannot reach the master" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--follow", "loosely"], "--follow"),
        (["--lag-s", "0"], "0 is not from 0.001 to 10 s"),
        (["--lag-s", "0.4"], "--lag-s goes with --follow lag; give both"),
        (["--port", "65536"], "65536 is not from 0 to 65535"),
        (["--record", "x.txt"], "must end in one of"),
        (["--side-effects", "all"], "--side-effects"),
    ],
)
def test_wrong_usage_is_one_sentence_and_status_2(
    options: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        parse(RobotOptions, options)
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_its_defaults(capsys: pytest.CaptureFixture[str]) -> None:
    options = parse(RobotOptions, [])
    assert (options.lags, options.lag_s, options.has_side_effects) == (False, 0.4, True)
    assert (options.has_own_master, options.port, options.host) == (False, 11311, None)
    assert not options.is_uncalibrated
    with pytest.raises(SystemExit):
        parse(RobotOptions, ["--help"])
    assert TERMINAL.name in capsys.readouterr().out
