"""Pairs of IK solutions in the order of the times that they promise."""

from __future__ import annotations

import numpy as np
import pytest

from baxter_kin.errors import RequestError
from planner import Manipulator, PickAndPlace, Plan, Scene, transfer_bound_s
from planner.errors import MotionError
from planner.pick_place.candidates import Candidates
from planner.pick_place.task import PlanRequest
from tests.conftest import at, overhead
from tests.planner.pick_place.conftest import PICK, PLACE, TASK
from tests.planner.toy_world import LIMITS

REACHED_M = 1e-6


def candidates(manipulator: Manipulator, task: PickAndPlace = TASK) -> Candidates:
    return Candidates(PlanRequest(manipulator, Scene.of(), manipulator.arm.start), task)


def test_pairs_reach_both_poses_inside_the_limits(manipulator: Manipulator) -> None:
    arm, found = manipulator.arm, candidates(manipulator)
    assert len(found.order) > 100
    for pair in (found.pair(*numbers) for numbers in found.order[::50]):
        for q, T in ((pair.q_pick, TASK.T_base_pick), (pair.q_place, TASK.T_base_place)):
            assert np.linalg.norm(arm.T_base_tip(q).translation - T.translation) <= REACHED_M
            assert not arm.limits.violations(q)


def test_the_same_request_is_answered_the_same(manipulator: Manipulator) -> None:
    first, again = (candidates(manipulator) for _ in range(2))
    for name in ("picks", "places", "order"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))


@pytest.mark.parametrize("swapped", [False, True])
def test_a_pose_out_of_reach_leaves_no_pair(manipulator: Manipulator, swapped: bool) -> None:
    far = at(2.0, 0.0, 0.0)
    poses = (far, TASK.T_base_place) if swapped else (TASK.T_base_pick, far)
    assert not len(candidates(manipulator, PickAndPlace("block", *poses)).order)


def test_a_bound_is_of_a_service_and_limits(manipulator: Manipulator) -> None:
    T = overhead(0.7, 0.15, -0.1)
    with pytest.raises(RequestError, match="ik must be of class IKService, got int"):
        transfer_bound_s(5, manipulator.limits, T, T)  # type: ignore[arg-type]
    with pytest.raises(MotionError, match="limits must be of class JointLimits, got int"):
        transfer_bound_s(manipulator.ik, 5, T, T)  # type: ignore[arg-type]
    with pytest.raises(MotionError, match="the limits are of 2 joints; an arm has 7"):
        transfer_bound_s(manipulator.ik, LIMITS, T, T)


def test_no_transfer_is_faster_than_its_bound(plan: Plan, manipulator: Manipulator) -> None:
    labels_ = ("pick: retract", "place: approach", "place: descend")
    taken = sum(m.trajectory.duration for m in plan.moves if m.label in labels_)
    bound = transfer_bound_s(manipulator.ik, manipulator.limits, PICK, PLACE)
    assert 0.5 < bound < taken < 2.0 * bound


def test_the_bound_to_a_pose_out_of_reach_is_infinite(manipulator: Manipulator) -> None:
    far = at(2.0, 0.0, 0.0)
    assert transfer_bound_s(manipulator.ik, manipulator.limits, PICK, far) == np.inf
