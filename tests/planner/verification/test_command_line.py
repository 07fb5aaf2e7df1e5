"""`python -m planner.verification`: exit statuses, and one sentence for each error."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from baxter_kin.fields import evolve
from planner import (
    Manipulator,
    Move,
    Plan,
    PlanFailure,
    Response,
    Scene,
    State,
    plan_joint_move,
    save_plan,
    verify,
)
from planner.errors import TaskError
from planner.motion.response import save_response
from planner.verification.command_line import main


@pytest.fixture(scope="module")
def plan(manipulator: Manipulator, scene: Scene) -> Plan:
    start = manipulator.arm.neutral
    goal = start + 0.1
    move = Move("reach out", plan_joint_move(start, goal, manipulator.limits))
    return Plan(State.of(manipulator, scene, q=start), (move,))


@pytest.fixture
def good(plan: Plan, tmp_path: Path) -> str:
    save_plan(plan, tmp_path / "good.json")
    return str(tmp_path / "good.json")


@pytest.fixture
def bad(plan: Plan, tmp_path: Path) -> str:
    save_plan(evolve(plan, failure=PlanFailure("grasp", "too wide")), tmp_path / "bad.json")
    return str(tmp_path / "bad.json")


def test_a_file_name_is_refused_with_a_hint_to_load_plan(good: str) -> None:
    with pytest.raises(TaskError, match="load_plan reads a file"):
        verify(good)  # type: ignore[arg-type]


def test_a_valid_plan_exits_with_0(good: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([good]) == 0
    said = capsys.readouterr()
    assert said.out.endswith("\nvalid\n")
    assert not said.err


def test_an_invalid_plan_exits_with_1_and_the_reason(
    bad: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([bad]) == 1
    said = capsys.readouterr()
    assert said.out.endswith("\nnot valid\n")
    assert said.err.startswith(f"{bad}: not valid: ")
    assert "FAILS  failed steps" in said.out
    assert "grasp: too wide" in said.err
    assert len(said.err.splitlines()) == 1


def test_quiet_prints_only_failures(
    good: str, bad: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (main([good, "-q"]), main([bad, "-q"])) == (0, 1)
    said = capsys.readouterr()
    assert not said.out
    assert len(said.err.splitlines()) == 1


def test_json_is_the_certificate(bad: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([bad, "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert data["is_valid"] is False
    assert data["checks"][0]["name"] == "failed steps"


def test_straight_adds_a_move_to_judge_as_straight(
    good: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([good, "-q", "--straight", "reach out"]) == 1
    assert "off its way" in capsys.readouterr().err


def test_acceleration_and_jerk_set_the_limits(
    plan: Plan, manipulator: Manipulator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    harder = evolve(manipulator.limits, a_max=np.full(7, 3.0), j_max=np.full(7, 30.0))
    fast = plan_joint_move(plan.q_start, plan.q_start + 0.1, harder)
    save_plan(evolve(plan, steps=(Move("reach out", fast),)), tmp_path / "fast.json")
    assert main([str(tmp_path / "fast.json")]) == 1
    assert "reach out: acceleration beyond its limit" in capsys.readouterr().err
    limits = ["--acceleration", "3", "--jerk", "30"]
    assert main([str(tmp_path / "fast.json"), *limits]) == 0
    assert "\njudged by 3 rad/s^2 and 30 rad/s^3, " in capsys.readouterr().out
    assert main([str(tmp_path / "fast.json"), "--jerk", "-1"]) == 2
    assert "j_max of left_s0 must be" in capsys.readouterr().err


def test_limits_selects_a_preset(
    plan: Plan, manipulator: Manipulator, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    harder = manipulator.limits.preset("torque-control")
    fast = plan_joint_move(plan.q_start, plan.q_start + 0.1, harder)
    file = str(tmp_path / "fast.json")
    save_plan(evolve(plan, steps=(Move("reach out", fast),)), file)
    assert main([file]) == main([file, "--limits", "safe"]) == 1
    assert "reach out: jerk beyond its limit" in capsys.readouterr().err
    assert main([file, "--limits", "torque-control"]) == 0
    assert "\njudged by 2 .. 8 rad/s^2 and 40 rad/s^3, " in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main([file, "--limits", "safe", "--jerk", "3"])
    assert "--limits sets acceleration and jerk" in capsys.readouterr().err


def test_response_adds_checks_of_an_arm_that_lags(
    good: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = str(tmp_path / "left.json")
    save_response(Response((0.1, 0.2)), "left", file)
    assert main([good, "--json"]) == 0
    without = json.loads(capsys.readouterr().out)["checks"]
    for speed in ([], ["--speed", "0.3"]):
        assert main([good, "--json", "--response", file, *speed]) == 0
        assert len(json.loads(capsys.readouterr().out)["checks"]) > len(without)
    save_response(Response((0.1, 0.2)), "right", file)
    assert main([good, "--response", file]) == 2
    assert "are of right, and the plan is of left" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([good, "--speed", "0.3"])
    assert "give --response FILE, too" in capsys.readouterr().err


@pytest.mark.parametrize("content", [b"", b"\xff\xfe"])
def test_a_file_without_a_plan_exits_with_2_and_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: bytes
) -> None:
    file = tmp_path / "noise"
    file.write_bytes(content)
    assert main([str(file)]) == 2
    said = capsys.readouterr()
    assert not said.out
    assert len(said.err.splitlines()) == 1
    assert str(file) in said.err


@pytest.mark.parametrize("arguments", [[], ["a", "b"], ["a", "--js"], ["a", "--straight"]])
def test_wrong_usage_exits_with_2_and_one_sentence(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as exit_:
        main(arguments)
    assert exit_.value.code == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.slow
def test_the_module_runs_as_a_program(good: str) -> None:
    runs = [
        subprocess.run(
            [sys.executable, "-m", "planner.verification", *arguments],
            capture_output=True,
            text=True,
            check=False,
        )
        for arguments in ([good], ["missing.json"])
    ]
    assert [run.returncode for run in runs] == [0, 2]
    assert runs[0].stdout.endswith("\nvalid\n")
    assert runs[1].stderr == (
        "planner.verification: missing.json: cannot be read: No such file or directory\n"
    )


def test_a_program_that_is_interrupted_exits_with_130(tmp_path: Path) -> None:
    code = (
        "import os, signal, sys\n"
        "from planner.verification import command_line\n"
        "from baxter_kin.command_line import run_process\n"
        "command_line.verify = lambda *_, **__: os.kill(os.getpid(), signal.SIGINT)\n"
        "command_line.load_any_plan = lambda _: None\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)  # background jobs ignore it\n"
        "sys.argv = ['verification', 'plan.json']\n"
        "run_process(command_line.main, 'verification', failed=2)\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (130, "stopped by Ctrl-C\n")
