"""The rows of Baxter's interface that are measured in a moment."""

from __future__ import annotations

import importlib

measure = importlib.import_module("measure_ros1")


def test_every_definition_has_the_sum_of_the_original() -> None:
    rows = list(measure.sums(0.0))
    assert len(rows) == 20
    assert all(row.is_met for row in rows), [row.what for row in rows if not row.is_met]


def test_a_row_shows_its_verdict() -> None:
    assert str(measure.Row("rate", "100 Hz", "12 Hz", False)) == "| rate | 100 Hz | 12 Hz | FAIL |"
    row = measure.Row("/robot/state", "100 Hz", "100 Hz", True, "std_msgs/Bool", "R->C")
    assert str(row) == "| /robot/state | std_msgs/Bool | R->C | 100 Hz | 100 Hz | pass |"
