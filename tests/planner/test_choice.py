from __future__ import annotations

import numpy as np
import pytest

from baxter_kin import RequestError
from planner import Manipulator, MotionError, transfer_bound_s
from planner.choice import Choices
from planner.lines import Lines
from tests.conftest import at, overhead

LINES = Lines(overhead(0.70, 0.15, -0.129), overhead(0.75, 0.0, -0.129), 0.05, 0.15)

REACHED_M = 1e-6


def test_choices_reach_both_poses_inside_the_limits(manipulator: Manipulator) -> None:
    arm = manipulator.arm
    choices = Choices.of(manipulator.ik, manipulator.limits, arm.start, LINES)
    pairs = list(choices.pairs())
    assert len(pairs) > 100
    for choice in (choices.at(*pair) for pair in pairs[::50]):
        for q, T in ((choice.q_pick, LINES.T_base_pick), (choice.q_place, LINES.T_base_place)):
            assert np.linalg.norm(arm.T_base_tip(q).translation - T.translation) <= REACHED_M
            assert not arm.limits.violations(q)


def test_the_same_request_is_answered_the_same(manipulator: Manipulator) -> None:
    request = manipulator.ik, manipulator.limits, manipulator.arm.start, LINES
    first, again = (Choices.of(*request) for _ in range(2))
    for name in ("picks", "places", "order"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))


@pytest.mark.parametrize("swapped", [False, True])
def test_a_pose_out_of_reach_leaves_no_choice(manipulator: Manipulator, swapped: bool) -> None:
    far = at(2.0, 0.0, 0.0)
    poses = (far, LINES.T_base_place) if swapped else (LINES.T_base_pick, far)
    lines = Lines(*poses, 0.05, 0.15)
    start = manipulator.arm.start
    choices = Choices.of(manipulator.ik, manipulator.limits, start, lines)
    assert list(choices.pairs()) == []


def test_a_bound_is_of_a_service_and_limits(manipulator: Manipulator) -> None:
    T = overhead(0.7, 0.15, -0.1)
    with pytest.raises(RequestError, match="ik must be of class IKService, got int"):
        transfer_bound_s(5, manipulator.limits, T, T)  # type: ignore[arg-type]
    with pytest.raises(MotionError, match="limits must be of class JointLimits, got int"):
        transfer_bound_s(manipulator.ik, 5, T, T)  # type: ignore[arg-type]
