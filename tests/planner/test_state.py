"""States: joints, bodies, and what hands hold."""

from __future__ import annotations

from itertools import repeat
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from planner import Body, Manipulator, Scene, State
from planner.errors import SceneError, TaskError
from planner.scene.bodies import Attachment
from tests.conftest import at

ORIGIN = at(0.0, 0.0, 0.0)
BAD_NUMBERS = (np.nan, np.inf, "0.1", None)


def test_joints_are_those_that_the_manipulator_plans_for(robot: Baxter, scene: Scene) -> None:
    q_others = np.array(robot.configuration({"right_s0": 0.3, "l_gripper_l_finger_joint": 0.01}))
    found = State.of(Manipulator.of(robot, "left", q_others=q_others), scene)
    assert set(found.joints) == set(robot.joint_names)
    assert found.joints["right_s0"] == 0.3
    assert found.joints["l_gripper_l_finger_joint"] == 0.01


def test_fingers_beyond_their_stroke_count_as_fully_open(robot: Baxter) -> None:
    """And the second finger mirrors the first, whatever its given position."""
    q_others = robot.configuration({"l_gripper_l_finger_joint": 0.5})
    manipulator = Manipulator.of(robot, "left", q_others=q_others)
    joints = State.of(manipulator, Scene.of()).joints
    stroke_m = manipulator.hand.stroke_m
    assert joints["l_gripper_l_finger_joint"] == stroke_m
    assert joints["l_gripper_r_finger_joint"] == -stroke_m


def test_it_keeps_its_joints_when_the_caller_changes_theirs(scene: Scene) -> None:
    joints = {"left_s0": 0.1}
    state = State(scene, joints)
    joints["left_s0"] = 0.2
    assert state.joints["left_s0"] == 0.1
    with pytest.raises(TypeError):
        state.joints["left_s0"] = 0.2  # type: ignore[index]


def test_both_hands_may_be_full(scene: Scene, block: Body) -> None:
    both = scene.with_body(Body("other", block.parts, block.T_base_body))
    attachments = held("block"), held("other", "right")
    assert State(both, {}, attachments).attachments == attachments


def held(body: str, side: str = "left") -> Attachment:
    return Attachment(body, f"{side}_gripper", ORIGIN)


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        *(((j,), TaskError) for j in (None, [0.1], {5: 0.1}, *({"s0": x} for x in BAD_NUMBERS))),
        *((({}, held), TaskError) for held in (None, 5, "block", [None])),
        (({}, (held("brick"),)), SceneError),
        (({}, (held("block"), held("table"))), TaskError),
    ],
    ids=str,
)
def test_refuses_invalid_joints_and_attachments(
    scene: Scene, arguments: tuple[Any, ...], error: type[Exception]
) -> None:
    with pytest.raises(error):
        State(scene, *arguments)


@pytest.mark.parametrize("bad", [None, 5, "left", [None], {}, repeat("left_s0")], ids=str)
def test_refuses_arguments_of_another_class(state: State, bad: Any) -> None:
    with pytest.raises(SceneError):
        State(bad, {})
    with pytest.raises(TaskError):
        State.of(bad, state.scene)
    with pytest.raises(TaskError):
        state.moved(bad, {})
    for names in (["left_s0", "left_s7"], *([] if bad == {} else [bad])):
        with pytest.raises(TaskError):
            state.q(names)


@pytest.fixture
def state(manipulator: Manipulator, scene: Scene) -> State:
    return State.of(manipulator, scene, q=manipulator.arm.start)


def test_a_held_body_moves_with_its_hand(state: State, manipulator: Manipulator) -> None:
    T_tip_body, arm = at(0.0, 0.0, 0.02), manipulator.arm
    moved = state.held_by("left_gripper", "block", T_tip_body).moved(
        manipulator.robot, arm.joints(arm.neutral)
    )
    assert moved.q(arm.joint_names).tolist() == arm.neutral.tolist()
    expected = arm.T_base_tip(arm.neutral) * T_tip_body
    assert moved.scene["block"].T_base_body.isApprox(expected)
    assert moved.scene["table"] is state.scene["table"]


def test_a_released_body_stays_behind(state: State, manipulator: Manipulator) -> None:
    robot, arm = manipulator.robot, manipulator.arm
    held = state.held_by("left_gripper", "block", ORIGIN).moved(robot, {})
    there = held.released("block")
    assert there.attachments == ()
    assert there.scene["block"] is held.scene["block"]
    lower = held.released("block", at(0.7, 0.1, 0.0)).moved(robot, arm.joints(arm.neutral))
    assert lower.scene["block"].T_base_body.isApprox(at(0.7, 0.1, 0.0))


def test_a_body_in_two_hands_is_where_both_have_it(state: State, manipulator: Manipulator) -> None:
    robot = manipulator.robot
    left, right = (
        robot.arm(side).T_base_tip(state.q(robot.arm(side).joint_names))
        for side in ("left", "right")
    )
    T = at(0.8, 0.0, 0.0)
    both = state.held_by("left_gripper", "block", left.actInv(T)).held_by(
        "right_gripper", "block", right.actInv(T)
    )
    assert both.moved(robot, {}).scene["block"].T_base_body.isApprox(T)
    with pytest.raises(TaskError, match="would tear it apart"):
        both.moved(robot, {"left_s0": 0.1})
