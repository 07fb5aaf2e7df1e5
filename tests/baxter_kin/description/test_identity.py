from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.description import RobotIdentity
from baxter_kin.description.urdf import Urdf
from tests.served_urdf import served_urdf


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
def test_what_differs_is_said(
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
    """No joint that moves lies elsewhere on the link that it is on."""
    own = Baxter.load(served_urdf(measured="one")).description.identity
    drawn = Baxter.load(served_urdf()).description.identity
    assert own.difference(drawn) == "joint left_torso_arm_mount lies 11 mm elsewhere"


def test_a_missing_hand_is_said(robot: Baxter) -> None:
    bare = Baxter.load(served_urdf(without_grippers=["right"])).description.identity
    found = robot.description.identity.difference(bare)
    assert found == "only one of the two has the joint r_gripper_l_finger_joint"


def test_a_body_counts_where_both_have_one(tree: Urdf) -> None:
    own = RobotIdentity.of(tree)
    one, other = replace(own, body="a"), replace(own, body="b")
    assert one.difference(other) == "its body has other shapes"
    assert own.difference(other) == one.difference(own) == ""


def test_every_calibration_has_a_digest_of_its_own() -> None:
    texts = [served_urdf(np.random.default_rng(seed)) for seed in range(10)]
    assert len({Baxter.load(text).digest for text in texts}) == len(texts)
