from __future__ import annotations

import numpy as np

from baxter_kin import Arm, IKService
from tests.conftest import overhead


def test_the_reference_finds_the_nearest_solution_to_the_seed(left: Arm) -> None:
    """First-order optimality: the way to the seed has no component along the self-motion."""
    result = IKService(left, "ipopt").solve(overhead(0.70, 0.15, -0.129), seed=left.start)
    self_motion = np.linalg.svd(left.jacobian(result.q))[2][-1]
    assert abs(self_motion @ (result.q - left.start)) < 1e-6


def test_the_reference_solver_knows_the_calibrated_arm(any_arm: Arm) -> None:
    ik = IKService(any_arm, "ipopt")
    T = any_arm.T_base_tip(any_arm.neutral)
    result = ik.solve(T, seed=any_arm.neutral + 0.05)
    assert result.is_valid
    assert np.linalg.norm(any_arm.T_base_tip(result.q).translation - T.translation) < 1e-6
