from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, Baxter
from lessons.answers import (
    Feedback,
    Mistake,
    Verdict,
    exercise,
    instance,
    joint_angles,
    number,
    numbers,
    refuse,
    shown,
)
from planner import Trajectory


@exercise("set `answer` to one")
def check_one(answer: object) -> str:
    """Whether it is one."""
    if number(answer, "one number") != 1.0:
        raise Mistake("that is not one")
    return "one is one"


def test_feedback_is_shown_as_its_sentence() -> None:
    assert repr(check_one(1)) == "Right: one is one"
    assert repr(check_one(2)) == "Not yet: that is not one."
    assert repr(check_one(...)) == "Not answered yet: set `answer` to one."


def test_only_what_is_right_is_right() -> None:
    assert check_one(1).is_right
    assert not check_one(2).is_right
    assert not check_one(None).is_right


@pytest.mark.parametrize("answer", [..., None, (..., ...), [1, None]])
def test_what_is_open_is_not_judged(answer: object) -> None:
    assert check_one(answer) == Feedback(Verdict.OPEN, "set `answer` to one.")


def test_an_error_of_ours_becomes_a_sentence() -> None:
    @exercise("give joint angles")
    def check(answer: object) -> str:
        Baxter.load().arm(str(answer))
        return "there is such an arm"

    assert check("left").is_right
    said = check("middle")
    assert said.verdict is Verdict.WRONG
    assert "middle" in said.text


def test_a_check_is_documented_by_what_it_judges() -> None:
    assert check_one.__name__ == "check_one"
    assert check_one.__doc__ == "Whether it is one."


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        ("3", "it is '3'"),
        (True, "it is True"),
        (np.nan, "it is nan"),
        ([1.0, 2.0], r"shape \(2,\)"),
        (object(), "class object"),
        (pin.SE3.Identity(), r"\.translation"),
    ],
)
def test_what_is_no_number_is_said(answer: object, told: str) -> None:
    with pytest.raises(Mistake, match=told):
        number(answer, "one number")


@pytest.mark.parametrize("answer", [3, 3.0, np.float32(3), [3], np.array([[3]])])
def test_a_number_may_come_in_any_form(answer: object) -> None:
    assert number(answer, "one number") == 3.0


def test_numbers_may_come_as_a_column() -> None:
    assert numbers(np.ones((3, 1)), 3, "three numbers").shape == (3,)


def test_a_typical_mistake_is_named() -> None:
    with pytest.raises(Mistake, match="in millimetres"):
        refuse([500.1, 0.0], {"in metres": [0.5, 0.0], "in millimetres": [500.0, 0.0]}, 1e-3)
    refuse([0.6, 0.0], {"in metres": [0.5, 0.0], "of another shape": 0.6}, 1e-3)


def test_joint_angles_beyond_a_limit_are_named_with_the_order(arm: Arm) -> None:
    q = np.array(arm.neutral)
    q[3] = -1.0
    with pytest.raises(Mistake, match=r"_e1 is at -1\.000 rad.*_s0, \w+_s1, \w+_e0"):
        joint_angles(q, arm)


def test_joint_angles_in_degrees_are_named(arm: Arm) -> None:
    with pytest.raises(Mistake, match="degrees"):
        joint_angles(np.degrees(arm.neutral), arm)


def test_an_answer_of_another_class_is_named() -> None:
    with pytest.raises(Mistake, match=r"should be a Trajectory.*class float"):
        instance(1.0, Trajectory, "plan_joint_move")


def test_a_point_is_shown_to_the_millimetre() -> None:
    assert shown([0.7, 0.1, -0.12345]) == "(0.700, 0.100, -0.123)"
