"""What a map will cost, told before it is built."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import Baxter
from planner.atlas import PositionGrid, ReachMap, RotationGrid
from planner.atlas.cost import MIN_MEASURED, Cost, Sample, estimate, is_within_reach, shown_time
from planner.errors import AtlasError

ROTATIONS = RotationGrid.hopf(0)


def test_all_of_a_small_grid_is_measured_and_its_size_is_that_of_the_map(
    robot: Baxter, small_map: ReachMap, small_grid: PositionGrid
) -> None:
    cost = estimate(robot, small_grid, ROTATIONS, measure_s=1e9)
    assert cost.measured == cost.units == 2 * len(small_grid)
    assert cost.cells == len(small_map)
    assert cost.core_error_s == 0.0
    chunks = [*small_map.path.glob("margins/c/**/0"), *small_map.path.glob("witnesses/c/**/0")]
    stored = sum(file.stat().st_size for file in chunks if file.is_file())
    assert cost.size_bytes == pytest.approx(stored, rel=0.15)  # chunks of others compress otherwise


def test_a_sample_stands_for_a_grid_that_is_far_larger(robot: Baxter) -> None:
    grid = PositionGrid.around(robot, 0.002)
    cost = estimate(robot, grid, ROTATIONS, ("left",), measure_s=1e-3, most_positions=200)
    assert cost.measured < 1000
    assert cost.units == pytest.approx(len(grid))
    assert cost.core_s > 3600.0
    assert 0.0 < cost.core_error_s < cost.core_s
    assert cost.size_bytes > 1e9


def test_positions_within_reach_and_beyond_are_measured_however_short_the_time(
    robot: Baxter,
) -> None:
    grid = PositionGrid.around(robot, 0.1)
    cost = estimate(robot, grid, ROTATIONS, ("right",), measure_s=1e-6)
    assert cost.measured >= 2 * MIN_MEASURED
    assert min(cost.position_s) > 0.0


def clocked(
    monkeypatch: pytest.MonkeyPatch, units: NDArray[np.float64]
) -> Iterator[Callable[[], int]]:
    """Units of work, shape (n, 2): each takes some time by a simulated clock and has a size."""
    now_s = 0.0
    monkeypatch.setattr("time.monotonic", lambda: now_s)
    monkeypatch.setattr("time.process_time", lambda: now_s)

    def work(duration_s: float, size: float) -> int:
        nonlocal now_s
        now_s += duration_s
        return int(size)

    return (partial(work, *each) for each in units.tolist())


def test_the_estimate_has_no_bias_and_its_error_is_what_it_says(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """For sizes and times that differ as those of directions do, and some units that are free."""
    rng, off = np.random.default_rng(2), list[float]()
    sizes = rng.integers(1, 13, 5000).astype(float)
    times_s = 1e-2 * sizes * rng.lognormal(0.0, 0.7, 5000) * (rng.random(5000) < 0.8)
    units = np.column_stack([times_s, sizes])
    for _ in range(150):
        work = clocked(monkeypatch, units[rng.permutation(5000)])
        sample = Sample.timed(sizes.sum(), work, 10.0, np.inf)
        assert sum(sample.times_s) < 12.0
        off.append((sample.total_s - times_s.sum()) / sample.error_s)
    assert abs(np.mean(off)) < 0.35
    assert np.mean(np.abs(off) > 2.0) < 0.1


def test_a_sample_of_everything_has_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    units = np.array([[0.5, 2.0], [2.0, 1.0], [0.25, 4.0]])
    sample = Sample.timed(7.0, clocked(monkeypatch, units), 1e9, np.inf)
    assert (sample.total_s, sample.error_s, sample.size) == (2.75, 0.0, 7)


def test_nothing_to_do_takes_no_time() -> None:
    sample = Sample.timed(0.0, iter(()), 1.0, np.inf)
    assert (sample.total_s, sample.error_s, sample.size) == (0.0, 0.0, 0)


@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
def test_no_tip_is_beyond_reach(robot: Baxter, q: list[float]) -> None:
    for arm in robot.arms.values():
        joints = np.clip([*q, *q, q[0]], arm.limits.q_min, arm.limits.q_max)
        tip = arm.T_base_tip(joints).translation
        assert is_within_reach(arm, tip[None]).all()


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
    cost = Cost(1440, 36.0, 2.0, 5e6, 3, 20, "position")
    assert repr(cost) == (
        "Cost(1,440 cells, 36 s +- 2 s of one core, 5 MB, 3 of 20 positions measured)"
    )
    assert cost.core_hours == 0.01
