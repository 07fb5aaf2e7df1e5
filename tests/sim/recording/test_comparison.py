"""Comparisons of plans with recordings, and the command that prints them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.fields import evolve
from planner import Plan, PlanFailure, save_plan
from sim import Recording, read_recording, save_recording
from sim.errors import RecordingError
from sim.recording import Comparison, compare_run
from sim.recording.__main__ import main
from sim.recording.comparison import MAX_LAG_S
from sim.recording.plot import plot_comparison
from sim.recording.recorder import planned_recording

LAG_S, OFFSET_RAD, NOISE_RAD = 0.137, 0.005, 1e-3
JOINT = 3


@pytest.fixture(scope="module")
def run(plan: Plan) -> Recording:
    """An execution exactly as planned."""
    return planned_recording(plan)


@pytest.fixture(scope="module")
def lagged(run: Recording, left: Arm) -> Recording:
    """Every joint late by the same time, one beside its path, and noise."""
    rng, q = np.random.default_rng(0), np.array(run.q)
    columns = [run.joint_names.index(name) for name in left.joint_names]
    for column in columns:
        q[:, column] = np.interp(run.times_s - LAG_S, run.times_s, run.q[:, column])
    q[:, columns] += NOISE_RAD * rng.normal(size=(len(q), 7))
    q[:, columns[JOINT]] += OFFSET_RAD
    return evolve(run, q=q)


def test_a_run_as_planned_is_nowhere_off(plan: Plan, run: Recording) -> None:
    found = compare_run(plan, run)
    assert found.lag_s == 0.0
    assert found.worst_rad.max() < 1e-9
    assert found.worst_tip_m < 1e-9
    assert found.compared_moves == found.planned_moves == len(plan.moves)
    assert "WARNING" not in str(found)


def test_the_moves_that_are_missing_in_a_recording_are_counted(plan: Plan, run: Recording) -> None:
    """The recording of the first move does not show how well the second one was done."""
    two = evolve(plan, steps=plan.moves[:2], failure=None)
    (first,) = [move for move in run.moves if move.limb == plan.limb][:1]
    kept = run.times_s <= first.start_s + first.trajectory.duration
    arrays = {name: getattr(run, name)[kept] for name in ("times_s", "q", "gripper_percent")}
    given = evolve(run, **arrays, body_poses={}, moves=(first,), events=(), captions=())
    found = compare_run(two, given)
    assert (found.compared_moves, found.planned_moves) == (1, 2)
    assert "moves     1 of 2 in the recording; WARNING" in str(found)


def test_a_move_that_began_after_the_last_sample_is_not_in_the_recording(
    plan: Plan, run: Recording
) -> None:
    own = [move for move in run.moves if move.limb == plan.limb]
    kept = run.times_s < own[-1].start_s
    arrays = {name: getattr(run, name)[kept] for name in ("times_s", "q", "gripper_percent")}
    given = evolve(run, **arrays, body_poses={}, events=(), captions=())
    assert compare_run(plan, given).compared_moves == len(plan.moves) - 1


def test_a_lag_at_the_bound_of_its_search_is_told(plan: Plan, run: Recording) -> None:
    q = np.array(run.q)
    for column in q.T:
        column[:] = np.interp(run.times_s - 1.5 * MAX_LAG_S, run.times_s, column)
    found = compare_run(plan, evolve(run, q=q))
    assert found.is_lag_at_bound
    assert "WARNING: the greatest that was tried" in str(found)


def test_lag_is_taken_out_and_the_rest_is_told_of_each_joint(
    plan: Plan, lagged: Recording, left: Arm
) -> None:
    """The noise of the others is found by its size; the tip moves with the one that is beside."""
    found = compare_run(plan, lagged)
    assert found.joint_names == left.joint_names
    assert found.lag_s == pytest.approx(LAG_S, abs=3e-3)
    others = np.delete(np.arange(7), JOINT)
    np.testing.assert_allclose(found.rms_rad[others], NOISE_RAD, rtol=0.5)
    assert found.rms_rad[JOINT] == pytest.approx(OFFSET_RAD, rel=0.15)
    assert (found.rms_rad <= found.worst_rad).all()
    tip_m = OFFSET_RAD * left.jacobian(plan.moves[1].trajectory.q_goal)[:3, JOINT]
    assert found.rms_tip_m == pytest.approx(float(np.linalg.norm(tip_m)), rel=0.5)


def test_moves_of_a_file_without_moves_are_placed_where_they_fit(
    plan: Plan, run: Recording, tmp_path: Path
) -> None:
    file = tmp_path / "run.csv"
    save_recording(run, file)
    found = compare_run(plan, read_recording(file).recording)
    assert found.lag_s is None
    assert found.worst_rad.max() < 2e-3
    assert len(found.times_s) == pytest.approx(plan.motion_time_s / 0.01, rel=0.05)


@pytest.mark.parametrize(
    "changes",
    [
        {"plan": "plan.json"},
        {"recording": "run.mcap"},
        {"robot": "stock"},
        *({"speed": speed} for speed in (0.0, -1.0, np.nan, "fast")),
    ],
)
def test_impossible_comparisons_are_refused(
    plan: Plan, run: Recording, changes: dict[str, Any]
) -> None:
    default: dict[str, Any] = {"plan": plan, "recording": run}
    with pytest.raises(RecordingError):
        compare_run(**(default | changes))


def test_recordings_that_do_not_hold_the_plan_are_refused(plan: Plan, run: Recording) -> None:
    bare = evolve(run, moves=())
    empty = evolve(plan, steps=(), failure=PlanFailure("a", "b"))
    for of, given, speed in (
        (plan, evolve(run, limbs=("right",)), 1.0),
        (empty, run, 1.0),
        (plan, bare, 0.3),  # the recording is too short
    ):
        with pytest.raises(RecordingError):
            compare_run(of, given, speed=speed)


def test_the_command_prints_a_table_and_draws(
    plan: Plan, lagged: Recording, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [tmp_path / name for name in ("plan.json", "run.mcap", "off.png", "plan.mcap")]
    save_plan(plan, files[0])
    save_recording(lagged, files[1])
    arguments = ["compare", *map(str, files[:2])]
    assert main([*arguments, "--plot", str(files[2])]) == 0
    printed = capsys.readouterr().out
    assert "left_e1" in printed
    assert "moves     6 of 6 in the recording" in printed
    assert "lag       0.1" in printed
    assert files[2].read_bytes().startswith(b"\x89PNG")
    assert main(["compare", str(files[0]), str(files[3])]) == 2
    assert main([*arguments, "--plot", str(tmp_path / "off.what")]) == 1
    assert len(capsys.readouterr().err.splitlines()) == 2


def test_a_plot_has_a_line_for_each_joint_and_the_tip(plan: Plan, lagged: Recording) -> None:
    joints, tip = plot_comparison(compare_run(plan, lagged)).get_axes()
    assert [len(axes.lines) for axes in (joints, tip)] == [7, 1]


def test_a_comparison_of_other_shapes_is_refused() -> None:
    with pytest.raises(RecordingError):
        Comparison(("left_s0",), np.zeros(2), np.zeros((2, 6)), np.zeros(2), 1, 1)
