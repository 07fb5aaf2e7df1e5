from __future__ import annotations

import numpy as np
import pytest

from baxter_kin import Arm, Baxter
from baxter_kin.ik.redundancy.continuation import EndKind, filled
from baxter_kin.ik.redundancy.cutting import Piece, pieces_inside
from baxter_kin.ik.redundancy.loop import loops_near
from baxter_kin.ik.redundancy.segment import feet
from baxter_kin.ik.redundancy.self_motion import trace_self_motion
from baxter_kin.ik.redundancy.solution_curve import SolutionCurve
from baxter_kin.ik.solution_set import distinct_solutions
from baxter_kin.validation import FloatArray
from tests.baxter_kin.ik.redundancy.test_self_motion import pose_error

WITH_TINY_PIECE = [
    [0.278, -0.361, 0.104, 0.86, -0.658, 0.263, 0.421],
    [-0.204, -0.42, 1.082, 1.755, -0.242, 0.246, 2.518],
    [-0.958, -1.737, 1.063, 2.132, -1.125, -1.143, 2.527],
]
"""Configurations of the left arm whose loops have a piece shorter than 0.01 rad elsewhere."""


def pieces_of(arm: Arm, q: FloatArray) -> list[Piece]:
    """Those of the loop through a configuration."""
    solution_curve = SolutionCurve(arm, arm.T_base_tip(q))
    return list(pieces_inside(solution_curve, loops_near(solution_curve, np.array([q]))))


def test_every_configuration_is_inside_the_limits(arm: Arm) -> None:
    rng = np.random.default_rng(1)
    for _ in range(10):
        for piece in pieces_of(arm, arm.random_configuration(rng)):
            for q in piece.points.q:
                assert not arm.limits.violations(q)


def test_the_curve_it_comes_from_is_among_the_pieces(arm: Arm) -> None:
    rng = np.random.default_rng(2)
    for _ in range(10):
        curve = trace_self_motion(arm, arm.random_configuration(rng))
        pieces = pieces_of(arm, curve.at(curve.s_start))
        assert min(curve.nearest(piece.points.q[0])[1] for piece in pieces) < 1e-6


def test_ends_of_pieces_are_those_of_the_curves_through_them(arm: Arm) -> None:
    """Those traced with limits, and those cut out of the loop: on the same limits."""
    rng = np.random.default_rng(4)
    for _ in range(6):
        for piece in pieces_of(arm, arm.random_configuration(rng)):
            middle = piece.points.q[len(piece.points) // 2]
            curve = trace_self_motion(arm, middle)
            assert curve.ends == piece.ends
            np.testing.assert_allclose(curve.q[[0, -1]], piece.points.q[[0, -1]], atol=1e-7)


def test_every_piece_leads_to_the_same_pieces(arm: Arm) -> None:
    """Being on one loop is an equivalence."""
    rng = np.random.default_rng(3)
    for _ in range(6):
        pieces = distinct_solutions(arm, [arm.random_configuration(rng)], step_rad=0.05)
        for piece in pieces[1:]:
            middle = piece.at(0.5 * piece.length_rad)
            again = distinct_solutions(arm, [middle], step_rad=0.05)
            assert [p.ends for p in again] == [p.ends for p in pieces]


@pytest.mark.parametrize("q", WITH_TINY_PIECE)
def test_piece_shorter_than_a_step_is_found(left: Arm, q: list[float]) -> None:
    pieces = distinct_solutions(left, [q])
    assert len(pieces) > 1
    assert pieces[-1].length_rad < 0.01


def test_pieces_reach_the_pose(robot: Baxter, left: Arm) -> None:
    q_known = np.array(WITH_TINY_PIECE[0])
    for piece in pieces_of(left, q_known):
        for q in piece.points.q:
            assert pose_error(robot, left, q, left.T_base_tip(q_known)) < 1e-9


def test_what_of_a_loop_is_inside_the_limits_is_on_one_piece(arm: Arm) -> None:
    """Between the points of the loop, sampled closely; pieces begin and end where it is not."""
    rng, checked = np.random.default_rng(8), 0
    for _ in range(5):
        q = arm.random_configuration(rng)
        solution_curve = SolutionCurve(arm, arm.T_base_tip(q))
        (loop,) = loops_near(solution_curve, q[None])
        pieces = list(pieces_inside(solution_curve, [loop]))
        points, _ = filled(solution_curve.without_limits, loop.points, 0.01)
        inside = solution_curve.into_range(points)
        for point in inside.q[inside.clearance_rad > AT_LIMIT_RAD]:
            assert sum(holds(piece, point) for piece in pieces) == 1
            checked += 1
        for point in inside.q[inside.clearance_rad < -AT_LIMIT_RAD]:
            assert not any(holds(piece, point) for piece in pieces)
    assert checked > 500


AT_LIMIT_RAD = 1e-3
"""Nearer to a limit, a sample may be taken for the end of a piece."""

CUBIC_RAD = 2e-4
"""How far the cubics of a piece may be from the curve; 7e-5 on these loops."""


def holds(piece: Piece, q: FloatArray) -> bool:
    if len(piece.points) < 2:
        return False
    return bool(feet(piece.points.q, piece.points.tangent, q[None])[0][0] < CUBIC_RAD)


def test_ends_stand_on_the_limit_they_name_and_lead_out_of_it(arm: Arm) -> None:
    rng = np.random.default_rng(9)
    for _ in range(10):
        for piece in pieces_of(arm, arm.random_configuration(rng)):
            sides = (piece.points[0].reversed(), piece.points[len(piece.points) - 1])
            for point, end in zip(sides, piece.ends, strict=True):
                if end.kind is EndKind.LIMIT:
                    joint = arm.joint_names.index(str(end.joint_name))
                    assert point.q[joint] == end.limit_rad
                    is_upper = end.limit_rad == arm.limits.q_max[joint]
                    assert (point.tangent[joint] > 0.0) == is_upper


def test_loops_cut_together_are_each_cut_as_alone(left: Arm) -> None:
    rng = np.random.default_rng(10)
    T = left.T_base_tip(left.start)
    solution_curve = SolutionCurve(left, T)
    starts = np.array([left.random_configuration(rng) for _ in range(200)])
    loops = loops_near(solution_curve, starts)
    assert len(loops) > 1
    together = list(pieces_inside(solution_curve, loops))
    alone = [piece for loop in loops for piece in pieces_inside(solution_curve, [loop])]
    assert [piece.ends for piece in together] == [piece.ends for piece in alone]
    for one, other in zip(together, alone, strict=True):
        np.testing.assert_allclose(one.points.q, other.points.q, atol=1e-12)


def test_no_loops_have_no_pieces(left: Arm) -> None:
    solution_curve = SolutionCurve(left, left.T_base_tip(left.start))
    assert list(pieces_inside(solution_curve, [])) == []
