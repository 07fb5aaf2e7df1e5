from __future__ import annotations

import copy
import pickle
import re
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter, ElectricGripper, Tool
from baxter_kin.description.hands import hand_of
from baxter_kin.description.urdf import ShapeKind, UrdfShape
from baxter_kin.errors import ConfigurationError, DescriptionError, PoseError
from tests.conftest import at

MOUNTS = [
    ElectricGripper(fingers, slot, tips)
    for fingers, slots in (("narrow", (2, 3, 4)), ("wide", (1, 2, 3, 4)))
    for slot in slots
    for tips in ("paddle", "half_round")
]


BALL = UrdfShape(ShapeKind.SPHERE, (0.02,), xyz=(0.0, 0.0, 0.1))


def test_the_stock_robot_has_the_same_hand_on_both_sides(robot: Baxter, drawn: Baxter) -> None:
    alike = Baxter.load(hands=dict.fromkeys(("left", "right"), ElectricGripper()))
    assert robot.digest == alike.digest
    assert drawn.digest == Baxter.load(hands={"right": ElectricGripper(tips="half_round")}).digest


def test_every_hand_has_a_digest_of_its_own_and_the_rest_stays() -> None:
    hands: list[Any] = [*MOUNTS, None, Tool((BALL,), at(0, 0, 0.1)), Tool((BALL,), at(0, 0, 0.2))]
    robots = [Baxter.load(hands={"right": hand}) for hand in hands]
    assert len({robot.digest for robot in robots}) == len(hands)
    assert len({robot.description.identity.kinematics for robot in robots}) == 1


def test_the_difference_of_two_slots_is_said_in_millimetres() -> None:
    first, second = (Baxter.load(hands={"left": ElectricGripper(slot=s)}) for s in (2, 3))
    said = first.description.identity.difference(second.description.identity)
    assert re.fullmatch(r"joint l_gripper_[lr]_finger_joint lies 9\.5 mm elsewhere", said)


@pytest.mark.parametrize("mount", [None, *MOUNTS[::3], Tool((BALL,), at(0, 0, 0.1))], ids=str)
def test_the_text_says_it_all(mount: Any) -> None:
    robot = Baxter.load(hands={"left": mount})
    assert Baxter.load(robot.description.text).digest == robot.digest


@pytest.mark.parametrize("mount", MOUNTS, ids=str)
def test_its_words_are_read_again(mount: ElectricGripper) -> None:
    assert hand_of(str(mount)) == mount
    assert mount == pickle.loads(pickle.dumps(mount)) == copy.deepcopy(mount)
    assert len(repr(mount)) <= 120


def test_what_the_words_leave_out_is_as_by_default() -> None:
    assert hand_of("wide") == ElectricGripper("wide")
    assert hand_of("half_round-4") == ElectricGripper(slot=4, tips="half_round")
    assert hand_of("none") is None


@pytest.mark.parametrize("text", ["", "broad", "narrow-wide", "2-3", "5", "1", "narrow-", "²"])
def test_other_words_are_refused(text: str) -> None:
    with pytest.raises(ConfigurationError):
        hand_of(text)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"fingers": "standard_narrow"}, "use narrow or wide"),
        ({"tips": "soft"}, "use paddle or half_round"),
        ({"slot": 0}, "slot 0 is not one of 1, 2, 3, 4"),
        ({"slot": 1}, "use slot 2, 3 or 4"),
        ({"slot": 2.5}, "must be int"),
        ({"slot": True}, "must be int"),
        ({"fingers": None}, "must be str"),
    ],
)
def test_a_gripper_that_cannot_be_is_refused(given: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigurationError, match=re.escape(words)):
        ElectricGripper(**given)


@pytest.mark.parametrize(
    ("hands", "words"),
    [
        (5, "given by side"),
        ([("left", None)], "given by side"),
        ({"middle": None}, "no side 'middle'"),
        ({"left": "narrow"}, "the left hand must be an ElectricGripper, a Tool or None"),
    ],
)
def test_hands_that_are_none_are_refused(hands: Any, words: str) -> None:
    with pytest.raises(DescriptionError, match=re.escape(words)):
        Baxter.load(hands=hands)


def test_a_tool_is_checked() -> None:
    for shapes in ((), (UrdfShape(ShapeKind.MESH, mesh="paddle_tip"),)):
        with pytest.raises(ConfigurationError, match="a tool"):
            Tool(shapes, at(0, 0, 0.1))
    with pytest.raises(ConfigurationError, match="are these millimetres"):
        Tool((BALL,), at(0, 0, 150.0))
    with pytest.raises(PoseError):
        Tool((BALL,), np.ones((4, 4)))
    tool = Tool((BALL,), at(0, 0, 0.1))
    for again in (pickle.loads(pickle.dumps(tool)), copy.deepcopy(tool)):
        assert again.shapes == tool.shapes
        assert again.T_hand_tip == tool.T_hand_tip
    assert len(repr(tool)) <= 120
