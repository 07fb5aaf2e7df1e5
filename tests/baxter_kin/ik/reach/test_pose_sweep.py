from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, Baxter
from baxter_kin.ik.reach import pose_sweep
from baxter_kin.ik.reach.linkage import Linkage
from baxter_kin.ik.reach.pose_sweep import LEVELS, MAX_SURVIVORS, PoseCells, PoseSweep
from baxter_kin.ik.reach.shoulder_sweep import ShoulderSweep
from baxter_kin.validation import FloatArray
from tests.baxter_kin.ik.reach.test_shoulder_sweep import pushed, reached
from tests.calibrated import calibrated_arm

RADIUS_M = 1e-5


@pytest.fixture(scope="module")
def sweep(left: Arm) -> PoseSweep:
    return PoseSweep(Linkage.of(left))


@pytest.fixture(scope="module")
def away(left: Arm) -> FloatArray:
    """Targets next to reachable ones with joints at limits; some are out of reach."""
    return pushed(reached(left, 120, 1)[::2], 0.02, 2)


def test_nothing_that_the_arm_reaches_is_excluded(any_arm: Arm) -> None:
    sweep = PoseSweep(Linkage.of(any_arm))
    assert not any(sweep.excludes(T, 0.0) for T in reached(any_arm, 20, 3))


def test_targets_near_reachable_ones_are_not_excluded(left: Arm, sweep: PoseSweep) -> None:
    assert not any(sweep.excludes(T, 0.02) for T in pushed(reached(left, 20, 4), 0.02, 5))


@pytest.mark.slow
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


def test_it_proves_more_than_the_sweep_over_the_shoulder(
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


@pytest.mark.slow
@pytest.mark.parametrize("passes", [0, 2])
@pytest.mark.parametrize("kind", ["tilted hand", "0.1", "0.3", "1.0"])
def test_the_cell_of_a_configuration_survives_however_small(
    robot: Baxter, monkeypatch: pytest.MonkeyPatch, kind: str, passes: int
) -> None:
    """At every level, even if the whole sweep would give up because of the number of cells."""
    monkeypatch.setattr(pose_sweep, "PASSES", passes)
    rng, nearer = np.random.default_rng(6), 0
    for side in ("left", "right"):
        is_tilted = kind == "tilted hand"
        arm = (
            _tilted_hand(robot, side)
            if is_tilted
            else calibrated_arm(robot, side, rng, float(kind))
        )
        linkage, low, high = Linkage.of(arm), arm.limits.q_min, arm.limits.q_max
        sweep = PoseSweep(linkage)
        for _ in range(8):
            ends = np.where(rng.random(7) < 0.5, low, high)
            q = np.where(rng.random(7) < 0.3, ends, arm.random_configuration(rng))
            target = linkage.targets(arm.T_base_tip(q).homogeneous[None])[0]
            s0, w0 = (q + linkage.q_offset)[[0, 4]]
            cells = PoseCells.of(linkage, sweep._deviation.anywhere)
            for _ in range(LEVELS):
                is_near = np.abs(cells.s0 - s0) <= cells.half[0] + 1e-9  # rounding
                cells = cells.part(is_near & (np.abs(cells.w0 - w0) <= cells.half[1] + 1e-9))
                cells = sweep._survivors(target, 0.0, cells, False, MAX_SURVIVORS)
                assert cells.s0.size
                cells = cells.split()
            nearer += cells.deviation.slack[1].min() < 0.1 * linkage.deviation.axis
    assert (nearer > 0) == (passes > 0)


@pytest.mark.slow
def test_of_a_calibrated_arm_more_is_proven_than_with_the_whole_deviation(
    robot: Baxter, monkeypatch: pytest.MonkeyPatch
) -> None:
    arm = calibrated_arm(robot, "left", np.random.default_rng(100), 0.1)
    targets = pushed(reached(arm, 80, 7)[::2], 0.01, 8)
    ours = np.array([PoseSweep(Linkage.of(arm)).excludes(T, RADIUS_M) for T in targets])
    monkeypatch.setattr(pose_sweep, "PASSES", 0)
    before = np.array([PoseSweep(Linkage.of(arm)).excludes(T, RADIUS_M) for T in targets])
    assert (ours | ~before).all()
    assert ours.sum() > before.sum()


def _tilted_hand(robot: Baxter, side: str) -> Arm:
    """An arm as drawn, except for the last axis, so that its deviation is always the largest."""
    model = robot.model.copy()
    joint = model.getJointId(f"{side}_w2")
    turn = pin.SE3(pin.exp3(np.full(3, 0.01)), np.zeros(3))  # about the wrist
    model.jointPlacements[joint] = turn * model.jointPlacements[joint]
    return Arm(side, model)
