from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from baxter_kin import Arm, Baxter
from baxter_kin.errors import ConfigurationError
from baxter_kin.ik.self_motion.continuation import EndKind
from baxter_kin.ik.self_motion.solution_curve import (
    TOUCHING_RAD,
    CurvePoint,
    CurvePoints,
    SolutionCurve,
    whole_turns_off,
)
from baxter_kin.ik.self_motion.tracing import trace_self_motion
from baxter_kin.validation import FloatArray
from tests.baxter_kin.ik.self_motion.test_tracing import (
    ALONE,
    CROSSING,
    EXACT,
    SAME_CURVE_RAD,
    pose_error,
    singular_near,
)
from tests.conftest import at

finite = st.floats(-100.0, 100.0)
rows = hnp.arrays(np.float64, st.tuples(st.integers(0, 6), st.just(17)), elements=finite)


@given(rows)
def test_points_return_their_columns(rows: FloatArray) -> None:
    points = CurvePoints(rows)
    assert len(points) == len(rows)
    np.testing.assert_array_equal(
        CurvePoints.of(map(points.__getitem__, range(len(rows)))).rows, rows
    )


def test_each_measure_is_in_its_place() -> None:
    point = CurvePoint(np.arange(7.0), 10.0 + np.arange(7.0), 20.0, 21.0, 22.0)
    points = CurvePoints.of([point])
    np.testing.assert_array_equal(points.q, [point.q])
    np.testing.assert_array_equal(points.tangent, [point.tangent])
    found = points.determinant[0], points.residual[0], points.clearance_rad[0]
    assert found == point.measures == (20.0, 21.0, 22.0)


@given(rows)
def test_twice_the_other_way_is_the_same_way(rows: FloatArray) -> None:
    points = CurvePoints(rows)
    np.testing.assert_array_equal(points.reversed().reversed().rows, rows)
    for i in range(len(points)):
        one, other = points[i].reversed(), points.reversed()[len(points) - 1 - i]
        np.testing.assert_array_equal(CurvePoints.of([one]).rows, CurvePoints.of([other]).rows)


@given(rows, rows)
def test_joined_points_can_be_cut(one: FloatArray, other: FloatArray) -> None:
    joined = CurvePoints(one).then(CurvePoints(other))
    np.testing.assert_array_equal(joined.part(slice(len(one))).rows, one)
    np.testing.assert_array_equal(joined.part(slice(len(one), None)).rows, other)


@given(hnp.arrays(np.float64, 7, elements=finite))
def test_whole_turns_off_are_whole_and_leave_half_a_turn_at_most(angles: FloatArray) -> None:
    rest = whole_turns_off(angles)
    turns = (angles - rest) / (2.0 * math.pi)
    rounding = 1e-12
    assert np.abs(rest).max() <= math.pi + rounding
    assert np.abs(turns - np.round(turns)).max() < rounding


def test_whole_turns_between_neighbours_do_not_lengthen_a_chord() -> None:
    q = np.zeros((3, 17))
    q[1, 2], q[2, 2] = 0.3, 0.5 + 2.0 * math.pi
    assert CurvePoints(q).chords_rad == pytest.approx([0.3, 0.2])


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


def test_other_branch_of_a_singular_start_can_be_chosen(left: Arm) -> None:
    q = singular_near(left, CROSSING)
    first = trace_self_motion(left, q)
    plane = np.linalg.svd(left.jacobian(q))[2][5:]
    angles = np.linspace(0.0, math.pi, 24)
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


def curve_of(arm: Arm, q: FloatArray) -> SolutionCurve:
    return SolutionCurve(arm, arm.T_base_tip(q))


def test_the_error_is_the_way_that_is_left_to_the_pose(any_arm: Arm) -> None:
    rng, first_order = np.random.default_rng(1), 1e-7
    for _ in range(20):
        q = any_arm.random_configuration(rng)
        dq = 1e-4 * rng.normal(size=7)
        twist = any_arm.jacobian(q) @ dq
        error = curve_of(any_arm, q + dq).error(q)
        np.testing.assert_allclose(error, twist, atol=first_order)
        assert np.linalg.norm(curve_of(any_arm, q).error(q)) < 1e-14


def test_corrections_stay_in_their_hyperplane(any_arm: Arm) -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        q = any_arm.random_configuration(rng)
        curve, off = curve_of(any_arm, q), q + 1e-3 * rng.normal(size=7)
        normal = np.linalg.svd(any_arm.jacobian(q))[2][6]
        found = curve.corrected(off, normal)
        assert found is not None
        assert np.linalg.norm(curve.error(found[0])) < 1e-12
        assert normal @ (found[0] - off) == pytest.approx(0.0, abs=1e-12)


def test_configurations_far_from_the_pose_are_not_corrected(left: Arm) -> None:
    curve = SolutionCurve(left, at(3.0, 0.0, 0.0))
    assert curve.corrected(left.start, np.eye(7)[0]) is None
    with pytest.raises(ConfigurationError, match="misses the pose by"):
        curve.onto(left.start)


def test_the_direction_of_a_start_is_that_of_every_curve(any_arm: Arm) -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        q = any_arm.random_configuration(rng)
        start, J = curve_of(any_arm, q).start(q), any_arm.jacobian(q)
        assert start is not None
        assert np.linalg.norm(J @ start.tangent) < 1e-12
        determinant = np.linalg.det(np.vstack([J, start.tangent]))
        assert start.determinant == pytest.approx(determinant, abs=1e-12)
        assert determinant > 0.0


def test_clearance_is_that_of_the_nearest_limit_and_negative_outside(arm: Arm) -> None:
    curve, limits = curve_of(arm, arm.start), arm.limits
    q = np.array([limits.q_min, limits.q_max, limits.q_min + 0.1, limits.q_max + 0.2])
    np.testing.assert_allclose(curve.clearance_rad(q), [0.0, 0.0, 0.1, -0.2], atol=1e-15)
    assert curve.without_limits.clearance_rad(q[3]) == math.inf


def test_without_limits_whole_turns_are_ignored(left: Arm) -> None:
    curve = curve_of(left, left.start)
    end = left.start + 0.1 + 2.0 * math.pi * np.eye(7)[4]
    np.testing.assert_array_equal(curve.way(left.start, end), end - left.start)
    way = curve.without_limits.way(left.start, end)
    np.testing.assert_allclose(way, np.full(7, 0.1), atol=1e-12)


def test_turned_configurations_are_next_to_the_middle_of_the_ranges(left: Arm) -> None:
    curve, rng = curve_of(left, left.start), np.random.default_rng(4)
    q = np.array([left.random_configuration(rng) for _ in range(20)])
    turns = 2.0 * math.pi * rng.integers(-2, 3, q.shape)
    np.testing.assert_allclose(curve.turned(q + turns), q, atol=1e-12)


def test_points_outside_by_rounding_are_moved_onto_the_limit(left: Arm) -> None:
    q = np.array(left.start)
    q[3] = left.limits.q_max[3]
    curve = curve_of(left, q)
    start = curve.without_limits.start(q)
    assert start is not None
    off = q + 0.5 * TOUCHING_RAD * np.eye(7)[3] - 2.0 * math.pi * np.eye(7)[6]
    inside = curve.into_range(CurvePoints.of([replace(start, q=off)]))
    np.testing.assert_allclose(inside.q, [q], atol=1e-12)
    assert inside.clearance_rad[0] >= 0.0


def test_a_rotation_of_few_digits_is_made_one(left: Arm) -> None:
    T = left.T_base_tip(left.start)
    rounded = SolutionCurve(left, pin.SE3(np.round(T.rotation, 4), T.translation)).T_base_tip
    np.testing.assert_allclose(rounded.rotation @ rounded.rotation.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(rounded.rotation, T.rotation, atol=1e-4)


def test_limits_of_some_joints_alone_leave_the_others_free(left: Arm) -> None:
    whole = SolutionCurve(left, left.T_base_tip(left.start))
    limited = whole.limited_by([1, 6])
    q = np.array(left.start)
    q[6], q[0] = left.limits.q_max[6] + 0.25, 50.0
    assert limited.clearance_rad(q) == pytest.approx(-0.25)
    assert whole.clearance_rad(q) < -40.0
    assert np.isinf(limited.q_max[[0, 2, 3, 4, 5]]).all()
    assert whole.q_max[0] == left.limits.q_max[0]
