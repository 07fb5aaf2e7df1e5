from __future__ import annotations

import numpy as np

from baxter_kin import Arm
from baxter_kin.ik.redundancy.cutting import pieces_inside
from baxter_kin.ik.redundancy.loop import loops_near
from baxter_kin.ik.redundancy.solution_curve import SolutionCurve
from baxter_kin.ik.solution_set import distinct_solutions
from tests.baxter_kin.ik.redundancy.test_cutting import pieces_of
from tests.baxter_kin.ik.redundancy.test_self_motion import ALONE, CLOSED, singular_near


def test_loop_holds_its_pieces_and_no_others(arm: Arm) -> None:
    rng = np.random.default_rng(5)
    for _ in range(40):
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


def test_point_that_stands_alone_has_no_loop(left: Arm) -> None:
    assert pieces_of(left, singular_near(left, ALONE)) == []
