"""Maps are built, resumed and kept whole."""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.errors import UnknownNameError
from baxter_kin.parallel import LocalPool, Serial
from planner.atlas import BlockReport, PositionGrid, ReachMap, RotationGrid, build_reach_map
from planner.atlas.blocks import Block, BlockTask
from planner.atlas.building import compute_block
from planner.errors import AtlasError


def digests(path: Path) -> dict[str, str]:
    """SHA-256 of every file of a map."""
    return {
        str(file.relative_to(path)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(path.rglob("*"))
        if file.is_file()
    }


def test_a_pool_writes_the_same_bytes_as_one_process(
    robot: Baxter, small_map: ReachMap, small_grid: PositionGrid, tmp_path: Path
) -> None:
    path = tmp_path / "pool.zarr"
    build_reach_map(path, robot, small_grid, RotationGrid.hopf(0), engine=LocalPool(2))
    assert digests(path) == digests(small_map.path)


def test_what_is_missing_is_computed_and_nothing_else(
    robot: Baxter, small_map: ReachMap, small_grid: PositionGrid, tmp_path: Path
) -> None:
    path = tmp_path / "resumed.zarr"
    grid, told = RotationGrid.hopf(0), list[tuple[int, int]]()

    class StoppedError(Exception):
        """Stands for whatever ends a build."""

    def stop(done: int, total: int, report: BlockReport) -> None:
        del report
        told.append((done, total))
        if len(told) == 1:
            raise StoppedError

    with pytest.raises(StoppedError):
        build_reach_map(path, robot, small_grid, grid, engine=Serial(), progress=stop)
    partial = ReachMap(path)
    assert len(partial.missing_blocks()) == len(partial.blocks) - 1
    (path / "margins" / "c" / "left.abc.partial").write_bytes(b"half")
    build_reach_map(path, robot, small_grid, grid, engine=Serial(), progress=stop)
    assert told[1][0] == 2
    assert len(told) == len(partial.blocks)
    assert digests(path) == digests(small_map.path)


def test_a_map_has_every_cell_of_its_grid(small_map: ReachMap, small_grid: PositionGrid) -> None:
    assert not small_map.missing_blocks()
    assert len(small_map) == 2 * len(small_grid) * 72
    for side in small_map.arms:
        margins = small_map.margins(side)
        assert margins.shape == (*small_grid.shape, 72)
        assert (margins != -3).all()


def test_blocks_read_as_they_were_written(small_map: ReachMap) -> None:
    block: Block = small_map.blocks[0]
    cells = small_map.read_block(block)
    assert cells is not None
    part = small_map.positions.block_slices(block[1:])
    assert np.array_equal(
        cells.margins, small_map.margins("left")[part].reshape(cells.margins.shape)
    )


def test_another_robot_or_grid_is_refused_and_nothing_changed(
    robot: Baxter, small_map: ReachMap, small_grid: PositionGrid
) -> None:
    before, rotations = digests(small_map.path), RotationGrid.hopf(0)
    other = Baxter.load(hands={"left": None})
    with pytest.raises(AtlasError, match="of another robot; nothing was changed"):
        build_reach_map(small_map.path, other, small_grid, rotations, engine=Serial())
    grid = PositionGrid(0.1, (0, 0, 0), (2, 2, 2))
    with pytest.raises(AtlasError, match="another grid of positions and another choice of arms"):
        build_reach_map(small_map.path, robot, grid, rotations, ("left",), engine=Serial())
    assert digests(small_map.path) == before


def test_a_damaged_block_is_told_and_can_be_computed_again(
    robot: Baxter, small_map: ReachMap, small_grid: PositionGrid, tmp_path: Path
) -> None:
    path, rotations = tmp_path / "damaged.zarr", RotationGrid.hopf(0)
    found = build_reach_map(path, robot, small_grid, rotations, engine=Serial())
    file = path / "margins/c/0/0/0/0/0"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    file.write_bytes(content)
    damaged = found.blocks[0]
    with pytest.raises(AtlasError, match=r"block \(0, 0, 0, 0\) of the map .* is damaged"):
        found.read_block(damaged)
    found.discard_block(damaged)
    assert list(found.missing_blocks()) == [damaged]
    build_reach_map(path, robot, small_grid, rotations, engine=Serial())
    assert digests(path) == digests(small_map.path)


def test_what_is_no_map_is_refused(robot: Baxter, tmp_path: Path) -> None:
    with pytest.raises(AtlasError, match="there is no map at"):
        ReachMap(tmp_path / "nothing")
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(AtlasError, match="exists and is no map"):
        build_reach_map(tmp_path, robot, PositionGrid(0.1, (0, 0, 0), (1, 1, 1)), engine=Serial())
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_too_many_cells_are_refused(robot: Baxter, tmp_path: Path) -> None:
    grid = PositionGrid.around(robot, 0.001)
    with pytest.raises(AtlasError, match=r"the map would have .* cells, and at most 1e\+10"):
        build_reach_map(tmp_path / "huge", robot, grid)
    assert not (tmp_path / "huge").exists()


def test_a_task_of_another_map_at_the_same_path_is_refused(small_map: ReachMap) -> None:
    """A worker of a cluster may still know the map that was there before."""
    before = digests(small_map.path)
    task = BlockTask(str(small_map.path), small_map.blocks[0], "another map")
    with pytest.raises(AtlasError, match="was replaced by another one"):
        compute_block(task)
    assert digests(small_map.path) == before


def test_blocks_of_many_rotations_are_small_and_read_alike(
    robot: Baxter, small_map: ReachMap, tmp_path: Path
) -> None:
    grid = PositionGrid(0.1, (6, 4, 1), (1, 1, 2))
    down = RotationGrid.about_tool_axis(np.diag([1.0, -1.0, -1.0]), 80_000)
    found = build_reach_map(tmp_path / "many", robot, grid, down, ("left",), engine=Serial())
    assert found.positions.block_edge == 1
    assert len(found.blocks) == 2
    first = RotationGrid.hopf(0).rolls
    assert np.array_equal(down.rolls[:: 80_000 // 6][:1], first[:1])
    coarse = small_map.cell("left", (1, 4, 1), 0)
    fine = found.cell("left", (0, 0, 0), 0)
    assert np.allclose(fine.T_base_tip.homogeneous, coarse.T_base_tip.homogeneous)
    assert fine.status == coarse.status == "reachable"


def test_an_unknown_arm_is_no_damage_and_a_grid_that_makes_no_sense_is(
    small_map: ReachMap, tmp_path: Path
) -> None:
    for read in (small_map.margins, small_map.witnesses):
        with pytest.raises(UnknownNameError, match="arm of this map 'middle'"):
            read("middle")
    own = Path(shutil.copytree(small_map.path, tmp_path / "own.zarr"))
    facts = own / "zarr.json"
    facts.write_text(facts.read_text().replace('"step_m": 0.1', '"step_m": -0.1'))
    with pytest.raises(AtlasError, match=r"own\.zarr is damaged: step_m"):
        ReachMap(own)
