from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter
from baxter_kin.ik.geometry.linkage import Linkage
from baxter_kin.ik.geometry.position_sweep import PositionSweep
from baxter_kin.validation import FloatArray

RESOLUTION_M = 1e-2
"""Of the bound: cells of 1.7 mrad, and points up to 3 m away from the axis."""

coordinates = st.floats(-3.0, 3.0)
points = st.tuples(coordinates, coordinates, coordinates).map(np.array)


@pytest.fixture(scope="module")
def linkage(left: Arm) -> Linkage:
    return Linkage.of(left)


@pytest.fixture(scope="module")
def sweep(linkage: Linkage) -> PositionSweep:
    return PositionSweep(linkage)


def elbow_distance_m(linkage: Linkage, point: FloatArray) -> float:
    """From a point to the nearest of elbows all over the ranges of s0, s1 and e0."""
    ranges = zip(linkage.q_min[:3], linkage.q_max[:3], (120, 60, 60), strict=True)
    grid = np.meshgrid(*(np.linspace(low, high, count) for low, high, count in ranges))
    s0, s1, e0 = (angles.ravel() for angles in grid)
    zero = np.zeros_like(s0)
    radial = np.array([np.cos(s0), np.sin(s0), zero])
    down = np.array([zero, zero, zero - 1.0])
    u = np.cos(s1) * radial + np.sin(s1) * down
    swing = np.cos(s1) * down - np.sin(s1) * radial
    r = np.cos(e0) * swing + np.sin(e0) * np.cross(u.T, swing.T).T
    elbow = linkage.shoulder_offset_m * radial + linkage.upper_m * u + linkage.elbow_offset_m * r
    return float(np.linalg.norm(elbow.T - point, axis=1).min())


def test_it_bounds_the_distance_to_sampled_elbows_from_below_and_not_by_much(
    linkage: Linkage, sweep: PositionSweep
) -> None:
    grid_m, cap_m = 0.03, 0.07  # between neighbours; across the arc, where e0 does not lead
    for point in np.random.default_rng(1).uniform(-2.0, 2.0, (25, 3)):
        sampled = elbow_distance_m(linkage, point) - sweep.tip_reach_m
        assert sampled - cap_m - grid_m <= sweep.excess_m(point) <= sampled


def test_no_tip_of_the_arm_has_an_excess(left: Arm, linkage: Linkage, sweep: PositionSweep) -> None:
    rng, rounding = np.random.default_rng(2), 1e-9
    for _ in range(300):
        tip = left.T_base_tip(left.random_configuration(rng)).translation
        assert sweep.excess_m(linkage.T_base_first.actInv(tip)) <= rounding


@given(points, points)
def test_it_changes_by_no_more_than_the_point_moves(
    sweep: PositionSweep, one: FloatArray, other: FloatArray
) -> None:
    change = abs(sweep.excess_m(one) - sweep.excess_m(other))
    assert change <= np.linalg.norm(one - other) + RESOLUTION_M


@given(points)
def test_mirrored_points_of_both_arms_have_the_same(robot: Baxter, point: FloatArray) -> None:
    one, other = (PositionSweep(Linkage.of(robot.arm(side))) for side in ("left", "right"))
    mirrored = point * np.array([1.0, -1.0, 1.0])
    urdf_digits = 1e-5
    assert one.excess_m(point) == pytest.approx(other.excess_m(mirrored), abs=urdf_digits)
