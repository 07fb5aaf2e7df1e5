"""The checks of notebook 8: every right answer passes, typical mistakes get their sentence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, pose_from_quaternion
from baxter_kin.ik import FarthestFromLimits
from baxter_kin.kinematics.arm import LIMBS
from lessons.two_arms import (
    BLUE_PLACE,
    DOWN,
    TRAY_GOAL_BASE,
    TRAY_YAW_RAD,
    UPRIGHT,
    check_list,
    check_place,
    check_tray,
)
from planner import (
    Attachment,
    Body,
    Box,
    Manipulator,
    PairMove,
    Part,
    PickAndPlace,
    Scene,
    State,
    TwoArmPlan,
    load_object,
    make_block,
    plan_pair_move,
    plan_together,
)
from sim import World
from tests.lessons.told import assert_told

Tasks = dict[str, list[PickAndPlace]]


def carry(name: str, pick: tuple[float, float], place: tuple[float, float]) -> PickAndPlace:
    return PickAndPlace(name, *(pose_from_quaternion((*xy, -0.13), DOWN) for xy in (pick, place)))


RED = carry("red", (0.65, 0.20), (0.75, 0.40))
GREEN = carry("green", (0.75, 0.08), (0.58, 0.42))
BLUE = carry("blue", (0.75, -0.20), (0.65, -0.40))


def planned(robot: Baxter, tasks: Tasks) -> TwoArmPlan:
    """A plan in the world of the first exercise."""
    world = World(robot)
    world.spawn(load_object("table", pose_from_quaternion((1.0, 0.0, -0.93), UPRIGHT)))
    for side in LIMBS:
        world.move_arm(side, robot.arm(side).start)
    for task in (RED, GREEN, BLUE):
        place = tuple(task.T_base_pick.translation)
        world.spawn(make_block(task.body, pose_from_quaternion(place, UPRIGHT)))
    return plan_together(tasks, {side: Manipulator.of(robot, side) for side in LIMBS}, world.state)


def test_a_plan_of_three_blocks_is_right(robot: Baxter) -> None:
    assert check_list(planned(robot, {"left": [RED, GREEN], "right": [BLUE]})).is_right


@pytest.mark.slow
def test_a_wrong_plan_is_explained(robot: Baxter) -> None:
    elsewhere = carry("blue", (0.75, -0.20), (0.65, -0.35))
    tasks: tuple[tuple[Tasks, str], ...] = (
        ({"left": [GREEN, RED], "right": [BLUE]}, "carries green and then red"),
        ({"left": [RED], "right": [BLUE]}, "left arm carries red, and it should"),
        ({"left": [RED, GREEN], "right": [elsewhere]}, "blue goes to"),
    )
    for given, told in tasks:
        assert_told(check_list(planned(robot, given)), told)
    assert_told(check_list(RED), "should be a TwoArmPlan")


def test_a_place_that_is_far_enough_is_right() -> None:
    assert check_place((0.70, -0.17)).is_right


def test_a_wrong_place_is_explained() -> None:
    for answer, told in (
        (BLUE_PLACE, "both hands cannot be"),
        ((0.70, -0.30), "at most 200 mm"),
        ("there", "x and y in m"),
    ):
        assert_told(check_place(answer), told)


@pytest.fixture(scope="module")
def tray(robot: Baxter) -> Any:
    """Moves of a tray in both hands to poses."""
    T_base_tray = pose_from_quaternion((0.5, 0.0, 0.05), UPRIGHT)
    arms, joints, held = {}, dict(World(robot).state.joints), []
    for side, sign in (("left", 1.0), ("right", -1.0)):
        R = np.array([[sign, 0.0, 0.0], [0.0, 0.0, -sign], [0.0, 1.0, 0.0]])
        T = pin.SE3(R, np.array([0.0, 0.22 * sign, 0.0]))
        arms[side] = Manipulator.of(robot, side)
        found = arms[side].ik.solve(T_base_tray * T, objective=FarthestFromLimits())
        joints |= robot.arm(side).joints(found.q)
        held.append(Attachment("tray", f"{side}_gripper", T.inverse()))
    body = Body("tray", (Part(Box((0.2, 0.5, 0.02)), pin.SE3.Identity()),), T_base_tray)
    state = State(Scene.of([body]), joints, tuple(held))

    def moved(yaw_rad: float, place: tuple[float, float, float] = TRAY_GOAL_BASE) -> PairMove:
        goal = pin.SE3(pin.utils.rotate("z", yaw_rad), np.array(place))
        return plan_pair_move(arms, state, goal)

    return moved


def test_a_turned_tray_is_right(tray: Any) -> None:
    assert check_tray(tray(TRAY_YAW_RAD)).is_right


def test_a_wrong_move_of_the_tray_is_explained(tray: Any) -> None:
    for answer, told in (
        (tray(-TRAY_YAW_RAD), "the other way"),
        (tray(0.0), "not turned by 15 degrees"),
        (tray(0.0, (0.50, 0.0, 0.20)), "ends at"),
        (TRAY_GOAL_BASE, "should be a PairMove"),
    ):
        assert_told(check_tray(answer), told)
