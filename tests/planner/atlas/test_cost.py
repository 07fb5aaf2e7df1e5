"""What a map will cost, told before it is built."""

from __future__ import annotations

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.validation import FloatArray
from planner.atlas import PositionGrid, ReachMap, RotationGrid
from planner.atlas.cost import LEAST, SPREADS, Cost, _measure, _Stratum, estimate, shown_time
from planner.atlas.reach_search import Cells
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


class Timed:
    """A search that takes as many seconds as the first coordinates of its positions say."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def search(self, points: FloatArray) -> Cells:
        self.now_s += float(points[:, 0].sum())
        return Cells(np.zeros((len(points), 1), np.int16), np.zeros((len(points), 7, 1), np.int32))


def test_the_estimate_has_no_bias_and_its_error_is_what_it_says(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """For costs that differ as those of searches do: a few positions take most of the time."""
    rng, runs, off = np.random.default_rng(2), 150, list[float]()
    spreads = np.array(SPREADS)[:, None]
    costs = rng.lognormal(-1.2, 1.3, (len(SPREADS), 2000)) * spreads
    for _ in range(runs):
        timed = Timed()
        monkeypatch.setattr("time.monotonic", lambda timed=timed: timed.now_s)
        monkeypatch.setattr("time.process_time", lambda timed=timed: timed.now_s)
        strata = []
        for shell, each in enumerate(costs):
            points = np.repeat(rng.permutation(each)[:, None], 3, axis=1)
            strata.append(_Stratum(0, shell, timed, points, 1e5, 1))  # type: ignore[arg-type]
        _measure(strata, 200.0, 10**6)
        told_s = sum(stratum.total_s for stratum in strata)
        error_s = float(np.linalg.norm([stratum.error_s for stratum in strata]))
        off.append((told_s - 1e5 * costs.mean(axis=1).sum()) / error_s)
    assert abs(np.mean(off)) < 0.35  # by the spread that few heavy costs leave undetected
    assert np.mean(np.abs(off) > 2.0) < 0.15


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
