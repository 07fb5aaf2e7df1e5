"""Linear bounds on distances near a motion."""

from __future__ import annotations

import numpy as np
import pytest

from baxter_kin.validation import FloatArray
from planner import Body, Box, Manipulator, Mesh, Part, Scene
from planner.collision.context import CollisionContext
from planner.collision.obstacles import REACH_M, SAMPLES, Obstacles
from planner.splines import weights_at
from tests.conftest import at

MARGIN_M, STEP_RAD, INTERVALS = 0.005, 1e-5, 6
NONE = np.zeros((0, 7))


@pytest.fixture(scope="module")
def around(manipulator: Manipulator) -> CollisionContext:
    """A box beside the hand in its start configuration."""
    T = manipulator.arm.T_base_tip(manipulator.arm.start)
    x, y, z = T.translation.tolist()
    box = Body("box", (Part(Box((0.1, 0.1, 0.1)), at(0.0, 0.0, 0.0)),), at(x + 0.13, y, z))
    return manipulator.context(Scene.of([box]), finger_m=manipulator.finger_m)


@pytest.fixture(scope="module")
def controls(manipulator: Manipulator) -> FloatArray:
    """A motion near that configuration."""
    steps = np.random.default_rng(3).normal(size=(INTERVALS + 3, 7))
    return manipulator.arm.start + 0.02 * steps


def obstacles_of(around: CollisionContext, resting: FloatArray, margin_m: float) -> Obstacles:
    return around.obstacles(margin_m, resting)


def positions(controls: FloatArray, weights: FloatArray) -> FloatArray:
    """Configurations of the arm in each interval, shape (n, 7)."""
    windows = np.lib.stride_tricks.sliding_window_view(controls, 4, axis=0)
    return np.asarray(np.einsum("nji,ni->nj", windows, weights))


def test_bounds_are_distances_and_their_derivatives(
    around: CollisionContext, controls: FloatArray
) -> None:
    """Compared with distances measured at changed configurations."""
    obstacles = obstacles_of(around, NONE, MARGIN_M)
    bounds = obstacles.sampled(controls).linear
    near = 0
    for q, rows in zip(positions(controls, bounds.weights), bounds.coefficients, strict=True):
        excess = np.sort(rows @ [*q, 1.0])
        assert excess[0] == pytest.approx(least_excess(obstacles, q), abs=1e-9)
        for joint in range(len(q)):
            step = STEP_RAD * np.eye(len(q))[joint]
            there, here = (least_excess(obstacles, q + sign * step) for sign in (1.0, -1.0))
            lowest = rows[np.argmin(rows @ [*q, 1.0])]
            slope = (there - here) / (2.0 * STEP_RAD)
            assert lowest[joint] == pytest.approx(slope, abs=2e-3)
        near += excess[0] < REACH_M
    assert near == INTERVALS


def test_the_nearest_pairs_at_configurations_are_those_of_bounds(
    around: CollisionContext, controls: FloatArray
) -> None:
    obstacles = obstacles_of(around, NONE, MARGIN_M)
    sampled = obstacles.sampled(controls)
    bounds = sampled.linear
    qs = positions(controls, bounds.weights)
    near = obstacles.nearest(qs, most=1)
    assert near.number.tolist() == list(range(INTERVALS))
    np.testing.assert_allclose(near.excess_m, sampled.least_m, atol=1e-9)
    np.testing.assert_allclose(near.slopes, bounds.coefficients[:, 0, :-1], atol=1e-12)
    assert not len(obstacles.nearest(qs, most=1, within_m=sampled.excess_m).number)


def least_excess(obstacles: Obstacles, q: FloatArray) -> float:
    """The smallest excess over a motion that rests."""
    return obstacles.sampled(np.tile(q, (4, 1))).excess_m


def test_each_interval_is_bounded_where_it_is_nearest(
    around: CollisionContext, controls: FloatArray
) -> None:
    obstacles = obstacles_of(around, NONE, MARGIN_M)
    bounds = obstacles.sampled(controls).linear
    for fraction in np.arange(SAMPLES) / SAMPLES:
        weights = np.tile(weights_at(np.array([fraction])), (INTERVALS, 1))
        others = [least_excess(obstacles, q) for q in positions(controls, weights)]
        chosen = [least_excess(obstacles, q) for q in positions(controls, bounds.weights)]
        assert (np.array(chosen) <= np.array(others) + 1e-9).all()


def test_hulls_are_never_farther_apart_than_the_shapes(
    around: CollisionContext, controls: FloatArray
) -> None:
    obstacles = obstacles_of(around, NONE, 0.0)
    for q in controls:
        assert least_excess(obstacles, q) <= around.clearance(q).distance_m + 1e-6


def test_a_smaller_distance_is_required_where_the_arm_rests_closer(
    around: CollisionContext, manipulator: Manipulator
) -> None:
    wide_m = 0.2
    obstacles = obstacles_of(around, manipulator.arm.start[None], wide_m)
    distance_m = around.clearance(manipulator.arm.start).distance_m
    assert 0.0 < distance_m < wide_m
    asked = obstacles.needed_m[np.isfinite(obstacles.needed_m)]
    assert asked.min() <= 0.5 * distance_m
    assert asked.max() == wide_m


@pytest.mark.parametrize("shape", ["sheet", "corner"])
def test_meshes_that_are_flat_or_hollow_have_bounds_too(
    manipulator: Manipulator, controls: FloatArray, shape: str
) -> None:
    """A flat sheet, whose hull has no volume, and a bent sheet, which differs from its hull."""
    corners = [(0.0, -0.1, -0.1), (0.0, 0.1, -0.1), (0.0, 0.1, 0.1), (0.0, -0.1, 0.1)]
    triangles = [(0, 1, 2), (0, 2, 3)]
    if shape == "corner":
        corners += [(0.1, 0.1, -0.1), (0.1, 0.1, 0.1)]
        triangles += [(1, 4, 5), (1, 5, 2)]
    T = manipulator.arm.T_base_tip(manipulator.arm.start)
    x, y, z = T.translation.tolist()
    mesh = Mesh(np.array(corners), np.array(triangles))
    body = Body("sheet", (Part(mesh, at(0.0, 0.0, 0.0)),), at(x + 0.1, y, z))
    around = manipulator.context(Scene.of([body]), finger_m=manipulator.finger_m)
    first, second = (obstacles_of(around, NONE, MARGIN_M).sampled(controls) for _ in range(2))
    assert 0.0 < first.excess_m < 0.1
    np.testing.assert_array_equal(first.linear.coefficients, second.linear.coefficients)
