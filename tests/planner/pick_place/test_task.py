"""What goes where, and every way of not saying so."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.errors import PoseError
from planner import Manipulator, PickAndPlace, Scene, plan_retract
from planner.errors import TaskError
from tests.planner.pick_place.conftest import PICK, PLACE

ROUNDING_M = 1e-12

heights_m = st.floats(1e-3, 100.0)


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        *(({"body": bad}, TaskError) for bad in (None, 5, ["block"])),
        *(
            ({which: bad}, PoseError)
            for which in ("T_base_pick", "T_base_place")
            for bad in (None, "here", np.eye(3), np.full((4, 4), np.nan))
        ),
    ],
    ids=str,
)
def test_refuses_invalid_bodies_and_poses(changes: dict[str, Any], error: type[Exception]) -> None:
    arguments: dict[str, Any] = {"body": "block", "T_base_pick": PICK, "T_base_place": PLACE}
    with pytest.raises(error):
        PickAndPlace(**{**arguments, **changes})


@pytest.mark.parametrize(
    "height_m",
    [1e308, 1001.0, np.nan, np.inf, 0.0, -0.1, "high", None, [0.1], True, 10**400],
    ids=str,
)
def test_a_height_beyond_what_is_measured_is_refused(
    manipulator: Manipulator, height_m: Any
) -> None:
    q, T = manipulator.arm.neutral, pin.SE3.Identity()
    with pytest.raises(TaskError, match="height_m"):
        plan_retract(manipulator, Scene.of(), q, height_m)
    with pytest.raises(TaskError, match="hover distance"):
        PickAndPlace("block", T, T, hover_m=height_m)
    with pytest.raises(TaskError, match="clear height"):
        PickAndPlace("block", T, T, clear_m=height_m)


@given(heights_m, heights_m)
def test_waypoints_are_straight_above_pick_and_place(hover_m: float, clear_m: float) -> None:
    task = PickAndPlace("block", PICK, PLACE, hover_m, clear_m)
    assert task.lift_m == min(hover_m, clear_m)
    for above, T, height_m in (
        (task.T_base_above_pick, PICK, task.lift_m),
        (task.T_base_above_place, PLACE, task.lift_m),
        (task.T_base_end, PLACE, hover_m),
    ):
        rise = above.translation - T.translation
        np.testing.assert_allclose(rise, [0.0, 0.0, height_m], atol=ROUNDING_M)
        np.testing.assert_array_equal(above.rotation, T.rotation)
