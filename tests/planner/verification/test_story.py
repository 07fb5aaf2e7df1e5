"""The world through a plan: what the hands hold when, and orders that contradict it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin.description import RobotDescription
from planner import (
    Attachment,
    Grip,
    GripperAction,
    Manipulator,
    Move,
    Plan,
    State,
    plan_joint_move,
    verify,
)
from planner.verification.body.robot_body import robot_body
from planner.verification.fingers import Fingers
from planner.verification.story import FingerMove, Run, Story
from planner.verification.urdf_robot import UrdfRobot
from tests.conftest import at
from tests.planner.verification.conftest import failed, forged, with_bodies


def verify_opening(plan: Plan) -> float:
    """How far each finger is open on the body it holds, m."""
    where = verify(plan)["gap of closed pads"].where
    return float(where.split("each finger ")[1].split(" mm")[0]) / 1e3


def test_a_block_out_of_the_hand_is_missed(plan: Plan) -> None:
    moved = with_bodies(plan, lambda scene: scene.moved("block", at(0.775, 0.125, -0.155)))
    found = verify(moved)
    assert {"gap of closed pads", "gripper actions out of order"} <= failed(found)
    assert "the hand holds nothing, not block" in found["gripper actions out of order"].where


def test_gripper_actions_out_of_order_are_found(plan: Plan) -> None:
    steps = tuple(s for s in plan if s.label != "pick: close")
    found = verify(forged(plan, steps=steps))
    assert "gripper actions out of order" in failed(found)


def test_a_body_that_is_not_there_is_found(plan: Plan) -> None:
    found = verify(with_bodies(plan, lambda scene: scene.without("block")))
    assert failed(found) == {"gripper actions out of order"}
    assert "no movable body 'block'" in found["gripper actions out of order"].where


def test_a_plan_of_one_arm_while_the_other_hand_holds_something_is_valid(
    cube_plan: Plan, holding: State
) -> None:
    found = verify(cube_plan, holding)
    assert found.is_valid, found.verdict


def test_a_hand_that_holds_something_carries_it_from_the_start(
    cube_plan: Plan, manipulator: Manipulator
) -> None:
    place = [step.label for step in cube_plan].index("place: approach")
    rest = cube_plan.steps[place:]
    assert isinstance(rest[0], Move)
    q = rest[0].trajectory.q_start
    way = plan_joint_move(q, rest[0].trajectory.q_goal, manipulator.limits)
    down = rest[1]
    assert isinstance(down, Move)
    lower = plan_joint_move(way.q_goal, down.trajectory.q_goal, manipulator.limits)
    steps = (
        replace(rest[0], trajectory=way),
        replace(down, trajectory=lower, is_straight=False),
        *rest[2:],
    )
    closed = verify_opening(cube_plan)
    joints = {
        **cube_plan.start.joints,
        "l_gripper_l_finger_joint": closed,
        "l_gripper_r_finger_joint": -closed,
        **manipulator.arm.joints(q),
    }
    T_tip_body = pin.SE3(pin.utils.rotate("x", np.pi), np.array([0.0, 0.0, 0.01]))
    body = cube_plan.start.scene["block"].at(manipulator.arm.T_base_tip(q) * T_tip_body)
    scene = cube_plan.start.scene.without("block").with_body(body)
    state = State(scene, joints, (Attachment("block", "left_gripper", T_tip_body),))
    found = verify(Plan(state, steps))
    assert not found["gripper actions out of order"].value, found.verdict
    assert failed(found) <= {"slide in contact"}, found.verdict


def test_an_open_that_lets_nothing_go_is_found(cube_plan: Plan) -> None:
    steps = tuple(
        replace(step, opening_m=0.001)
        if isinstance(step, Grip) and step.label == "place: open"
        else step
        for step in cube_plan
    )
    found = verify(replace(cube_plan, steps=steps))
    assert "gripper actions out of order" in failed(found)
    assert "lets nothing go" in found["gripper actions out of order"].where


def test_an_open_beyond_the_stroke_is_found(cube_plan: Plan) -> None:
    opening = Grip("wide", GripperAction.OPEN, None, 0.03)
    found = verify(replace(cube_plan, steps=(opening, *cube_plan.steps)))
    assert failed(found) == {"gripper actions out of order"}
    assert "its stroke is 20.833 mm" in found.verdict


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
