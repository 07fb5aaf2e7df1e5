"""What is found for all rolls of a direction at once is what is found pose by pose."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, Baxter, IKService
from baxter_kin.ik import SelfMotion, solutions, trace_self_motion
from baxter_kin.ik.self_motion.continuation import EndKind
from baxter_kin.kinematics.dh_parameters import DHParameters
from planner.atlas.reach_search import is_coaxial
from planner.atlas.redundancy.rolls import STEP_RAD, pieces_of_rolls, turned, with_witness
from tests.calibrated import calibrated_arm

LENGTH_RAD = 1e-4
"""Quadratures of one piece by other points."""

NONE = np.zeros((0, 7))


def same(found: tuple[SelfMotion, ...], expected: tuple[SelfMotion, ...]) -> bool:
    """Whether pieces are the same, in the same order but for those of one length."""
    lengths = [curve.length_rad for curve in expected]
    if [curve.length_rad for curve in found] != pytest.approx(lengths, abs=LENGTH_RAD):
        return False
    return all(
        any(c.nearest(curve.q[len(curve.q) // 2])[1] < 1e-6 for c in [expected[i], *expected])
        for i, curve in enumerate(found)
    )


@pytest.mark.parametrize("side", ["left", "right"])
def test_rolls_have_the_pieces_of_their_poses(robot: Baxter, side: str) -> None:
    arm, rng = robot.arm(side), np.random.default_rng(7)
    ik, rolls = IKService(arm), np.array([0.0, 0.4, 3.1, -1.9])
    for _ in range(3):
        T = arm.T_base_tip(arm.random_configuration(rng))
        found = pieces_of_rolls(ik, T, rolls, NONE)
        for curves, T_rolled in zip(found, turned(T, rolls), strict=True):
            assert same(curves, solutions(ik, T_rolled, step_rad=STEP_RAD))
            for curve in curves:
                assert arm.limits.violations(curve.q[0]) == arm.limits.violations(curve.q[-1]) == ()
                assert curve.limit_distance_rad.min() >= 0.0
                assert curve.pose_residual < 1e-10


def test_a_tool_beside_the_last_axis_has_one_roll(robot: Baxter) -> None:
    arm = calibrated_arm(robot, "left", np.random.default_rng(3))
    assert is_coaxial(DHParameters.of(robot.arm("left")).T_last_tip)
    assert not is_coaxial(DHParameters.of(arm).T_last_tip)
    ik, T = IKService(arm), arm.T_base_tip(arm.start)
    (curves,) = pieces_of_rolls(ik, T, np.zeros(1), NONE)
    assert same(curves, solutions(ik, T, step_rad=STEP_RAD))


def test_pieces_end_where_w2_does(left: Arm) -> None:
    """The pose of one end of a piece, turned until w2 is what ends it."""
    piece = trace_self_motion(left, left.start)
    (curves,) = pieces_of_rolls(IKService(left), left.T_base_tip(left.start), np.array([2.9]), NONE)
    names = {end.joint_name for curve in curves for end in curve.ends}
    assert "left_w2" in names
    assert piece.ends[0].kind is EndKind.LIMIT


def test_a_witness_on_no_piece_adds_its_own(left: Arm) -> None:
    T = left.T_base_tip(left.start)
    (curves,) = pieces_of_rolls(IKService(left), T, np.zeros(1), NONE)
    assert with_witness(curves, left, T, left.start) is curves
    (alone,) = with_witness((), left, T, left.start)
    assert alone.nearest(left.start)[1] < 1e-6
    corner = np.array([-0.48514126853, 1.047, 1.1315255858299293, 2.618, 3.059, -1.57079632679, 0])
    corner[6] = -1.583915926165547
    T_corner = left.T_base_tip(corner)
    assert len(with_witness((curves[0],), left, T_corner, corner)) == 2


def test_known_configurations_lead_to_pieces_too(left: Arm) -> None:
    T, rolls = left.T_base_tip(left.start), np.zeros(1)
    ik = IKService(left)
    (with_known,) = pieces_of_rolls(ik, T, rolls, left.start[None])
    (without,) = pieces_of_rolls(ik, T, rolls, NONE)
    assert same(with_known, without)


def test_nothing_is_found_where_nothing_is_reached(left: Arm) -> None:
    far = pin.SE3(np.eye(3), np.array([3.0, 0.0, 0.0]))
    assert pieces_of_rolls(IKService(left), far, np.array([0.0, 1.0]), NONE) == [(), ()]
