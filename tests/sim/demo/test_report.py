"""The report: totals of what succeeded, and entries that JSON can hold."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from baxter_kin.command_line import parse
from baxter_kin.fields import evolve
from planner import Grip, GripperAction, Manipulator, Move, Plan, PlanFailure, plan_joint_move
from planner.clearance import Clearance
from sim import Event, EventKind, Outcome
from sim.demo.options import DemoOptions
from sim.demo.report import MAX_CYCLES, MAX_EVENTS, Report, Totals
from tests.conftest import state_at

POSES_M = ((0.7, 0.15, -0.129), (0.75, 0.0, -0.129))
DONE, FAILED = Outcome(None, 6.0), Outcome("pick: close: missed", 2.0)


@pytest.fixture(scope="module")
def plan(manipulator: Manipulator) -> Plan:
    """Three moves between two configurations, the one in the middle with closed fingers."""
    here, limits = manipulator.arm.neutral, manipulator.limits
    ways = [(here, here + 0.1), (here + 0.1, here - 0.2), (here - 0.2, here)]
    moves = [
        Move(label, plan_joint_move(*way, limits), clearance=Clearance(m, "wrist", "table", 0.0))
        for label, way, m in zip("abc", ways, (0.03, 0.01, 0.02), strict=True)
    ]
    close = Grip("pick: close", GripperAction.CLOSE, "block")
    opening = Grip("place: open", GripperAction.OPEN, "block")
    return Plan(state_at(here), (moves[0], close, moves[1], opening, moves[2]))


@pytest.fixture
def report() -> Report:
    return Report(parse(DemoOptions, []))


def spoken(entry: Any) -> Any:
    """What a reader of the file gets."""
    return json.loads(json.dumps(entry, allow_nan=False))


def test_means_and_ratios_are_those_of_the_cycles_that_succeeded(plan: Plan) -> None:
    totals = Totals()
    for outcome in (DONE, FAILED, Outcome(None, 8.0)):
        totals.add(plan, outcome, 0.5)
    carried_s = plan.moves[1].trajectory.duration
    assert totals.cycles_done == 2
    assert totals.cycle_time_s == 7.0
    assert totals.transfer_ratio == pytest.approx(carried_s / 0.5)


def test_motion_and_the_least_clearance_are_those_of_all_cycles(plan: Plan) -> None:
    totals = Totals()
    totals.add(plan, DONE, 0.5)
    nearer = Clearance(0.005, "wrist", "table", 0.0)
    steps = tuple(evolve(s, clearance=nearer) if isinstance(s, Move) else s for s in plan)
    totals.add(evolve(plan, steps=steps), FAILED, 0.5)
    totals.add(plan, DONE, 0.5)
    assert totals.min_clearance_m == 0.005
    assert totals.motion_time_s == pytest.approx(3 * plan.motion_time_s)


def test_before_the_first_cycle_there_is_no_mean_and_no_ratio() -> None:
    assert (Totals().cycle_time_s, Totals().transfer_ratio) == (0.0, None)


def test_an_entry_has_the_picks_places_and_moves_of_its_plan(report: Report, plan: Plan) -> None:
    entry = spoken(report.add_cycle(1, POSES_M, plan, 0.5))
    assert (entry["pick_m"], entry["place_m"]) == (list(POSES_M[0]), list(POSES_M[1]))
    assert entry["picks"] == [{"label": "pick: close", "body": "block"}]
    assert entry["places"] == [{"label": "place: open", "body": "block"}]
    assert [move["clearance_m"] for move in entry["moves"]] == [0.03, 0.01, 0.02]
    carried_s = plan.moves[1].trajectory.duration
    assert entry["transfer_time_s"] == pytest.approx(carried_s)
    assert entry["transfer_ratio"] == pytest.approx(carried_s / 0.5)


@pytest.mark.parametrize(("bound_s", "kept"), [(math.inf, None), (0.0, 0.0)])
def test_a_bound_that_is_none_is_null_and_one_of_0_has_no_ratio(
    report: Report, plan: Plan, bound_s: float, kept: float | None
) -> None:
    entry = spoken(report.add_cycle(1, POSES_M, plan, bound_s))
    assert entry["transfer_bound_s"] == kept
    assert entry["transfer_ratio"] == (0.0 if math.isinf(bound_s) else None)


def test_a_plan_that_failed_has_its_reason_and_no_transfer(report: Report, plan: Plan) -> None:
    failed = evolve(plan, failure=PlanFailure("place: approach", "too far"))
    entry = spoken(report.add_cycle(1, POSES_M, failed, 0.5))
    assert (entry["planned"], entry["failure"]) == (False, "place: approach: too far")
    assert entry["transfer_time_s"] is entry["transfer_ratio"] is None


def test_only_the_last_cycles_and_events_are_kept(report: Report, manipulator: Manipulator) -> None:
    nothing = Plan(state_at(manipulator.arm.neutral), (), limb="left")
    for number in range(MAX_CYCLES + 3):
        report.add_cycle(number, POSES_M, nothing, 0.0)
    for number in range(MAX_EVENTS + 5):
        report.on_event(Event(float(number), EventKind.ENABLED, "robot enabled"))
    data = report.as_json()
    assert [entry["cycle"] for entry in data["cycles"]] == [*range(3, MAX_CYCLES + 3)]
    assert data["events"][0]["time_s"] == 5.0
    assert len(data["events"]) == MAX_EVENTS


def test_a_report_is_no_success_until_it_is_said(report: Report) -> None:
    assert (report.as_json()["success"], report.as_json()["failure"]) == (
        False,
        "it did not finish",
    )
    report.failure = None
    assert (report.as_json()["success"], report.as_json()["failure"]) == (True, None)


def test_noise_is_told_of_only_where_the_block_is_looked_for() -> None:
    assert Report(parse(DemoOptions, [])).as_json()["noise"] is None
    told = Report(parse(DemoOptions, ["--noise-mm", "3", "--retries", "2"])).as_json()["noise"]
    assert told == {"position_m": 0.003, "yaw_rad": 0.0, "retries": 2, "seed": 0}


def test_the_file_says_what_the_report_does(report: Report, plan: Plan, tmp_path: Path) -> None:
    report.add_cycle(1, POSES_M, plan, 0.5)
    report.on_event(Event(0.5, EventKind.ENABLED, "robot enabled"))
    report.write(tmp_path / "report.json")
    assert json.loads((tmp_path / "report.json").read_text()) == spoken(report.as_json())
