"""Exact answers for single poses."""

from __future__ import annotations

import numpy as np
import pytest

from baxter_kin import Baxter, IKService, pose_from_quaternion
from baxter_kin.ik.solution_set import sample_solutions
from planner.atlas.checking.pose_finder import PoseFinder
from planner.atlas.questions.pose_answer import answer_pose, margin_of


@pytest.mark.parametrize("side", ["left", "right"])
def test_witnesses_hold_and_none_of_many_solutions_has_a_wider_margin(
    robot: Baxter, finders: dict[str, PoseFinder], side: str
) -> None:
    arm, rng = robot.arm(side), np.random.default_rng(4)
    ik = IKService(arm)
    for _ in range(12):
        T = arm.T_base_tip(arm.random_configuration(rng))
        answer = answer_pose(ik, T)
        assert answer.status == "reachable"
        assert answer.q is not None
        assert answer.margin_rad is not None
        assert finders[side].holds(T, answer.q)
        others = [margin_of(arm.limits, q)[0] for q in sample_solutions(ik, T)]
        assert answer.margin_rad >= max(others, default=0.0) - 1e-6
        joint = arm.joint_names.index(answer.nearest_limit)
        off = min(
            answer.q[joint] - arm.limits.q_min[joint], arm.limits.q_max[joint] - answer.q[joint]
        )
        assert off == pytest.approx(answer.margin_rad, abs=1e-12)


def test_a_pose_out_of_reach_says_why(robot: Baxter) -> None:
    T = pose_from_quaternion((0.7, 0.9, 0.9), (0.0, 1.0, 0.0, 0.0))
    answer = answer_pose(IKService(robot.arm("right")), T, "shelf")
    assert answer.status == "unreachable"
    assert answer.is_proven_unreachable
    assert "proven out of reach" in str(answer)
    assert answer.q is None
