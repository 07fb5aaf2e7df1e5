"""The checks of notebook 4: every right answer passes, typical mistakes get their sentence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, pose_from_quaternion
from baxter_kin.frames import T_world_base
from lessons.pick_and_place import (
    DOWN,
    FROM_BASE,
    TO_BASE,
    TURNED_BASE,
    UPRIGHT,
    check_camera,
    check_faster_arm,
    check_grasp,
)
from planner import (
    Manipulator,
    PickAndPlace,
    Plan,
    Scene,
    load_object,
    make_block,
    overhead_grasp,
    plan_pick_and_place,
)
from sim import Noise
from tests.lessons.told import assert_told

ROBOT = Baxter.load()
CENTRE = pin.SE3(np.eye(3), np.array(TURNED_BASE))
HAND_DOWN = pose_from_quaternion((0.0, 0.0, 0.0), DOWN)


def turned(angle_rad: float) -> pin.SE3:
    return pin.SE3(pin.utils.rotate("z", angle_rad), np.zeros(3))


def lifted(T: pin.SE3, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> pin.SE3:
    return pin.SE3(T.rotation, np.add(T.translation, [x, y, z]))


GRASP = CENTRE * turned(np.pi / 6) * HAND_DOWN


@pytest.mark.parametrize("quarter", range(-2, 3))
def test_all_four_ways_round_are_right(quarter: int) -> None:
    assert check_grasp(GRASP * turned(quarter * np.pi / 2)).is_right


def test_a_matrix_and_the_planners_own_grasp_are_right() -> None:
    assert check_grasp(GRASP.homogeneous).is_right
    block = make_block("turned", CENTRE * turned(np.pi / 6))
    assert check_grasp(overhead_grasp(Manipulator.of(ROBOT, "left").hand, block)).is_right


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (CENTRE * HAND_DOWN, "the hand is not"),
        (CENTRE * HAND_DOWN * turned(np.pi / 6), "the other way round"),
        (CENTRE * turned(30.0) * HAND_DOWN, "30 radians"),
        (CENTRE * turned(0.6) * HAND_DOWN, "4.4 degrees from square"),
        (CENTRE * turned(np.pi / 6), "points up"),
        (GRASP * pin.SE3(pin.utils.rotate("x", 0.1), np.zeros(3)), "leans"),
        (T_world_base() * GRASP, "where world sees the block"),
        (pin.SE3(GRASP.rotation, 1e3 * GRASP.translation), "millimetres"),
        (lifted(GRASP, z=0.025), "on top of the block"),
        (lifted(GRASP, y=-0.20), "the robot's right"),
        (lifted(GRASP, x=0.02), "20.0 mm from the block's centre"),
        (TURNED_BASE, "shape"),
    ],
)
def test_a_wrong_grasp_is_explained(answer: Any, told: str) -> None:
    assert_told(check_grasp(answer), told)


def planned(
    side: str, to: tuple[float, float, float] = TO_BASE, at: tuple[float, float, float] = FROM_BASE
) -> Plan:
    table = load_object("table", pose_from_quaternion((1.0, 0.0, -0.93), UPRIGHT))
    scene = Scene.of([table, make_block("red", pose_from_quaternion(at, UPRIGHT))])
    task = PickAndPlace("red", pose_from_quaternion(at, DOWN), pose_from_quaternion(to, DOWN))
    return plan_pick_and_place(task, Manipulator.of(ROBOT, side), scene, ROBOT.arm(side).neutral)


@pytest.mark.slow
def test_the_plan_of_the_faster_arm_is_right() -> None:
    said = check_faster_arm(planned("left"))
    assert said.is_right, said
    assert "the left arm is faster" in said.text


@pytest.mark.slow
def test_plans_of_other_tasks_are_explained() -> None:
    assert_told(check_faster_arm(planned("right")), "the right arm needs .* the left arm needs")
    assert_told(check_faster_arm(planned("left", (0.7, 0.2, -0.3))), "refused: place: descend")
    assert_told(check_faster_arm(planned("left", (0.7, 0.1, -0.13))), r"not to \(0\.700, 0\.200")
    other = planned("left", at=(0.7, 0.05, -0.13))
    assert_told(check_faster_arm(other), r"the block is at \(0\.700, 0\.050, -0\.130\) m; plan in")
    assert_told(check_faster_arm("left"), "should be a Plan")


def test_the_camera_is_right() -> None:
    assert check_camera(Noise(0.001, np.radians(0.5), 0.1)).is_right
    assert check_camera(Noise(1e-3, 0.0087, dropout=0.1, latency_s=0.0)).is_right


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (Noise(1.0, np.radians(0.5), 0.1), "a millimetre is 0.001"),
        (Noise(0.001, 0.5, 0.1), r"np\.radians\(0\.5\)"),
        (Noise(0.001, np.radians(0.5), 0.9), "one in ten, not nine"),
        (Noise(0.001, np.radians(0.5)), r"dropout should be 0\.1"),
        (Noise(0.001, np.radians(0.5), 0.1, 0.1), "leave latency_s out"),
        ((0.001, 0.0087, 0.1), "should be a Noise"),
    ],
)
def test_a_wrong_camera_is_explained(answer: Any, told: str) -> None:
    assert_told(check_camera(answer), told)
