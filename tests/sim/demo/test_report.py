"""The report: totals of what succeeded, entries that JSON can hold, and what is printed of them."""

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
from sim.demo.report import MAX_CYCLES, MAX_EVENTS, Report, format_move
from tests.conftest import overhead, state_at

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


def add(report: Report, plan: Plan, outcome: Outcome, bound_s: float = 0.5) -> Any:
    """The entry of a cycle that was executed."""
    report.add_plan(1, *POSES_M, plan, bound_s)
    report.end_cycle(plan, outcome, (0.7, 0.1, -0.13))
    return spoken(report.as_json())["cycles"][-1]


def test_means_and_ratios_are_those_of_the_cycles_that_succeeded(
    report: Report, plan: Plan, capsys: pytest.CaptureFixture[str]
) -> None:
    for outcome in (DONE, FAILED, Outcome(None, 8.0)):
        add(report, plan, outcome)
    data = report.as_json()
    assert (data["cycles_done"], data["cycle_time_s"]) == (2, 7.0)
    report.finish()
    ratio = plan.moves[1].trajectory.duration / 0.5
    assert data["transfer_ratio"] == pytest.approx(ratio)
    assert f"from grasp to release: {ratio:.2f} times" in capsys.readouterr().out


def test_motion_and_the_least_clearance_are_those_of_all_cycles(report: Report, plan: Plan) -> None:
    nearer = Clearance(0.005, "wrist", "table", 0.0)
    steps = tuple(evolve(s, clearance=nearer) if isinstance(s, Move) else s for s in plan)
    add(report, plan, DONE)
    add(report, evolve(plan, steps=steps), FAILED)
    add(report, plan, DONE)
    data = report.as_json()
    assert data["min_clearance_m"] == 0.005
    assert data["motion_time_s"] == pytest.approx(3 * plan.motion_time_s)


def test_an_entry_has_the_picks_places_and_moves_of_its_plan(report: Report, plan: Plan) -> None:
    entry = add(report, plan, DONE)
    assert (entry["pick_m"], entry["place_m"]) == (list(POSES_M[0]), list(POSES_M[1]))
    assert entry["picks"] == [{"label": "pick: close", "body": "block"}]
    assert entry["places"] == [{"label": "place: open", "body": "block"}]
    assert [move["clearance_m"] for move in entry["moves"]] == [0.03, 0.01, 0.02]
    carried_s = plan.moves[1].trajectory.duration
    assert entry["transfer_time_s"] == pytest.approx(carried_s)
    assert entry["transfer_ratio"] == pytest.approx(carried_s / 0.5)


@pytest.mark.parametrize(("bound_s", "kept"), [(math.inf, None), (0.0, 0.0)])
def test_an_infinite_bound_is_null_and_neither_that_nor_0_has_a_ratio(
    report: Report, plan: Plan, bound_s: float, kept: float | None
) -> None:
    entry = add(report, plan, DONE, bound_s)
    assert entry["transfer_bound_s"] == kept
    assert entry["transfer_ratio"] is None


def test_a_plan_that_failed_has_its_reason_and_no_transfer(report: Report, plan: Plan) -> None:
    failed = evolve(plan, failure=PlanFailure("place: approach", "too far"))
    report.add_plan(1, *POSES_M, failed, 0.5)
    (entry,) = spoken(report.as_json())["cycles"]
    assert (entry["planned"], entry["failure"]) == (False, "place: approach: too far")
    assert entry["transfer_time_s"] is entry["transfer_ratio"] is None


def test_only_the_last_cycles_and_events_are_kept(report: Report, manipulator: Manipulator) -> None:
    nothing = Plan(state_at(manipulator.arm.neutral), (), limb="left")
    for number in range(MAX_CYCLES + 3):
        report.add_plan(number, *POSES_M, nothing, 0.0)
    for number in range(MAX_EVENTS + 5):
        report.on_event(Event(float(number), EventKind.ENABLED, "robot enabled"))
    data = report.as_json()
    assert [entry["cycle"] for entry in data["cycles"]] == [*range(3, MAX_CYCLES + 3)]
    assert data["events"][0]["time_s"] == 5.0
    assert len(data["events"]) == MAX_EVENTS


def test_a_report_is_no_success_until_it_is_done(report: Report) -> None:
    assert (report.as_json()["success"], report.as_json()["failure"]) == (
        False,
        "the run did not finish",
    )
    report.failure = None
    assert (report.as_json()["success"], report.as_json()["failure"]) == (True, None)


def test_noise_is_reported_only_where_the_block_is_perceived() -> None:
    assert Report(parse(DemoOptions, [])).as_json()["noise"] is None
    told = Report(parse(DemoOptions, ["--noise-mm", "3", "--retries", "2"])).as_json()["noise"]
    assert told == {"position_m": 0.003, "yaw_rad": 0.0, "retries": 2, "seed": 0}


def test_the_file_says_what_the_report_does(report: Report, plan: Plan, tmp_path: Path) -> None:
    report.add_plan(1, *POSES_M, plan, 0.5)
    report.on_event(Event(0.5, EventKind.ENABLED, "robot enabled"))
    report.write(tmp_path / "report.json")
    assert json.loads((tmp_path / "report.json").read_text()) == spoken(report.as_json())


# What is printed

OPENED = Event(1.0, EventKind.OPENED, "left gripper opened", "left")
GRASPED = Event(2.0, EventKind.GRASPED, "block grasped", "left")


@pytest.fixture(scope="module")
def move(manipulator: Manipulator) -> Move:
    """A move by inverse kinematics."""
    T = overhead(0.70, 0.15, -0.129)
    ik = manipulator.ik.solve(T, current=manipulator.arm.start)
    assert ik.is_valid
    way = plan_joint_move(manipulator.arm.start, ik.q, manipulator.limits)
    return Move("pick: approach", way, T, ik)


def test_a_move_is_a_row_with_seed_residual_and_duration(move: Move) -> None:
    row = format_move(move)
    assert row.startswith("  pick: approach ")
    assert move.seed_label in row
    assert " m, " in row
    assert " rad " in row
    assert row.endswith(f" {move.trajectory.duration:.3f} s")


def test_a_move_by_joint_angles_has_no_residual(move: Move) -> None:
    row = format_move(evolve(move, T_base_tip=None, ik=None))
    assert "(joint angles)" in row
    assert "rad" not in row


@pytest.mark.parametrize(
    ("line", "printed"),
    [("-q", []), ("", ["  block grasped"]), ("-v", ["  left gripper opened", "  block grasped"])],
)
def test_the_verbosity_decides_which_events_are_printed(
    line: str, printed: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    report = Report(parse(DemoOptions, line.split()))
    for event in (OPENED, GRASPED):
        report.on_event(event)
    assert capsys.readouterr().out.splitlines() == printed


def test_rows_stand_below_their_headings(
    report: Report, move: Move, capsys: pytest.CaptureFixture[str]
) -> None:
    report.start_cycle(3, (0.7, 0.15, -0.129), (0.75, -0.0, -0.129))
    report.on_event(Event(0.0, EventKind.MOVE_STARTED, "", "left", move=move))
    *_, title, heading, row = capsys.readouterr().out.splitlines()
    assert title == (
        "cycle 3: pick at (0.7000, 0.1500, -0.1290), place at (0.7500, 0.0000, -0.1290) m in base"
    )
    assert heading.index("stage") == row.index("pick: approach")
    assert heading.index("IK seed") == row.index(move.seed_label)
    assert heading.index("time") == row.index(f"{move.trajectory.duration:.3f} s")


def test_the_columns_are_explained_once_in_lines_of_100_columns(
    report: Report, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in (1, 2):
        report.start_cycle(number, *POSES_M)
    printed = capsys.readouterr().out
    assert printed.count("A row is a move of the arm.") == 1
    assert "See docs/concepts/ik.md" in printed
    assert max(map(len, printed.splitlines())) <= 100


def test_a_summary_has_what_is_known(
    report: Report, plan: Plan, capsys: pytest.CaptureFixture[str]
) -> None:
    report.planning_time_s, report.wall_time_s = 0.5, 1.25
    report.finish()
    assert report.as_json()["cycle_time_s"] is None
    assert report.as_json()["transfer_ratio"] is None
    nothing = "time: planning 0.50 s, arm motion 0.00 s, wall clock 1.25 s\n"
    assert capsys.readouterr().out == nothing
    add(report, plan, Outcome(None, 6.5))
    report.blocks_start_m = {"block": (0.7, 0.15, -0.13)}
    report.blocks_final_m = {"block": (0.7, 0.1, -0.13)}
    report.finish()
    carried_s = plan.moves[1].trajectory.duration
    assert capsys.readouterr().out.splitlines() == [
        "block: from (0.7000, 0.1500, -0.1300) to (0.7000, 0.1000, -0.1300) m in base",
        f"time: planning 0.50 s, arm motion {plan.motion_time_s:.2f} s, wall clock 1.25 s; one "
        "pick and place 6.50 s, gripper included",
        f"from grasp to release: {carried_s / 0.5:.2f} times as long as the fastest direct joint "
        "motion, which ignores",
        "  straight lines and obstacles (see docs/concepts/motion_program.md)",
        "planned clearance: 10.0 mm to the nearest thing that the arm is not meant to touch",
    ]
