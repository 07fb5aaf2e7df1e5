from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, ElectricGripper
from baxter_kin.description import RobotDescription, RobotIdentity, StockFiles
from baxter_kin.description.urdf import Urdf
from baxter_kin.errors import ConfigurationError, DescriptionError
from baxter_kin.fields import evolve
from tests.served_urdf import served_urdf

STOCK = StockFiles.installed()


def served(seed: int | None = None, **options: Any) -> str:
    return served_urdf(None if seed is None else np.random.default_rng(seed), **options)


def worst_difference(first: pin.Model, second: pin.Model) -> float:
    """The largest difference of poses of common joints and frames at random configurations."""
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


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=r"lacks .*baxter\.urdf"):
        StockFiles.below(tmp_path)


def test_stock_robot_is_that_of_the_file(robot: Baxter) -> None:
    whole = pin.buildModelFromUrdf(str(STOCK.urdf))
    assert list(robot.model.names) == list(whole.names)
    assert [f.name for f in robot.model.frames] == [f.name for f in whole.frames]
    assert worst_difference(robot.model, whole) == 0.0
    for limit in ("lowerPositionLimit", "upperPositionLimit", "velocityLimit", "effortLimit"):
        np.testing.assert_array_equal(getattr(robot.model, limit), getattr(whole, limit))


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("without", [(), ("left",), ("left", "right")])
def test_kinematics_agree_with_pinocchio(seed: int, without: tuple[str, ...]) -> None:
    """From the original text, to the bit, since every number is kept."""
    text = served(seed, without_grippers=without, limit_change=0.01, shuffled=True)
    own, untouched = Baxter.load(text).model, pin.buildModelFromXML(text)
    assert list(own.names) == list(untouched.names)
    assert worst_difference(own, untouched) == 0.0
    for limit in ("lowerPositionLimit", "upperPositionLimit", "velocityLimit"):
        np.testing.assert_array_equal(getattr(own, limit), getattr(untouched, limit))


@pytest.mark.parametrize("side", ["left", "right"])
def test_tips_of_a_calibrated_robot_agree_with_pinocchio(side: str) -> None:
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


def test_order_of_the_text_does_not_count() -> None:
    text = served(5)
    joints = re.findall(r"<joint.*?</joint>", text, re.DOTALL)
    turned = text
    for joint in joints:
        turned = turned.replace(joint, "")
    turned = turned.replace("</robot>", "".join(reversed(joints)) + "</robot>")
    assert Baxter.load(turned).description == Baxter.load(text).description


def test_in_another_process_the_digest_is_the_same_and_no_mesh_is_opened(tmp_path: Path) -> None:
    """None of the files that the process opens while loading is named in the text."""
    path = tmp_path / "robot.urdf"
    path.write_text(served(1).replace("package://baxter_description", str(tmp_path / "away")))
    code = (
        "import sys; opened = []; sys.addaudithook("
        "lambda event, args: opened.append(str(args[0])) if event == 'open' else None);"
        f"from baxter_kin import Baxter; print(Baxter.load({str(path)!r}).digest);"
        "print([name for name in opened if 'away' in name or name.endswith(('.DAE', '.STL'))])"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    assert found.stdout.split() == [Baxter.load(path).digest, "[]"]
    assert re.fullmatch("[0-9a-f]{64}", Baxter.load(path).digest)
    assert "away" not in Baxter.load(path).description.text


@pytest.mark.parametrize("given", [5, ["x"], Path("/nowhere"), Path("/tmp"), Path("/dev/null")])
def test_what_is_neither_text_nor_a_regular_file_is_refused(given: Any) -> None:
    with pytest.raises(DescriptionError):
        Baxter.load(given)


def test_the_installed_description_is_the_stock_robot(robot: Baxter) -> None:
    assert RobotDescription.of() == robot.description


# Identity


@pytest.fixture(scope="module")
def tree(robot: Baxter) -> Urdf:
    return robot.description.tree


def with_joint(tree: Urdf, name: str, **changes: object) -> RobotIdentity:
    joints = [replace(j, **changes) if j.name == name else j for j in tree.joints]  # type: ignore[arg-type]
    return RobotIdentity.of(Urdf(tree.root, tuple(joints)))


def test_the_same_robot_has_no_difference(tree: Urdf) -> None:
    one, other = RobotIdentity.of(tree), RobotIdentity.of(tree)
    assert one == other
    assert one.difference(other) == ""
    assert one.digest == other.digest


def test_a_moved_joint_is_named_with_its_distance(tree: Urdf) -> None:
    x, y, z = tree.by_name["left_s1"].xyz
    other = with_joint(tree, "left_s1", xyz=(x, y + 0.0021, z))
    found = RobotIdentity.of(tree).difference(other)
    assert found == "joint left_s1 lies 2.1 mm elsewhere"


@pytest.mark.parametrize(
    ("name", "changes", "difference"),
    [
        ("left_s1", {"rpy": (-1.57, 0.0, 0.0)}, "its kinematics differ"),
        ("left_s1", {"axis": (0.0, 1e-12, 1.0)}, "its kinematics differ"),
        ("pedestal_fixed", {"xyz": (0.0, 0.0, 1e-9)}, "its kinematics differ"),
        ("left_endpoint", {"xyz": (0.0, 0.0, 0.2)}, "its hands differ"),
    ],
)
def test_differences_are_stated(
    tree: Urdf, name: str, changes: dict[str, object], difference: str
) -> None:
    own, other = RobotIdentity.of(tree), with_joint(tree, name, **changes)
    assert own.difference(other) == difference
    assert own.digest != other.digest


def test_other_limits_are_named(tree: Urdf) -> None:
    own = tree.by_name["right_w1"]
    assert own.range is not None
    for change in ({"lower": -1.5}, {"upper": 2.0}, {"velocity": 3.9}):
        other = with_joint(tree, "right_w1", range=replace(own.range, **change))
        assert RobotIdentity.of(tree).difference(other) == "joint right_w1 has other limits"


def test_effort_does_not_count(tree: Urdf) -> None:
    own = tree.by_name["right_w1"]
    assert own.range is not None
    other = with_joint(tree, "right_w1", range=replace(own.range, effort=1.0))
    assert RobotIdentity.of(tree).digest == other.digest


def test_a_mount_that_lies_elsewhere_is_named_with_its_distance(tree: Urdf) -> None:
    """All movable joints are in their places on their parents."""
    own = Baxter.load(served(measured="one")).description.identity
    drawn = Baxter.load(served()).description.identity
    assert own.difference(drawn) == "joint left_torso_arm_mount lies 11 mm elsewhere"


def test_missing_hand_is_reported(robot: Baxter) -> None:
    bare = Baxter.load(served(without_grippers=["right"])).description.identity
    found = robot.description.identity.difference(bare)
    assert found == "only one of the two has the joint r_gripper_l_finger_joint"


def test_a_body_counts_where_both_have_one(tree: Urdf) -> None:
    own = RobotIdentity.of(tree)
    one, other = evolve(own, body="a"), evolve(own, body="b")
    assert one.difference(other) == "its body has other shapes"
    assert own.difference(other) == one.difference(own) == ""


def test_every_calibration_has_a_digest_of_its_own() -> None:
    texts = [served(seed) for seed in range(4)]
    assert len({Baxter.load(text).digest for text in texts}) == len(texts)


@pytest.mark.parametrize("changes", [{"kinematics": 5}, {"places": 5}, {"ranges": {"a": (None,)}}])
def test_an_identity_refuses_values_of_other_classes(tree: Urdf, changes: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError):
        evolve(RobotIdentity.of(tree), **changes)
