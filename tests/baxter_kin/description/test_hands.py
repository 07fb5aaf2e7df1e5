from __future__ import annotations

import copy
import pickle
import re
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, ElectricGripper, Tool
from baxter_kin.description import StockFiles
from baxter_kin.description.hands import hand_links, hand_of, with_hands
from baxter_kin.description.urdf import ShapeKind, UrdfShape
from baxter_kin.errors import BaxterError, ConfigurationError, DescriptionError, PoseError
from tests.conftest import at
from tests.served_urdf import served_urdf

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


def test_difference_of_two_slots_is_stated_in_millimetres() -> None:
    first, second = (Baxter.load(hands={"left": ElectricGripper(slot=s)}) for s in (2, 3))
    said = first.description.identity.difference(second.description.identity)
    assert re.fullmatch(r"joint l_gripper_[lr]_finger_joint lies 9\.5 mm elsewhere", said)


@pytest.mark.parametrize("mount", [None, *MOUNTS[::3], Tool((BALL,), at(0, 0, 0.1))], ids=str)
def test_text_determines_the_robot(mount: Any) -> None:
    robot = Baxter.load(hands={"left": mount})
    assert Baxter.load(robot.description.text).digest == robot.digest


@pytest.mark.parametrize("mount", MOUNTS, ids=str)
def test_its_words_are_read_again(mount: ElectricGripper) -> None:
    assert hand_of(str(mount)) == mount
    assert mount == pickle.loads(pickle.dumps(mount)) == copy.deepcopy(mount)
    assert len(repr(mount)) <= 120


def test_missing_words_mean_defaults() -> None:
    assert hand_of("wide") == ElectricGripper("wide")
    assert hand_of("half_round-4") == ElectricGripper(slot=4, tips="half_round")
    assert hand_of("none") is None


@pytest.mark.parametrize("text", ["", "broad", "narrow-wide", "2-3", "5", "1", "narrow-", "²"])
def test_other_words_are_refused(text: str) -> None:
    with pytest.raises(ConfigurationError):
        hand_of(text)


@pytest.mark.parametrize(
    ("make", "arguments", "error"),
    [
        (ElectricGripper, {"fingers": "standard_narrow"}, ConfigurationError),
        (ElectricGripper, {"tips": "soft"}, ConfigurationError),
        (ElectricGripper, {"slot": 1}, ConfigurationError),
        (ElectricGripper, {"slot": 2.5}, ConfigurationError),
        (ElectricGripper, {"slot": True}, ConfigurationError),
        (Tool, {"shapes": ()}, ConfigurationError),
        (Tool, {"shapes": (UrdfShape(ShapeKind.MESH, mesh="paddle_tip"),)}, ConfigurationError),
        (Tool, {"shapes": 101 * (BALL,)}, ConfigurationError),
        (Tool, {"shapes": (5,)}, ConfigurationError),
        (Tool, {"T_hand_tip": np.ones((4, 4))}, PoseError),
        (Baxter.load, {"hands": 5}, DescriptionError),
        (Baxter.load, {"hands": {"middle": None}}, DescriptionError),
        (Baxter.load, {"hands": {"left": "narrow"}}, DescriptionError),
    ],
)
def test_invalid_hands_are_refused(
    make: Any, arguments: dict[str, Any], error: type[BaxterError]
) -> None:
    defaults = {"shapes": (BALL,), "T_hand_tip": at(0, 0, 0.1)} if make is Tool else {}
    with pytest.raises(error):
        make(**(defaults | arguments))


# Mounting

STOCK_TEXT = StockFiles.installed().urdf.read_text(encoding="utf-8")


def both(hand: ElectricGripper) -> dict[str, ElectricGripper]:
    return {"left": hand, "right": hand}


RETHINKS = {"narrow": 0.01725, "wide": 0.05503}
"""`finger_width` of the fingers' xacro."""


def place(robot: Baxter, link: str, seen_from: str) -> pin.SE3:
    """The pose of a link by Pinocchio, with all joints at zero."""
    model = pin.buildModelFromXML(robot.description.text)
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    T, T_link = (data.oMf[model.getFrameId(name, pin.FrameType.BODY)] for name in (seen_from, link))
    return T.actInv(T_link)


@pytest.mark.parametrize(
    ("mount", "side"), list(zip(MOUNTS, len(MOUNTS) * ("left", "right"), strict=False)), ids=str
)
def test_fingers_are_where_rethinks_xacro_puts_them(mount: ElectricGripper, side: str) -> None:
    robot = Baxter.load(hands={side: mount})
    slot_m = (mount.slot - 1) * 0.0095 - 0.011
    for finger, sign in (("l", 1.0), ("r", -1.0)):
        link = f"{side[0]}_gripper_{finger}_finger"
        base = place(robot, link, f"{side}_hand_link").translation
        np.testing.assert_allclose(base, [0.0, sign * slot_m, 0.025 + 0.02], atol=1e-12)
        tip = place(robot, f"{link}_tip", link).translation
        np.testing.assert_allclose(tip, [0.0, sign * RETHINKS[mount.fingers], 0.1127], atol=1e-12)
    tip = place(robot, f"{side}_gripper", f"{side}_hand_link").translation
    np.testing.assert_allclose(tip, [0.0, 0.0, 0.025 + 0.1327], atol=1e-12)


def test_wide_fingers_of_a_robots_own_text_are_known_by_their_mesh() -> None:
    wide = STOCK_TEXT.replace("extended_narrow.DAE", "extended_wide.DAE")
    wide = wide.replace("0.01725 0.1127", "0.05503 0.1127")
    assert "paddle" in wide
    expected = {"left": ElectricGripper("wide"), "right": ElectricGripper("wide", 2, "half_round")}
    assert Baxter.load(wide).digest == Baxter.load(hands=expected).digest


def test_a_gripper_can_be_mounted_on_a_bare_flange_and_taken_off(robot: Baxter) -> None:
    bare = served_urdf(without_grippers=["left", "right"])
    assert Baxter.load(bare, hands=both(ElectricGripper())).digest == robot.digest
    assert Baxter.load(hands={"left": None, "right": None}).digest == Baxter.load(bare).digest


def test_a_calibrated_robot_keeps_its_joints_under_another_hand() -> None:
    text = served_urdf(np.random.default_rng(5))
    own, other = Baxter.load(text), Baxter.load(text, hands={"left": ElectricGripper(slot=3)})
    same, differs = own.description.identity, other.description.identity
    assert same.kinematics == differs.kinematics
    assert same.limits == differs.limits
    assert same.hands != differs.hands


def test_the_tip_of_a_tool_is_the_arms_tip() -> None:
    T_hand_tip = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2, 0.1), np.array([0.01, 0.02, 0.3]))
    robot = Baxter.load(hands={"left": Tool((BALL,), T_hand_tip)})
    arm = robot.arm("left")
    hand = arm.with_tip("left_hand")
    q = arm.start
    found = hand.T_base_tip(q).actInv(arm.T_base_tip(q))
    assert np.abs(found.homogeneous - T_hand_tip.homogeneous).max() < 1e-12
    assert robot.joint_names == Baxter.load(hands={"left": None}).joint_names


def test_a_mesh_that_is_not_known_is_refused_unless_another_hand_is_named() -> None:
    text = STOCK_TEXT.replace("paddle_tip.DAE", "basic_hard_tip.DAE")
    with pytest.raises(DescriptionError, match="the mesh basic_hard_tip; known are paddle_tip"):
        Baxter.load(text)
    assert Baxter.load(text, hands={"left": ElectricGripper()}).joint_names


def test_a_tools_link_in_a_text_must_be_one_simple_shape() -> None:
    text = Baxter.load(hands={"left": Tool((BALL,), at(0, 0, 0.1))}).description.text
    for radius, words in (("0.0", "above zero"), ("x", "finite number"), ("1 2", "needed: 1")):
        with pytest.raises(DescriptionError, match=words):
            Baxter.load(text.replace('sphere radius="0.02"', f'sphere radius="{radius}"'))
    with pytest.raises(DescriptionError, match="not one box, cylinder or sphere"):
        Baxter.load(text.replace('<sphere radius="0.02"/>', '<mesh filename="a/b.stl"/>'))


@pytest.mark.parametrize("side", ["left", "right"])
def test_without_its_gripper_the_tip_stays_where_it_was(drawn: Baxter, side: str) -> None:
    tree = drawn.description.tree
    bare = with_hands(tree, {side: None}, tree)
    flange, tip = f"{side}_hand_link", f"{side}_gripper"
    rounding = 1e-15
    difference = tree.pose(flange, tip).homogeneous - bare.pose(flange, tip).homogeneous
    assert np.abs(difference).max() <= rounding
    assert hand_links(bare, side) < hand_links(tree, side)


def test_on_a_flange_are_the_gripper_and_the_sensors_of_its_own_side(drawn: Baxter) -> None:
    links = hand_links(drawn.description.tree, "left")
    assert {"l_gripper_l_finger", "l_gripper_r_finger_tip", "left_gripper"} <= links
    assert not {"left_wrist", "left_hand_link", "r_gripper_l_finger", "base"} & links
