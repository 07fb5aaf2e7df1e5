from __future__ import annotations

from itertools import combinations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from planner import RobotBody, RobotShapes
from planner.drawing import Drawing
from planner.verification.body.links import OwnPairs
from planner.verification.body.robot_body import robot_body
from planner.verification.urdf_robot import read_model
from tests.served_urdf import served_urdf

NEAREST = ("left_upper_elbow", "left_upper_forearm")
"""Two joints apart: e1 and w0."""


def calibrated(*joints: str, seed: int = 1, limit_change: float = 0.0) -> Baxter:
    rng = np.random.default_rng(seed)
    return Baxter.load(served_urdf(rng, joints=joints, limit_change=limit_change))


def drawing(robot: Baxter, stock: Baxter) -> Drawing:
    return Drawing(robot.model, stock.model)


def test_all_of_the_stock_robot_is_as_drawn(robot: Baxter) -> None:
    of_stock = drawing(robot, robot)
    assert all(of_stock.is_as_drawn(*pair) for pair in combinations(RobotBody.load().links, 2))


@pytest.mark.parametrize("joint", ["left_e1", "left_w0"])
def test_a_joint_between_that_is_elsewhere_undoes_the_proof(robot: Baxter, joint: str) -> None:
    assert not drawing(calibrated(joint), robot).is_as_drawn(*NEAREST)


def test_joints_that_are_not_between_do_not_count(robot: Baxter) -> None:
    others = drawing(calibrated("head_pan", "left_s0", "left_e0", "left_w1", "right_e1"), robot)
    assert others.is_as_drawn(*NEAREST)
    assert not others.is_as_drawn("torso", "left_lower_shoulder")


def test_one_joint_apart_is_taken_to_be_mounted_as_drawn(robot: Baxter) -> None:
    assert drawing(calibrated("left_e1"), robot).is_as_drawn("left_upper_elbow", "left_lower_elbow")


def test_a_wider_range_undoes_the_proof_and_a_narrower_does_not(robot: Baxter) -> None:
    text = served_urdf()
    wider, narrower = (text.replace('upper="2.618"', f'upper="{x}"') for x in (2.7, 2.5))
    assert not drawing(Baxter.load(wider), robot).is_as_drawn(*NEAREST)
    assert drawing(Baxter.load(narrower), robot).is_as_drawn(*NEAREST)


def test_pairs_that_are_left_out_are_proven_or_mounted_on_each_other() -> None:
    """Of a robot of which every joint of both arms is elsewhere, by kinematics of its own."""
    own = Baxter.load(served_urdf(np.random.default_rng(0)))
    shapes, model = RobotShapes(own), own.model
    checked = {frozenset((shapes.links[a], shapes.links[b])) for a, b in shapes.pairs}
    chains = {
        name: set(list(model.supports[model.frames[model.getFrameId(name)].parentJoint])[1:])
        for name in shapes.body.links
    }
    fingers = {model.getJointId(name) for name in own.joint_names if "gripper" in name}
    for one, other in combinations(shapes.body.links, 2):
        between = chains[one] ^ chains[other]
        is_out = len(between) <= 1 or between <= fingers
        assert (frozenset((one, other)) in checked) != is_out, (one, other)


def test_the_verifier_checks_the_same_pairs_by_its_own_code(robot: Baxter) -> None:
    for own in (robot, calibrated("left_e1", "head_pan"), Baxter.load(served_urdf())):
        shapes, verified = RobotShapes(own), robot_body(own.description)
        pairs = OwnPairs(read_model(own.description), read_model(robot.description))
        planned = {frozenset((shapes.links[a], shapes.links[b])) for a, b in shapes.pairs}
        judged = {
            frozenset((a.name, b.name))
            for a, b in combinations(verified.solids, 2)
            if pairs.is_checked(a, b)
        }
        assert judged <= planned


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
