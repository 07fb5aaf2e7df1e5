"""Meshes: what is one, what is not, and which are convex."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.errors import SceneError
from planner.scene.mesh import LARGEST_SHAPE_M
from tests.bodies import CORNERS, SIDES
from tests.planner.conftest import hull, mesh_of

TRIANGLE = np.eye(3)


def test_a_cube_is_convex() -> None:
    assert mesh_of(CORNERS, SIDES).is_convex


@given(st.integers(0, 2**32 - 1), st.integers(5, 40))
def test_a_convex_hull_is_convex(seed: int, count: int) -> None:
    assert hull(np.random.default_rng(seed).normal(size=(count, 3))).is_convex


@pytest.mark.parametrize(
    ("vertices", "triangles"),
    [
        (CORNERS, SIDES[1:]),  # open
        (CORNERS, np.array(SIDES)[:, ::-1]),  # inside out
        (CORNERS, [SIDES[0][::-1], *SIDES[1:]]),  # one triangle turned over
        (TRIANGLE, [[0, 1, 2]]),
        (TRIANGLE, [[0, 1, 2], [0, 2, 1]]),  # closed, but flat
        (np.concatenate([CORNERS, CORNERS + 3]), [*SIDES, *(np.array(SIDES) + 8).tolist()]),
        (np.concatenate([CORNERS, CORNERS / 2]), [*SIDES, *(np.array(SIDES) + 8).tolist()]),
        (CORNERS * np.where(np.arange(8) == 7, 0.1, 1.0)[:, None], SIDES),  # one corner dented
    ],
)
def test_what_does_not_close_around_a_convex_volume_is_a_surface(
    vertices: Any, triangles: Any
) -> None:
    assert not mesh_of(vertices, triangles).is_convex


@given(st.integers(0, 2**32 - 1))
def test_support_is_the_farthest_corner(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(3, 3))
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    farthest = max(float(np.dot(vertex, direction)) for vertex in vertices)
    assert mesh_of(vertices, [[0, 1, 2]]).support_m(direction) == pytest.approx(farthest)


def test_copies_what_it_is_given() -> None:
    vertices, triangles = np.eye(3), np.array([[0, 1, 2]])
    mesh = mesh_of(vertices, triangles)
    vertices[0], triangles[0] = 9.0, 0
    assert np.array_equal(mesh.corners[0], np.eye(3))


@pytest.mark.parametrize("name", ["vertices", "triangles"])
def test_is_frozen(name: str) -> None:
    mesh = mesh_of(TRIANGLE, [[0, 1, 2]])
    with pytest.raises(ValueError, match="read-only"):
        getattr(mesh, name)[0, 0] = 1


@pytest.mark.parametrize(
    ("vertices", "triangles", "says"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3)), "1 .. "),
        (TRIANGLE, np.zeros((0, 3)), "1 .. "),
        (TRIANGLE[:, :2], [[0, 1, 2]], "shape"),
        (TRIANGLE, [0, 1, 2], "shape"),
        (TRIANGLE, [[0, 1, 2, 0]], "shape"),
        (3.0, [[0, 1, 2]], "shape"),
        (TRIANGLE, 3, "shape"),
        (TRIANGLE * np.nan, [[0, 1, 2]], "finite"),
        (TRIANGLE + np.inf, [[0, 1, 2]], "finite"),
        (TRIANGLE, [[0, 1, np.nan]], "finite"),
        (TRIANGLE, [[0, 1, 3]], "vertex 3"),
        (TRIANGLE, [[0, 1, -1]], "vertex -1"),
        (TRIANGLE, [[0, 1, 1.5]], "vertex 1.5"),
        (TRIANGLE, [[0, 1, 1e300]], "vertex 1e\\+300"),
        ("corners", [[0, 1, 2]], "real numbers"),
        (TRIANGLE, "abc", "real numbers"),
        (None, None, "mesh vertices"),
        (TRIANGLE, [[0, 1, 1]], "vertex 2 of a mesh is in no triangle"),
        (TRIANGLE, [[0, 1, 2], [0, 1, 1]], "triangle 1 of a mesh has no area"),
        (np.outer([0.0, 1.0, 2.0], [1.0, 1.0, 1.0]), [[0, 1, 2]], "no area"),
        (TRIANGLE * 1e-9, [[0, 1, 2]], "no area"),
        (TRIANGLE * 1e-300, [[0, 1, 2]], "no area"),
        (TRIANGLE * 2 * LARGEST_SHAPE_M, [[0, 1, 2]], "in metres"),
        (TRIANGLE * 1e300, [[0, 1, 2]], "in metres"),
    ],
)
def test_refuses_what_is_no_mesh(vertices: Any, triangles: Any, says: str) -> None:
    with pytest.raises(SceneError, match=says):
        mesh_of(vertices, triangles)


def test_refuses_more_triangles_than_memory_is_for() -> None:
    with pytest.raises(SceneError, match="200000"):
        mesh_of(TRIANGLE, np.tile([0, 1, 2], (200_001, 1)))
