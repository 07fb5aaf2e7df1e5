"""Conversion of shapes to coal's, and the distances that coal finds between them."""

from __future__ import annotations

from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from planner import Body, Box, Cylinder, Part, Sphere
from planner.collision.distances import ACCURACY_M
from planner.errors import SceneError
from planner.scene.bodies import Shape
from planner.scene.coal_shapes import (
    MAX_TOUCHED_TRIANGLES,
    coal_pose,
    coal_shape,
    convex_pieces,
    shape_of,
)
from planner.scene.mesh import Mesh
from tests.bodies import CORNERS, SIDES
from tests.conftest import at
from tests.planner.conftest import distance, hull, mesh_of

CONTACT_TOLERANCE_M = 1e-6
"""Distances to rounded shapes are accurate to 1e-8, magnified at grazing angles."""

FINE_TOLERANCE = 1e-10
"""Of GJK, where coal's default, 1e-6, leaves the direction of the distance too coarse."""

ORIGIN = at(0.0, 0.0, 0.0)
CUBE = Box((0.05, 0.05, 0.05))
FloatArray = NDArray[np.float64]

seeds = st.integers(0, 2**32 - 1)

SOLID = mesh_of(CORNERS / 10, SIDES)
OPEN = mesh_of(CORNERS / 10, SIDES[:-1])
"""A box of 20 cm, whole and without one triangle of its sides."""


@pytest.mark.parametrize("shape", [CUBE, Cylinder(0.02, 0.1), Sphere(0.03)])
def test_a_shape_is_the_same_after_conversion_to_coal_and_back(shape: Any) -> None:
    assert shape_of(coal_shape(shape)) == shape


def test_an_unsupported_shape_is_refused_by_name() -> None:
    with pytest.raises(SceneError, match="not Cone"):
        shape_of(coal.Cone(0.1, 0.1))


def surface_of(mesh: Mesh, seed: int) -> FloatArray:
    """Points spread over the triangles, shape (k, 3)."""
    weights = np.random.default_rng(seed).dirichlet(np.ones(3), size=(len(mesh.triangles), 20))
    points: FloatArray = np.einsum("tkc,tcx->tkx", weights, mesh.corners).reshape(-1, 3)
    return points


@given(seeds, st.floats(0.01, 2.0))
def test_a_solid_mesh_is_as_far_away_as_the_same_box(seed: int, apart: float) -> None:
    rng = np.random.default_rng(seed)
    T = random_pose(rng, apart)
    box, ball = coal_shape(Box((0.2, 0.2, 0.2))), coal_shape(Sphere(0.05))
    as_box, as_mesh = (distance(shape, ORIGIN, ball, T) for shape in (box, coal_shape(SOLID)))
    assert as_mesh == pytest.approx(as_box, abs=CONTACT_TOLERANCE_M)


@given(seeds, st.floats(0.5, 2.0))
def test_an_open_mesh_is_as_far_away_as_its_nearest_triangle(seed: int, apart: float) -> None:
    T, ball = random_pose(np.random.default_rng(seed), apart), coal_shape(Sphere(0.05))
    nearest = min(distance(piece, ORIGIN, ball, T) for piece in convex_pieces(OPEN))
    whole = distance(coal_shape(OPEN), ORIGIN, ball, T)
    sampled = np.linalg.norm(surface_of(OPEN, seed) - T.translation, axis=1).min() - 0.05
    assert whole == pytest.approx(nearest, abs=CONTACT_TOLERANCE_M)
    assert whole <= sampled + CONTACT_TOLERANCE_M


def test_a_ball_wholly_inside_touches_an_open_mesh_nowhere_and_has_a_depth_in_a_solid_one() -> None:
    inside = distance(coal_shape(OPEN), ORIGIN, coal_shape(Sphere(0.02)), ORIGIN)
    assert inside == pytest.approx(0.08)
    assert distance(coal_shape(SOLID), ORIGIN, coal_shape(Sphere(0.02)), ORIGIN) < -0.1


def test_an_open_mesh_of_many_triangles_has_no_intended_contacts() -> None:
    count = MAX_TOUCHED_TRIANGLES // len(OPEN.triangles) + 1
    vertices = np.concatenate([OPEN.vertices + k * np.eye(3)[0] / 100 for k in range(count)])
    triangles = np.concatenate([OPEN.triangles + 8 * k for k in range(count)])
    with pytest.raises(SceneError, match="convex hull"):
        convex_pieces(mesh_of(vertices, triangles))


def random_pose(rng: np.random.Generator, apart: float) -> pin.SE3:
    quat, direction = rng.normal(size=4), rng.normal(size=3)
    R = pin.Quaternion(*(quat / np.linalg.norm(quat))).matrix()
    return pin.SE3(R, apart * direction / np.linalg.norm(direction))


def random_shape(rng: np.random.Generator) -> Shape:
    x, y, z = (10 ** rng.uniform(-3, 0, size=3)).tolist()
    points = x * rng.normal(size=(rng.integers(4, 40), 3)) / 3
    return (Box((x, y, z)), Cylinder(x, y), Sphere(x), hull(points))[rng.integers(4)]


def widest_slab_m(first: Part, second: Part, axes: FloatArray) -> float:
    """The widest gap between two separating planes normal to one of the axes, shape (k, 3)."""
    gaps = []
    for axis in axes / np.linalg.norm(axes, axis=1, keepdims=True):
        low, high = Body("first", (first,), ORIGIN).extent_m(axis)
        other_low, other_high = Body("second", (second,), ORIGIN).extent_m(axis)
        gaps.append(max(other_low - high, low - other_high))
    return max(gaps)


@settings(max_examples=50)
@given(seeds)
def test_distances_are_not_longer_than_the_slab_between_the_shapes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    first = Part(random_shape(rng), ORIGIN)
    second = Part(random_shape(rng), random_pose(rng, rng.uniform(0.0, 2.0)))
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    arguments = [(coal_shape(p.shape), coal_pose(p.T_body_part)) for p in (first, second)]
    found = coal.distance(*arguments[0], *arguments[1], request, result)
    if found > 0.0:
        request.gjk_tolerance = FINE_TOLERANCE  # for a normal as good as the distance is
        normals = [result.normal]
        coal.distance(*arguments[0], *arguments[1], request, result)
        normals.append(result.normal)
        assert found <= widest_slab_m(first, second, np.array(normals)) + ACCURACY_M
