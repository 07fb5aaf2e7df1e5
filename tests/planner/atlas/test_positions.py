"""Grids of positions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Baxter
from planner.atlas import PositionGrid
from planner.atlas.positions import BLOCK_EDGE, MAX_CELLS_PER_BLOCK, MIN_BLOCKS
from planner.atlas.rotations import MOST_ROTATIONS
from planner.errors import AtlasError


def test_points_are_multiples_of_the_step() -> None:
    grid = PositionGrid.within([-0.06, 0.0, 0.31], [0.1, 0.2, 0.4], 0.05)
    assert grid.first == (-1, 0, 7)
    assert grid.shape == (4, 5, 2)
    assert np.allclose(grid.points()[1, 2, 1], [0.0, 0.1, 0.4])
    assert np.allclose(grid.point((1, 2, 1)), [0.0, 0.1, 0.4])
    assert np.allclose(grid.low_m, grid.points()[0, 0, 0])
    assert np.allclose(grid.high_m, grid.points()[-1, -1, -1])


def test_blocks_hold_every_point_once() -> None:
    grid = PositionGrid(0.1, (-3, 2, 0), (9, 17, 8))
    times = np.zeros(grid.shape, int)
    for block in np.ndindex(*grid.blocks):
        times[grid.block_slices(block)] += 1
    assert (times == 1).all()


@given(st.integers(1, 10_000), st.integers(1, 10_000), st.integers(1, MOST_ROTATIONS))
@settings(max_examples=200)
def test_blocks_fit_into_memory_and_are_as_few_as_allowed(
    side: int, other: int, rotations: int
) -> None:
    grid = PositionGrid(0.1, (0, 0, 0), (side, other, 7)).in_blocks_for(rotations)
    assert grid == PositionGrid(0.1, (0, 0, 0), (side, other, 7))
    edge = grid.block_edge
    assert edge == 1 or edge**3 * rotations <= MAX_CELLS_PER_BLOCK
    if edge < BLOCK_EDGE:
        assert (2 * edge) ** 3 * rotations > MAX_CELLS_PER_BLOCK
    if edge > BLOCK_EDGE:
        assert len(grid) >= MIN_BLOCKS * edge**3


def test_the_largest_grids_have_millions_of_blocks_at_most() -> None:
    """Of 10^12 cells, for any number of rotations."""
    for rotations, shape in (
        (1, (10_000, 10_000, 10_000)),
        (72, (2_404, 2_404, 2_404)),
        (576, (1_202, 1_202, 1_202)),
        (MOST_ROTATIONS, (149, 149, 149)),
    ):
        grid = PositionGrid(0.1, (0, 0, 0), shape).in_blocks_for(rotations)
        assert np.prod(grid.blocks) < 5e6


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40)
def test_the_grid_around_a_robot_encloses_every_tip(robot: Baxter, seed: int) -> None:
    grid, rng = PositionGrid.around(robot, 0.1), np.random.default_rng(seed)
    for arm in robot.arms.values():
        p = arm.T_base_tip(rng.uniform(arm.limits.q_min, arm.limits.q_max)).translation
        assert (p > grid.low_m - 0.1).all()
        assert (p < grid.high_m + 0.1).all()


def test_positions_outside_have_no_nearest_point() -> None:
    grid = PositionGrid(0.1, (0, 0, 0), (3, 3, 3))
    assert grid.nearest([0.12, 0.0, 0.19]) == (1, 0, 2)
    assert grid.nearest([0.26, 0.0, 0.0]) is None


@pytest.mark.parametrize(
    ("step_m", "low", "high"),
    [(0.0, 0.0, 1.0), (0.1, 0.01, 0.09), (1e-5, 0.0, 1.0), (np.nan, 0.0, 1.0)],
)
def test_grids_of_no_or_too_many_points_are_refused(step_m: float, low: float, high: float) -> None:
    with pytest.raises(AtlasError):
        PositionGrid.within([low] * 3, [high] * 3, step_m)
