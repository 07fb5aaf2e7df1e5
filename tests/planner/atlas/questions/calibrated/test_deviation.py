"""How far tips of two arms can be apart at the same joint angles."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter
from planner.atlas import TipDeviation
from tests.calibrated import calibrated_arm
from tests.served_urdf import served_urdf


@given(seed=st.integers(0, 2**32), share=st.floats(0.0, 1.0))
@settings(max_examples=15)
def test_no_configuration_exceeds_the_bound(robot: Baxter, seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    first = robot.arm("left")
    second = calibrated_arm(robot, "left", rng, share)
    bound = TipDeviation.of(first, second)
    for _ in range(40):
        q = rng.uniform(-np.pi, np.pi, 7)
        off = first.T_base_tip(q).actInv(second.T_base_tip(q))
        assert np.linalg.norm(off.translation) <= bound.position_m
        assert np.linalg.norm(pin.log3(off.rotation)) <= bound.angle_rad


def test_tilted_axes_count(robot: Baxter) -> None:
    """Robots that serve a URDF have axes that are not z."""
    rng = np.random.default_rng(3)
    own = Baxter.load(served_urdf(rng)).arm("right")
    assert np.abs(own.chain.axes[:, :2]).max() > 1e-3
    first = robot.arm("right")
    bound = TipDeviation.of(first, own)
    worst_m = 0.0
    for q in rng.uniform(-np.pi, np.pi, (500, 7)):
        off = first.T_base_tip(q).actInv(own.T_base_tip(q))
        worst_m = max(worst_m, float(np.linalg.norm(off.translation)))
        assert np.linalg.norm(pin.log3(off.rotation)) <= bound.angle_rad
    assert 0.2 * bound.position_m < worst_m <= bound.position_m


def test_an_arm_does_not_differ_from_itself(robot: Baxter) -> None:
    bound = TipDeviation.of(robot.arm("left"), Baxter.load().arm("left"))
    assert bound.position_m == pytest.approx(0.0, abs=1e-11)
    assert bound.angle_rad == pytest.approx(0.0, abs=1e-11)


def test_a_longer_tool_is_as_far_off_as_it_is_longer(robot: Baxter) -> None:
    arm = robot.arm("left")
    longer = arm.with_tip(pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.02])))
    assert TipDeviation.of(arm, longer).position_m == pytest.approx(0.02)


@pytest.mark.parametrize("joint", ["s1", "e1", "w1"])
def test_one_joint_turned_is_off_by_nearly_the_bound_where_the_arm_is_straight(
    robot: Baxter, joint: str
) -> None:
    """What follows the joint turns with it, so that its length counts."""
    model = robot.model.copy()
    number = model.getJointId(f"left_{joint}")
    turn = pin.SE3(pin.exp3(np.array([0.0, 0.01, 0.0])), np.zeros(3))
    model.jointPlacements[number] = model.jointPlacements[number] * turn
    first, second = robot.arm("left"), Arm("left", model)
    bound = TipDeviation.of(first, second)
    qs = np.random.default_rng(5).uniform(-np.pi, np.pi, (2000, 7))
    tips = first.T_base_tips(qs), second.T_base_tips(qs)
    worst_m = np.linalg.norm(tips[0][:, :3, 3] - tips[1][:, :3, 3], axis=1).max()
    assert 0.6 * bound.position_m < worst_m <= bound.position_m
    assert bound.angle_rad == pytest.approx(0.01)
