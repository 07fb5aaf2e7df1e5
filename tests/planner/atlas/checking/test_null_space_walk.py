"""The walk that checks self-motions is right by itself."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from baxter_kin import Arm, Baxter
from planner.atlas.checking.null_space_walk import WALK_RAD, NullSpaceWalker


def test_a_walk_keeps_the_pose_and_the_limits(robot: Baxter, left: Arm) -> None:
    T = left.T_base_tip(left.start)
    walk = NullSpaceWalker(robot, "left").walk(T, left.start)
    steps = np.linalg.norm(np.diff(walk.q, axis=0), axis=1)
    assert np.abs(steps - WALK_RAD).max() < 1e-4
    assert 0.0 <= walk.length_rad - steps.sum() <= 2.0 * WALK_RAD
    for q in walk.q[::50]:
        assert not left.limits.violations(q)
        assert np.linalg.norm(pin.log6(T.actInv(left.T_base_tip(q))).vector) < 1e-9


def test_a_joint_is_on_a_limit_where_a_walk_ends(robot: Baxter, left: Arm) -> None:
    walk = NullSpaceWalker(robot, "left").walk(left.T_base_tip(left.start), left.start)
    for end in (walk.q[0], walk.q[-1]):
        margin = np.minimum(end - left.limits.q_min, left.limits.q_max - end).min()
        assert margin <= WALK_RAD
