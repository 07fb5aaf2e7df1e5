from __future__ import annotations

import math

import numpy as np
import pytest

from baxter_kin import Arm, Baxter
from baxter_kin.ik.redundancy.continuation import EndKind
from baxter_kin.ik.redundancy.self_motion import trace_self_motion
from tests.baxter_kin.ik.redundancy.test_self_motion import (
    ALONE,
    CLOSED,
    CROSSING,
    SAME_CURVE_RAD,
    hausdorff_rad,
    singular_near,
    spread,
    with_limits,
)


def test_end_reads_as_a_sentence(left: Arm) -> None:
    curve = trace_self_motion(left, left.start)
    assert {str(end) for end in curve.ends} <= {
        f"{name} reaches its limit of {bound:.6g} rad"
        for name, lower, upper in zip(
            left.joint_names, left.limits.q_min, left.limits.q_max, strict=True
        )
        for bound in (lower, upper)
    }


def test_closed_curve_returns_to_its_start(left: Arm) -> None:
    curve = trace_self_motion(left, CLOSED)
    assert curve.is_closed
    np.testing.assert_array_equal(curve.q[0], curve.q[-1])
    assert {end.joint_name for end in curve.ends} == {None}


def test_small_loop_closes(robot: Baxter, left: Arm) -> None:
    """Next to a point that stands alone the curves are loops as small as one likes."""
    q = singular_near(left, ALONE)
    curve = trace_self_motion(left, q + 1e-3 * np.linalg.svd(left.jacobian(q))[2][6])
    assert curve.is_closed
    assert 1e-3 < curve.length_rad < 0.1


def test_piece_shorter_than_a_step_has_both_ends(robot: Baxter, left: Arm) -> None:
    narrow = with_limits(left, robot, left.start - 1e-3, left.start + 1e-3)
    curve = trace_self_motion(narrow, left.start)
    assert 1e-3 < curve.length_rad < 1e-2
    assert [end.kind for end in curve.ends] == [EndKind.LIMIT, EndKind.LIMIT]


def test_piece_that_limits_cut_to_a_point_is_a_point(robot: Baxter, left: Arm) -> None:
    """Joints that both leave their range, one each way."""
    tangent = np.linalg.svd(left.jacobian(left.start))[2][6]
    q_min, q_max = np.array(left.limits.q_min), np.array(left.limits.q_max)
    first, second = np.argsort(-np.abs(tangent))[:2]
    for joint, way in ((first, tangent[first]), (second, -tangent[second])):
        (q_max if way > 0.0 else q_min)[joint] = left.start[joint]
    curve = trace_self_motion(with_limits(left, robot, q_min, q_max), left.start)
    assert curve.length_rad == 0.0
    assert {end.joint_name for end in curve.ends} == {
        left.joint_names[first],
        left.joint_names[second],
    }


@pytest.mark.parametrize("excess_rad", [1e-3, 1e-5, 1e-7])
def test_limit_grazed_within_a_step_ends_the_curve(
    robot: Baxter, left: Arm, excess_rad: float
) -> None:
    """A joint that turns back beyond its limit between two points that are both inside."""
    curve = trace_self_motion(left, CLOSED)
    joint = int(np.argmax(np.ptp(curve.q, axis=0)))
    q_max = np.array(left.limits.q_max)
    q_max[joint] = max(q[joint] for q in spread(curve, 1000)) - excess_rad
    narrow = with_limits(left, robot, left.limits.q_min, q_max)
    start = curve.q[int(np.argmin(curve.q[:, joint]))]
    cut = trace_self_motion(narrow, start)
    assert {end.joint_name for end in cut.ends} == {left.joint_names[joint]}


@pytest.mark.parametrize("side", [-0.05, 0.05])
def test_tracing_stops_where_branches_meet(left: Arm, side: float) -> None:
    q = singular_near(left, CROSSING)
    through = trace_self_motion(left, q)
    half = trace_self_motion(left, through.at(through.s_start + side))
    kinds = [end.kind for end in half.ends]
    assert kinds.count(EndKind.SINGULARITY) == 1
    end = half.q[0 if kinds[0] is EndKind.SINGULARITY else -1]
    weak = 1e-3  # rad within which the rank counts as five: its loss is slow here
    assert np.linalg.norm(end - q) < weak


def test_singularity_is_named_as_the_reason(left: Arm) -> None:
    q = singular_near(left, CROSSING)
    through = trace_self_motion(left, q)
    half = trace_self_motion(left, through.at(through.s_start + 0.05))
    assert any("branches meet" in str(end) for end in half.ends)


@pytest.mark.parametrize("gap_rad", [1e-1, 1e-2, 1e-3])
def test_sharp_turn_beside_a_singularity_is_followed(left: Arm, gap_rad: float) -> None:
    """Curves of neighbouring poses turn off where the branches of the singular one cross."""
    q = singular_near(left, CROSSING)
    plane = np.linalg.svd(left.jacobian(q))[2][5:]
    for a in np.linspace(0.0, math.pi, 7):
        beside = q + gap_rad * np.array([math.cos(a), math.sin(a)]) @ plane
        curve = trace_self_motion(left, beside)
        turns = (curve.tangent[1:] * curve.tangent[:-1]).sum(axis=1)
        assert turns.min() > math.cos(0.2001)
        again = trace_self_motion(left, curve.at(0.9 * curve.length_rad))
        assert again.ends == curve.ends
        assert hausdorff_rad(curve, again) < SAME_CURVE_RAD
