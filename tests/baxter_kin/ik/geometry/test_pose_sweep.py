from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm
from baxter_kin.ik.geometry.linkage import Linkage
from baxter_kin.ik.geometry.pose_sweep import PoseSweep
from baxter_kin.ik.geometry.shoulder_sweep import ShoulderSweep
from baxter_kin.validation import FloatArray
from tests.baxter_kin.ik.geometry.test_shoulder_sweep import pushed, reached

RADIUS_M = 1e-5


@pytest.fixture(scope="module")
def sweep(left: Arm) -> PoseSweep:
    return PoseSweep(Linkage.of(left))


@pytest.fixture(scope="module")
def away(left: Arm) -> FloatArray:
    """Targets next to what is reached with joints at limits; some are out of reach."""
    return pushed(reached(left, 160, 1)[::2], 0.02, 2)


def test_nothing_that_the_arm_reaches_is_excluded(any_arm: Arm) -> None:
    sweep = PoseSweep(Linkage.of(any_arm))
    assert not any(sweep.excludes(T, 0.0) for T in reached(any_arm, 40, 3))


def test_nothing_within_the_radius_of_what_is_reached_is_excluded(
    left: Arm, sweep: PoseSweep
) -> None:
    assert not any(sweep.excludes(T, 0.02) for T in pushed(reached(left, 40, 4), 0.02, 5))


def test_a_proof_holds_for_every_smaller_radius_and_with_more_cells(
    sweep: PoseSweep, away: FloatArray
) -> None:
    far = [sweep.excludes(T, 0.01) for T in away]
    near = [sweep.excludes(T, RADIUS_M) for T in away]
    hasty = [sweep.excludes(T, RADIUS_M, 250) for T in away]
    assert 0 < sum(far) <= sum(near) < len(away)
    assert sum(hasty) < sum(near)
    for one, other, least in zip(far, near, hasty, strict=True):
        assert other >= max(one, least)


def test_it_proves_what_the_sweep_over_the_shoulder_does_not(
    left: Arm, sweep: PoseSweep, away: FloatArray
) -> None:
    shoulder = ShoulderSweep(Linkage.of(left))
    proven = shoulder.exclusions(away, np.full(len(away), RADIUS_M), 5).is_proven
    ours = np.array([sweep.excludes(T, RADIUS_M) for T in away])
    assert (ours & ~proven).any()


def test_a_roll_that_the_last_joint_cannot_make_is_excluded(left: Arm, sweep: PoseSweep) -> None:
    """w2 stops short of a whole turn; there is no other way to point the tool there."""
    q = np.array(left.start)
    q[[0, 1, 3, 5, 6]] = left.limits.q_max[[0, 1, 3, 5, 6]]
    T = Linkage.of(left).targets(left.T_base_tip(q).homogeneous[None])[0]
    turned = {
        roll: sweep.excludes(T @ pin.SE3(pin.utils.rotate("z", roll), np.zeros(3)).homogeneous, 0.0)
        for roll in (-1.0, 0.0, 0.08)
    }
    assert turned == {-1.0: False, 0.0: False, 0.08: True}
