from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm
from baxter_kin.ik.reach import ReachBound


def test_no_reachable_pose_is_declared_out_of_reach(arm: Arm) -> None:
    bound, rng = ReachBound(arm), np.random.default_rng(6)
    for _ in range(5000):
        q = rng.uniform(-np.pi, np.pi, 7)  # even beyond the joint limits
        assert bound.excess_m(arm.T_base_tip(q)) == 0.0


def test_excess_is_the_distance_beyond_the_ball(left: Arm) -> None:
    bound = ReachBound(left)
    shoulder = left.model.jointPlacements[1].translation
    away = np.array([0.6, 0.0, 0.8])
    beyond = pin.SE3(np.eye(3), shoulder + (bound.radius_m + 0.25) * away)
    assert bound.excess_m(beyond) == pytest.approx(0.25, abs=1e-12)
