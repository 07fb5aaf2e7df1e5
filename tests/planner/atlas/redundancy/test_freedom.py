"""The freedom of one pose."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, IKService, pose_from_quaternion
from baxter_kin.errors import PoseError
from baxter_kin.fields import field_names
from baxter_kin.ik import solutions
from planner.atlas import ReachMap
from planner.atlas.redundancy import RedundancySearch, freedom_at


def test_the_pick_of_the_demo_has_four_pieces(
    small_map: ReachMap, left: Arm, ik: IKService
) -> None:
    """As docs/concepts/self_motion.md has it: 10.12, 3.17, 2.73 and 0.07 rad."""
    T = pose_from_quaternion((0.70, 0.15, -0.129), (0.0, 1.0, 0.0, 0.0))
    found = freedom_at(small_map.robot, "left", T)
    curves = solutions(ik, T)
    assert found.pieces == len(curves) == 4
    assert found.length_rad == pytest.approx(16.09, abs=0.02)
    assert found.longest_rad == pytest.approx(10.12, abs=0.01)
    assert found.manipulability == pytest.approx(0.129, abs=1e-3)
    assert 0.0 < found.margin_rad < 3.06
    assert 0.0 < found.free_share <= 1.0
    assert repr(found).startswith("Freedom(4 pieces, 16.1 rad, the longest 10.1, up to ")


def test_a_pose_out_of_reach_has_none(search: RedundancySearch) -> None:
    found = search.at(pin.SE3(np.eye(3), np.array([4.0, 0.0, 0.0])))
    assert (found.pieces, found.length_rad, found.longest_rad) == (0, 0.0, 0.0)
    assert all(map(math.isnan, (found.margin_rad, found.manipulability, found.free_share)))
    assert repr(found) == "Freedom(not reached)"


def test_rolls_have_the_freedom_of_their_poses(search: RedundancySearch, left: Arm) -> None:
    q = left.start
    T, rolls = left.T_base_tip(q), np.array([0.0, 0.5, -0.8])
    witnesses = q + np.outer(rolls, np.eye(7)[6])
    found = search.at_rolls(T, rolls, witnesses, q[None])
    for roll, one in zip(rolls, found, strict=True):
        R = pin.AngleAxis(roll, np.array([0.0, 0.0, 1.0])).matrix()
        alone = search.at(T * pin.SE3(R, np.zeros(3)))
        assert one.pieces == alone.pieces
        for name in field_names(one):
            assert getattr(one, name) == pytest.approx(getattr(alone, name), abs=2e-3), name


def test_what_is_no_pose_is_refused(search: RedundancySearch) -> None:
    with pytest.raises(PoseError):
        search.at(np.zeros((4, 4)))
