"""Closing fingers end where both touch, and a drop is measured down to the support."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin.description import RobotDescription
from planner import Body, Box, Cylinder, Manipulator, Part
from planner.verification.body.robot_body import robot_body
from planner.verification.fingers import LEAD_M, Fingers, drop_m
from planner.verification.urdf_robot import UrdfRobot
from tests.conftest import at

COAL_M = 2e-6
"""Coal's accuracy, from both sides of a comparison."""


@pytest.fixture(scope="module")
def fingers(urdf: UrdfRobot) -> Fingers:
    return Fingers(urdf, robot_body(RobotDescription.installed()).solids)


BODIES = st.one_of(
    st.builds(Box, st.tuples(*[st.floats(0.02, 0.04)] * 3)),
    st.builds(Cylinder, st.floats(0.01, 0.02), st.floats(0.02, 0.04)),
)


@given(
    shape=BODIES,
    offset=st.tuples(*[st.floats(-0.008, 0.008)] * 3),
    turn=st.tuples(*[st.floats(-0.4, 0.4)] * 3),
)
@settings(max_examples=15)
def test_closing_fingers_end_where_both_touch_and_touch_nothing_before(
    fingers: Fingers, manipulator: Manipulator, shape: Any, offset: Any, turn: Any
) -> None:
    T_tip_body = pin.SE3(pin.exp3(np.array(turn)), np.array(offset))
    body = Body("thing", (Part(shape, at(0, 0, 0)),), T_tip_body, is_movable=True)
    stroke = manipulator.hand.stroke_m
    ours = fingers.closing(body, T_tip_body, stroke)
    # what begins inside a body, by up to `LEAD_M`, pushes it by more than it travels
    has_room = min(fingers.gaps_m(body, T_tip_body, stroke)) > 0.0
    if not (ours.is_hold and has_room):
        return
    assert max(map(abs, fingers.gaps_m(body, ours.T_tip_body, ours.finger_m))) < 1e-5
    for share in (0.1, 0.5, 0.9):
        open_m = ours.touch_m + share * (stroke - ours.touch_m)
        assert min(fingers.gaps_m(body, T_tip_body, open_m)) > -LEAD_M
    pushed = ours.T_tip_body.translation - T_tip_body.translation
    assert pushed == pytest.approx([0.0, ours.push_m, 0.0], abs=1e-15)
    assert abs(ours.push_m) == pytest.approx(ours.touch_m - ours.finger_m, abs=2 * COAL_M)


def test_closed_fingers_are_on_the_body(fingers: Fingers) -> None:
    block = Body("block", (Part(Box((0.05, 0.05, 0.05)), at(0, 0, 0)),), at(0, 0.003, 0))
    closing = fingers.closing(block, block.T_base_body, 0.020833)
    # 50 mm less 16 mm, halved, and the meshes' pads stand 0.35 mm further in
    assert closing.finger_m == pytest.approx(0.01735, abs=1e-5)
    assert np.abs(closing.T_tip_body.translation).max() < COAL_M  # pushed to the middle
    assert max(map(abs, fingers.gaps_m(block, closing.T_tip_body, closing.finger_m))) < COAL_M


def test_fingers_that_meet_nothing_close_fully(fingers: Fingers) -> None:
    block = Body("block", (Part(Box((0.05, 0.05, 0.05)), at(0, 0, 0)),), at(0, 0, 0.3))
    closing = fingers.closing(block, block.T_base_body, 0.02)
    assert not closing.is_hold
    assert closing.finger_m == 0.0


@pytest.mark.parametrize(("height_m", "drop"), [(0.025, 0.0), (0.032, 0.007), (0.5, math.inf)])
def test_a_drop_is_measured_down_to_the_support(height_m: float, drop: float) -> None:
    block = Body("block", (Part(Box((0.05, 0.05, 0.05)), at(0, 0, 0)),), at(0, 0, height_m))
    floor = Body("floor", (Part(Box((1.0, 1.0, 0.1)), at(0, 0, -0.05)),), at(0, 0, 0))
    assert drop_m(block, floor, 0.02) == pytest.approx(drop, abs=COAL_M)
