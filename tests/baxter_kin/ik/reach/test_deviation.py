"""Compared with Pinocchio: the arm minus `Linkage.wrist_and_axis`, seen as s0 turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Arm, Baxter
from baxter_kin.ik.reach.deviation import NearbyDeviation
from baxter_kin.ik.reach.linkage import ROUNDING, Linkage
from baxter_kin.validation import FloatArray
from tests.calibrated import calibrated_arm

BOXES, POINTS = 20, 30


@pytest.mark.parametrize("link", range(6))
def test_the_slack_holds_where_one_link_is_off(left: Arm, link: int) -> None:
    """The bound is attained; joints are moved one or two at a time, from many middles."""
    for twist_rad, missing_m in ((0.02, 0.0), (0.0, 0.01), (0.02, 0.01)):
        nearby = NearbyDeviation(_with_link(Linkage.of(left), link, twist_rad, missing_m))
        rng, count = np.random.default_rng(link), 4000
        q = rng.uniform(-np.pi, np.pi, (5, count))
        moved = rng.random((5, count)).argsort(axis=0) < rng.integers(1, 3, count)
        slack = moved * rng.choice([0.01, 0.3, 1.0, 2.0, np.pi], count)
        near = nearby.near(q, slack)
        for _ in range(8):
            ends = rng.choice([-1.0, 1.0], (5, count)) * rng.random((5, count)) ** 0.3
            there = nearby.near(q + slack * ends, np.zeros((5, count)))
            off_m = np.linalg.norm(there.wrist - near.wrist, axis=0)
            chords = np.linalg.norm(there.R - near.R, axis=(0, 1)) / np.sqrt(2.0)
            assert (off_m <= near.slack[0] + ROUNDING).all()
            assert (chords <= near.slack[1] + ROUNDING).all()


@pytest.mark.slow
@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("half_rad", [0.02, 0.2, 1.0])
def test_no_point_of_a_box_deviates_by_more_than_the_slack(
    robot: Baxter, side: str, half_rad: float
) -> None:
    rng, worst = np.random.default_rng(11), np.zeros(2)
    for share in (0.1, 1.0):
        arm = calibrated_arm(robot, side, rng, share)
        linkage = Linkage.of(arm)
        q, slack = rng.uniform(-np.pi, np.pi, (7, BOXES)), half_rad * rng.random((5, BOXES))
        near = NearbyDeviation(linkage).near(q[1:6], slack)
        for i in range(BOXES):
            for signs in rng.choice([-1.0, 0.0, 1.0], (POINTS, 5)):
                at = q[:, i].copy()
                at[0] = rng.uniform(-np.pi, np.pi)
                at[1:6] += slack[:, i] * signs
                off = _off(arm, linkage, at, near.wrist[:, i], near.R[:, :, i])
                worst = np.maximum(worst, off / near.slack[:, i])
    assert (worst <= 1.0).all()
    assert (worst > 0.4).all()  # the slack is not much more than it has to be


def test_at_known_angles_the_deviation_is_exact(any_arm: Arm) -> None:
    linkage, rng = Linkage.of(any_arm), np.random.default_rng(12)
    q = rng.uniform(-np.pi, np.pi, (7, 20))
    near = NearbyDeviation(linkage).near(q[1:6], np.zeros((5, 20)))
    assert not near.slack.any()
    for i in range(20):
        off = _off(any_arm, linkage, q[:, i], near.wrist[:, i], near.R[:, :, i])
        assert (off <= ROUNDING).all()


def _with_link(linkage: Linkage, link: int, twist_rad: float, missing_m: float) -> Linkage:
    """One link of the arm that the linkage stands for twisted, and its missing lengths added."""
    a, alpha, d = (np.array(v) for v in (linkage.dh.a_m, linkage.dh.alpha_rad, linkage.dh.d_m))
    alpha[link] += twist_rad
    if link % 2:
        a[link] += missing_m
        d[link - 1] += missing_m
    return replace(linkage, dh=replace(linkage.dh, a_m=a, alpha_rad=alpha, d_m=d))


def _off(arm: Arm, linkage: Linkage, q: FloatArray, wrist: FloatArray, R: FloatArray) -> FloatArray:
    """How far wrist (m) and last axis of the linkage are from where they are said to be, (2,).

    Args:
        arm: whose hand is taken to the linkage's.
        linkage: the arm's.
        q: the linkage's joint angles.
        wrist: the arm's less the linkage's.
        R: what turns the arm's last axis into the linkage's.
    """
    angles = q - linkage.q_offset
    seen = linkage.targets(arm.T_base_tip(angles).homogeneous[None])[0]
    wrist_here, axis_here = linkage.wrist_and_axis(angles)
    R_s0_first = pin.utils.rotate("z", -q[0])
    off_m = R_s0_first @ (seen[:3, 3] - wrist_here) - wrist
    off_axis = R @ R_s0_first @ seen[:3, 2] - R_s0_first @ axis_here
    return np.array([np.linalg.norm(off_m), np.linalg.norm(off_axis)])
