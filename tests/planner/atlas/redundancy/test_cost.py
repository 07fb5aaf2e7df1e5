"""What a redundancy map will cost, told before it is built."""

from __future__ import annotations

import numpy as np
import pytest

from planner.atlas import ReachMap
from planner.atlas.redundancy import RedundancyCost, RedundancyMap, Subset, estimate
from planner.errors import AtlasError


def test_cells_and_reachable_ones_are_counted(
    redundancy_map: RedundancyMap, small_map: ReachMap, subset: Subset
) -> None:
    cost = estimate(small_map, subset, measure_s=0.2)
    assert cost.cells == len(subset)
    assert cost.reachable == (redundancy_map.codes("left") == 0).sum()
    assert 0.0 < cost.core_error_s < cost.core_s
    assert 1e-3 < cost.core_s / cost.reachable < 1.0
    assert 0 < cost.measured < cost.reachable
    chunks = [f for f in redundancy_map.path.glob("freedom/c/**/*") if f.is_file()]
    stored = sum(file.stat().st_size for file in chunks)
    assert 0.2 * stored < cost.size_bytes < 2.0 * stored


def test_only_what_is_missing_is_told(
    redundancy_map: RedundancyMap, small_map: ReachMap, subset: Subset
) -> None:
    one = estimate(small_map, subset, missing=redundancy_map.blocks[:1], measure_s=1e-3)
    assert one.cells == 2 * 4 * 6
    assert one.reachable == (redundancy_map.codes("left")[:, :4] == 0).sum()
    none = estimate(small_map, subset, missing=(), measure_s=1e-3)
    assert (none.cells, none.reachable, none.core_s, none.size_bytes) == (0, 0, 0.0, 0.0)


def test_scattered_rotations_are_counted_by_direction(small_map: ReachMap) -> None:
    subset = Subset(("left",), (1,), (3, 5), (1,), (1, 4, 20, 33, 34))
    margins = small_map.margins("left")[np.ix_(subset.x, subset.y, subset.z, subset.rotations)]
    assert estimate(small_map, subset, measure_s=1e-3).reachable == (margins >= 0).sum()


def test_no_time_to_measure_is_refused(small_map: ReachMap) -> None:
    with pytest.raises(AtlasError, match="measure_s"):
        estimate(small_map, measure_s=0.0)


def test_costs_are_shown_in_units_that_fit() -> None:
    cost = RedundancyCost(1440, 500, 7200.0, 36.0, 2e6, 12)
    assert repr(cost) == (
        "RedundancyCost(1,440 cells, 500 of them reachable, 2 h +- 36 s of one core, 2 MB, "
        "12 poses measured)"
    )
    assert cost.core_hours == 2.0
