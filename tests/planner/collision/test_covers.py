"""Simple shapes around all others, against points of these."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.validation import FloatArray
from planner.collision.covers import Covers, placed_points
from planner.scene.contact import surface
from tests.bodies import CORNERS, SIDES
from tests.planner.conftest import distance

ROUNDING_M = 1e-12

GJK_M = 1e-6
"""Coal's default tolerance."""

MESH = CORNERS * [0.2, 0.03, 0.05] + [0.1, 0.0, 0.3]
"""Corners of a plank beside its origin."""

SHAPES = {
    "box": coal.Box(0.3, 0.1, 0.02),
    "ball": coal.Sphere(0.07),
    "can": coal.Cylinder(0.05, 0.4),
    "coin": coal.Cylinder(0.2, 0.01),
    "mesh": surface(MESH, np.array(SIDES)),
}

seeds = st.integers(0, 2**32 - 1)


def points_of(name: str) -> FloatArray:
    """Points of its surface, the farthest from its middle among them, shape (n, 3)."""
    shape, angles = SHAPES[name], np.linspace(0.0, 2.0 * np.pi, 33)
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    if isinstance(shape, coal.Box):
        return np.asarray(CORNERS * shape.halfSide)
    if isinstance(shape, coal.Sphere):
        return np.concatenate([shape.radius * np.roll(ring, k, axis=1) for k in range(3)])
    if isinstance(shape, coal.Cylinder):
        ends = np.array([0.0, 0.0, shape.halfLength])
        return np.concatenate([shape.radius * ring + ends, shape.radius * ring - ends])
    return MESH


def beside_segment_m(points: FloatArray, ends: FloatArray) -> FloatArray:
    """How far points are from a segment, shape (n,)."""
    way = ends[1] - ends[0]
    share = np.clip((points - ends[0]) @ way / max(way @ way, 1e-300), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - ends[0] - share[:, None] * way, axis=1))


@pytest.fixture(scope="module")
def covers() -> Covers:
    return Covers.of(list(SHAPES.values()))


@pytest.mark.parametrize("name", SHAPES)
def test_no_point_of_a_shape_is_outside_its_box_its_ball_or_its_capsule(
    covers: Covers, name: str
) -> None:
    points, i = points_of(name), list(SHAPES).index(name)
    assert (points >= covers.lowest[i] - ROUNDING_M).all()
    assert (points <= covers.highest[i] + ROUNDING_M).all()
    from_middle = np.linalg.norm(points - covers.centres[i], axis=1)
    assert from_middle.max() <= covers.ball_radii[i] + ROUNDING_M
    assert beside_segment_m(points, covers.ends[i]).max() <= covers.radii[i] + ROUNDING_M


@pytest.mark.parametrize("name", SHAPES)
def test_balls_are_no_larger_than_they_must_be(covers: Covers, name: str) -> None:
    i = list(SHAPES).index(name)
    farthest = np.linalg.norm(points_of(name) - covers.centres[i], axis=1).max()
    assert covers.ball_radii[i] == pytest.approx(farthest, abs=ROUNDING_M)


@given(seeds)
def test_gaps_are_no_greater_than_distances(covers: Covers, seed: int) -> None:
    rng, shapes = np.random.default_rng(seed), list(SHAPES.values())
    poses = [pin.SE3(pin.exp3(rng.normal(size=3)), 0.5 * rng.normal(size=3)) for _ in shapes]
    first, second = (each.ravel() for each in np.indices((len(shapes), len(shapes))))
    placed = np.array([[T.homogeneous for T in poses]])
    gaps = covers.gaps_m(placed, np.zeros_like(first), first, second)
    for i, k, gap in zip(first.tolist(), second.tolist(), gaps.tolist(), strict=True):
        if i != k:
            apart = distance(shapes[i], poses[i], shapes[k], poses[k])
            assert gap <= max(apart, 0.0) + GJK_M


def test_the_gap_of_a_ball_beside_a_box_is_their_distance() -> None:
    covers = Covers.of([coal.Sphere(0.1), coal.Box(0.2, 0.2, 0.2)])
    poses = np.array([np.eye(4), np.eye(4)])
    poses[0, :3, 3] = [0.5, 0.5, 0.0]
    [gap] = covers.gaps_m(poses[None], *(np.array([n]) for n in (0, 0, 1)))
    assert gap == pytest.approx(0.4 * np.sqrt(2.0) - 0.1)


def test_those_of_further_shapes_come_behind(covers: Covers) -> None:
    shapes = list(SHAPES.values())
    joined = Covers.of(shapes[:2]).with_those_of(shapes[2:])
    for one, other in zip(joined, covers, strict=True):
        np.testing.assert_array_equal(one, other)


@given(seeds)
def test_points_are_placed_as_each_pose_acts_on_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    poses = [
        [pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3)) for _ in range(3)]
        for _ in range(2)
    ]
    points = rng.normal(size=(3, 4, 3))
    found = placed_points(np.array([[T.homogeneous for T in row] for row in poses]), points)
    for m, n, k in np.ndindex(2, 3, 4):
        np.testing.assert_allclose(found[m, n, k], poses[m][n].act(points[n, k]), atol=ROUNDING_M)
