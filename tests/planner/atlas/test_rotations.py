"""Grids of rotations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from planner.atlas import RotationGrid
from planner.atlas.rotations import MOST_ROTATIONS
from planner.errors import AtlasError


@pytest.mark.parametrize(("level", "count"), [(0, 72), (1, 576), (2, 4608)])
def test_a_hopf_grid_has_as_many_rotations_as_published(level: int, count: int) -> None:
    grid = RotationGrid.hopf(level)
    assert len(grid) == count == len(grid.matrices)
    assert np.abs(np.linalg.det(grid.matrices) - 1.0).max() < 1e-12


def test_a_hopf_grid_covers_all_rotations_evenly() -> None:
    """No rotation is far from the grid, and none of the grid near another (Yershova 2010)."""
    grid = Rotation.from_matrix(RotationGrid.hopf(1).matrices)
    some = Rotation.random(400, rng=np.random.default_rng(3))
    off = np.array([(grid.inv() * one).magnitude().min() for one in some])
    assert off.max() < np.deg2rad(30.0)
    apart = np.array([np.partition((grid.inv() * one).magnitude(), 1)[1] for one in grid])
    assert apart.min() > np.deg2rad(15.0)


def test_the_first_rotation_points_straight_down_along_base() -> None:
    for level in (0, 1, 2):
        assert np.allclose(RotationGrid.hopf(level).matrices[0], np.diag([1.0, -1.0, -1.0]))


@given(st.integers(0, 575))
@settings(max_examples=30)
def test_a_rotation_turned_a_little_is_nearest_to_the_one_of_the_grid(index: int) -> None:
    grid, turn = RotationGrid.hopf(1), Rotation.from_rotvec([0.05, -0.04, 0.06])
    turned = grid.matrices[index] @ turn.as_matrix()
    assert grid.nearest(turned) == index
    off = Rotation.from_matrix(grid.matrices).inv() * Rotation.from_matrix(turned)
    assert grid.angles_rad(turned) == pytest.approx(off.magnitude(), abs=1e-7)


def test_rolls_turn_the_tool_about_its_own_axis() -> None:
    grid = RotationGrid.about_tool_axis(np.diag([1.0, -1.0, -1.0]), 8)
    assert np.allclose(grid.matrices[:, :, 2], [0.0, 0.0, -1.0])
    assert len(grid.expanded()) == 8
    assert np.array_equal(grid.expanded().matrices, grid.matrices)


@pytest.mark.parametrize(
    "rotations",
    [
        [],
        ["a"],
        [np.eye(3) * 2.0],
        [np.eye(3), np.diag([1.0, 1.0, -1.0])],
        [np.full((3, 3), np.nan)],
    ],
)
def test_invalid_rotations_are_refused(rotations: Any) -> None:
    with pytest.raises(AtlasError):
        RotationGrid.of(rotations)


def test_more_rotations_than_a_worker_holds_are_refused() -> None:
    with pytest.raises(AtlasError):
        RotationGrid(np.eye(3)[None], np.zeros(MOST_ROTATIONS + 1))


@pytest.mark.parametrize("level", [-1, 5, 0.5, None])
def test_invalid_levels_are_refused(level: Any) -> None:
    with pytest.raises(AtlasError):
        RotationGrid.hopf(level)
