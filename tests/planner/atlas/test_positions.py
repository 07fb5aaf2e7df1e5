"""Grids of positions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Baxter
from planner.atlas import PositionGrid
from planner.errors import AtlasError


def test_points_are_multiples_of_the_step() -> None:
    grid = PositionGrid.within([-0.06, 0.0, 0.31], [0.1, 0.2, 0.4], 0.05)
    assert grid.first == (-1, 0, 7)
    assert grid.shape == (4, 5, 2)
    assert np.allclose(grid.points()[1, 2, 1], [0.0, 0.1, 0.4])
    assert np.allclose(grid.point((1, 2, 1)), [0.0, 0.1, 0.4])
    assert np.allclose(grid.low_m, grid.points()[0, 0, 0])
    assert np.allclose(grid.high_m, grid.points()[-1, -1, -1])


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
