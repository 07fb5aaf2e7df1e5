"""The fuzzing script: what it finds to call, how it judges, and one small run of all of it."""

from __future__ import annotations

import importlib
import os
import signal
import time
from pathlib import Path
from typing import Any

import pytest

from baxter_kin import BaxterError
from baxter_kin.errors import RequestError
from tests.front_doors import FRONT_DOORS

fuzz: Any = importlib.import_module("fuzz")
targets: Any = importlib.import_module("fuzzing.targets")
values: Any = importlib.import_module("fuzzing.values")


def judged(function: Any, **given: Any) -> str:
    kind, fault = fuzz.judged(fuzz.Call(function, (), given, "a call"))
    assert bool(fault) == kind.startswith("other")
    return str(kind).partition(":")[0]


def test_every_public_class_and_function_is_called() -> None:
    found = targets.all_targets()
    names, called = {target.name for target in found}, {id(each.function) for each in found}
    for package in FRONT_DOORS:
        for name in package.__all__:
            thing = getattr(package, name)
            if callable(thing) and not isinstance(thing, type):  # at two doors, called at one
                assert id(thing) in called, name
    assert {"planner.Scene.moved", "baxter_kin.IKService.solve", "sim.read_recording"} <= names


def test_every_parameter_and_receiver_has_a_valid_value() -> None:
    for target in targets.all_targets():
        values.receivers(target)
        for parameter in target.parameters:
            values.valid(target.name, parameter)


def test_the_same_number_makes_the_same_calls() -> None:
    (target,) = targets.all_targets("baxter_kin.JointLimits.scaled")
    first, again, other = list[str](), list[str](), list[str]()
    for number, texts in ((5, first), (5, again), (6, other)):
        fuzz.drawn(target, 20, number, lambda call, texts=texts: texts.append(call.text))
    assert first == again != other
    assert any("<valid>" not in text for text in first)


def refuse(message: str) -> None:
    raise RequestError(message)


def fail(value: int) -> float:
    return 1 / value


def late() -> Any:
    yield 1
    raise BaxterError("late")


@pytest.mark.parametrize(
    ("function", "given", "kind"),
    [
        (lambda: 5, {}, "returned"),
        (refuse, {"message": "no"}, "refused"),
        (refuse, {"message": "x" * 201}, "other"),
        (refuse, {"message": "no " * 2_000}, "other"),
        (refuse, {"message": "\ud800"}, "other"),
        (refuse, {}, "TypeError at the call"),
        (refuse, {"message": "no", "surprise": 5}, "TypeError at the call"),
        (fail, {"value": 0}, "other"),
        (fail, {"value": None}, "other"),
        (late, {}, "refused"),
    ],
    ids=lambda value: getattr(value, "__name__", None) or ascii(value)[:40],
)
def test_calls_are_judged_and_what_is_returned_is_read(
    function: Any, given: dict[str, Any], kind: str
) -> None:
    assert judged(function, **given) == kind


@pytest.mark.slow
def test_a_small_run_finds_no_fault(capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--count", "150", "--jobs", "1", "--only", "baxter_kin.J"]
    status = fuzz.main(options)
    said = capsys.readouterr().out
    assert status == 0, said
    assert "| returned |" in said
    assert "| refused: " in said


def work_badly(there: Any, names: list[str], each: int, number: int, folder: Path) -> None:
    """Report as a worker does, but die at target b, compute for ever at d and sleep at e."""
    for name in names:
        there.send(("target", name))
        there.send(("call", name))
        if name == "b":
            os._exit(3)
        if name in "de":
            fuzz.limit(0.01)
            signal.alarm(1 if name == "e" else 600)
        while name == "d":
            pass
        while name == "e":
            time.sleep(600.0)
        there.send(("report", fuzz.Report("returned", name)))


@pytest.mark.slow
def test_what_crashes_and_what_hangs_is_told_and_the_rest_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2] / "scripts"), prepend=":")
    reports = list(fuzz.run("abcdef", 1, 0, tmp_path, work_badly))
    assert [report.call for report in reports] == list("abcdef")
    kinds = ["returned", "crash", "returned", "hang", "standstill", "returned"]
    assert [report.kind for report in reports] == kinds
