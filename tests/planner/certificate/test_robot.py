"""The URDF as the checker reads it: kinematics and limits against Pinocchio."""

from __future__ import annotations

import re

import numpy as np
import pytest

from baxter_kin import Baxter
from planner.certificate.errors import NotCertifiedError
from planner.certificate.intervals import Interval
from planner.certificate.robot import Robot
from tests.served_urdf import served_urdf

SAME_M = 1e-14


@pytest.fixture(scope="module", params=["as drawn", "calibrated"])
def anyone(request: pytest.FixtureRequest, robot: Baxter) -> Baxter:
    """A robot whose joints turn about z, and one whose axes are up to 10 mrad off."""
    if request.param == "as drawn":
        return robot
    return Baxter.load(served_urdf(np.random.default_rng(1)))


@pytest.mark.parametrize("limb", ["left", "right"])
def test_tips_and_limits_are_those_of_pinocchio(anyone: Baxter, limb: str) -> None:
    arm, own = anyone.arm(limb), Robot(anyone.description.text, limb)
    assert own.names == arm.joint_names
    np.testing.assert_array_equal(own.q_min, arm.limits.q_min)
    np.testing.assert_array_equal(own.q_max, arm.limits.q_max)
    np.testing.assert_array_equal(own.v_max, arm.limits.v_max)
    q = np.random.default_rng(0).uniform(arm.limits.q_min, arm.limits.q_max, (50, 7))
    T = own.tips(Interval(q))
    (R, error_R), (p, error_p) = T.R.centred(), T.p.centred()
    assert max(error_R, error_p) < 1e-10
    for i, each in enumerate(q):
        expected = arm.T_base_tip(each)
        np.testing.assert_allclose(p[i], expected.translation, atol=SAME_M)
        np.testing.assert_allclose(R[i], expected.rotation, atol=SAME_M)


def test_links_hang_where_pinocchio_has_them(anyone: Baxter) -> None:
    own, robot = Robot(anyone.description.text, "left"), anyone
    joints = dict(zip(robot.joint_names, robot.configuration(), strict=True))
    places = own.places(joints)
    where = own.attached("left_gripper", places)
    assert (where.level, where.finger) == (7, None)
    assert own.attached("l_gripper_l_finger_tip", places).finger in own.fingers
    other = own.attached("right_gripper", places)
    assert (other.level, other.finger) == (0, None)
    expected = robot.arm("right").T_base_tip([joints[n] for n in robot.arm("right").joint_names])
    np.testing.assert_allclose(other.T.p.centred()[0], expected.translation, atol=SAME_M)


@pytest.mark.parametrize(
    ("pattern", "instead", "reason"),
    [
        (r"<robot", "<<robot", "malformed"),
        (r'child link="left_upper_elbow"', 'child link="left_upper_shoulder"', "two joints"),
        (r'axis xyz="0.0 0.0 1.0"', 'axis xyz="0.0 1.0 0.0"', "another axis"),
        (r'type="revolute"', 'type="floating"', "unknown kind"),
        (
            r'(left_upper_shoulder"/>\s*<origin xyz="[^"]*" rpy=)"[^"]*"',
            r'\1"0 nan 0"',
            "not finite",
        ),
        (r'(left_upper_shoulder"/>\s*<origin xyz="[^"]*" rpy=)"[^"]*"', r'\1"0 0"', "malformed"),
        (r'parent link="left_upper_elbow"', 'parent link="left_gripper"', "circle"),
    ],
)
def test_an_invalid_urdf_is_refused(text: str, pattern: str, instead: str, reason: str) -> None:
    changed = re.sub(pattern, instead, text, count=1)
    assert changed != text
    with pytest.raises((NotCertifiedError, ValueError), match=reason):
        Robot(changed, "left")


def test_a_missing_arm_is_refused(text: str) -> None:
    with pytest.raises(NotCertifiedError, match="no link middle_gripper"):
        Robot(text, "middle")
