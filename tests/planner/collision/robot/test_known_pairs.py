"""Pairs of links for which the proofs on the reference robot hold on other robots."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, ElectricGripper
from planner import RobotBody, RobotShapes
from planner.collision.robot.known_pairs import Comparison, other_side
from tests.served_urdf import served_urdf

NEAREST = ("left_upper_elbow", "left_upper_forearm")
"""Two joints apart: e1 and w0."""


def calibrated(*joints: str, seed: int = 1, limit_change: float = 0.0) -> Baxter:
    rng = np.random.default_rng(seed)
    return Baxter.load(served_urdf(rng, joints=joints, limit_change=limit_change))


def links_of(body: RobotBody) -> list[str]:
    """The links of the reference robot, without those that may replace others."""
    return [name for name in body.links if ":" not in name]


def test_the_reference_robot_is_alike_itself(drawn: Baxter) -> None:
    with_itself, links = Comparison(drawn, drawn), links_of(RobotBody.load())
    assert all(with_itself.is_alike(*pair) for pair in combinations(links, 2))


RIGHT_TIPS = ("r_gripper_l_finger_tip", "r_gripper_r_finger_tip")


def test_a_proof_for_the_other_side_holds_for_the_same_tips(robot: Baxter, drawn: Baxter) -> None:
    """Paddles on the right, as on the left of the reference."""
    assert not Comparison(robot, drawn).is_alike(*RIGHT_TIPS)
    assert Comparison(robot, drawn, is_swapped=True).is_alike(*RIGHT_TIPS)
    assert not Comparison(drawn, drawn, is_swapped=True).is_alike(*RIGHT_TIPS)


@pytest.mark.parametrize("slot", [3, 4])
def test_no_proof_holds_for_fingers_in_another_slot(drawn: Baxter, slot: int) -> None:
    own = Baxter.load(hands={"right": ElectricGripper(slot=slot)})
    for is_swapped in (False, True):
        assert not Comparison(own, drawn, is_swapped=is_swapped).is_alike(*RIGHT_TIPS)


@pytest.mark.parametrize(
    "name", ["left_s0", "r_gripper_l_finger_joint", "left_hand_link", "head_pan", "torso"]
)
def test_the_other_side_of_the_other_side_is_the_same(name: str) -> None:
    assert other_side(other_side(name)) == name
    assert (other_side(name) == name) == (name in ("head_pan", "torso"))


@pytest.mark.parametrize("joint", ["left_e1", "left_w0"])
def test_no_proof_holds_when_a_joint_between_has_another_pose(drawn: Baxter, joint: str) -> None:
    assert not Comparison(calibrated(joint), drawn).is_alike(*NEAREST)


def test_joints_that_are_not_between_do_not_matter(drawn: Baxter) -> None:
    others = Comparison(calibrated("head_pan", "left_s0", "left_e0", "left_w1", "right_e1"), drawn)
    assert others.is_alike(*NEAREST)
    assert not others.is_alike("torso", "left_lower_shoulder")


def test_links_of_one_joint_are_always_alike(drawn: Baxter) -> None:
    assert Comparison(calibrated("left_e1"), drawn).is_alike("left_upper_elbow", "left_lower_elbow")


def test_a_proof_holds_for_narrower_ranges_only(drawn: Baxter) -> None:
    text = served_urdf()
    wider, narrower = (text.replace('upper="2.618"', f'upper="{x}"') for x in (2.7, 2.5))
    assert not Comparison(Baxter.load(wider), drawn).is_alike(*NEAREST)
    assert Comparison(Baxter.load(narrower), drawn).is_alike(*NEAREST)


def test_skipped_pairs_are_proven_or_mounted_on_each_other() -> None:
    """On a robot with other poses of all joints of both arms, by separate kinematics."""
    own = Baxter.load(served_urdf(np.random.default_rng(0)))
    shapes, model = RobotShapes(own), own.model
    checked = {frozenset((shapes.links[a], shapes.links[b])) for a, b in shapes.pairs}
    chains = {
        name: set(list(model.supports[model.frames[model.getFrameId(name)].parentJoint])[1:])
        for name in links_of(shapes.body)
    }
    fingers = {model.getJointId(name) for name in own.joint_names if "gripper" in name}
    for one, other in combinations(links_of(shapes.body), 2):
        between = chains[one] ^ chains[other]
        is_out = len(between) <= 1 or between <= fingers
        assert (frozenset((one, other)) in checked) != is_out, (one, other)


def test_links_of_a_calibrated_robot_are_at_its_own_joints(robot: Baxter) -> None:
    own = Baxter.load(served_urdf(np.random.default_rng(2)))
    untouched = pin.buildModelFromXML(served_urdf(np.random.default_rng(2)))
    q, data = own.configuration(own.arm("left").joints(own.arm("left").start)), None
    data = untouched.createData()
    pin.framesForwardKinematics(untouched, data, q)
    shapes, rounding = RobotShapes(own), 1e-12
    mine = own.model.createData()
    pin.forwardKinematics(own.model, mine, q)
    for shape, link in zip(shapes.model.geometryObjects, shapes.links, strict=True):
        name = link if untouched.existFrame(link) else link.removesuffix("_link")
        T_base_link = data.oMf[untouched.getFrameId(name, pin.FrameType.BODY)]
        T_base_shape = mine.oMi[shape.parentJoint] * shape.placement
        assert np.abs(T_base_shape.homogeneous - T_base_link.homogeneous).max() < rounding
