"""Random picks and places, as `scripts/measure_cycles.py` measures them."""

from __future__ import annotations

import importlib
import re
from typing import Any

import pytest


@pytest.fixture(scope="module")
def script() -> Any:
    return importlib.import_module("measure_cycles")


def test_a_task_is_planned_verified_and_compared(
    script: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["measure_cycles.py", "--count", "1"])
    assert script.main() == 0
    said = capsys.readouterr().out
    assert "1 of 1 tasks have plans" in said
    ratio = re.search(r"over the optimum: median (\S+),", said)
    assert ratio is not None
    assert 0.99 < float(ratio[1]) < 1.01


def test_plans_around_the_wall_keep_clear_of_it(
    script: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["measure_cycles.py", "--wall"])
    assert script.main() == 0
    clear_mm = [float(x) for x in re.findall(r"(\S+) mm clear", capsys.readouterr().out)]
    assert len(clear_mm) == 2
    assert min(clear_mm) >= 2.0
