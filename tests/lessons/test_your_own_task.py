"""The checks of notebook 5: every right answer passes, typical mistakes get their sentence."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter, pose_from_quaternion
from lessons.your_own_task import (
    BACK_BASE,
    TOWER,
    check_file,
    check_tower,
    check_way_back,
)
from planner import (
    Manipulator,
    PickAndPlace,
    Plan,
    Scene,
    load_object,
    make_block,
    plan_pick_and_place,
    save_plan,
)
from sim import Workbench, write_csv
from tests.lessons.told import assert_told

UPRIGHT, DOWN = (0.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0)
ROBOT = Baxter.load()
ON_BLUE = (0.70, -0.06, -0.08)


def bench_with(*names: str) -> Workbench:
    bench = Workbench(ROBOT)
    for name, y in zip(names, (0.0, 0.15, -0.15), strict=False):
        bench.add_block(name, 0.70, y)
    return bench


def stacked(bench: Workbench, order: Sequence[str]) -> Workbench:
    for below, above in pairwise(order):
        on_top = np.add(bench.world.body(below).T_base_body.translation, [0.0, 0.0, 0.05])
        bench.world.place_body(above, pose_from_quaternion(on_top, UPRIGHT))
    return bench


def test_a_tower_is_right() -> None:
    assert check_tower(stacked(bench_with(*TOWER), TOWER)).is_right
    assert_told(check_tower("red, green, blue"), "should be a Workbench")


def test_wrong_towers_are_explained() -> None:
    assert_told(check_tower(bench_with("red", "green")), "lacks a block named blue")
    assert_told(check_tower(bench_with(*TOWER)), "green stands on table, .* stand on red")
    upside_down = stacked(bench_with(*TOWER), TOWER[::-1])
    assert_told(check_tower(upside_down), "red stands on green, .* on table")


def test_what_was_refused_is_told_again() -> None:
    bench = stacked(bench_with(*TOWER), TOWER[:2])
    bench.carry("red", onto="blue")
    assert_told(check_tower(bench), "blue stands on table, .*; carry red: refused: green stands on")


def planned(
    goal: tuple[float, float, float] = BACK_BASE,
    start: tuple[float, float, float] = ON_BLUE,
    ratio: float = 0.25,
) -> Plan:
    table = load_object("table", pose_from_quaternion((1.0, 0.0, -0.93), UPRIGHT))
    bodies = [table, make_block("red", pose_from_quaternion(start, UPRIGHT))]
    if start == ON_BLUE:
        bodies.append(make_block("blue", pose_from_quaternion((0.70, -0.06, -0.13), UPRIGHT)))
    task = PickAndPlace("red", pose_from_quaternion(start, DOWN), pose_from_quaternion(goal, DOWN))
    hand = Manipulator.of(ROBOT, "left", speed_ratio=ratio)
    return plan_pick_and_place(task, hand, Scene.of(bodies), ROBOT.arm("left").neutral)


@pytest.fixture(scope="module")
def slow() -> Plan:
    return planned()


@pytest.fixture(scope="module")
def fast() -> Plan:
    return planned(ratio=1.0)


def test_a_slow_way_back_is_right_and_so_is_a_slower_one(slow: Plan) -> None:
    assert check_way_back(slow).is_right
    assert check_way_back(planned(ratio=0.2)).is_right


@pytest.mark.slow
def test_a_wrong_way_back_is_explained(fast: Plan) -> None:
    assert_told(check_way_back(fast), r"velocity limit; .*speed_ratio=0\.25")
    assert_told(check_way_back(planned((0.70, 0.27, -0.3))), "refused: place")
    assert_told(check_way_back(planned((0.70, 0.20, -0.13))), r"not to \(0\.700, 0\.270, -0\.130\)")
    first = planned(start=(0.70, 0.10, -0.13))
    assert_told(check_way_back(first), "stands on the table at first")
    assert_told(check_way_back(0.25), "should be a Plan")


def test_a_slow_file_is_right_with_and_without_dwells(slow: Plan, tmp_path: Path) -> None:
    for dwell_s in (0.0, 1.0):
        write_csv(slow, tmp_path / "slow.csv", dwell_s=dwell_s)
        assert check_file(tmp_path / "slow.csv").is_right
        assert check_file(str(tmp_path / "slow.csv")).is_right


def test_a_wrong_file_is_explained(slow: Plan, fast: Plan, tmp_path: Path) -> None:
    write_csv(fast, tmp_path / "fast.csv")
    save_plan(slow, tmp_path / "slow.json")
    (tmp_path / "odd.csv").write_text("time\n")
    answers: dict[Any, str] = {
        tmp_path / "fast.csv": "of the left arm goes up to .* write the slow plan",
        tmp_path / "slow.json": "write_csv",
        tmp_path / "none.csv": "there is no file",
        tmp_path / "odd.csv": "odd",
        3: "the name of a file",
    }
    for answer, told in answers.items():
        assert_told(check_file(answer), told)


def test_a_file_in_which_nothing_moves_is_told(slow: Plan, tmp_path: Path) -> None:
    write_csv(slow, tmp_path / "slow.csv")
    head, row, *_ = (tmp_path / "slow.csv").read_text("utf-8").splitlines()
    rest = row.split(",", 1)[1]
    rows = [f"{time:.2f},{rest}" for time in np.arange(0.0, 1.0, 0.1)]
    (tmp_path / "still.csv").write_text("\n".join([head, *rows]) + "\n", "utf-8")
    assert_told(check_file(tmp_path / "still.csv"), "nothing moves")
