from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.benchmark.command import BenchmarkOptions
from baxter_kin.benchmark.measurement import Verifier, measure
from baxter_kin.benchmark.poses import PoseSet
from baxter_kin.benchmark.report import (
    BATCH_COLUMNS,
    COLUMNS,
    BenchmarkOutcome,
    Machine,
    markdown,
    percent,
    three_digits,
)
from baxter_kin.benchmark.solvers import Absence
from tests.baxter_kin.benchmark.conftest import COUNT
from tests.baxter_kin.benchmark.test_measurement import fake, raising


def test_table_has_every_column(outcome: BenchmarkOutcome) -> None:
    lines = markdown(outcome).splitlines()
    for columns in (COLUMNS, BATCH_COLUMNS):
        assert "| " + " | ".join(columns) + " |" in lines
    row = next(line for line in lines if line.startswith("| baxter-kin |"))
    assert row.count("|") == len(COLUMNS) + 1
    assert "100 % | 100 %" in row


def test_table_names_machine_arms_and_settings(outcome: BenchmarkOutcome) -> None:
    text = markdown(outcome)
    assert text.startswith(f"Measured on {outcome.machine.cpu}")
    for word in ("Left arm", "Right arm", "CPython", "numpy", "`IKService.solve`", "Pinocchio"):
        assert word in text


def test_json_has_a_number_for_every_pose(numbers: Any) -> None:
    assert [row["limb"] for row in numbers["measurements"]] == ["left", "right"]
    for row in numbers["measurements"]:
        for key in ("times_ms", "is_solved", "position_errors_m", "orientation_errors_rad"):
            assert len(row[key]) == COUNT


def test_json_names_the_arm_of_a_batch_once(numbers: Any) -> None:
    for row in numbers["batches"]:
        assert row["limb"] in {"left", "right"}
        assert "side" not in row


@pytest.mark.parametrize(
    ("ratio", "text"),
    [(1.0, "100 %"), (0.99999, "99.99 %"), (0.9935, "99.35 %"), (0.57, "57.00 %"), (0.0, "0.00 %")],
)
def test_only_all_is_100_per_cent(ratio: float, text: str) -> None:
    assert percent(ratio) == text


@pytest.mark.parametrize(
    ("number", "text"),
    [(0.003712, "0.00371"), (0.287, "0.287"), (12.34, "12.3"), (1234.5, "1,234")],
)
def test_times_have_three_digits(number: float, text: str) -> None:
    assert three_digits(number) == text


def test_table_lists_an_absent_package_once_and_every_complaint(
    poses: PoseSet, verifier: Verifier
) -> None:
    bad = fake(poses, raising)
    absences = [Absence("a", "x is not installed"), Absence("b", "x is not installed")]
    options = BenchmarkOptions(solvers=("bad",), count=len(poses))
    rows = measure({"bad": bad}, poses, verifier)
    text = markdown(BenchmarkOutcome(options, Machine.this(), {"bad": bad}, absences, rows, []))
    assert text.count("Not measured: x is not installed.") == 1
    assert f"{len(poses)} calls raised ZeroDivisionError: no luck." in text


def test_what_is_infinite_is_null_in_json(
    poses: PoseSet, verifier: Verifier, tmp_path: Path
) -> None:
    bad = fake(poses, lambda _: None)
    options = BenchmarkOptions(solvers=("bad",), count=len(poses))
    rows = measure({"bad": bad}, poses, verifier)
    BenchmarkOutcome(options, Machine.this(), {"bad": bad}, [], rows, []).write(tmp_path / "a.json")
    (row,) = json.loads((tmp_path / "a.json").read_text("utf-8"))["measurements"]
    assert row["position_errors_m"] == row["orientation_errors_rad"] == [None] * len(poses)
    assert not any(row["is_solved"])


@given(st.floats(0.0, 1.0))
def test_a_rate_is_never_rounded_up(ratio: float) -> None:
    rounding = 1e-8
    assert float(percent(ratio).removesuffix(" %")) <= 100.0 * (ratio + rounding)
