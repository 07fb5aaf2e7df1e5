from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, IKService, RequestError
from baxter_kin.frames import angle_between
from baxter_kin.ik import sample_solutions
from baxter_kin.ik.samples import MOST_TURNS
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
    with pytest.raises(RequestError, match="turns must be a whole number from 1 to 10000"):
        sample_solutions(ik, at(0.6, 0.3, 0.2), turns=0)


def test_another_tip_has_the_samples_of_its_own(left: Arm) -> None:
    tipped = left.with_tip(pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.1])))
    T = tipped.T_base_tip(tipped.start)
    for q in sample_solutions(IKService(tipped), T):
        assert np.linalg.norm(tipped.T_base_tip(q).translation - T.translation) <= TOLERANCE


@pytest.mark.parametrize(
    "turns", [0.5, 48.0, "48", None, True, -1, MOST_TURNS + 1, 10**12], ids=str
)
def test_turns_are_a_whole_number_with_a_greatest_value(ik: IKService, turns: Any) -> None:
    with pytest.raises(RequestError, match=f"turns must be a whole number from 1 to {MOST_TURNS}"):
        sample_solutions(ik, at(0.7, 0.2, 0.1), turns=turns)


@pytest.mark.parametrize("service", [None, 5, "ik"], ids=str)
def test_what_is_no_service_has_no_samples(service: Any) -> None:
    with pytest.raises(RequestError, match="ik must be of class IKService"):
        sample_solutions(service, at(0.7, 0.2, 0.1))
