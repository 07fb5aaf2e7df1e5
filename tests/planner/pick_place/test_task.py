"""What goes where, and every way of not saying so."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.errors import PoseError
from planner import Line, Manipulator, PickAndPlace, Scene, plan_retract
from planner.errors import TaskError
from planner.pick_place.task import INWARD, MOVES, back_along, retreat_poses
from tests.planner.pick_place.conftest import PICK, PLACE

ROUNDING_M = 1e-12

NAMES = "approach", "retreat", "place_approach", "place_retreat"

heights_m = st.floats(1e-3, 100.0)


def pose(seed: int) -> pin.SE3:
    rng = np.random.default_rng(seed)
    return pin.SE3(pin.exp3(rng.uniform(-2.0, 2.0, 3)), rng.uniform(-1.0, 1.0, 3))


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


@pytest.mark.parametrize(
    "given",
    [
        {"direction": (0.0, 0.0, 0.0)},
        {"direction": (np.nan, 0.0, 1.0)},
        {"direction": (1.0, 0.0)},
        {"direction": "hand"},
        {"direction": None},
        {"length_m": 0.0},
        {"length_m": -0.1},
        {"length_m": np.inf},
        {"length_m": "far"},
    ],
    ids=str,
)
def test_a_line_without_direction_or_length_is_refused(given: dict[str, Any]) -> None:
    with pytest.raises(TaskError):
        Line(given.get("direction", "tool"), given.get("length_m", 0.1))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("lines", ["tool", (0.0, 0.0, 1.0), [Line("tool", 0.1), None]], ids=str)
def test_what_is_no_line_is_refused(name: str, lines: Any) -> None:
    with pytest.raises(TaskError):
        PickAndPlace("block", PICK, PLACE, **{name: lines})


@given(heights_m, heights_m)
def test_lines_are_vertical_by_default(hover_m: float, clear_m: float) -> None:
    task = PickAndPlace("block", PICK, PLACE, hover_m, clear_m)
    assert tuple(leg.label for leg in task.legs) == MOVES
    lift_m = min(hover_m, clear_m)
    heights = [(PICK, lift_m), (PICK, 0.0), (PICK, lift_m)]
    heights += [(PLACE, lift_m), (PLACE, 0.0), (PLACE, hover_m)]
    for leg, (T, height_m) in zip(task.legs, heights, strict=True):
        rise = leg.T_base_goal.translation - T.translation
        np.testing.assert_allclose(rise, [0.0, 0.0, height_m], atol=ROUNDING_M)
        np.testing.assert_array_equal(leg.T_base_goal.rotation, T.rotation)
        assert leg.line is None or leg.is_vertical
    assert task.T_base_end.isApprox(task.legs[-1].T_base_goal)


directions = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda d: np.linalg.norm(d) > 0.1)
lines = st.builds(Line, st.one_of(st.just("tool"), directions), st.floats(0.01, 0.5))
several = st.lists(lines, max_size=3).map(tuple)
poses = st.builds(pose, st.integers(0, 2**32 - 1))


@given(poses, poses, st.fixed_dictionaries(dict.fromkeys(NAMES, several)))
def test_each_leg_begins_where_the_one_before_it_ends(
    pick: pin.SE3, place: pin.SE3, given_lines: dict[str, Any]
) -> None:
    task = PickAndPlace("block", pick, place, **given_lines)
    labels = [leg.label for leg in task.legs]
    assert len(set(labels)) == len(labels)
    for before, leg in pairwise(task.legs):
        if leg.line is None:
            continue
        ends = leg.line.T_base_start, leg.line.T_base_goal
        start, goal = reversed(ends) if leg.stage in INWARD else ends
        assert start.isApprox(before.T_base_goal, ROUNDING_M)
        assert goal.isApprox(leg.T_base_goal, ROUNDING_M)
    by_label = {leg.label: leg for leg in task.legs}
    assert by_label["pick: descend"].T_base_goal.isApprox(pick)
    assert by_label["place: descend"].T_base_goal.isApprox(place)


@given(poses, several)
def test_a_retreat_back_along_an_approach_ends_where_that_began(
    T: pin.SE3, approach: tuple[Line, ...]
) -> None:
    start = T
    for line in reversed(approach):
        start = line.start(start)
    end = retreat_poses(T, back_along(approach))[-1]
    np.testing.assert_allclose(end.homogeneous, start.homogeneous, atol=ROUNDING_M)


def test_the_tool_advances_along_its_axis_and_draws_back() -> None:
    line = Line("tool", 0.1)
    np.testing.assert_allclose(line.start(PICK).translation, line.goal(PICK).translation)
    forwards = PICK.actInv(line.start(PICK)).translation
    np.testing.assert_allclose(forwards, [0.0, 0.0, -0.1], atol=ROUNDING_M)
