from __future__ import annotations

import numpy as np
import pytest

from baxter_kin import Arm, Baxter
from baxter_kin.ik.components import distinct_solutions
from baxter_kin.ik.loop import inside_limits
from baxter_kin.ik.self_motion import trace_self_motion
from tests.baxter_kin.ik.test_self_motion import ALONE, CLOSED, pose_error, singular_near

WITH_TINY_PIECE = [
    [0.278, -0.361, 0.104, 0.86, -0.658, 0.263, 0.421],
    [-0.204, -0.42, 1.082, 1.755, -0.242, 0.246, 2.518],
    [-0.958, -1.737, 1.063, 2.132, -1.125, -1.143, 2.527],
]
"""Configurations of the left arm whose loops have a piece shorter than 0.01 rad elsewhere."""


def test_every_configuration_is_inside_the_limits(arm: Arm) -> None:
    rng = np.random.default_rng(1)
    for _ in range(10):
        for q in inside_limits(trace_self_motion(arm, arm.random_configuration(rng))):
            assert not arm.limits.violations(q)


def test_the_curve_it_comes_from_is_among_the_pieces(arm: Arm) -> None:
    rng = np.random.default_rng(2)
    for _ in range(10):
        curve = trace_self_motion(arm, arm.random_configuration(rng))
        assert min(curve.nearest(q)[1] for q in inside_limits(curve)) < 1e-6


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


def test_loop_that_limits_do_not_cut_is_one_piece(left: Arm) -> None:
    assert len(distinct_solutions(left, [CLOSED])) == 1


def test_point_that_stands_alone_has_no_loop(left: Arm) -> None:
    assert inside_limits(trace_self_motion(left, singular_near(left, ALONE))) == []


def test_pieces_reach_the_pose(robot: Baxter, left: Arm) -> None:
    curve = trace_self_motion(left, WITH_TINY_PIECE[0])
    for q in inside_limits(curve):
        assert pose_error(robot, left, q, curve.T_base_tip) < 1e-9
