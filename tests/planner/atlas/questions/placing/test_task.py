"""Tasks at a table that has no place yet."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.atlas import TableTask, TableTransfer, Visit
from planner.errors import SceneError, TaskError

HERE = pin.SE3(np.diag([-1.0, 1.0, -1.0]), np.array([0.1, 0.2, 0.8]))


@given(yaw=st.floats(-3.0, 3.0), x=st.floats(-1.0, 1.0), y=st.floats(-1.0, 1.0))
@settings(max_examples=20)
def test_poses_are_those_of_the_planner_at_every_placement(
    task: TableTask, yaw: float, x: float, y: float
) -> None:
    T_base_table = pin.SE3(pin.utils.rotate("z", yaw), np.array([x, y, -0.9]))
    planned = task.transfers[0].seen_from_base(T_base_table)
    (job,) = task.jobs
    wanted = {
        "red: pick": planned.T_base_pick,
        "red: above the pick": planned.T_base_above_pick,
        "red: place": planned.T_base_place,
        "red: above the place": planned.T_base_above_place,
        "red: end": planned.T_base_end,
    }
    assert dict(job.poses).keys() == wanted.keys()
    for label, T_table_tip in job.poses:
        assert (T_base_table * T_table_tip).isApprox(wanted[label], 1e-9)


def test_the_body_goes_along_with_the_tip(task: TableTask) -> None:
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


def test_tasks_that_make_no_sense_are_refused(task: TableTask) -> None:
    with pytest.raises(TaskError, match="a task has a transfer or a visit"):
        TableTask()
    with pytest.raises(SceneError, match="no body 'red' in the scene"):
        TableTask(task.transfers)
    with pytest.raises(TaskError, match="'table' is not movable"):
        TableTask((TableTransfer("table", HERE, HERE),), bodies=task.bodies)
    with pytest.raises(SceneError, match="already has a body named 'red'"):
        TableTask(task.transfers, bodies=task.bodies, standing=task.bodies[1:])
    with pytest.raises(TaskError, match=r"Visit\.name"):
        Visit(3, HERE)  # type: ignore[arg-type]
