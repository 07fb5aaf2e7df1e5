from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter
from baxter_kin.ik.self_motion.continuation import (
    LONGEST_STEP_RAD,
    EndKind,
    filled,
    loops_near,
    may_leave,
    minimum,
    root,
    walk,
    walk_both_ways,
    with_last,
)
from baxter_kin.ik.self_motion.curve_cubics import cubics
from baxter_kin.ik.self_motion.curve_kernel import MAX_TURN_RAD
from baxter_kin.ik.self_motion.pieces import pieces_inside
from baxter_kin.ik.self_motion.solution_curve import CurvePoint, CurvePoints, SolutionCurve
from baxter_kin.ik.self_motion.tracing import trace_self_motion
from baxter_kin.ik.solution_set import distinct_solutions
from tests.baxter_kin.ik.self_motion.test_pieces import pieces_of
from tests.baxter_kin.ik.self_motion.test_tracing import (
    ALONE,
    CLOSED,
    CROSSING,
    SAME_CURVE_RAD,
    hausdorff_rad,
    singular_near,
    spread,
    with_limits,
)


@given(where=st.floats(0.01, 0.99), power=st.sampled_from([1, 3]))
def test_root_is_found(where: float, power: int) -> None:
    found = root(lambda x: (x - where) ** power, 0.0, 1.0)
    flat = 1e-3 if power == 3 else 1e-9  # where the function is within 1e-12 of zero
    assert found == pytest.approx(where, abs=flat)


def test_root_at_the_lower_end_is_found() -> None:
    assert root(lambda x: x, 0.0, 1.0) == 0.0


@pytest.mark.parametrize(("lower", "upper"), [(0.6, 1.0), (0.0, 0.4), (1.0, 0.0)])
def test_without_a_change_of_sign_there_is_no_root(lower: float, upper: float) -> None:
    assert root(lambda x: x - 0.5, lower, upper) is None


@given(where=st.floats(0.0, 1.0))
def test_least_value_is_found(where: float) -> None:
    value, x = minimum(lambda x: math.fabs(x - where), 0.0, 1.0, 1e-9)
    assert x == pytest.approx(where, abs=1e-9)
    assert value == math.fabs(x - where)


def test_closed_curve_returns_to_its_start(left: Arm) -> None:
    curve = trace_self_motion(left, CLOSED)
    assert curve.is_closed
    np.testing.assert_array_equal(curve.q[0], curve.q[-1])
    assert {end.joint_name for end in curve.ends} == {None}


def test_small_loop_closes(robot: Baxter, left: Arm) -> None:
    """Next to an isolated point the curves are loops of any size."""
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
    """Joints that leave their ranges, one below and one above."""
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


@pytest.mark.parametrize("excess_rad", [1e-3, 1e-7])
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
    assert any("branches meet" in str(end) for end in half.ends)
    end = half.q[0 if kinds[0] is EndKind.SINGULARITY else -1]
    weak = 1e-3  # rad within which the rank counts as five: its loss is slow here
    assert np.linalg.norm(end - q) < weak


@pytest.mark.parametrize("gap_rad", [1e-1, 1e-3])
def test_sharp_turn_beside_a_singularity_is_followed(left: Arm, gap_rad: float) -> None:
    """Curves of neighbouring poses turn off where the branches of the singular one cross."""
    q = singular_near(left, CROSSING)
    plane = np.linalg.svd(left.jacobian(q))[2][5:]
    for a in np.linspace(0.0, math.pi, 5):
        beside = q + gap_rad * np.array([math.cos(a), math.sin(a)]) @ plane
        curve = trace_self_motion(left, beside)
        turns = (curve.tangent[1:] * curve.tangent[:-1]).sum(axis=1)
        assert turns.min() > math.cos(0.2001)
        again = trace_self_motion(left, curve.at(0.9 * curve.length_rad))
        assert again.ends == curve.ends
        assert hausdorff_rad(curve, again) < SAME_CURVE_RAD


@pytest.fixture(scope="module")
def solution_curve(arm: Arm) -> SolutionCurve:
    return SolutionCurve(arm, arm.T_base_tip(arm.start))


@pytest.fixture(scope="module")
def start(arm: Arm, solution_curve: SolutionCurve) -> CurvePoint:
    found = solution_curve.start(arm.start)
    assert found is not None
    return found


def test_both_ways_are_each_way_from_the_start(
    solution_curve: SolutionCurve, start: CurvePoint
) -> None:
    points, at, ends = walk_both_ways(solution_curve, start)
    ahead, last = walk(solution_curve, start)
    behind, first = walk(solution_curve, start.reversed())
    assert ends == (first, last)
    np.testing.assert_array_equal(points.q[at], start.q)
    np.testing.assert_array_equal(points.q[at:], ahead.q)
    np.testing.assert_array_equal(points.q[: at + 1], behind.q[::-1])


def test_points_are_in_the_limits_and_turn_little(
    solution_curve: SolutionCurve, start: CurvePoint
) -> None:
    points, _ = walk(solution_curve, start)
    assert points.clearance_rad[0] > 0.0
    assert points.clearance_rad.min() == points.clearance_rad[-1] == 0.0
    cosines = (points.tangent[1:] * points.tangent[:-1]).sum(axis=1)
    assert np.arccos(cosines.clip(max=1.0)).max() <= MAX_TURN_RAD
    bent = 1.02  # a step is so long along the tangent, and goes as far aside as the curve bends
    assert points.chords_rad.max() <= bent * LONGEST_STEP_RAD


@pytest.mark.parametrize("step_rad", [0.05, 0.005])
def test_filled_points_reach_the_pose_and_keep_the_step(
    solution_curve: SolutionCurve, start: CurvePoint, step_rad: float
) -> None:
    points, _ = walk(solution_curve, start)
    closer, places = filled(solution_curve, points, step_rad)
    np.testing.assert_array_equal(closer.rows[places], points.rows)
    assert len(closer) > len(points)
    assert closer.chords_rad.max() <= 1.01 * step_rad  # a cubic is not travelled at one speed
    assert max(np.linalg.norm(solution_curve.error(q)) for q in closer.q) < 1e-11
    assert ((closer.tangent[1:] * closer.tangent[:-1]).sum(axis=1) > 0.9).all()


def test_short_arcs_get_no_points(solution_curve: SolutionCurve, start: CurvePoint) -> None:
    points, _ = walk(solution_curve, start)
    steps = np.full(len(points) - 1, np.inf)
    assert len(filled(solution_curve, points, steps)[0]) == len(points)
    steps[2] = 0.25 * points.chords_rad[2]
    _, places = filled(solution_curve, points, steps)
    assert np.diff(places)[2] > 3
    assert (np.delete(np.diff(places), 2) == 1).all()


def test_wherever_a_curve_leaves_its_limits_it_was_suspected(arm: Arm) -> None:
    """Loops without limits, and their cubics sampled closely."""
    rng, crossings = np.random.default_rng(7), 0
    for _ in range(4):
        q = arm.random_configuration(rng)
        curve = SolutionCurve(arm, arm.T_base_tip(q))
        start = curve.start(q)
        assert start is not None
        points = curve.into_range(walk(curve.without_limits, start)[0])
        suspected = may_leave(points)
        for i, is_suspected in enumerate(suspected):
            segment, u = np.full(50, i), np.linspace(0.0, 1.0, 50)
            sampled, _ = cubics(points.q, points.tangent, segment, u)
            inside = curve.clearance_rad(sampled) >= 0.0
            if inside.any() and not inside.all() and inside[0] | inside[-1]:
                crossings += 1
                assert is_suspected, (q, i)
    assert crossings > 12


def test_the_last_point_takes_the_place_of_one_that_it_coincides_with(start: CurvePoint) -> None:
    one = CurvePoints.of([start])
    ahead = replace(start, q=start.q + 0.1)
    two = with_last(one, ahead)
    assert len(two) == 2
    same = replace(ahead, q=ahead.q + 1e-10, residual=0.5)
    assert len(with_last(two, same)) == 2
    assert with_last(two, same).residual[-1] == 0.5
    assert len(with_last(one, replace(start, residual=0.5))) == 1
    assert with_last(one, replace(start, residual=0.5)).residual[0] == start.residual


def test_a_limit_that_is_crossed_between_two_points_inside_ends_the_curve(
    robot: Baxter, left: Arm
) -> None:
    """Limits of each joint halfway between its maximum at points and its maximum in between."""
    whole = SolutionCurve(left, left.T_base_tip(CLOSED))
    start = whole.start(CLOSED)
    assert start is not None
    points, _ = walk(whole, start)
    at_points = points.q.max(axis=0)
    between = filled(whole, points, 1e-3)[0].q.max(axis=0)
    joints = np.flatnonzero(between - at_points > 1e-4)
    assert joints.size > 2
    for joint in joints:
        q_max = np.array(left.limits.q_max)
        q_max[joint] = 0.5 * (at_points + between)[joint]
        narrow = with_limits(left, robot, left.limits.q_min, q_max)
        _, end = walk(SolutionCurve(narrow, left.T_base_tip(CLOSED)), start)
        assert end.joint_name == left.joint_names[joint]


def test_loop_holds_its_pieces_and_no_others(arm: Arm) -> None:
    rng = np.random.default_rng(5)
    for _ in range(12):
        q = arm.random_configuration(rng)
        solution_curve = SolutionCurve(arm, arm.T_base_tip(q))
        (loop,) = loops_near(solution_curve, np.array([q]))
        pieces = list(pieces_inside(solution_curve, [loop]))
        on = pieces[0].points.then(*(piece.points for piece in pieces[1:]))
        assert loop.holds(on.q, on.tangent).all()
        assert not loop.holds(on.q, -on.tangent).any()
        across = np.linalg.svd(on.tangent[:1])[2][3]
        assert not loop.holds(on.q[:1] + 0.01 * across, on.tangent[:1]).any()


def test_loop_that_limits_do_not_cut_is_one_piece(left: Arm) -> None:
    assert len(distinct_solutions(left, [CLOSED])) == 1


def test_isolated_point_has_no_loop(left: Arm) -> None:
    assert pieces_of(left, singular_near(left, ALONE)) == []
