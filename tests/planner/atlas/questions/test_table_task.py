"""Tasks at a table, in programs and in JSON files."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Baxter, BaxterError
from baxter_kin.frames import raised
from planner import Manipulator
from planner.atlas import TableTask, TableTransfer, Visit, load_task
from planner.atlas.questions import task_file
from planner.errors import AtlasError, SceneError, TaskError
from planner.grasping.hand import Hand

HERE = pin.SE3(np.diag([-1.0, 1.0, -1.0]), np.array([0.1, 0.2, 0.8]))
RED = {
    "name": "red",
    "size_m": [0.05, 0.05, 0.05],
    "position_m": [-0.3, 0.15, 0.8],
    "is_movable": True,
}
FILE: dict[str, Any] = {
    "table": "table",
    "bodies": [RED],
    "transfers": [{"body": "red", "to": {"position_m": [-0.3, -0.15, 0.8]}}],
    "placements": {"x_m": [0.6, 1.0], "y_m": [0.0, 0.0], "step_m": 0.2, "yaw_deg": [0, 30]},
}


@given(yaw=st.floats(-3.0, 3.0), x=st.floats(-1.0, 1.0), y=st.floats(-1.0, 1.0))
@settings(max_examples=20)
def test_poses_are_those_of_the_planner_at_every_placement(
    task: TableTask, yaw: float, x: float, y: float
) -> None:
    T_base_table = pin.SE3(pin.utils.rotate("z", yaw), np.array([x, y, -0.9]))
    planned = task.transfers[0].seen_from_base(T_base_table)
    (job,) = task.jobs
    expected = {
        "red: before the pick": raised(planned.T_base_pick, planned.clear_m),
        "red: pick": planned.T_base_pick,
        "red: before the place": raised(planned.T_base_place, planned.clear_m),
        "red: place": planned.T_base_place,
        "red: end": raised(planned.T_base_place, planned.hover_m),
    }
    assert dict(job.poses).keys() == expected.keys()
    for label, T_table_tip in job.poses:
        assert (T_base_table * T_table_tip).isApprox(expected[label], 1e-9)


def test_the_carried_body_moves_with_the_tip(task: TableTask) -> None:
    (transfer,), block = task.transfers, task.bodies[1]
    T_tip_body = transfer.T_table_pick.actInv(block.T_base_body)
    moved = transfer.T_table_place * T_tip_body
    assert np.allclose(moved.translation, [-0.3, -0.15, 0.80])


def test_bodies_move_with_the_table_and_standing_ones_stay(task: TableTask) -> None:
    shelf = task.bodies[0].at(pin.SE3.Identity())
    both = TableTask(task.transfers, bodies=task.bodies[1:], standing=(shelf,))
    T = pin.SE3(pin.utils.rotate("z", 0.4), np.array([1.0, 0.1, -0.93]))
    scene = both.scene(T)
    assert scene["table"].T_base_body.isApprox(pin.SE3.Identity())
    assert scene["red"].T_base_body.isApprox(T * task.bodies[1].T_base_body)


def test_invalid_tasks_are_refused(task: TableTask) -> None:
    cases: list[tuple[type[BaxterError], Any]] = [
        (TaskError, TableTask),
        (SceneError, lambda: TableTask(task.transfers)),
        (TaskError, lambda: TableTask((TableTransfer("table", HERE, HERE),), bodies=task.bodies)),
        (
            SceneError,
            lambda: TableTask(task.transfers, bodies=task.bodies, standing=task.bodies[1:]),
        ),
        (TaskError, lambda: TableTransfer("red", HERE, HERE, hover_m=-1.0)),
        (TaskError, lambda: Visit(3, HERE)),  # type: ignore[arg-type]
    ]
    for error, make in cases:
        with pytest.raises(error):
            make()


@pytest.fixture(scope="module")
def hand(robot: Baxter) -> Hand:
    return Manipulator.of(robot, "left").hand


def written(folder: Path, content: object) -> Path:
    path = folder / "table.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_a_file_gives_the_task_that_it_describes(
    tmp_path: Path, hand: Hand, task: TableTask
) -> None:
    read, grid = load_task(written(tmp_path, FILE), hand)
    for (label, T), (same, expected) in zip(read.jobs[0].poses, task.jobs[0].poses, strict=True):
        assert label == same
        assert T.isApprox(expected, 1e-9)
    assert [body.name for body in read.bodies] == ["table", "red"]
    assert grid is not None
    assert len(grid) == 6
    assert grid.yaw_rad == pytest.approx((0.0, math.pi / 6))


def test_a_file_may_give_picks_and_visits(tmp_path: Path, hand: Hand) -> None:
    pick = {"position_m": [-0.3, 0.15, 0.79], "quat_xyzw": [0, 1, 0, 0]}
    content = FILE | {
        "transfers": [FILE["transfers"][0] | {"pick": pick}],
        "visits": [{"name": "look", "position_m": [0, 0, 1], "quat_xyzw": [0, 1, 0, 0]}],
        "placements": None,
    }
    read, grid = load_task(written(tmp_path, content), hand)
    assert grid is None
    assert np.allclose(read.transfers[0].T_table_pick.translation, [-0.3, 0.15, 0.79])
    assert np.allclose(read.transfers[0].T_table_place.translation, [-0.3, -0.15, 0.79])
    assert read.visits[0].name == "look"


def test_the_example_of_the_module_can_be_read(tmp_path: Path, hand: Hand) -> None:
    read, grid = load_task(written(tmp_path, str(task_file.__doc__).split("```")[1]), hand)
    assert len(read.jobs) == 2
    assert grid is not None


@pytest.mark.parametrize(
    "content",
    [
        "{",
        FILE | {"tables": 1},
        FILE | {"transfers": []},
        FILE | {"bodies": [RED, RED]},
        FILE | {"transfers": [{"body": "blue", "to": {"position_m": [0, 0, 0]}}]},
        FILE | {"table": "desk"},
        FILE | {"placements": {"x_m": [0, 1], "y_m": [0, 1], "of": "robot"}},
        FILE | {"visits": [{"name": "a", "position_m": [0, 0]}]},
        FILE | {"visits": [{"name": "a", "position_m": [0, 0, 1], "quat_xyzw": [0, 0, 0, 0]}]},
    ],
)
def test_invalid_files_are_refused_in_one_sentence(
    tmp_path: Path, hand: Hand, content: object
) -> None:
    with pytest.raises(AtlasError, match=r"table\.json: ") as refused:
        load_task(written(tmp_path, content), hand)
    assert "\n" not in str(refused.value)


def test_a_missing_file_is_refused(tmp_path: Path, hand: Hand) -> None:
    with pytest.raises(AtlasError, match="the task cannot be read"):
        load_task(tmp_path / "none.json", hand)
