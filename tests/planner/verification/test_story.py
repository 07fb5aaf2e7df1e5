"""The world through a plan: what the hands hold when, and orders that contradict it."""

from __future__ import annotations

import numpy as np
import pytest

from baxter_kin.description import RobotDescription
from planner import (
    Manipulator,
    Plan,
)
from planner.verification.body.robot_body import robot_body
from planner.verification.fingers import Fingers
from planner.verification.story import FingerMove, Run, Story
from planner.verification.urdf_robot import UrdfRobot


@pytest.fixture(scope="module")
def story(cube_plan: Plan, urdf: UrdfRobot) -> Story:
    solids = robot_body(RobotDescription.installed()).solids
    return Story(cube_plan, cube_plan.start, urdf, Fingers(urdf, solids))


def test_runs_and_travels_of_the_fingers_take_turns_and_hold_every_step(
    story: Story, cube_plan: Plan
) -> None:
    kinds = [type(stage) for stage in story.stages]
    assert kinds == [Run, FingerMove, Run, FingerMove, Run, FingerMove, Run]
    told = [
        step
        for stage in story.stages
        for step in (stage.moves if isinstance(stage, Run) else (stage.grip,))
    ]
    assert told == list(cube_plan.steps)
    assert story.faults == []


def test_fingers_are_as_far_open_as_the_last_travel_left_them(story: Story) -> None:
    for run, travel, following in zip(*(story.stages[k::2] for k in (0, 1, 2)), strict=False):
        assert isinstance(run, Run)
        assert isinstance(travel, FingerMove)
        assert isinstance(following, Run)
        assert (travel.begin_m, travel.end_m) == (run.finger_m, following.finger_m)


def test_a_body_is_in_the_hand_or_in_the_scene_never_in_both(story: Story) -> None:
    laden = []
    for run in story.stages:
        if isinstance(run, Run):
            is_carried = run.carried is not None
            assert is_carried is ("block" not in run.scene.bodies)
            laden.append(is_carried)
    assert laden == [False, False, True, False]


def test_what_was_let_go_stands_where_the_tip_put_it(
    story: Story, manipulator: Manipulator, cube_plan: Plan
) -> None:
    laden, last = (story.stages[k] for k in (4, 6))
    assert isinstance(laden, Run)
    assert isinstance(last, Run)
    assert laden.carried is not None
    assert laden.is_put_down
    tip = manipulator.arm.T_base_tip(laden.moves[-1].trajectory.q_goal)
    off = last.scene["block"].T_base_body.homogeneous - (tip * laden.carried.T_tip_body).homogeneous
    assert np.abs(off).max() < 1e-9
    assert last.released == "block"
