from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, Baxter, ConfigurationError
from baxter_kin.ik.redundancy.continuation import EndKind
from baxter_kin.ik.redundancy.self_motion import trace_self_motion
from tests.baxter_kin.ik.redundancy.test_self_motion import (
    ALONE,
    CROSSING,
    EXACT,
    SAME_CURVE_RAD,
    pose_error,
    singular_near,
)


def test_start_that_nearly_reaches_the_pose_is_moved_onto_it(robot: Baxter, left: Arm) -> None:
    T = pin.SE3(left.T_base_tip(left.start))
    T.translation = T.translation + np.array([1e-6, 0.0, 0.0])
    curve = trace_self_motion(left, left.start, T_base_tip=T)
    assert max(pose_error(robot, left, q, T) for q in curve.q) <= EXACT


def test_start_on_a_limit_that_would_move_out_stays_on_it(left: Arm) -> None:
    q = np.array(trace_self_motion(left, left.start).q[0])
    T = pin.SE3(left.T_base_tip(q))
    for way in (-1e-7, 1e-7):
        moved = pin.SE3(T.rotation, T.translation + way)
        curve = trace_self_motion(left, q, T_base_tip=moved)
        assert curve.nearest(q)[1] < 1e-4
        assert not left.limits.violations(curve.q[0])


def test_pose_written_with_few_digits_is_traced(left: Arm) -> None:
    rounded = np.round(left.T_base_tip(left.start).homogeneous, 7)
    assert trace_self_motion(left, left.start, T_base_tip=rounded).pose_residual <= 1e-10


def test_start_that_misses_the_pose_is_refused_with_the_miss(left: Arm) -> None:
    T = pin.SE3(left.T_base_tip(left.start))
    T.translation = T.translation + np.array([0.01, 0.0, 0.0])
    with pytest.raises(ConfigurationError, match=r"misses the pose by 0\.01 "):
        trace_self_motion(left, left.start, T_base_tip=T)


def test_branches_that_cross_are_followed_through_a_singular_start(left: Arm) -> None:
    q = singular_near(left, CROSSING)
    curve = trace_self_motion(left, q)
    assert 0.1 < curve.s_start < curve.length_rad - 0.1
    turn = curve.tangent[np.searchsorted(curve.s, curve.s_start) + np.array([-1, 1])]
    assert turn[0] @ turn[1] > 0.99


def test_other_branch_of_a_singular_start_can_be_asked_for(left: Arm) -> None:
    q = singular_near(left, CROSSING)
    first = trace_self_motion(left, q)
    plane = np.linalg.svd(left.jacobian(q))[2][5:]
    angles = np.linspace(0.0, math.pi, 60)
    across = [
        trace_self_motion(left, q, towards=[math.cos(a), math.sin(a)] @ plane, step_rad=0.1)
        for a in angles
    ]
    distances = np.array([other.nearest(first.at(first.s_start + 0.1))[1] for other in across])
    assert (distances < SAME_CURVE_RAD).any()
    assert (distances > 1e-3).any()


def test_singular_configuration_that_no_branch_leaves_is_a_point(left: Arm) -> None:
    q = singular_near(left, ALONE)
    curve = trace_self_motion(left, q)
    np.testing.assert_array_equal(curve.q, [q])
    assert curve.length_rad == 0.0
    assert [end.kind for end in curve.ends] == [EndKind.SINGULARITY] * 2
