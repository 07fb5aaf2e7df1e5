from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin import Arm, Baxter, IKService
from baxter_kin.ik.search.searcher import Searcher
from baxter_kin.ik.self_motion.continuation import EndKind, filled, loops_near
from baxter_kin.ik.self_motion.curve_cubics import feet
from baxter_kin.ik.self_motion.pieces import (
    SAME_CURVE_RAD,
    Piece,
    all_pieces,
    pieces_inside,
    pieces_through,
)
from baxter_kin.ik.self_motion.solution_curve import SolutionCurve
from baxter_kin.ik.self_motion.tracing import trace_self_motion
from baxter_kin.ik.solution_set import distinct_solutions, solutions
from baxter_kin.validation import FloatArray
from tests.baxter_kin.ik.test_solution_set import BLOCK, independent_solutions
from tests.served_urdf import served_urdf

WITH_TINY_PIECE = [
    [0.278, -0.361, 0.104, 0.86, -0.658, 0.263, 0.421],
    [-0.204, -0.42, 1.082, 1.755, -0.242, 0.246, 2.518],
    [-0.958, -1.737, 1.063, 2.132, -1.125, -1.143, 2.527],
]
"""Configurations of the left arm whose loops have a piece shorter than 0.01 rad elsewhere."""


def pieces_of(arm: Arm, q: FloatArray) -> list[Piece]:
    """The pieces of the loop through a configuration."""
    solution_curve = SolutionCurve(arm, arm.T_base_tip(q))
    return list(pieces_inside(solution_curve, loops_near(solution_curve, np.array([q]))))


def test_every_configuration_is_inside_the_limits(arm: Arm) -> None:
    rng = np.random.default_rng(1)
    for _ in range(4):
        for piece in pieces_of(arm, arm.random_configuration(rng)):
            for q in piece.points.q:
                assert not arm.limits.violations(q)


def test_the_curve_it_comes_from_is_among_the_pieces(arm: Arm) -> None:
    rng = np.random.default_rng(2)
    for _ in range(4):
        curve = trace_self_motion(arm, arm.random_configuration(rng))
        pieces = pieces_of(arm, curve.at(curve.s_start))
        assert min(curve.nearest(piece.points.q[0])[1] for piece in pieces) < 1e-6


def test_ends_of_pieces_agree_with_traced_curves(arm: Arm) -> None:
    """Pieces traced with limits, and pieces cut out of the loop, end on the same limits."""
    rng = np.random.default_rng(4)
    for _ in range(3):
        for piece in pieces_of(arm, arm.random_configuration(rng)):
            middle = piece.points.q[len(piece.points) // 2]
            curve = trace_self_motion(arm, middle)
            assert curve.ends == piece.ends
            np.testing.assert_allclose(curve.q[[0, -1]], piece.points.q[[0, -1]], atol=1e-7)


def test_every_piece_leads_to_the_same_pieces(arm: Arm) -> None:
    """Being on one loop is an equivalence."""
    rng = np.random.default_rng(3)
    for _ in range(3):
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


@pytest.mark.slow
def test_points_of_a_loop_inside_the_limits_are_on_one_piece(arm: Arm) -> None:
    """Sampled closely between the points of the loop."""
    rng, checked = np.random.default_rng(8), 0
    for _ in range(3):
        q = arm.random_configuration(rng)
        solution_curve = SolutionCurve(arm, arm.T_base_tip(q))
        (loop,) = loops_near(solution_curve, q[None])
        pieces = list(pieces_inside(solution_curve, [loop]))
        points, _ = filled(solution_curve.without_limits, loop.points, 0.01)
        inside = solution_curve.into_range(points)
        for point in inside.q[inside.clearance_rad > AT_LIMIT_RAD][::3]:
            assert sum(holds(piece, point) for piece in pieces) == 1
            checked += 1
        for point in inside.q[inside.clearance_rad < -AT_LIMIT_RAD][::3]:
            assert not any(holds(piece, point) for piece in pieces)
    assert checked > 100


AT_LIMIT_RAD = 1e-3
"""Nearer to a limit, a sample may be taken for the end of a piece."""

CUBIC_RAD = 2e-4
"""Allowed distance of the cubics of a piece from the curve; 7e-5 on these loops."""


def holds(piece: Piece, q: FloatArray) -> bool:
    if len(piece.points) < 2:
        return False
    return bool(feet(piece.points.q, piece.points.tangent, q[None])[0][0] < CUBIC_RAD)


def test_ends_stand_on_the_limit_they_name_and_lead_out_of_it(arm: Arm) -> None:
    rng = np.random.default_rng(9)
    for _ in range(4):
        for piece in pieces_of(arm, arm.random_configuration(rng)):
            sides = (piece.points[0].reversed(), piece.points[len(piece.points) - 1])
            for point, end in zip(sides, piece.ends, strict=True):
                if end.kind is EndKind.LIMIT:
                    joint = arm.joint_names.index(str(end.joint_name))
                    assert point.q[joint] == end.limit_rad
                    is_upper = end.limit_rad == arm.limits.q_max[joint]
                    assert (point.tangent[joint] > 0.0) == is_upper


def test_loops_cut_together_are_cut_as_separately(left: Arm) -> None:
    rng = np.random.default_rng(10)
    T = left.T_base_tip(left.start)
    solution_curve = SolutionCurve(left, T)
    starts = np.array([left.random_configuration(rng) for _ in range(80)])
    loops = loops_near(solution_curve, starts)
    assert len(loops) > 1
    together = list(pieces_inside(solution_curve, loops))
    alone = [piece for loop in loops for piece in pieces_inside(solution_curve, [loop])]
    assert [piece.ends for piece in together] == [piece.ends for piece in alone]
    for one, other in zip(together, alone, strict=True):
        np.testing.assert_allclose(one.points.q, other.points.q, atol=1e-12)


def test_pose_of_which_a_piece_was_missed_has_eleven(left: Arm, ik: IKService) -> None:
    """Random seeds led to 10; the eleventh is 3 rad long."""
    q = (-1.416317, -1.827109, -0.598712, 0.95013, 1.787514, -1.458849, 0.568832)
    curves = solutions(ik, left.T_base_tip(q))
    assert len(curves) == 11
    assert sum(curve.length_rad > 2.9 for curve in curves) == 4


CORNERED = [
    [1.70167993878, 1.0443488648307344, 3.05417993878, 1.42441708, -0.06325, -1.57079632679, 2.339],
    [-0.48514126853, 1.047, 1.1315255858299293, 2.618, 3.059, -1.57079632679, -1.583915925166547],
    [-1.267772644728416, 1.047, 2.6609278854205, 0.160593487500, -3.059, 2.094, -3.059],
]
"""Configurations of the left arm that cannot move: joints at limits stop it both ways."""


@pytest.mark.parametrize("q", CORNERED)
def test_solution_cornered_between_limits_is_a_piece(
    left: Arm, ik: IKService, q: list[float]
) -> None:
    curves = solutions(ik, left.T_base_tip(q))
    (cornered,) = [curve for curve in curves if curve.nearest(q)[1] < 1e-6]
    assert cornered.length_rad < 1e-6
    assert {end.kind for end in cornered.ends} == {EndKind.LIMIT}
    assert all(not left.limits.violations(point) for curve in curves for point in curve.q)


def test_more_starts_find_nothing_more(ik: IKService) -> None:
    one, other = (solutions(ik, BLOCK, starts=starts) for starts in (1, 100))
    assert [c.length_rad for c in one] == pytest.approx([c.length_rad for c in other], abs=1e-6)


CALIBRATED = [
    [-1.70167993878, 0.577773317903, 1.325334048397, -0.05, -3.059, 1.951729631474, 2.604904680837],
    [-0.9592524447, -1.9142184511, 2.990260422, 0.247286426, 0.1654163201, 1.770201325, -2.4610039],
]
"""Configurations of a calibrated left arm whose loops lie 0.1 rad and more from all closed forms of
the arm as drawn."""


@pytest.mark.parametrize("q", CALIBRATED)
def test_all_pieces_of_a_calibrated_arm_are_found(q: list[float]) -> None:
    arm = Baxter.load(served_urdf(np.random.default_rng(7))).arm("left")
    T = arm.T_base_tip(q)
    curves = solutions(IKService(arm), T)
    for other in [np.array(q), *independent_solutions(arm, T, 30, seed=2)]:
        assert min(curve.nearest(other)[1] for curve in curves) < 1e-4


@pytest.mark.parametrize(("side", "held"), [("left", 0), ("right", 2), ("left", 4)])
def test_solutions_hold_every_other_solution(robot: Any, side: str, held: int) -> None:
    """For poses of configurations with this many joints at limits."""
    arm, rng = robot.arm(side), np.random.default_rng(20)
    q = arm.random_configuration(rng)
    at_limits = rng.permutation(7)[:held]
    q[at_limits] = arm.limits.q_max[at_limits]
    T = arm.T_base_tip(q)
    curves = solutions(IKService(arm), T)
    for other in [q, *independent_solutions(arm, T, 30, seed=8)]:
        assert min(curve.nearest(other)[1] for curve in curves) < 1e-4


def test_every_candidate_is_on_exactly_one_piece(arm: Arm) -> None:
    T = arm.T_base_tip(arm.start)
    candidates = np.array(independent_solutions(arm, T, 30, seed=3))
    found = pieces_through(SolutionCurve(arm, T), candidates, 0.05)
    for q in candidates:
        assert sum(piece.nearest(q)[1] < SAME_CURVE_RAD for piece in found) == 1


def test_a_known_solution_is_on_one_of_the_pieces(any_arm: Arm) -> None:
    search, rng = Searcher(any_arm), np.random.default_rng(5)
    for _ in range(5):
        q = any_arm.random_configuration(rng)
        found = all_pieces(any_arm, search, any_arm.T_base_tip(q), 0.1, q, starts=1)
        assert min(piece.nearest(q)[1] for piece in found) < SAME_CURVE_RAD


def test_the_sweep_finds_the_pieces_that_searches_lead_to(left: Arm) -> None:
    search, T = Searcher(left), left.T_base_tip(left.start)
    swept, all_ = (all_pieces(left, search, T, 0.1, starts=starts) for starts in (1, 64))
    lengths = [piece.length_rad for piece in all_]
    assert [piece.length_rad for piece in swept] == pytest.approx(lengths, abs=1e-4)
    assert len(swept) > 1
