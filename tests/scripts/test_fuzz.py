"""The fuzzing script: what it finds to call, how it judges, and one small run of all of it."""

from __future__ import annotations

import importlib
import os
from pathlib import Path
from typing import Any

import pytest

from baxter_kin import BaxterError
from baxter_kin.errors import RequestError
from tests.front_doors import FRONT_DOORS


def module(name: str) -> Any:
    return importlib.import_module(f"fuzzing.{name}")


def made(function: Any, **given: Any) -> Any:
    calls = module("calls")
    return calls.made(calls.Prepared(function, (), given))


def test_every_public_class_and_function_is_called() -> None:
    targets = module("targets").all_targets()
    names, called = {target.name for target in targets}, {id(t.function) for t in targets}
    for package in FRONT_DOORS:
        for name in package.__all__:
            thing = getattr(package, name)
            if callable(thing) and not isinstance(thing, type):  # at two doors, called at one
                assert id(thing) in called, name
    assert {"planner.Scene.moved", "baxter_kin.IKService.solve", "sim.read_recording"} <= names


def test_every_parameter_has_a_valid_value(tmp_path: Path) -> None:
    stage = module("stage").Stage(tmp_path)
    for target in module("targets").all_targets():
        for parameter in target.parameters:
            module("values").valid_value(target, parameter, stage)


def test_the_same_number_makes_the_same_call() -> None:
    targets, chosen = module("targets").all_targets(), module("calls").chosen
    first, again = ([str(chosen(targets, 5, number)) for number in range(50)] for _ in range(2))
    assert first == again
    assert len(set(first)) > 40


def refuse(message: str) -> None:
    raise RequestError(message)


def fail(value: int) -> float:
    return 1 / value


@pytest.mark.parametrize(
    ("function", "given", "verdict"),
    [
        (lambda: 5, {}, "RETURNED"),
        (refuse, {"message": "no"}, "REFUSED"),
        (refuse, {"message": "x" * 201}, "OTHER"),
        (refuse, {"message": "no " * 2_000}, "OTHER"),
        (refuse, {"message": "\ud800"}, "OTHER"),
        (refuse, {}, "NOT_CALLED"),
        (refuse, {"message": "no", "surprise": 5}, "NOT_CALLED"),
        (fail, {"value": 0}, "OTHER"),
        (fail, {"value": None}, "OTHER"),
    ],
    ids=lambda value: getattr(value, "__name__", None) or ascii(value)[:40],
)
def test_calls_are_judged(function: Any, given: dict[str, Any], verdict: str) -> None:
    assert made(function, **given).verdict.name == verdict


def test_what_is_returned_is_read() -> None:
    def read() -> Any:
        yield 1
        raise BaxterError("late")

    assert made(read).verdict.name == "REFUSED"


def test_a_small_run_finds_no_fault(capsys: pytest.CaptureFixture[str]) -> None:
    script = importlib.import_module("fuzz")
    options = ["--count", "150", "--jobs", "1", "--only", "baxter_kin"]
    status = script.main(options)
    said = capsys.readouterr().out
    assert status == 0, said
    assert "150 calls" in said
    assert "| returned |" in said


def work_badly(there: Any, numbers: range, seed: int, only: str, folder: Path) -> None:
    """Answer as a worker does, but die at call 2 and go round in circles at call 4."""
    for number in numbers:
        there.send(None)
        if number == 2:
            os._exit(3)
        while number == 4:
            pass
        outcome = module("calls").Outcome(module("calls").Verdict.RETURNED)
        there.send(module("workers").Report(number, outcome))


def test_what_crashes_and_what_hangs_is_told_and_the_rest_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    workers = module("workers")
    monkeypatch.setattr(workers, "LIMIT_S", 0.3)
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2] / "scripts"), prepend=":")
    reports = list(workers.run(range(6), 0, "", tmp_path, work_badly))
    assert [report.number for report in reports] == list(range(6))
    assert [report.fault for report in reports] == ["", "", "crash", "", "hang", ""]
