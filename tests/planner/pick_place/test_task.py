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


@pytest.mark.parametrize("hover", [0.0, -0.1, np.nan, np.inf, None, "high", [0.1], True, 10**400])
def test_a_hover_distance_that_is_none_raises(hover: Any) -> None:
    with pytest.raises(TaskError, match="hover distance"):
        PickAndPlace("block", PICK, PLACE, hover)


@pytest.mark.parametrize("pose", [None, "here", np.eye(3), np.full((4, 4), np.nan)])
def test_a_pose_that_is_none_raises(pose: Any) -> None:
    for poses in ((pose, PLACE), (PICK, pose)):
        with pytest.raises(PoseError):
            PickAndPlace("block", *poses)


@pytest.mark.parametrize("body", [None, 5, ["block"]])
def test_a_body_without_name_raises(body: Any) -> None:
    with pytest.raises(TaskError, match="body must be str"):
        PickAndPlace(body, PICK, PLACE)


@pytest.mark.parametrize("height_m", [1e308, 1001.0, np.nan, 0.0, "high", None], ids=str)
def test_a_height_beyond_what_is_measured_is_refused(
    manipulator: Manipulator, height_m: Any
) -> None:
    q, T = manipulator.arm.neutral, pin.SE3.Identity()
    with pytest.raises(TaskError, match="height_m must be"):
        plan_retract(manipulator, Scene.of(), q, height_m)
    with pytest.raises(TaskError, match="hover distance must be"):
        PickAndPlace("block", T, T, hover_m=height_m)
    with pytest.raises(TaskError, match="clear height must be"):
        PickAndPlace("block", T, T, clear_m=height_m)


@given(heights_m, heights_m)
def test_the_tip_moves_sideways_from_the_lower_of_both_heights(
    hover_m: float, clear_m: float
) -> None:
    task = PickAndPlace("block", PICK, PLACE, hover_m, clear_m)
    assert task.lift_m == min(hover_m, clear_m)


@given(heights_m, heights_m)
def test_waypoints_are_straight_above_pick_and_place(hover_m: float, clear_m: float) -> None:
    task = PickAndPlace("block", PICK, PLACE, hover_m, clear_m)
    for above, T, height_m in (
        (task.T_base_above_pick, PICK, task.lift_m),
        (task.T_base_above_place, PLACE, task.lift_m),
        (task.T_base_end, PLACE, hover_m),
    ):
        rise = above.translation - T.translation
        np.testing.assert_allclose(rise, [0.0, 0.0, height_m], atol=ROUNDING_M)
        np.testing.assert_array_equal(above.rotation, T.rotation)


def test_its_poses_do_not_follow_those_it_was_made_of() -> None:
    T = PICK.copy()
    task = PickAndPlace("block", T, PLACE)
    T.translation = np.zeros(3)
    np.testing.assert_array_equal(task.T_base_pick.translation, PICK.translation)


def test_a_height_in_millimetres_is_asked_about() -> None:
    with pytest.raises(TaskError, match=r"at most 1000 m, got 1500; are these millimetres\?"):
        PickAndPlace("block", PICK, PLACE, hover_m=1500)
