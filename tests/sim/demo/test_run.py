"""The demo as one program, in this process; its report, its outputs, its failures."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from planner import Manipulator, load_plan, load_two_arm_plan, transfer_bound_s, verify
from planner.plan import SHOWN_RAD
from sim import read_recording
from sim.demo import main
from tests.conftest import overhead

RATIO = 1.0 + 1e-9
RESIDUAL = 1e-6
PLACED_WITHIN_M = 5e-3
ON_TABLE_WITHIN_M = 1e-4

LABELS = [
    f"{what}: {move}" for what in ("pick", "place") for move in ("approach", "descend", "retract")
]
STRAIGHT = {"pick: descend", "pick: retract", "place: descend", "place: retract"}
TRANSFER = {"pick: retract", "place: approach", "place: descend"}


SLOWLY = ("--speed", "0.3")
"""Ten times as fast to plan."""


def report_of(folder: Path, *options: str, status: int = 0) -> dict[str, Any]:
    """Run the demo headless and quiet, and read its report."""
    path = folder / "report.json"
    assert main(["--headless", "-q", "--report", str(path), *options]) == status
    report: dict[str, Any] = json.loads(path.read_text())
    return report


@dataclass(frozen=True)
class Run:
    """The default run with every output, what it printed, and its report."""

    folder: Path
    printed: str
    report: dict[str, Any]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder, printed = tmp_path_factory.mktemp("default"), io.StringIO()
    outputs = {"html": "replay.html", "csv": "run.csv", "record": "run.mcap", "report": "r.json"}
    line = [word for name, file in outputs.items() for word in (f"--{name}", str(folder / file))]
    with contextlib.redirect_stdout(printed):
        assert main(["--headless", "-v", *line]) == 0
    return Run(folder, printed.getvalue(), json.loads((folder / "r.json").read_text()))


@pytest.fixture(scope="module")
def report(run: Run) -> dict[str, Any]:
    return run.report


def test_default_run_picks_and_places_once_per_block_pose(report: dict[str, Any]) -> None:
    promised = (
        "limb hover_distance_m block_poses cycles block min_clearance_m motion_time_s "
        "cycle_time_s planning_time_s wall_time_s events success"
    )
    assert set(promised.split()) <= set(report)
    assert report["success"]
    assert [cycle["success"] for cycle in report["cycles"]] == [True, True]
    assert all(len(cycle["picks"]) == len(cycle["places"]) == 1 for cycle in report["cycles"])


def test_every_waypoint_is_reached(report: dict[str, Any]) -> None:
    waypoints = [waypoint for cycle in report["cycles"] for waypoint in cycle["waypoints"]]
    assert len(waypoints) == 12
    assert all(waypoint["position_error_m"] <= RESIDUAL for waypoint in waypoints)
    assert all(waypoint["orientation_error_rad"] <= RESIDUAL for waypoint in waypoints)
    assert {waypoint["seed_type"] for waypoint in waypoints} <= {"USER", "CURRENT", "NS_MAP"}


def test_every_move_keeps_every_limit(report: dict[str, Any]) -> None:
    moves = [move for cycle in report["cycles"] for move in cycle["moves"]]
    for kind in ("velocity", "acceleration", "jerk"):
        assert max(move[f"peak_{kind}_ratio"] for move in moves) <= RATIO
    assert max(move["peak_jerk_ratio"] for move in moves) > 0.99  # time-optimal: a limit is active


def test_block_starts_where_the_original_settles_it_and_ends_at_the_last_place(
    report: dict[str, Any],
) -> None:
    np.testing.assert_allclose(report["block"]["start_m"], [0.6975, 0.1515, -0.130], atol=1e-6)
    x, y, z = report["block"]["final_m"]
    place = report["cycles"][-1]["place_m"]
    assert abs(x - place[0]) <= PLACED_WITHIN_M
    assert abs(y - place[1]) <= PLACED_WITHIN_M
    assert z == pytest.approx(-0.130, abs=ON_TABLE_WITHIN_M)


def test_times_are_sums_and_means_and_beat_the_originals_16_7_s(report: dict[str, Any]) -> None:
    assert report["cycles"][1]["duration_s"] <= 9.0
    mean = sum(cycle["duration_s"] for cycle in report["cycles"]) / 2
    assert report["cycle_time_s"] == pytest.approx(mean)
    total = sum(move["duration_s"] for cycle in report["cycles"] for move in cycle["moves"])
    assert report["motion_time_s"] == pytest.approx(total)  # from the start pose on


def test_moves_down_to_poses_and_up_from_them_are_straight(report: dict[str, Any]) -> None:
    for cycle in report["cycles"]:
        assert [move["label"] for move in cycle["moves"]] == LABELS
        assert {move["label"] for move in cycle["moves"] if move["is_straight"]} == STRAIGHT


def test_every_move_is_proven_clear_by_no_more_than_was_measured(report: dict[str, Any]) -> None:
    for cycle in report["cycles"]:
        for move in cycle["moves"]:
            assert 0.0 < move["proven_clearance_m"] <= move["clearance_m"]
    fingers_above_the_table_m = 0.0222
    assert report["min_clearance_m"] == pytest.approx(fingers_above_the_table_m, abs=1e-4)


def test_transfer_is_what_is_moved_from_grasp_to_release(report: dict[str, Any]) -> None:
    for cycle in report["cycles"]:
        durations = [m["duration_s"] for m in cycle["moves"] if m["label"] in TRANSFER]
        assert cycle["transfer_time_s"] == pytest.approx(sum(durations), rel=1e-12)
        ratio = cycle["transfer_time_s"] / cycle["transfer_bound_s"]
        assert cycle["transfer_ratio"] == pytest.approx(ratio, rel=1e-12)
        assert ratio >= 1.0


def test_speed_scales_the_velocity_limits_and_with_them_the_bound(
    tmp_path: Path, robot: Baxter, report: dict[str, Any]
) -> None:
    slow = report_of(tmp_path, *SLOWLY, "--cycles", "1")
    peak = max(move["peak_velocity_ratio"] for move in slow["cycles"][0]["moves"])
    assert peak == pytest.approx(1.0, rel=1e-3)  # as near as the program comes to its optimum
    fast_s = sum(move["duration_s"] for move in report["cycles"][0]["moves"])
    assert slow["motion_time_s"] > 1.1 * fast_s  # most moves are short
    for found, speed_ratio in ((report, 1.0), (slow, 0.3)):
        arm = Manipulator.of(robot, "left", speed_ratio=speed_ratio)
        pick, place = (overhead(*cycle_m) for cycle_m in found["block_poses"])
        expected_s = transfer_bound_s(arm.ik, arm.limits, pick, place)
        assert found["cycles"][0]["transfer_bound_s"] == pytest.approx(expected_s, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("z", "has_bound"), [("-0.14", True), ("5", False)])
def test_a_failed_plan_has_no_transfer_and_its_bound_only_where_poses_are_reachable(
    tmp_path: Path, z: str, *, has_bound: bool
) -> None:
    report = report_of(tmp_path, *SLOWLY, "--add-pose", "0.72", "0.075", z, status=1)
    first, last = report["cycles"]
    assert first["transfer_ratio"] >= 1.0
    assert last["transfer_time_s"] is last["transfer_ratio"] is None
    assert (last["transfer_bound_s"] is not None) is has_bound


@pytest.mark.slow
def test_a_place_that_is_the_pick_has_a_bound_of_0_and_no_ratio(tmp_path: Path) -> None:
    again = ["--add-pose", "0.75", "0", "-0.129", "--cycles", "2"]
    stay = report_of(tmp_path, *again, *SLOWLY)["cycles"][1]
    assert stay["transfer_bound_s"] == 0.0
    assert stay["transfer_time_s"] > 0.0
    assert stay["transfer_ratio"] is None


def test_events_are_complete_and_in_order(report: dict[str, Any]) -> None:
    kinds = [event["kind"] for event in report["events"]]
    assert kinds[:3] == ["spawned", "spawned", "enabled"]
    assert kinds[-2:] == ["deleted", "deleted"]
    assert kinds.count("grasped") == kinds.count("released") == 2
    times = [event["time_s"] for event in report["events"]]
    assert times == sorted(times)


@pytest.mark.slow
def test_three_poses_are_visited_in_turn_without_a_drift(tmp_path: Path) -> None:
    third = ["--add-pose", "0.72", "0.075", "-0.129", "--cycles", "6"]
    report = report_of(tmp_path, *third, *SLOWLY)
    a, b, c = [0.70, 0.15, -0.129], [0.75, 0.0, -0.129], [0.72, 0.075, -0.129]
    visited = [(cycle["pick_m"], cycle["place_m"]) for cycle in report["cycles"]]
    assert visited == 2 * [(a, b), (b, c), (c, a)]
    np.testing.assert_allclose(report["block"]["final_m"][:2], a[:2], atol=PLACED_WITHIN_M)
    first, last = (report["cycles"][i]["block_m"] for i in (2, 5))
    np.testing.assert_allclose(first, last, atol=1e-5)


def test_hover_is_how_far_the_cycle_ends_above_the_place(
    tmp_path: Path, report: dict[str, Any]
) -> None:
    low = report_of(tmp_path, "--hover", "0.05", "--cycles", "1")
    assert low["hover_distance_m"] == 0.05 < report["hover_distance_m"]
    ends = [run["cycles"][0]["moves"][-1]["duration_s"] for run in (low, report)]
    assert ends[0] < ends[1]
    assert low["success"]


@pytest.mark.slow
def test_obstacles_are_gone_around_and_the_plan_is_saved(tmp_path: Path) -> None:
    wall, file = ["0.72", "0.075", "-0.055", "0.3", "0.02", "0.2"], tmp_path / "plan.json"
    options = ["--obstacle", *wall, "--cycles", "1", "--plan", str(file), "--margin", "0.001"]
    report = report_of(tmp_path, *options, *SLOWLY)
    assert report["success"]
    assert report["obstacles_m"] == [[float(number) for number in wall]]
    assert report["margin_m"] == 0.001
    assert report["min_clearance_m"] >= 0.001
    assert {event["text"] for event in report["events"]} >= {"obstacle 1 spawned"}
    plan = load_plan(file)
    assert verify(plan).is_valid
    assert "obstacle 1" in plan.start.scene.bodies
    assert plan.motion_time_s == pytest.approx(report["motion_time_s"])


def test_with_noise_it_tries_again_until_the_block_is_placed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "report.json"
    noise = ["--noise-mm", "3", "--noise-deg", "1", "--retries", "5", "--seed", "4"]
    assert main(["--headless", "--cycles", "3", "--report", str(path), *noise, *SLOWLY]) == 0
    report, said = json.loads(path.read_text()), capsys.readouterr().out
    assert report["success"]
    assert report["cycles_done"] == 3
    assert report["noise"]["position_m"] == 0.003
    assert report["noise"]["retries"] == 5
    assert len(report["cycles"]) > 3  # one entry for each attempt
    assert "tries again, attempt 2 of 6" in said
    events = [event["kind"] for event in report["events"]]
    assert events.count("missed") == len(report["cycles"]) - 3
    assert abs(report["block"]["final_m"][2] + 0.130) <= ON_TABLE_WITHIN_M


def test_without_retries_a_miss_ends_the_demo(tmp_path: Path) -> None:
    noise = ["--noise-mm", "3", "--retries", "0", "--seed", "4", "--cycles", "9"]
    report = report_of(tmp_path, *noise, *SLOWLY, status=1)
    assert "block was not placed in one attempt; the last: pick: close: missed" in report["failure"]


@pytest.mark.slow
def test_exact_poses_are_as_good_as_the_true_ones(tmp_path: Path) -> None:
    report = report_of(tmp_path, "--retries", "0", "--cycles", "2", *SLOWLY)
    assert report["success"]
    assert report["noise"] == {"position_m": 0.0, "yaw_rad": 0.0, "retries": 0, "seed": 0}
    assert report["block"]["final_m"] == pytest.approx([0.70, 0.15, -0.13], abs=1e-4)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--add-pose 2 0 0", ["out of reach"]),
        ("--add-pose 1.1 0.2 -0.129", ["the left arm reaches as far as ("]),
        (
            "--obstacle 0.7 0.15 -0.1 0.1 0.1 0.1",
            ["'block' would be 52.5 mm inside 'obstacle 1'"],
        ),
        (
            "--add-pose 0.7 -0.5 -0.129",
            ["the right arm reaches (0.7, -0.5, -0.129)", "--limb right"],
        ),
        ("--add-pose 0.3 0.1 -0.129", ["is not above the table", "from 0.54 to 1.46"]),
        (
            "--add-pose 0.7 0 -0.17",
            ["41 mm inside the table", "z from -0.129", "block with table, at best 41.0 mm deep"],
        ),
        ("--add-pose 0.7 0 -0.4", ["with table, at best"]),
        ("--add-pose 0.72 0.075 -0.14", ["block with table, at best 11.0 mm deep"]),
        ("--add-pose 0.72 0.075 0.1", ["block would fall: nothing is within 10 mm below it"]),
        ("--hover 5", ["up to 0.48 m above the place", "smaller --hover", "out of reach"]),
        (
            "--limb right --right-hand half_round",
            ["the right hand opens for (52.7 mm)", "a pad would come down 0.1 mm inside it"],
        ),
        ("--left-hand 4", ["closed finger pads are 53.3 mm apart"]),
    ],
)
def test_task_without_a_solution_is_status_1_and_one_sentence(
    tmp_path: Path, options: str, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    report = report_of(tmp_path, *options.split(), *SLOWLY, status=1)
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1
    assert not report["success"]
    for each in words:
        assert each in printed
        assert each in report["failure"]


def test_what_was_done_before_a_failure_is_kept_and_the_failed_waypoint_comes_last(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.csv"
    far = ["--add-pose", "2", "0", "0", "--csv", str(path)]
    report = report_of(tmp_path, *far, *SLOWLY, status=1)
    assert [cycle["success"] for cycle in report["cycles"]] == [True, False]
    recorded_s = float(path.read_text().splitlines()[-1].split(",")[0])
    assert recorded_s > report["cycles"][0]["duration_s"]
    last = report["cycles"][-1]["waypoints"][-1]
    assert last["seed_type"] == "INVALID"
    assert "out of reach" in last["failure"]
    assert capsys.readouterr().out == ""  # it is quiet


@pytest.mark.slow
def test_limits_of_torque_control_are_faster_and_their_plan_verifies(
    tmp_path: Path, robot: Baxter, report: dict[str, Any]
) -> None:
    path = tmp_path / "plan.json"
    options = "--limits", "torque-control", "--cycles", "1", "--plan", str(path)
    found = report_of(tmp_path, *options)
    assert (found["limits"], report["limits"]) == ("torque-control", "safe")
    slower = report["cycles"][0]["transfer_time_s"]
    assert found["cycles"][0]["transfer_time_s"] < slower
    harder = robot.arm("left").limits.preset("torque-control")
    assert verify(load_plan(path), limits=harder).is_valid
    assert not verify(load_plan(path)).is_valid


def test_csv_is_the_recorders_of_the_rsdk(run: Run) -> None:
    text = (run.folder / "run.csv").read_bytes()
    assert b"\r" not in text
    rows = list(csv.reader(text.decode("ascii").splitlines()))
    assert rows[0][:2] == ["time", "left_s0"]
    assert rows[0][8:10] == ["left_gripper", "right_s0"]
    assert {len(row) for row in rows} == {17}
    times = np.array([float(row[0]) for row in rows[1:]])
    np.testing.assert_allclose(np.diff(times), 0.01, atol=1e-6)
    assert all(math.isfinite(float(value)) for row in rows[1:] for value in row)


def test_csv_with_a_dwell_is_what_a_robot_is_sent(tmp_path: Path, robot: Baxter) -> None:
    path = tmp_path / "robot.csv"
    report_of(tmp_path, "--csv", str(path), "--dwell", "0.5", "--cycles", "2", *SLOWLY)
    found, notes = read_recording(path, robot)
    assert notes == ()
    percent = found.gripper_percent[:, 0]
    assert percent[np.flatnonzero(np.diff(percent)) + 1].tolist() == [0.0, 100.0] * 2
    q = found.motion("left").q
    for row in np.flatnonzero(np.diff(percent)):
        assert np.ptp(q[row - 45 : row + 45], axis=0).max() == 0.0


def test_everything_that_happens_is_recorded_in_complete_files(run: Run) -> None:
    path, report = run.folder / "run.mcap", run.report
    assert path.read_bytes()[-8:] == path.read_bytes()[:8] == b"\x89MCAP0\r\n"
    found = read_recording(path).recording
    assert [event.text for event in found.events][: len(report["events"])] == [
        event["text"] for event in report["events"]
    ]
    labels = [move["label"] for cycle in report["cycles"] for move in cycle["moves"]]
    assert all(label in move.label for label, move in zip(labels, found.moves[1:], strict=True))
    assert set(found.bodies) == {"table", "block"}
    assert (run.folder / "replay.html").stat().st_size <= 5e6


@pytest.mark.parametrize("option", ["--record run.mcap", "--csv run.csv"])
def test_a_disk_that_fills_up_ends_the_demo_with_that_reason(
    tmp_path: Path,
    small_disk: Callable[[int], None],
    capsys: pytest.CaptureFixture[str],
    option: str,
) -> None:
    """Clearing the scene away writes, too, and once complained of a "closed file" instead."""
    small_disk(10_000)
    name, file = option.split()
    path = tmp_path / file
    report = report_of(tmp_path, name, str(path), *SLOWLY, status=1)
    reason = f"cannot write {path}: No space left on device"
    *warnings, last = capsys.readouterr().err.splitlines()
    assert last == f"baxter-demo: {reason}"
    assert all("as it is drawn" in warning for warning in warnings)
    assert report["failure"] == reason
    assert 0 < path.stat().st_size <= 10_000


def test_summary_names_seeds_residuals_durations_times_and_events(run: Run) -> None:
    rows = re.findall(
        r"^  ((?:pick|place): \w+) +(\S.*?)  .*e-\d+ rad +\d\.\d{3} s$", run.printed, re.M
    )
    wanted = []
    for cycle in run.report["cycles"]:
        for waypoint in cycle["waypoints"]:
            seed, moved_rad = waypoint["seed_label"], waypoint["moved_rad"]
            moved = f", optimised by {moved_rad:.2f} rad" if moved_rad > SHOWN_RAD else ""
            wanted.append((waypoint["waypoint"], f"{seed}{moved}"))
    assert rows == wanted
    assert [label for label, _ in rows] == LABELS * 2
    assert {"Current Joint Angles", "Nullspace Setpoints"} >= {
        waypoint.split(",")[0] for _, waypoint in rows
    }
    for word in ("residual", "move", "planning", "motion", "wall", "block: from"):
        assert word in run.printed
    assert "block at rest on table" in run.printed
    times_s, bounds_s = (
        sum(cycle[f"transfer_{what}_s"] for cycle in run.report["cycles"])
        for what in ("time", "bound")
    )
    assert f"from grasp to release: {times_s / bounds_s:.2f} times as long" in run.printed


def test_summary_without_a_transfer_compares_none(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--headless", "--hover", "5"]) == 1
    printed = capsys.readouterr().out
    assert "time: planning" in printed
    assert "from grasp to release" not in printed


@pytest.mark.slow
def test_both_arms_let_two_blocks_change_sides_at_the_same_time(tmp_path: Path) -> None:
    """Half a minute, nearly all of it planning: the arms' ways cross."""
    record, file = tmp_path / "both.mcap", tmp_path / "plan.json"
    report = report_of(tmp_path, "--both-arms", "--record", str(record), "--plan", str(file))
    assert report["success"]
    assert report["limb"] == "both"
    assert [cycle["limb"] for cycle in report["cycles"]] == ["left", "right"]
    together = report["together"]
    assert together["planned"]
    assert together["verified"]
    assert load_two_arm_plan(file).duration_s == pytest.approx(together["duration_s"])
    assert together["in_turn"] == ""
    assert together["proven_clearance_m"] > 0.0
    for cycle in report["cycles"]:
        assert cycle["success"]
        assert cycle["duration_s"] == pytest.approx(together["duration_s"], abs=1e-6)
        block = report["blocks"][cycle["block"]]
        np.testing.assert_allclose(block["final_m"][:2], cycle["place_m"][:2], atol=PLACED_WITHIN_M)
        assert block["start_m"][1] * block["final_m"][1] < 0.0  # on the other side
    alone_s = sum(
        each["end_s"] - each["begin_s"] for each in together["steps"] if each["arm"] == "left"
    )
    assert together["duration_s"] < 1.6 * alone_s
    found = read_recording(record).recording
    assert {move.limb for move in found.moves} == {"left", "right"}
    assert found.limbs == ("left", "right")
