from __future__ import annotations

import numpy as np

from baxter_kin import Arm
from baxter_kin.benchmark.poses import PoseSet
from baxter_kin.benchmark.solvers.ours import contestant
from tests.conftest import at


def test_our_solver_reaches_every_pose_alone_and_in_a_batch(left: Arm, poses: PoseSet) -> None:
    ours = contestant(left)
    assert ours.call_batch is not None
    batch = ours.call_batch(poses.T_base_tips, list(poses.q_seeds))
    for T, q_seed, result in zip(poses.T_base_tips, poses.q_seeds, batch, strict=True):
        for answer in (ours.call(*ours.prepare(T, q_seed)), result):
            q = ours.read(answer)
            assert q is not None
            assert np.abs(left.T_base_tip(q).homogeneous - T.homogeneous).max() < 2e-6


def test_no_solution_is_no_answer(left: Arm) -> None:
    ours = contestant(left)
    assert ours.read(ours.call(*ours.prepare(at(3.0, 0.0, 0.0), left.neutral))) is None


def test_settings_say_what_was_chosen(left: Arm) -> None:
    assert contestant(left).settings == "`IKService.solve`, all defaults"
    chosen = contestant(left, backend="casadi")
    assert chosen.name == "baxter-kin (backend casadi)"
    assert "backend casadi" in chosen.settings
