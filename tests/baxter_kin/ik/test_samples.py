from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, IKService, RequestError
from baxter_kin.frames import angle_between
from baxter_kin.ik import sample_solutions
from tests.conftest import at

TOLERANCE = 1e-6


def test_samples_are_solutions_all_over_the_solution_set(arm: Arm) -> None:
    service, rng = IKService(arm), np.random.default_rng(9)
    for _ in range(10):
        q_goal = arm.random_configuration(rng)
        T = arm.T_base_tip(q_goal)
        samples = sample_solutions(service, T)
        for q in samples:
            reached = arm.T_base_tip(q)
            assert np.linalg.norm(reached.translation - T.translation) <= TOLERANCE
            assert angle_between(reached.rotation, T.rotation) <= TOLERANCE
            assert not arm.limits.violations(q)
        assert np.abs(samples - q_goal).max(axis=1).min() < 0.5
        assert len(np.unique(samples.round(4), axis=0)) == len(samples)


def test_a_pose_out_of_reach_has_no_samples(ik: IKService) -> None:
    assert sample_solutions(ik, at(2.0, 0.0, 0.0)).shape == (0, 7)
    with pytest.raises(RequestError, match="turns must be above zero"):
        sample_solutions(ik, at(0.6, 0.3, 0.2), turns=0)


def test_another_tip_has_the_samples_of_its_own(left: Arm) -> None:
    tipped = left.with_tip(pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.1])))
    T = tipped.T_base_tip(tipped.start)
    for q in sample_solutions(IKService(tipped), T):
        assert np.linalg.norm(tipped.T_base_tip(q).translation - T.translation) <= TOLERANCE
