"""The world that a plan was made for, and what is no world."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from planner import Body, Manipulator, Scene, Situation
from planner.errors import SceneError, TaskError
from planner.scene.held import Held
from tests.conftest import at

ORIGIN = at(0.0, 0.0, 0.0)


def test_joints_stand_where_the_manipulator_plans_for_them(robot: Baxter, scene: Scene) -> None:
    q_others = np.array(robot.configuration({"right_s0": 0.3, "l_gripper_l_finger_joint": 0.01}))
    found = Situation.of(Manipulator.of(robot, "left", q_others=q_others), scene)
    assert set(found.joints) == set(robot.joint_names)
    assert found.joints["right_s0"] == 0.3
    assert found.joints["l_gripper_l_finger_joint"] == 0.01


def test_fingers_beyond_their_stroke_count_as_open_all_the_way(robot: Baxter) -> None:
    """And the second finger mirrors the first, wherever it was said to be."""
    q_others = robot.configuration({"l_gripper_l_finger_joint": 0.5})
    manipulator = Manipulator.of(robot, "left", q_others=q_others)
    joints = Situation.of(manipulator, Scene.of()).joints
    stroke_m = manipulator.hand.stroke_m
    assert joints["l_gripper_l_finger_joint"] == stroke_m
    assert joints["l_gripper_r_finger_joint"] == -stroke_m


def test_it_does_not_follow_the_joints_that_it_was_made_of(scene: Scene) -> None:
    joints = {"left_s0": 0.1}
    situation = Situation(scene, joints)
    joints["left_s0"] = 0.2
    assert situation.joints["left_s0"] == 0.1
    with pytest.raises(TypeError):
        situation.joints["left_s0"] = 0.2  # type: ignore[index]


@pytest.mark.parametrize("value", [np.nan, np.inf, "0.1", None])
def test_a_joint_that_stands_nowhere_is_refused_by_name(scene: Scene, value: Any) -> None:
    with pytest.raises(TaskError, match="joint left_s0"):
        Situation(scene, {"left_s0": value})


@pytest.mark.parametrize("joints", [None, [0.1], {5: 0.1}])
def test_joints_without_names_are_refused(scene: Scene, joints: Any) -> None:
    with pytest.raises(TaskError, match="joint"):
        Situation(scene, joints)


def test_a_held_body_must_be_in_the_scene(scene: Scene) -> None:
    with pytest.raises(SceneError, match="no body 'brick' in the scene; it has: "):
        Situation(scene, {}, (Held("left", "brick", ORIGIN),))


def test_both_hands_may_be_full(scene: Scene, block: Body) -> None:
    both = scene.with_body(Body("other", block.parts, block.T_base_body))
    held = Held("left", "block", ORIGIN), Held("right", "other", ORIGIN)
    assert Situation(both, {}, held).held == held


@pytest.mark.parametrize(
    "held",
    [
        (Held("left", "block", ORIGIN), Held("left", "table", ORIGIN)),
        (Held("left", "block", ORIGIN), Held("right", "block", ORIGIN)),
    ],
    ids=["two bodies in one hand", "one body in two hands"],
)
def test_a_hand_holds_one_body_and_a_body_is_in_one_hand(
    scene: Scene, held: tuple[Held, ...]
) -> None:
    with pytest.raises(TaskError, match="a hand holds one body and a body is held by one hand"):
        Situation(scene, {}, held)
