"""Builds are resumed, keep what is stored whole, and cost what was estimated."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.errors import ConfigurationError
from baxter_kin.parallel import Engine, LocalPool, Serial
from planner.atlas import (
    BlockReport,
    Cost,
    PositionGrid,
    ReachDefinition,
    ReachMap,
    RotationGrid,
    build_reach_map,
    estimate,
)
from planner.atlas.block_map import BlockGrid, Layer, Rows
from planner.atlas.building import MIN_BLOCKS, OVERHEAD, MapSource, compute_block, shown_time
from planner.atlas.redundancy import RedundancyDefinition, Subset, build_redundancy_map
from planner.errors import AtlasError
from tests.planner.atlas.maps import BuiltMap, chunk, digests, small_files

ROTATIONS = RotationGrid.hopf(0)


class StoppedError(Exception):
    """Whatever ends a build."""


# Building ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_worker_processes_write_the_same_bytes(built: BuiltMap, tmp_path: Path) -> None:
    path = tmp_path / "pool.zarr"
    assert not built.build(path, engine=LocalPool(2)).missing_blocks()
    assert digests(path) == digests(built.path)


def test_a_build_that_was_stopped_computes_what_is_missing_and_nothing_else(
    built: BuiltMap, tmp_path: Path
) -> None:
    own = built.copied(tmp_path / "own.zarr").map
    done = own.blocks[-1]
    for block in own.blocks[:-1]:
        own.discard_block(block)
    (chunk(own, done).parent / "0.abc.partial").write_bytes(b"half")
    told = list[tuple[int, int, BlockReport]]()

    def stop(*at: Any) -> None:
        told.append(at)
        (chunk(own, done).parent / "0.f00d.partial").write_bytes(b"of a worker that is killed")
        if len(told) == 1:
            raise StoppedError

    with pytest.raises(StoppedError):
        built.build(own.path, progress=stop)
    assert list(own.missing_blocks()) == list(own.blocks[1:-1])
    built.build(own.path, progress=stop)
    total = len(own.blocks)
    assert [at[:2] for at in told] == [(i, total) for i in range(2, total + 1)]
    assert [at[2].block for at in told] == list(own.blocks[:-1])
    codes = own.codes_of((own.read_rows(own.blocks[0]),))
    assert told[0][2].cells == codes.size
    assert told[0][2].reachable == np.count_nonzero(codes >= 0)
    assert digests(own.path) == digests(built.path)


@pytest.mark.slow
@pytest.mark.parametrize("engine", [Serial(), LocalPool(1)], ids=["serial", "pool"])
def test_a_full_disk_ends_a_build_and_what_is_stored_stays_whole(
    built: BuiltMap, tmp_path: Path, engine: Engine
) -> None:
    own = built.copied(tmp_path / "full.zarr").map
    first, *_ = own.blocks
    room = chunk(own, first, len(own.KIND.layers) - 1).stat().st_size // 2
    own.discard_block(first)
    with small_files(room), pytest.raises(AtlasError, match=r"cannot be .* written: File too larg"):
        built.build(own.path, engine=engine)
    assert list(own.missing_blocks()) == [first]
    assert not list(own.path.rglob("*.partial"))
    built.build(own.path)
    assert digests(own.path) == digests(built.path)


def test_a_task_of_another_map_at_the_same_path_is_refused(built: BuiltMap) -> None:
    """A worker of a cluster may still know the map that was there before."""
    before = digests(built.path)
    source = MapSource.of(built.map, *built.definition.sources)._replace(identity="another map")
    with pytest.raises(AtlasError, match="was replaced by another one"):
        compute_block(source, built.map.blocks[0])
    assert digests(built.path) == before


def test_a_reach_map_of_something_else_is_refused_and_nothing_changed(
    small_map: ReachMap,
) -> None:
    before, robot, grid = digests(small_map.path), small_map.robot, small_map.positions
    few, coarse = PositionGrid(0.1, (0, 0, 0), (2, 2, 2)), RotationGrid.of([np.eye(3)])
    wrong: dict[str, tuple[Any, ...]] = {
        "robot": (Baxter.load(hands={"left": None}), grid, ROTATIONS),
        "set of rotations": (robot, grid, coarse),
        "grid of positions and another choice of arms": (robot, few, ROTATIONS, ("left",)),
    }
    for words, asked in wrong.items():
        with pytest.raises(AtlasError, match=f"is of another {words}; nothing was changed"):
            build_reach_map(small_map.path, *asked, engine=Serial())
    assert digests(small_map.path) == before


def test_a_redundancy_map_of_something_else_is_refused_and_nothing_changed(
    redundancy_map: Any, small_map: ReachMap, subset: Subset, tmp_path: Path
) -> None:
    before, path = digests(redundancy_map.path), redundancy_map.path
    other = Subset(("left",), (0,), (0,), (0,), (0,))
    with pytest.raises(AtlasError, match="of another subset; nothing was changed"):
        build_redundancy_map(path, small_map, other, engine=Serial())
    moved = small_map.robot.configuration({"right_s0": 0.3})
    with pytest.raises(AtlasError, match="of another posture of the other arm"):
        build_redundancy_map(path, small_map, subset, q_others=moved, engine=Serial())
    with pytest.raises(ConfigurationError, match="q_others"):
        build_redundancy_map(path, small_map, subset, q_others=[0.0] * 7, engine=Serial())
    bare = ReachMap.create(
        tmp_path / "bare.zarr",
        Baxter.load(hands={"left": None}),
        small_map.positions,
        small_map.rotations,
        backend="any",
    )
    with pytest.raises(AtlasError, match=r"block \(0, 0, 0, 0\) of the reach map .* is not comp"):
        build_redundancy_map(tmp_path / "none", bare, subset, engine=Serial())
    assert not (tmp_path / "none").exists()
    for block in small_map.blocks:
        cells = small_map.read_block(block)
        assert cells is not None
        bare.write_block(block, cells)
    with pytest.raises(AtlasError, match="another robot and another reach map"):
        build_redundancy_map(path, bare, subset, engine=Serial())
    assert digests(path) == before


def test_too_many_cells_are_refused(robot: Baxter, small_map: ReachMap, tmp_path: Path) -> None:
    grid = PositionGrid.around(robot, 0.001)
    with pytest.raises(AtlasError, match=r"the map would have .* cells, and at most 1e\+10"):
        build_reach_map(tmp_path / "none", robot, grid)
    with pytest.raises(AtlasError, match=r"would have 1.73e\+04 cells, and at most 100 are"):
        build_redundancy_map(tmp_path / "none", small_map, most_cells=100)
    assert not (tmp_path / "none").exists()


# Estimating --------------------------------------------------------------------------------------


class SimulatedMap:
    """Positions whose computation takes known times by a clock of its own.

    Times differ from block to block as those of reach maps do, and some blocks take none.
    """

    arms, sample, backend, sources = ("left", "right"), 4, "none", ()
    grid = BlockGrid((2, 30, 22, 13), 4)

    def __init__(self) -> None:
        self.layers = {"values": Layer("int16", -3, {"rotation": 6})}
        self.attributes, self.constants = dict[str, Any](), dict[str, Any]()
        rng, self.now_s = np.random.default_rng(2), 0.0
        of_block = rng.lognormal(0.0, 0.7, self.grid.blocks.shape)
        of_block *= rng.random(self.grid.blocks.shape) < 0.7
        self.times_s = 1e-2 * rng.lognormal(0.0, 0.4, self.grid.shape)
        for block in self.grid.blocks:
            self.times_s[(block[0], *self.grid.slices(block))] *= of_block[block]

    def compute(self, arm: int, at: np.ndarray) -> Rows:
        self.now_s += float(self.times_s[(arm, *at.T)].sum())
        return (np.zeros((len(at), 6), np.int16),)

    def clock(self) -> float:
        return self.now_s


@pytest.mark.slow
@pytest.mark.parametrize("share", [1.0, 0.3], ids=["all", "missing"])
def test_an_estimate_has_no_bias_and_its_error_is_the_spread(share: float) -> None:
    of, off = SimulatedMap(), list[float]()
    blocks = of.grid.blocks
    missing = blocks[: int(share * len(blocks))]
    total_s = sum(of.times_s[(b[0], *of.grid.slices(b))].sum() for b in missing)
    for seed in range(80):
        cost = estimate(of, missing=missing, measure_s=3.0, seed=seed, clock=of.clock)
        assert cost.positions == of.grid.positions_of(missing)
        assert MIN_BLOCKS * of.sample <= cost.measured < 0.2 * cost.positions
        off.append((cost.core_s / OVERHEAD - total_s) / (cost.core_error_s / OVERHEAD))
    assert abs(np.mean(off)) < 0.35
    assert np.mean(np.abs(off) > 2.0) < 0.12


@pytest.mark.slow
def test_a_reach_map_has_the_size_that_was_estimated(small_map: ReachMap) -> None:
    definition = small_map.definition()
    definition.sample = 11  # of more blocks
    cost = estimate(definition, measure_s=1e9)
    assert cost.cells == len(small_map)
    assert cost.measured >= cost.positions == 2 * len(small_map.positions)
    stored = sum(f.stat().st_size for f in small_map.path.rglob("c/**/*") if f.is_file())
    assert cost.size_bytes == pytest.approx(stored, rel=0.15)  # chunks of others compress otherwise


@pytest.mark.slow
def test_only_missing_blocks_cost_something(built: BuiltMap) -> None:
    cost = estimate(built.definition, missing=built.map.blocks[:1], measure_s=1e-6)
    assert cost.cells == built.map.codes_of((built.map.read_rows(built.map.blocks[0]),)).size
    assert cost.core_s > 0.0
    assert cost.size_bytes > 0.0
    none = estimate(built.definition, missing=built.map.blocks[:0], measure_s=1e-6)
    assert (none.cells, none.core_s, none.size_bytes) == (0, 0.0, 0.0)


def test_a_sample_stands_for_a_grid_that_is_far_larger(robot: Baxter) -> None:
    grid = PositionGrid.around(robot, 0.002)
    definition = ReachDefinition(robot, grid, ROTATIONS, ("left",))
    cost = estimate(definition, measure_s=1e9, max_positions=400)
    assert cost.measured < 1000
    assert cost.positions == len(grid)
    assert cost.core_s > 3600.0
    assert 0.0 < cost.core_error_s < cost.core_s
    assert cost.size_bytes > 1e9


def test_no_time_to_measure_is_refused(small_map: ReachMap) -> None:
    for definition in (small_map.definition(), RedundancyDefinition(small_map)):
        with pytest.raises(AtlasError, match="measure_s"):
            estimate(definition, measure_s=0.0)


def test_times_and_costs_are_shown_in_units_that_fit() -> None:
    assert list(map(shown_time, (1.0, 119.0, 180.0, 18_000.0, 864_000.0))) == [
        "1 s",
        "119 s",
        "3 min",
        "5 h",
        "10 days",
    ]
    cost = Cost(1440, 36.0, 2.0, 5e6, 3, 20)
    assert repr(cost) == (
        "Cost(1,440 cells, 36 s +- 2 s of one core, 5 MB, 3 of 20 positions measured)"
    )
    assert cost.core_hours == 0.01
