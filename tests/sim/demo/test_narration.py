"""What the demo prints: a row for each move, what happened, and a summary."""

from __future__ import annotations

import pytest

from planner import Manipulator, Move, plan_joint_move
from sim import Event, EventKind
from sim.demo.narration import Narrator
from sim.demo.report import Totals
from tests.conftest import overhead

OPENED = Event(1.0, EventKind.OPENED, "left gripper opened", "left")
GRASPED = Event(2.0, EventKind.GRASPED, "block grasped", "left")


@pytest.fixture(scope="module")
def started(manipulator: Manipulator) -> Event:
    """A move by inverse kinematics begins."""
    T = overhead(0.70, 0.15, -0.129)
    ik = manipulator.ik.solve(T, current=manipulator.arm.start)
    assert ik.is_valid
    way = plan_joint_move(manipulator.arm.start, ik.q, manipulator.limits)
    move = Move("pick: approach", way, T, ik)
    return Event(0.0, EventKind.MOVE_STARTED, "cycle 1, pick: approach", "left", move=move)


def test_a_move_is_a_row_with_seed_residual_and_duration(
    started: Event, capsys: pytest.CaptureFixture[str]
) -> None:
    Narrator(1).on_event(started)
    row = capsys.readouterr().out
    assert started.move is not None
    assert row.startswith("  pick: approach ")
    assert started.move.seed_label in row
    assert " m, " in row
    assert " rad " in row
    assert row.endswith(f" {started.move.trajectory.duration:.3f} s\n")


def test_a_move_by_joint_angles_has_no_residual(
    manipulator: Manipulator, capsys: pytest.CaptureFixture[str]
) -> None:
    start = manipulator.arm.start
    move = Move(
        "move to start", plan_joint_move(manipulator.arm.neutral, start, manipulator.limits)
    )
    Narrator(1).on_event(Event(0.0, EventKind.MOVE_STARTED, "", "left", move=move))
    row = capsys.readouterr().out
    assert "(joint angles)" in row
    assert "rad" not in row


@pytest.mark.parametrize(
    ("verbosity", "told"),
    [(0, []), (1, ["  block grasped"]), (2, ["  left gripper opened", "  block grasped"])],
)
def test_the_more_it_may_say_the_more_events_it_tells(
    verbosity: int, told: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    narrator = Narrator(verbosity)
    for event in (OPENED, GRASPED):
        narrator.on_event(event)
    assert capsys.readouterr().out.splitlines() == told


def test_a_complaint_is_heard_even_when_it_is_quiet(capsys: pytest.CaptureFixture[str]) -> None:
    Narrator(0).complain("no way")
    assert capsys.readouterr() == ("", "no way\n")


def test_rows_stand_below_their_headings(
    started: Event, capsys: pytest.CaptureFixture[str]
) -> None:
    narrator = Narrator(1)
    narrator.start_cycle(3, (0.7, 0.15, -0.129), (0.75, -0.0, -0.129))
    narrator.on_event(started)
    *_, title, heading, row = capsys.readouterr().out.splitlines()
    assert title == (
        "cycle 3: pick at (0.7000, 0.1500, -0.1290), place at (0.7500, 0.0000, -0.1290) m in base"
    )
    assert started.move is not None
    assert heading.index("stage") == row.index("pick: approach")
    assert heading.index("IK seed") == row.index(started.move.seed_label)
    assert heading.index("time") == row.index(f"{started.move.trajectory.duration:.3f} s")


def test_a_summary_leaves_out_what_there_was_not(capsys: pytest.CaptureFixture[str]) -> None:
    Narrator(1).finish(Totals())
    said = capsys.readouterr().out
    assert [line.split(":")[0] for line in said.splitlines()] == ["time"]


def test_the_columns_are_explained_once_in_lines_of_100_columns(
    capsys: pytest.CaptureFixture[str],
) -> None:
    narrator = Narrator(1)
    for number in (1, 2):
        narrator.start_cycle(number, (0.7, 0.15, -0.129), (0.75, 0.0, -0.129))
    said = capsys.readouterr().out
    assert said.count("A row is a move of the arm.") == 1
    assert "See docs/concepts/ik.md" in said
    assert max(map(len, said.splitlines())) <= 100


def test_a_summary_sums_up(capsys: pytest.CaptureFixture[str]) -> None:
    totals = Totals(
        2, 9.0, 13.0, 6.0, 4.0, 0.5, 1.25, 0.0222, (0.7, 0.15, -0.13), (0.7, 0.1, -0.13)
    )
    Narrator(1).finish(totals)
    assert capsys.readouterr().out.splitlines() == [
        "block: from (0.7000, 0.1500, -0.1300) to (0.7000, 0.1000, -0.1300) m in base",
        "time: planning 0.50 s, arm motion 9.00 s, wall clock 1.25 s; one pick and place 6.50 s, "
        "gripper included",
        "from grasp to release: 1.50 times as long as the fastest direct joint motion, which heeds",
        "  neither lines nor obstacles (see docs/concepts/motion_program.md)",
        "clearance: 22.2 mm where the arm came nearest to what it is not meant to touch",
    ]


def test_a_summary_of_no_cycle_says_no_time_of_one(capsys: pytest.CaptureFixture[str]) -> None:
    Narrator(1).finish(Totals(planning_time_s=0.5, wall_time_s=1.25))
    said = capsys.readouterr().out
    assert said == "time: planning 0.50 s, arm motion 0.00 s, wall clock 1.25 s\n"
