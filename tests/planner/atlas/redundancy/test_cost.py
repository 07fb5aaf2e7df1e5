"""What a redundancy map will cost, told before it is built."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from baxter_kin.validation import Indices
from planner.atlas import ReachMap, RotationGrid
from planner.atlas.redundancy import RedundancyCost, RedundancyMap, Subset, estimate
from planner.atlas.redundancy import cost as cost_module
from planner.atlas.redundancy.cost import _measure, _Stratum
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


def test_all_of_a_few_poses_is_measured_and_no_error_is_left(small_map: ReachMap) -> None:
    for rotations in ((1,), (0, 1), tuple(range(18))):
        subset = Subset(("left",), (1,), (3, 5), (1,), rotations)
        cost = estimate(small_map, subset, measure_s=1e9)
        assert cost.measured == cost.reachable > 0
        assert cost.core_s > 1e-3
        assert cost.core_error_s == 0.0


class Timed:
    """Stands for a worker: a direction takes as many seconds as its position's number says."""

    rotations = RotationGrid.hopf(0)

    def __init__(self) -> None:
        self.now_s = 0.0

    def freedoms(self, position: Indices, *_: object) -> Iterator[Any]:
        self.now_s += 1e-6 * int(position[0])
        return iter(())


def test_the_estimate_has_no_bias_and_its_error_is_what_it_says(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """For costs that differ as those of directions do, in strata of which most times are near."""
    rng, runs, off = np.random.default_rng(3), 200, list[float]()
    costs = [
        (rolls, np.rint(1e4 * rolls * rng.lognormal(0.0, 0.5, (2000, 1))).astype(int))
        for rolls in (1, 2, 4, 6, 6)
    ]
    truth_s = 1e-6 * sum(each.sum() for _, each in costs)
    nothing = np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 1))
    monkeypatch.setattr(cost_module, "reach_cells", lambda *_: iter([nothing]))
    for _ in range(runs):
        timed = Timed()
        monkeypatch.setattr("time.monotonic", lambda timed=timed: timed.now_s)
        monkeypatch.setattr("time.process_time", lambda timed=timed: timed.now_s)
        strata = []
        for rolls, each in costs:
            left = np.repeat(rng.permutation(each), 4, axis=1)
            any_map, chosen = None, np.zeros(1, int)
            strata.append(_Stratum(timed, any_map, "left", chosen, rolls, 2000, left))  # type: ignore[arg-type]
        _measure(strata, 5.0)
        told_s = sum(stratum.total_s for stratum in strata)
        error_s = float(np.linalg.norm([stratum.error_s for stratum in strata]))
        off.append((told_s - truth_s) / error_s)
    assert abs(np.mean(off)) < 0.35  # by the spread that few heavy costs leave undetected
    assert np.mean(np.abs(off) > 2.0) < 0.15


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
