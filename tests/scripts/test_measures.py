"""Short runs of the scripts that measure."""

from __future__ import annotations

import importlib
import re
from typing import Any

import numpy as np
import pytest

handovers: Any = importlib.import_module("measure_handovers")
motion: Any = importlib.import_module("measure_motion")
ros1: Any = importlib.import_module("measure_ros1")
ros1_both: Any = importlib.import_module("measure_ros1_both")
together: Any = importlib.import_module("measure_together")


def printed(capsys: pytest.CaptureFixture[str], words: str) -> str:
    assert motion.main(words.split()) == 0
    return capsys.readouterr().out


@pytest.mark.slow
def test_a_task_is_planned_verified_and_compared(capsys: pytest.CaptureFixture[str]) -> None:
    said = printed(capsys, "cycles --count 1")
    assert "1 of 1 tasks have plans" in said
    ratio = re.search(r"over the optimum: median (\S+),", said)
    assert ratio is not None
    assert 0.99 < float(ratio[1]) < 1.01


@pytest.mark.slow
def test_both_arms_take_as_long_as_the_slower_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert together.main(["--count", "1", "--kinds", "plain"]) == 0
    said = capsys.readouterr().out
    assert "plain: 1 pairs, 1 at once, 0 in turn, 0 refused" in said
    assert "the referee contradicts 0 of 1 plans" in said


@pytest.mark.slow
def test_a_handover_is_certified_executed_and_judged(capsys: pytest.CaptureFixture[str]) -> None:
    assert handovers.main(["--count", "1", "--kinds", "stick"]) == 0
    said = capsys.readouterr().out
    assert "1 of 1 planned, 1 certified, 1 executed, 0 contradicted" in said


@pytest.mark.campaign
def test_plans_around_the_wall_keep_clear_of_it(capsys: pytest.CaptureFixture[str]) -> None:
    clear_mm = [float(x) for x in re.findall(r"(\S+) mm clear", printed(capsys, "cycles --wall"))]
    assert len(clear_mm) == 2
    assert min(clear_mm) >= 2.0


@pytest.mark.slow
def test_a_line_takes_no_longer_than_by_other_means(capsys: pytest.CaptureFixture[str]) -> None:
    said = printed(capsys, "lines --count 1 --segments 100")
    norm, finer = (float(x) for x in re.findall(r"worst (\S+),", said))
    assert norm < 1.01
    assert 0.99 < finer < 1.01


def test_every_definition_of_ros_has_the_sum_of_the_original() -> None:
    rows = list(ros1.sums(0.0))
    assert len(rows) == 20
    assert all(row.is_met for row in rows), [row.what for row in rows if not row.is_met]


def test_a_row_shows_its_verdict() -> None:
    assert str(ros1.Row("rate", "100 Hz", "12 Hz", False)) == "| rate | 100 Hz | 12 Hz | FAIL |"
    row = ros1.Row("/robot/state", "100 Hz", "100 Hz", True, "std_msgs/Bool", "R->C")
    assert str(row) == "| /robot/state | std_msgs/Bool | R->C | 100 Hz | 100 Hz | pass |"


def test_an_arm_stands_from_its_last_set_point_that_differs() -> None:
    sent = [(0.0, 0.1), (0.01, 0.2), (0.02, 0.2), (0.03, 0.2)]
    heard = [
        ros1_both.Heard(time_s + late_s, side, (q, 0.0))
        for side, late_s in (("left", 0.0), ("right", 0.005))
        for time_s, q in sent
    ]
    assert [ros1_both._stands_s(heard, side) for side in ("left", "right")] == [0.01, 0.015]
    assert ros1_both.spread(np.array([-0.001, 0.001])) == "p50 1.00, p99 1.00, max 1.00 ms"
