"""The checks of notebook 2: every right answer passes, typical mistakes get their sentence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Baxter, IKService, pose_from_quaternion
from baxter_kin.ik import trace_self_motion
from lessons.inverse_kinematics import (
    DOWN,
    PLACE_BASE,
    POSE_BASE,
    check_edge,
    check_elbows,
    check_place,
)
from tests.lessons.told import assert_told

ROBOT = Baxter.load()
ARM = ROBOT.arm("left")
IK = IKService(ARM)
POSE = pose_from_quaternion(PLACE_BASE, DOWN)
X, Y, Z = PLACE_BASE


def solved(x: float, y: float, z: float, quat_xyzw: Any = DOWN) -> Any:
    return IK.solve(pose_from_quaternion((x, y, z), quat_xyzw), current=ARM.start)


PLACED = solved(X, Y, Z)
CURVE = trace_self_motion(ARM, solved(*POSE_BASE).q).q


def test_a_result_and_its_angles_are_right() -> None:
    assert check_place(PLACED).is_right
    assert check_place(PLACED.q).is_right
    assert check_place(list(PLACED.q)).is_right


@given(st.floats(-np.pi, np.pi))
def test_the_hand_may_be_turned_about_the_vertical(yaw_rad: float) -> None:
    turned = pin.SE3(pin.utils.rotate("z", yaw_rad) @ POSE.rotation, POSE.translation)
    result = IK.solve(turned)
    assert check_place(result).is_right == result.is_valid


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (np.degrees(PLACED.q), "degrees"),
        (POSE, r"ik\.solve\(pose\)\.q"),
        (solved(1e3 * X, 1e3 * Y, Z), "millimetres"),
        (solved(X, Y, Z, (0.0, 0.0, 1.0, 0.0)), "quaternion come with w first"),
        (solved(X, -Y, Z), "the robot's right"),
        (solved(X, Y, Z - 0.2), "200.0 mm off"),
        (IKService(ROBOT.arm("right")).solve(POSE).q, "the right arm's"),
        (solved(X, Y, Z, (0.0, np.cos(0.1), 0.0, np.sin(0.1))), "leans by 11.5 degrees"),
        ((1.0, 2.0), r"shape \(2,\)"),
    ],
)
def test_wrong_angles_are_explained(answer: Any, told: str) -> None:
    assert_told(check_place(answer), told)


def test_a_place_that_changed_its_axes_is_named() -> None:
    assert_told(check_place(solved(Y, X, Z)), "x and y have changed places")


def test_any_two_solutions_far_apart_are_right() -> None:
    assert check_elbows((CURVE[0], CURVE[len(CURVE) // 2])).is_right
    assert check_elbows(np.array([CURVE[len(CURVE) // 3], CURVE[-1]])).is_right
    assert check_elbows([solved(*POSE_BASE), CURVE[-1]]).is_right


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        ((CURVE[0], CURVE[0]), "one place"),
        ((CURVE[0], CURVE[3]), "cm apart"),
        ((PLACED, CURVE[0]), "the first is not a solution: its tip is 204.7 mm"),
        ((CURVE[0], np.degrees(CURVE[9])), "degrees"),
        (CURVE[0], "this is one solution"),
        (CURVE, r"these are \d+"),
        (PLACED, "two solutions"),
    ],
)
def test_wrong_elbows_are_explained(answer: Any, told: str) -> None:
    assert_told(check_elbows(answer), told)


@pytest.mark.parametrize("answer", [0.85, 0.855, np.float64(0.851)])
def test_the_edge_is_right_to_the_centimetre(answer: Any) -> None:
    assert check_edge(answer).is_right


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (0.84, "so is 1 cm more"),
        (0.86, r"out of reach \(proven, by 3 mm\)"),
        (85.0, "millimetres or centimetres"),
        (850, "millimetres or centimetres"),
    ],
)
def test_a_wrong_edge_is_explained(answer: Any, told: str) -> None:
    assert_told(check_edge(answer), told)
