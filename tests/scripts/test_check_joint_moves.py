"""Random motions between moving states, as `scripts/check_joint_moves.py` judges them."""

from __future__ import annotations

import importlib
from typing import Any

import pytest


def test_no_plan_between_moving_states_is_slower_than_it_has_to_be(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    script: Any = importlib.import_module("check_joint_moves")
    monkeypatch.setattr("sys.argv", ["check_joint_moves.py", "--count", "500", "--seed", "33"])
    assert script.main() == 0, capsys.readouterr().out
