"""What a redundancy map will cost, told before it is built."""

from __future__ import annotations

import numpy as np
import pytest

from planner.atlas import ReachMap
from planner.atlas.redundancy import RedundancyMap, Subset, estimate
from planner.errors import AtlasError


def test_cells_and_reachable_ones_are_counted(
    redundancy_map: RedundancyMap, small_map: ReachMap, subset: Subset
) -> None:
    cost = estimate(small_map, subset, measure_s=0.2)
    assert cost.cells == len(subset)
    assert cost.units == (redundancy_map.codes("left") == 0).sum()
    assert 0.0 < cost.core_error_s < cost.core_s
    assert 1e-3 < cost.core_s / cost.units < 1.0
    assert 0 < cost.measured < cost.units
    chunks = [f for f in redundancy_map.path.glob("freedom/c/**/*") if f.is_file()]
    stored = sum(file.stat().st_size for file in chunks)
    assert 0.2 * stored < cost.size_bytes < 2.0 * stored


def test_only_what_is_missing_is_told(
    redundancy_map: RedundancyMap, small_map: ReachMap, subset: Subset
) -> None:
    one = estimate(small_map, subset, missing=redundancy_map.blocks[:1], measure_s=1e-3)
    assert one.cells == 2 * 4 * 6
    assert one.units == (redundancy_map.codes("left")[:, :4] == 0).sum()
    none = estimate(small_map, subset, missing=(), measure_s=1e-3)
    assert (none.cells, none.units, none.core_s, none.size_bytes) == (0, 0, 0.0, 0.0)


def test_scattered_rotations_are_counted_by_direction(small_map: ReachMap) -> None:
    subset = Subset(("left",), (1,), (3, 5), (1,), (1, 4, 20, 33, 34))
    margins = small_map.margins("left")[np.ix_(subset.x, subset.y, subset.z, subset.rotations)]
    assert estimate(small_map, subset, measure_s=1e-3).units == (margins >= 0).sum()


def test_all_of_a_few_poses_is_measured_and_no_error_is_left(small_map: ReachMap) -> None:
    for rotations in ((1,), (0, 1), tuple(range(18))):
        subset = Subset(("left",), (1,), (3, 5), (1,), rotations)
        cost = estimate(small_map, subset, measure_s=1e9)
        assert cost.measured == cost.units > 0
        assert cost.core_s > 1e-3
        assert cost.core_error_s == 0.0


def test_no_time_to_measure_is_refused(small_map: ReachMap) -> None:
    with pytest.raises(AtlasError, match="measure_s"):
        estimate(small_map, measure_s=0.0)
