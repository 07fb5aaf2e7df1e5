from __future__ import annotations

import numpy as np
import pytest

from baxter_kin import Arm, Baxter
from baxter_kin.ik.redundancy.cutting import Piece, pieces_inside
from baxter_kin.ik.redundancy.loop import loops_near
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
