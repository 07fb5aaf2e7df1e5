"""What a page shows of a map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from baxter_kin import Baxter
from planner.atlas import PositionGrid, ReachMap, RotationGrid
from sim.view.atlas.shown_map import shown_part, thinning


def test_all_cells_are_those_of_the_map(small_map: ReachMap) -> None:
    shown = shown_part(small_map)
    for arm, side in enumerate(small_map.arms):
        assert np.array_equal(shown.codes[arm], small_map.margins(side))
    rng = np.random.default_rng(3)
    for which in rng.choice(len(shown.q), 50, replace=False):
        arm, *position, rotation = (int(i) for i in shown.cells[:, which])
        cell = small_map.cell(small_map.arms[arm], tuple(position), rotation)
        assert cell.q is not None
        assert np.array_equal(cell.q, shown.q[which])
        point = shown.points(shown.cells[:, which, None])[0]
        assert point == pytest.approx(cell.T_base_tip.translation, abs=1e-12)


@pytest.mark.parametrize("every", [2, 3, 5])
def test_a_thinned_map_has_cells_of_the_whole(small_map: ReachMap, every: int) -> None:
    shown = shown_part(small_map, every)
    grid = small_map.positions
    first = np.rint((shown.low_m - grid.low_m) / grid.step_m).astype(int)
    pieces = tuple(slice(f, n, every) for f, n in zip(first, grid.shape, strict=True))
    for arm, side in enumerate(small_map.arms):
        assert np.array_equal(shown.codes[arm], small_map.margins(side)[pieces])
    assert shown.step_m == pytest.approx(every * grid.step_m)
    assert len(shown.q) == (shown.codes >= 0).sum()
    arm, *position, rotation = shown.cells[:, -1]
    in_map = tuple(int(f + every * i) for f, i in zip(first, position, strict=True))
    last = small_map.cell(small_map.arms[arm], in_map, int(rotation))
    assert last.q is not None
    assert np.array_equal(last.q, shown.q[-1])


@pytest.mark.parametrize("most", [1, 2000, 9000, 10**7])
def test_thinning_is_the_least_that_fits(small_map: ReachMap, most: int) -> None:
    every = thinning(small_map, most)
    if every < max(small_map.positions.shape):
        assert shown_part(small_map, every).codes.size <= most
    if every > 1:
        assert shown_part(small_map, every - 1).codes.size > most


def test_what_is_not_computed_is_shown_as_such(robot: Baxter, tmp_path: Path) -> None:
    grid = PositionGrid(0.1, (5, 0, 0), (2, 2, 2))
    empty = ReachMap.create(tmp_path / "empty", robot, grid, RotationGrid.hopf(0), backend="none")
    shown = shown_part(empty)
    assert (shown.codes == -3).all()
    assert shown.q.shape == (0, 7)
