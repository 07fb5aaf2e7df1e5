"""Tasks in JSON files."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from planner import Manipulator
from planner.atlas import TableTask, load_task
from planner.errors import AtlasError
from planner.grasping.hand import Hand

FILE: dict[str, Any] = {
    "table": "table",
    "bodies": [
        {
            "name": "red",
            "size_m": [0.05, 0.05, 0.05],
            "position_m": [-0.3, 0.15, 0.8],
            "is_movable": True,
        }
    ],
    "transfers": [{"body": "red", "to": {"position_m": [-0.3, -0.15, 0.8]}}],
    "placements": {"x_m": [0.6, 1.0], "y_m": [0.0, 0.0], "step_m": 0.2, "yaw_deg": [0, 30]},
}


@pytest.fixture(scope="module")
def hand(robot: Baxter) -> Hand:
    return Manipulator.of(robot, "left").hand


def written(folder: Path, **changes: object) -> Path:
    path = folder / "table.json"
    path.write_text(json.dumps(FILE | changes))
    return path


def test_a_file_says_the_same_as_the_task_it_describes(
    tmp_path: Path, hand: Hand, task: TableTask
) -> None:
    read, grid = load_task(written(tmp_path), hand)
    for (label, T), (same, wanted) in zip(read.jobs[0].poses, task.jobs[0].poses, strict=True):
        assert label == same
        assert T.isApprox(wanted, 1e-9)
    assert [body.name for body in read.bodies] == ["table", "red"]
    assert grid is not None
    assert len(grid) == 6
    assert grid.yaw_rad == pytest.approx((0.0, math.pi / 6))


def test_a_pick_and_visits_of_its_own(tmp_path: Path, hand: Hand) -> None:
    at = [-0.3, 0.15, 0.79]
    pick = {"position_m": at, "quat_xyzw": [0, 1, 0, 0]}
    changed = written(
        tmp_path,
        transfers=[FILE["transfers"][0] | {"pick": pick}],
        visits=[{"name": "look", "position_m": [0, 0, 1], "quat_xyzw": [0, 1, 0, 0]}],
        placements=None,
    )
    read, grid = load_task(changed, hand)
    assert grid is None
    assert np.allclose(read.transfers[0].T_table_pick.translation, at)
    assert np.allclose(read.transfers[0].T_table_place.translation, [-0.3, -0.15, 0.79])
    assert read.visits[0].name == "look"


def test_the_example_of_the_module_is_one(tmp_path: Path, hand: Hand) -> None:
    from planner.atlas.questions.placing import task_file  # noqa: PLC0415 - its docstring

    path = tmp_path / "told.json"
    path.write_text(str(task_file.__doc__).split("```")[1])
    read, grid = load_task(path, hand)
    assert len(read.jobs) == 2
    assert grid is not None


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"tables": 1}, "has an entry 'tables'; a Document has: table, bodies, transfers"),
        ({"transfers": []}, "a task has a transfer or a visit"),
        ({"transfers": [{"body": "blue", "to": {"position_m": [0, 0, 0]}}]}, "carries 'blue'"),
        ({"table": "desk"}, "no object 'desk'"),
        ({"placements": {"x_m": [0, 1], "y_m": [0, 1], "of": "robot"}}, "got 'robot'"),
        ({"visits": [{"name": "a", "position_m": [0, 0]}]}, "must have 3 items, got 2"),
        (
            {"visits": [{"name": "a", "position_m": [0, 0, 1], "quat_xyzw": [0, 0, 0, 0]}]},
            "quat_xyzw",
        ),
    ],
)
def test_files_that_make_no_sense_are_one_sentence(
    tmp_path: Path, hand: Hand, changes: dict[str, object], said: str
) -> None:
    with pytest.raises(AtlasError, match=r"table\.json") as refused:
        load_task(written(tmp_path, **changes), hand)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_files_that_are_not_there_or_no_json_are_told(tmp_path: Path, hand: Hand) -> None:
    with pytest.raises(AtlasError, match="the task cannot be read"):
        load_task(tmp_path / "none.json", hand)
    (tmp_path / "text.json").write_text("{")
    with pytest.raises(AtlasError, match=r"text\.json: is not complete JSON"):
        load_task(tmp_path / "text.json", hand)
