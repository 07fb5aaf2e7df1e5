from __future__ import annotations

import re
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.description import ElectricGripper
from baxter_kin.description.calibration import MAX_APART_M, MAX_TURNED_RAD, as_baxter
from baxter_kin.description.hands import finger_joints
from baxter_kin.description.urdf import Urdf
from baxter_kin.errors import DescriptionError, UnknownNameError
from tests.served_urdf import VARIANTS, served_urdf, variant


@pytest.fixture(scope="module")
def tree(drawn: Baxter) -> Urdf:
    """The tree of the stock robot."""
    return drawn.description.tree


def served(seed: int | None = None, **options: Any) -> str:
    return served_urdf(None if seed is None else np.random.default_rng(seed), **options)


XYZ, RPY, AXIS = 'origin rpy="[^"]*" xyz="[^"]*"', 'rpy="[^"]*"', 'axis xyz="[^"]*"'


def changed(text: str, joint: str, pattern: str, by: str) -> str:
    """A text in which a pattern of one joint is replaced."""
    whole = re.search(f'<joint name="{joint}".*?</joint>', text, re.DOTALL)
    assert whole is not None
    found, count = re.subn(pattern, by, whole[0])
    assert count
    return text.replace(whole[0], found)


def without(text: str, *joints: str) -> str:
    for name in joints:
        text = re.sub(f'<joint name="{name}".*?</joint>', "", text, flags=re.DOTALL)
    return text


def with_joint(text: str, parent: str) -> str:
    """A text with another movable joint."""
    knob = (
        f'<link name="x"/><joint name="knob" type="revolute"><parent link="{parent}"/>'
        '<child link="x"/><limit upper="1" velocity="1"/></joint></robot>'
    )
    return text.replace("</robot>", knob)


@pytest.mark.parametrize(
    ("joint", "pattern", "by", "reason"),
    [
        ("left_s1", XYZ, 'origin rpy="-1.5708 0 0" xyz="0.069 0 0.23"', "lies 40.3 mm"),
        ("left_e1", RPY, 'rpy="-1.57 -1.50 0"', "left_e1 is turned 71 mrad"),
        ("left_e1", AXIS, 'axis xyz="0 0.1 1"', "axis of its joint left_e1 is turned 100"),
        ("left_e1", AXIS, 'axis xyz="0 0 -1"', "turned 3142 mrad"),
        ("left_e1", "revolute", "prismatic", "left_e1 is prismatic"),
        ("left_e1", "revolute", "continuous", "'continuous'"),
        ("left_e1", "revolute", "fixed", "left_e1 is fixed"),
        ("pedestal_fixed", '"fixed"', '"revolute"', "has no <limit>"),
        ("head_pan", '"torso"', '"left_wrist"', "head_pan is on left_w2"),
        ("head_pan", XYZ, 'origin rpy="0 0 0" xyz="0.06 0 0.9"', "head_pan lies 214.0 mm"),
        ("left_s1", 'lower="[^"]*"', 'lower="2"', "empty range"),
        ("left_s1", 'lower="[^"]*"', 'lower="nan"', "lower 'nan'"),
        ("left_hand_camera_joint", '"left_hand"', '"left_wrist"', "camera_joint lies 113.5 mm"),
    ],
)
def test_a_joint_of_no_baxter_is_named(joint: str, pattern: str, by: str, reason: str) -> None:
    with pytest.raises(DescriptionError, match=reason) as refused:
        Baxter.load(changed(served(), joint, pattern, by))
    assert "\n" not in str(refused.value)


OTHER_ROBOT = '<robot name="x"><link name="base"/><joint name="arm_1" type="continuous"/></robot>'


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("<robot name='x'><link name='base'/></robot>", "head_pan is missing"),
        (OTHER_ROBOT, "used: this toolkit is for Baxter only; it"),
        (without(served(), "left_w2"), "left_w2 is missing"),
        (without(served(), "l_gripper_l_finger_joint"), "lacks l_gripper_l_finger_joint"),
        (with_joint(served(), "torso"), "knob is revolute, and not one of Baxter's"),
        ("this is no XML", "cannot be read"),
        ("<this is no XML", "not XML"),
        (b"", "not XML"),
    ],
)
def test_texts_of_other_robots_are_refused(text: str | bytes, reason: str) -> None:
    with pytest.raises(DescriptionError, match=reason):
        Baxter.load(text)


def test_a_movable_joint_on_a_hand_is_refused_unless_another_hand_is_named() -> None:
    text = with_joint(served(), "left_hand")
    with pytest.raises(DescriptionError, match=r"hands=\{'left'"):
        Baxter.load(text)
    assert Baxter.load(text, hands={"left": None}).joint_names


def test_fingers_of_another_length_are_refused_with_advice(robot: Baxter) -> None:
    """Rethink's standard fingers are 37.7 mm shorter, and there is no body of them."""
    text = changed(served(), "r_gripper_r_finger_tip_joint", "0.1127", "0.075")
    with pytest.raises(DescriptionError, match=r"by hands=\{'right'"):
        Baxter.load(text)
    hands = {side: ElectricGripper() for side in ("left", "right")}
    assert Baxter.load(text, hands=hands).digest == robot.digest


@pytest.mark.parametrize("name", VARIANTS)
def test_files_of_real_robots_load(name: str) -> None:
    robot = Baxter.load(variant(name))
    again = Baxter.load(robot.description.text)
    assert again.description.text == robot.description.text
    assert again.digest == robot.digest


@pytest.mark.parametrize("name", VARIANTS)
def test_in_files_of_real_robots_arms_are_as_stated(robot: Baxter, name: str) -> None:
    """Except for the mounts, they state every joint as it is drawn."""
    own = Baxter.load(variant(name))
    for side in ("left", "right"):
        q = robot.arm(side).neutral
        T_mount_hand, T_drawn = (
            each.model.frames[each.model.getFrameId(f"{side}_arm_mount")].placement.actInv(
                each.arm(side).with_tip(f"{side}_hand_link").T_base_tip(q)
            )
            for each in (own, robot)
        )
        rounding = 1e-12
        assert np.abs(T_mount_hand.homogeneous - T_drawn.homogeneous).max() < rounding


def test_a_fixed_joint_may_have_the_name_of_a_link_that_carries_another() -> None:
    text = variant("camera_on_the_head")
    robot = Baxter.load(text)
    names = [str(frame.name) for frame in robot.model.frames]
    assert len(set(names)) == len(names)
    assert {"cam", "cam_lens"} <= set(names)


def test_a_link_with_the_name_of_a_moving_joint_is_found_as_a_tip() -> None:
    arm = Baxter.load(variant("camera_named_as_a_moving_joint")).arm("left")
    T_hand_eye = (
        arm.with_tip("left_hand")
        .T_base_tip(arm.neutral)
        .actInv(arm.with_tip("left_w2").T_base_tip(arm.neutral))
    )
    np.testing.assert_allclose(T_hand_eye.translation, [0.0, 0.0, 0.05], atol=1e-12)


def test_older_head_is_replaced_and_parts_on_it_stay(
    drawn: Baxter,
) -> None:
    own = Baxter.load(variant("older_head"))
    for link in ("head", "screen", "display", "head_camera_link"):
        assert place(own.description.tree, "base", link) == place(
            drawn.description.tree, "base", link
        )
    lens = place(own.description.tree, "base", "lens").translation
    np.testing.assert_allclose(lens, [0.0947 + 0.1, 0.0, 0.686 + 0.1], atol=1e-12)
    assert any("head_pan 34.7 mm" in note for note in own.description.notes)


def test_calibrated_head_is_kept() -> None:
    text = changed(served(), "head_pan", XYZ, 'origin rpy="0 0 0" xyz="0.065 0 0.686"')
    robot = Baxter.load(text)
    assert place(robot.description.tree, "base", "head").translation[0] == 0.065
    assert robot.description.notes == ()


def test_a_gripper_on_a_base_of_the_robot_has_its_own_base_where_it_is(drawn: Baxter) -> None:
    own = Baxter.load(variant("grippers_on_bases")).description.tree
    for link in ("left_gripper_base_link", "right_gripper_base_link", "l_gripper_l_finger_tip"):
        difference = place(own, "base", link).homogeneous
        difference -= place(drawn.description.tree, "base", link).homogeneous
        assert np.abs(difference).max() < 1e-12
    assert place(own, "left_hand_link", "left_gripper_base").isIdentity(1e-12)


def test_limits_are_read_from_the_text_and_wider_ones_are_noted(
    caplog: pytest.LogCaptureFixture,
) -> None:
    wider = Baxter.load(variant("older_limits"))
    (note,) = wider.description.notes
    assert caplog.messages == [f"the URDF given as text: {note}"]
    assert "left_s0 up to 2.5/s instead of 1.5/s" in note
    assert "and 12 more" in note
    assert wider.arm("left").limits.v_max.tolist() == [2.5] * 4 + [5.0] * 3
    narrower = Baxter.load(changed(served(), "left_s0", 'upper="[^"]*"', 'upper="1.5"'))
    assert narrower.arm("left").limits.q_max[0] == 1.5
    assert narrower.description.notes == ()


def test_bounds_exceed_calibrations() -> None:
    for seed in range(3):
        text = served(seed, apart_m=0.7 * MAX_APART_M, turned_rad=0.45 * MAX_TURNED_RAD)
        assert Baxter.load(text).arm("left").limits.names[0] == "left_s0"


def test_links_of_any_name_are_known_by_their_joints() -> None:
    text = served(4)
    for name in ("left_upper_elbow", "l_gripper_l_finger"):
        text = re.sub(f'"{name}"', f'"{name}_of_mine"', text)
    assert Baxter.load(text).digest == Baxter.load(served(4)).digest


def test_a_tip_of_its_own_is_kept_where_there_is_no_gripper() -> None:
    links = '<link name="left_gripper_base"/><link name="left_gripper"/>'
    joints = (
        '<joint name="a" type="fixed"><origin xyz="0 0 0.025"/><parent link="left_hand"/>'
        '<child link="left_gripper_base"/></joint><joint name="b" type="fixed">'
        '<origin xyz="0 0 0.3"/><parent link="left_gripper_base"/><child link="left_gripper"/>'
        "</joint></robot>"
    )
    text = served(without_grippers=["left"]).replace("</robot>", links + joints)
    robot = Baxter.load(text)
    arm = robot.arm("left")
    tip, hand = (arm.model.getFrameId(name) for name in ("left_gripper", "left_hand_link"))
    T_hand_tip = arm.model.frames[hand].placement.actInv(arm.model.frames[tip].placement)
    np.testing.assert_allclose(T_hand_tip.translation, [0.0, 0.0, 0.325], atol=1e-15)
    assert arm.with_tip("left_gripper_base").tip_frame == "left_gripper_base"


def test_frames_that_a_text_leaves_out_are_where_the_drawings_have_them(drawn: Baxter) -> None:
    text = served()
    for tag, name in (("link", "pedestal"), ("joint", "pedestal_fixed")):
        text = re.sub(f'<{tag} name="{name}".*?</{tag}>', "", text, flags=re.DOTALL)
    assert "pedestal_fixed" not in text
    assert Baxter.load(text).digest == drawn.digest


@pytest.mark.parametrize("side", ["left", "right"])
def test_without_gripper_the_tip_is_where_the_drawings_have_it(robot: Baxter, side: str) -> None:
    bare = Baxter.load(served(without_grippers=[side]))
    assert not set(finger_joints(side)) & set(bare.joint_names)
    q = robot.arm(side).neutral
    difference = (
        bare.arm(side).T_base_tip(q).homogeneous - robot.arm(side).T_base_tip(q).homogeneous
    )
    rounding = 1e-15
    assert np.abs(difference).max() <= rounding
    assert bare.digest != robot.digest
    with pytest.raises(UnknownNameError):
        bare.arm(side).with_tip(f"{side}_gripper_base_link")


@pytest.mark.parametrize(
    "name", ["left_hand", "left_hand_link", "left_hand_camera", "left_gripper"]
)
def test_frames_have_both_names(name: str) -> None:
    arm = Baxter.load(served(2)).arm("left").with_tip(name)
    assert arm.tip_frame.removesuffix("_link") == name.removesuffix("_link")


def test_stock_robot_is_unchanged(tree: Urdf) -> None:
    assert as_baxter(tree, tree) == tree


def place(tree: Urdf, first: str, last: str) -> pin.SE3:
    """The pose of a link by Pinocchio, with all joints at zero."""
    model = pin.buildModelFromXML(tree.text)
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    T, T_last = (data.oMf[model.getFrameId(name, pin.FrameType.BODY)] for name in (first, last))
    return T.actInv(T_last)
