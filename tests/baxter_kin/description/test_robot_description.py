from __future__ import annotations

import pickle
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, Baxter, ElectricGripper
from baxter_kin.description import RobotDescription, StockFiles
from baxter_kin.description.calibration import MOST_APART_M, MOST_TURNED_RAD, finger_joints
from baxter_kin.errors import DescriptionError, UnknownNameError
from tests.served_urdf import served_urdf

STOCK = StockFiles.installed()


def served(seed: int | None = None, **options: Any) -> str:
    return served_urdf(None if seed is None else np.random.default_rng(seed), **options)


def worst_difference(first: pin.Model, second: pin.Model) -> float:
    """Of all joints and all frames that both have, over random configurations, m or none."""
    rng, worst = np.random.default_rng(0), 0.0
    data = first.createData(), second.createData()
    names = {f.name: f.name.removesuffix("_link") for f in first.frames}
    others = {f.name.removesuffix("_link") for f in second.frames}
    links = [n for n, short in names.items() if short in others and first.existFrame(n, BODY)]
    for _ in range(20):
        q = rng.uniform(first.lowerPositionLimit, first.upperPositionLimit)
        for model, each in zip((first, second), data, strict=True):
            pin.framesForwardKinematics(model, each, q)
        pairs = [(data[0].oMi[i], data[1].oMi[i]) for i in range(first.njoints)]
        for name in links:
            found = name if second.existFrame(name, BODY) else names[name]
            where = first.getFrameId(name, BODY), second.getFrameId(found, BODY)
            pairs.append((data[0].oMf[where[0]], data[1].oMf[where[1]]))
        worst = max(worst, *(np.abs(a.homogeneous - b.homogeneous).max() for a, b in pairs))
    return worst


BODY = pin.FrameType.BODY


def test_finds_the_installed_files() -> None:
    assert STOCK.urdf.is_file()
    assert STOCK.srdf.is_file()
    mesh = "example-robot-data/robots/baxter_description/meshes/head/H0.DAE"
    assert (STOCK.package_dir / mesh).is_file()


def test_missing_file_is_named(tmp_path: Path) -> None:
    nowhere = tmp_path / "baxter.urdf"
    with pytest.raises(DescriptionError, match=r"lacks .*baxter\.urdf"):
        StockFiles(urdf=nowhere, srdf=nowhere, package_dir=tmp_path)


def test_stock_robot_is_that_of_the_file(robot: Baxter) -> None:
    whole = pin.buildModelFromUrdf(str(STOCK.urdf))
    assert list(robot.model.names) == list(whole.names)
    assert [f.name for f in robot.model.frames] == [f.name for f in whole.frames]
    assert worst_difference(robot.model, whole) == 0.0
    for limit in ("lowerPositionLimit", "upperPositionLimit", "velocityLimit", "effortLimit"):
        np.testing.assert_array_equal(getattr(robot.model, limit), getattr(whole, limit))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("without", [(), ("left",), ("left", "right")])
def test_kinematics_are_those_that_pinocchio_reads(seed: int, without: tuple[str, ...]) -> None:
    """From the untouched text; bit by bit, since every number is kept."""
    text = served(seed, without_grippers=without, limit_change=0.01, shuffled=True)
    own, untouched = Baxter.load(text).model, pin.buildModelFromXML(text)
    assert list(own.names) == list(untouched.names)
    assert worst_difference(own, untouched) == 0.0
    for limit in ("lowerPositionLimit", "upperPositionLimit", "velocityLimit"):
        np.testing.assert_array_equal(getattr(own, limit), getattr(untouched, limit))


@pytest.mark.parametrize("side", ["left", "right"])
def test_arms_of_a_calibrated_robot_end_where_pinocchio_says(side: str) -> None:
    text = served(11)
    robot, untouched = Baxter.load(text), pin.buildModelFromXML(text)
    arm, data, rng = robot.arm(side), untouched.createData(), np.random.default_rng(0)
    rounding = 1e-14
    for _ in range(50):
        q = arm.random_configuration(rng)
        pin.framesForwardKinematics(untouched, data, robot.configuration(arm.joints(q)))
        T_base_tip = data.oMf[untouched.getFrameId(arm.tip_frame)]
        difference = arm.T_base_tip(q).homogeneous - T_base_tip.homogeneous
        assert np.abs(difference).max() < rounding


def test_path_text_and_bytes_are_the_same_robot(tmp_path: Path) -> None:
    text = served(3)
    path = tmp_path / "robot.urdf"
    path.write_text(text, encoding="utf-8")
    given: list[Any] = [path, str(path), text, text.encode(), f"\n  {text.split('?>')[1]}"]
    robots = [Baxter.load(each) for each in given]
    assert len({robot.digest for robot in robots}) == 1
    assert len({robot.description for robot in robots}) == 1
    assert robots[0].description.source == str(path)


def test_stock_robot_from_its_file_is_the_stock_robot(robot: Baxter) -> None:
    alike = {"right": ElectricGripper()}
    assert Baxter.load(STOCK.urdf, hands=alike).digest == robot.digest
    assert Baxter.load(served(), hands=alike).digest == robot.digest
    assert Baxter.load(STOCK.urdf).digest == Baxter.load(served()).digest != robot.digest
    assert Baxter.load(served(0, apart_m=0.0, turned_rad=0.0, shuffled=True)).digest != ""


def test_digest_is_the_same_in_another_process(robot: Baxter) -> None:
    code = "from baxter_kin import Baxter; print(Baxter.load().digest)"
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    assert found.stdout.strip() == robot.digest
    assert re.fullmatch("[0-9a-f]{64}", robot.digest)


def test_order_of_the_text_does_not_count() -> None:
    text = served(5)
    joints = re.findall(r"<joint.*?</joint>", text, re.DOTALL)
    turned = text
    for joint in joints:
        turned = turned.replace(joint, "")
    turned = turned.replace("</robot>", "".join(reversed(joints)) + "</robot>")
    assert Baxter.load(turned).description == Baxter.load(text).description


@pytest.mark.parametrize(
    "name", ["left_hand", "left_hand_link", "left_hand_camera", "left_gripper"]
)
def test_frames_have_both_names(name: str) -> None:
    arm = Baxter.load(served(2)).arm("left").with_tip(name)
    assert arm.tip_frame.removesuffix("_link") == name.removesuffix("_link")


def test_links_of_any_name_are_known_by_their_joints() -> None:
    text = served(4)
    for name in ("left_upper_elbow", "l_gripper_l_finger"):
        text = re.sub(f'"{name}"', f'"{name}_of_mine"', text)
    assert Baxter.load(text).digest == Baxter.load(served(4)).digest


def test_meshes_are_never_opened(tmp_path: Path) -> None:
    """Of all files that the process opens while it loads, none is named in the text."""
    path = tmp_path / "robot.urdf"
    path.write_text(served(1).replace("package://baxter_description", str(tmp_path / "away")))
    code = (
        "import sys; opened = []; sys.addaudithook("
        "lambda event, args: opened.append(str(args[0])) if event == 'open' else None);"
        f"from baxter_kin import Baxter; Baxter.load({str(path)!r});"
        "print([name for name in opened if 'away' in name or name.endswith(('.DAE', '.STL'))])"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    assert found.stdout.strip() == "[]"
    assert "away" not in Baxter.load(path).description.text


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


def changed(text: str, joint: str, pattern: str, by: str) -> str:
    """A text with something of one joint replaced."""
    whole = re.search(f'<joint name="{joint}".*?</joint>', text, re.DOTALL)
    assert whole is not None
    found, count = re.subn(pattern, by, whole[0])
    assert count
    return text.replace(whole[0], found)


def without(text: str, *joints: str) -> str:
    for name in joints:
        text = re.sub(f'<joint name="{name}".*?</joint>', "", text, flags=re.DOTALL)
    return text


XYZ, RPY, AXIS = 'origin rpy="[^"]*" xyz="[^"]*"', 'rpy="[^"]*"', 'axis xyz="[^"]*"'


@pytest.mark.parametrize(
    ("joint", "pattern", "by", "reason"),
    [
        ("left_s1", XYZ, 'origin rpy="-1.5708 0 0" xyz="0.069 0 0.23"', "lies 40.3 mm"),
        ("left_e1", RPY, 'rpy="-1.57 -1.50 0"', "joint left_e1 is turned 71 mrad"),
        ("left_e1", AXIS, 'axis xyz="0 0.1 1"', "axis of its joint left_e1 is turned 100 mrad"),
        ("left_e1", AXIS, 'axis xyz="0 0 -1"', "turned 3142 mrad"),
        ("left_e1", "revolute", "prismatic", "left_e1 is prismatic; Baxter's is revolute"),
        ("left_e1", "revolute", "continuous", "'continuous'"),
        ("left_e1", "revolute", "fixed", "left_e1 is fixed"),
        ("torso_t0", "fixed", "revolute", "torso_t0 is revolute, and not one of Baxter's"),
        ("head_pan", '"torso"', '"left_wrist"', "head_pan is on left_w2; Baxter's is on base"),
        ("left_s1", 'lower="[^"]*"', 'lower="2"', "left_s1 has an empty range"),
        ("left_s1", 'lower="[^"]*"', 'lower="nan"', "left_s1 has lower 'nan'"),
        (
            "left_hand_camera_joint",
            '"left_hand"',
            '"left_wrist"',
            "left_hand_camera_joint lies 113.5 mm",
        ),
    ],
)
def test_a_joint_of_no_baxter_is_named(joint: str, pattern: str, by: str, reason: str) -> None:
    with pytest.raises(DescriptionError, match=reason) as refused:
        Baxter.load(changed(served(), joint, pattern, by))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("<robot name='x'><link name='base'/></robot>", "joint head_pan is missing"),
        (without(served(), "left_w2"), "joint left_w2 is missing"),
        (without(served(), "l_gripper_l_finger_joint"), "lacks l_gripper_l_finger_joint"),
        ("this is no XML", "cannot be read"),
        ("<this is no XML", "no XML"),
        (b"", "no XML"),
    ],
)
def test_what_is_no_baxter_is_refused(text: str | bytes, reason: str) -> None:
    with pytest.raises(DescriptionError, match=reason):
        Baxter.load(text)


def test_a_joint_that_baxter_lacks_is_named() -> None:
    stool = (
        '<link name="stool"/><joint name="knob" type="revolute"><parent link="torso"/>'
        '<child link="stool"/><limit upper="1" velocity="1"/></joint></robot>'
    )
    with pytest.raises(DescriptionError, match="joint knob is revolute, and not one of Baxter's"):
        Baxter.load(served().replace("</robot>", stool))


@pytest.mark.parametrize("given", [5, dict, ["x"], np.zeros(3)])
def test_what_names_no_urdf_is_refused(given: Any) -> None:
    with pytest.raises(DescriptionError, match="given by its path, or as text or bytes"):
        Baxter.load(given)


def test_a_folder_a_pipe_and_nothing_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "away", Path("/dev/null")):
        with pytest.raises(DescriptionError, match="cannot be read"):
            Baxter.load(path)


def test_bounds_are_wide_of_what_calibration_does() -> None:
    for seed in range(5):
        text = served(seed, apart_m=0.7 * MOST_APART_M, turned_rad=0.45 * MOST_TURNED_RAD)
        assert Baxter.load(text).arm("left").limits.names[0] == "left_s0"


def test_can_be_pickled(arm: Arm) -> None:
    robot = Baxter.load(served(6))
    again = pickle.loads(pickle.dumps(robot))
    assert again.digest == robot.digest
    q = arm.neutral
    assert again.arm(arm.side).T_base_tip(q) == robot.arm(arm.side).T_base_tip(q)


def test_the_installed_description_is_the_stock_robot(robot: Baxter) -> None:
    assert RobotDescription.installed() == robot.description
