"""Comparing records: what differs is named, and nothing else is."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Any

import pytest

golden_outputs: Any = importlib.import_module("golden_outputs")

RECORD = {"steps": [{"label": "pick: approach", "q": [0.5, 1e-3]}], "failure": None}


def _folder(top: Path, name: str, record: object) -> Path:
    folder = top / name / "plans"
    folder.mkdir(parents=True)
    (folder / "plain_0.json").write_text(json.dumps(record))
    return top / name


def _compare(top: Path, changed: object, *options: str) -> int:
    before, after = _folder(top, "before", RECORD), _folder(top, "after", changed)
    return int(golden_outputs.main(["compare", str(before), str(after), *options]))


def test_equal_records_have_no_differences(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _compare(tmp_path, RECORD) == 0
    assert capsys.readouterr().out == "1 files compared, 0 differences\n"


@pytest.mark.parametrize(
    ("changed", "at"),
    [
        (RECORD | {"failure": "blocked"}, "plans/plain_0.failure"),
        (RECORD | {"more": 1}, "plans/plain_0.more"),
        (RECORD | {"steps": []}, "plans/plain_0.steps"),
        (
            RECORD | {"steps": [{"label": "pick: approach", "q": [0.5 + 1e-8, 1e-3]}]},
            "plans/plain_0.steps.0.q.0",
        ),
    ],
)
def test_a_difference_is_named_by_its_path(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changed: object, at: str
) -> None:
    assert _compare(tmp_path, changed) == 1
    assert capsys.readouterr().out.startswith(f"{at}: ")


def test_differences_within_the_tolerance_or_ignored_do_not_count(tmp_path: Path) -> None:
    changed = RECORD | {"steps": [{"label": "pick: approach", "q": [0.5 + 1e-11, 1e-3]}], "new": 1}
    assert _compare(tmp_path, changed, "--ignore", "*.new") == 0


def test_nothing_to_compare_is_a_failure(tmp_path: Path) -> None:
    assert golden_outputs.main(["compare", str(tmp_path / "a"), str(tmp_path / "b")]) == 1


@pytest.mark.slow
def test_a_plan_is_recorded_with_its_certificate(tmp_path: Path) -> None:
    golden_outputs._record_one(("plans", "plain", 0, str(tmp_path)))
    found = json.loads((tmp_path / "plans" / "plain_0.json").read_text())
    assert found["failure"] == "None"
    assert found["certificate"]["is_valid"]
    assert [len(step["trajectory"]["q"][0]) for step in found["steps"] if "trajectory" in step] == [
        7
    ] * 6
