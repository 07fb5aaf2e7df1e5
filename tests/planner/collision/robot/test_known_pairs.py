from __future__ import annotations

from itertools import combinations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, ElectricGripper
from planner import Hand, RobotBody, RobotShapes
from planner.collision.robot.known_pairs import Drawing, other_side
from tests.served_urdf import served_urdf

NEAREST = ("left_upper_elbow", "left_upper_forearm")
"""Two joints apart: e1 and w0."""


T_HAND_CUBE = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.025]))


def fingered(robot: Baxter) -> list[str]:
    return [side for side in robot.arms if Hand.is_on(robot, side)]


def calibrated(*joints: str, seed: int = 1, limit_change: float = 0.0) -> Baxter:
    rng = np.random.default_rng(seed)
    return Baxter.load(served_urdf(rng, joints=joints, limit_change=limit_change))


def links_of(body: RobotBody) -> list[str]:
    """Those of the drawn robot, not what may be mounted instead."""
    return [name for name in body.links if ":" not in name]


def test_all_of_the_drawn_robot_is_as_drawn(drawn: Baxter) -> None:
    beside_itself, links = Drawing(drawn, drawn), links_of(RobotBody.load())
    assert all(beside_itself.is_as_drawn(*pair) for pair in combinations(links, 2))


RIGHT_TIPS = ("r_gripper_l_finger_tip", "r_gripper_r_finger_tip")


def test_what_another_tip_is_near_is_known_from_the_side_that_is_drawn_with_it(
    robot: Baxter, drawn: Baxter
) -> None:
    """Paddles on the right, as on the left of the drawing."""
    assert not Drawing(robot, drawn).is_as_drawn(*RIGHT_TIPS)
    assert Drawing(robot, drawn, is_swapped=True).is_as_drawn(*RIGHT_TIPS)
    assert not Drawing(drawn, drawn, is_swapped=True).is_as_drawn(*RIGHT_TIPS)


@pytest.mark.parametrize("slot", [3, 4])
def test_nothing_is_known_of_fingers_in_another_slot(drawn: Baxter, slot: int) -> None:
    own = Baxter.load(hands={"right": ElectricGripper(slot=slot)})
    for is_swapped in (False, True):
        assert not Drawing(own, drawn, is_swapped=is_swapped).is_as_drawn(*RIGHT_TIPS)


@pytest.mark.parametrize(
    "name", ["left_s0", "r_gripper_l_finger_joint", "left_hand_link", "head_pan", "torso"]
)
def test_the_other_side_of_the_other_side_is_the_same(name: str) -> None:
    assert other_side(other_side(name)) == name
    assert (other_side(name) == name) == (name in ("head_pan", "torso"))


@pytest.mark.parametrize("joint", ["left_e1", "left_w0"])
def test_a_joint_between_that_is_elsewhere_undoes_the_proof(drawn: Baxter, joint: str) -> None:
    assert not Drawing(calibrated(joint), drawn).is_as_drawn(*NEAREST)


def test_joints_that_are_not_between_do_not_count(drawn: Baxter) -> None:
    others = Drawing(calibrated("head_pan", "left_s0", "left_e0", "left_w1", "right_e1"), drawn)
    assert others.is_as_drawn(*NEAREST)
    assert not others.is_as_drawn("torso", "left_lower_shoulder")


def test_one_joint_apart_is_taken_to_be_mounted_as_drawn(drawn: Baxter) -> None:
    assert Drawing(calibrated("left_e1"), drawn).is_as_drawn("left_upper_elbow", "left_lower_elbow")


def test_a_wider_range_undoes_the_proof_and_a_narrower_does_not(drawn: Baxter) -> None:
    text = served_urdf()
    wider, narrower = (text.replace('upper="2.618"', f'upper="{x}"') for x in (2.7, 2.5))
    assert not Drawing(Baxter.load(wider), drawn).is_as_drawn(*NEAREST)
    assert Drawing(Baxter.load(narrower), drawn).is_as_drawn(*NEAREST)


def test_pairs_that_are_left_out_are_proven_or_mounted_on_each_other() -> None:
    """Of a robot of which every joint of both arms is elsewhere, by kinematics of its own."""
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


def test_links_of_another_robot_sit_where_its_joints_are(robot: Baxter) -> None:
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
