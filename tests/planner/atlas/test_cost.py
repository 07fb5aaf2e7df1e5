"""What a map will cost, told before it is built."""

from __future__ import annotations

import pytest

from baxter_kin import Baxter
from planner.atlas import PositionGrid, ReachMap, RotationGrid
from planner.atlas.cost import LEAST, Cost, estimate, shown_time
from planner.errors import AtlasError

ROTATIONS = RotationGrid.hopf(0)


def test_all_of_a_small_grid_is_measured_and_its_size_is_that_of_the_map(
    robot: Baxter, small_map: ReachMap, small_grid: PositionGrid
) -> None:
    cost = estimate(robot, small_grid, ROTATIONS, measure_s=1e9)
    assert cost.measured == cost.of_positions == 2 * len(small_grid)
    assert cost.cells == 2 * cost.poses == len(small_map)
    assert cost.core_error_s == 0.0
    chunks = [*small_map.path.glob("margins/c/**/0"), *small_map.path.glob("witnesses/c/**/0")]
    stored = sum(file.stat().st_size for file in chunks if file.is_file())
    assert cost.size_bytes == pytest.approx(stored, rel=0.15)  # chunks of others compress otherwise


def test_a_sample_stands_for_a_grid_that_is_far_larger(robot: Baxter) -> None:
    grid = PositionGrid.around(robot, 0.002)
    cost = estimate(robot, grid, ROTATIONS, ("left",), measure_s=1e-3, most_positions=200)
    assert cost.measured < 1000
    assert cost.of_positions == pytest.approx(len(grid))
    assert cost.core_s > 3600.0
    assert 0.0 < cost.core_error_s < cost.core_s
    assert cost.size_bytes > 1e9


def test_every_shell_is_measured_however_short_the_time(robot: Baxter) -> None:
    grid = PositionGrid.around(robot, 0.1)
    cost = estimate(robot, grid, ROTATIONS, ("right",), measure_s=1e-6)
    assert cost.measured >= 7 * LEAST


def test_only_what_is_missing_is_told(robot: Baxter, small_map: ReachMap) -> None:
    one = estimate(
        robot, small_map.positions, ROTATIONS, missing=small_map.blocks[:1], measure_s=1e-6
    )
    assert one.cells == small_map.margins("left")[:8, :8, :8].size
    none = estimate(robot, small_map.positions, ROTATIONS, missing=(), measure_s=1e-6)
    assert (none.cells, none.core_s, none.size_bytes) == (0, 0.0, 0.0)


def test_nothing_to_measure_is_told(robot: Baxter, small_grid: PositionGrid) -> None:
    with pytest.raises(AtlasError, match="measure_s"):
        estimate(robot, small_grid, ROTATIONS, measure_s=0.0)
    with pytest.raises(AtlasError, match="arms is empty"):
        estimate(robot, small_grid, ROTATIONS, ())


def test_times_and_costs_are_shown_in_units_that_fit() -> None:
    assert list(map(shown_time, (1.0, 119.0, 180.0, 18_000.0, 864_000.0))) == [
        "1 s",
        "119 s",
        "3 min",
        "5 h",
        "10 days",
    ]
    cost = Cost(720, 1440, 36.0, 2.0, 5e6, 3, 20)
    assert repr(cost) == (
        "Cost(1,440 cells, 36 s +- 2 s of one core, 5 MB, 3 of 20 positions measured)"
    )
    assert cost.core_hours == 0.01
