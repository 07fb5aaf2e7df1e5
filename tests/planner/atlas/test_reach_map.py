"""Reading reach maps."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.errors import UnknownNameError
from baxter_kin.parallel import Serial
from planner.atlas import PositionGrid, ReachMap, RotationGrid, build_reach_map, count_contents
from planner.atlas.reach_search import UNDECIDED, UNREACHABLE
from planner.errors import AtlasError
from tests.planner.atlas.maps import change_attributes, chunk


def test_a_map_has_every_cell_of_its_grid(small_map: ReachMap, small_grid: PositionGrid) -> None:
    assert not small_map.missing_blocks()
    assert len(small_map) == 2 * len(small_grid) * 72
    for side in small_map.arms:
        margins = small_map.margins(side)
        assert margins.shape == (*small_grid.shape, 72)
        assert (margins != -3).all()
        for block in small_map.blocks:
            if small_map.arms[block[0]] == side:
                cells = small_map.read_block(block)
                assert cells is not None
                part = margins[small_map.grid.slices(block)]
                assert np.array_equal(cells.margins, part.reshape(cells.margins.shape))


def test_cells_are_counted_arm_by_arm(small_map: ReachMap) -> None:
    told: list[object] = []
    for arm in count_contents(small_map, told.append):
        codes = small_map.margins(arm.side)
        assert arm.cells == arm.computed == codes.size
        assert arm.reachable == np.count_nonzero(codes >= 0)
        assert arm.unreachable == np.count_nonzero(codes == UNREACHABLE)
        assert arm.undecided == np.count_nonzero(codes == UNDECIDED)
        assert (arm.missing_blocks, arm.damaged) == (0, [])
    assert told == list(small_map.blocks)


def test_missing_and_incomplete_blocks_are_counted(small_map: ReachMap, tmp_path: Path) -> None:
    found = ReachMap(shutil.copytree(small_map.path, tmp_path / "own.zarr"))
    found.discard_block(found.blocks[0])
    cells = found.read_block(found.blocks[-1])
    assert cells is not None
    cells.margins[3, 5] = -3
    found.write_block(found.blocks[-1], cells)
    assert found.read_block(found.blocks[-1]) is None
    left, right = count_contents(found)
    assert (left.missing_blocks, left.damaged) == (1, [])
    assert left.computed < left.cells
    assert right.missing_blocks == 0
    assert "has cells that are not computed" in right.damaged[0]


def test_a_block_without_its_witnesses_is_damaged(small_map: ReachMap, tmp_path: Path) -> None:
    found = ReachMap(shutil.copytree(small_map.path, tmp_path / "own.zarr"))
    chunk(found, found.blocks[0], 1).unlink()
    with pytest.raises(AtlasError, match=r"block \(0, 0, 0, 0\) .* its witnesses are missing"):
        found.read_block(found.blocks[0])
    x, y, z, rotation = map(int, np.argwhere(found.margins("left")[:, :8] >= 0)[0])
    with pytest.raises(AtlasError, match=r"the witnesses around \(.*\) are missing"):
        found.cell("left", (x, y, z), rotation)


@pytest.mark.slow
def test_blocks_of_many_rotations_are_small_and_read_alike(
    robot: Baxter, small_map: ReachMap, tmp_path: Path
) -> None:
    grid = PositionGrid(0.1, (6, 4, 1), (1, 1, 2))
    down = RotationGrid.about_tool_axis(np.diag([1.0, -1.0, -1.0]), 80_000)
    found = build_reach_map(tmp_path / "many", robot, grid, down, ("left",), engine=Serial())
    assert found.grid.edge == 1
    assert len(found.blocks) == 2
    coarse = small_map.cell("left", (1, 4, 1), 0)
    fine = found.cell("left", (0, 0, 0), 0)
    assert np.allclose(fine.T_base_tip.homogeneous, coarse.T_base_tip.homogeneous)
    assert fine.status == coarse.status == "reachable"


def test_an_unknown_arm_is_no_damage_and_a_grid_that_makes_no_sense_is(
    small_map: ReachMap, robot: Baxter, tmp_path: Path
) -> None:
    for read in (small_map.margins, small_map.witnesses):
        with pytest.raises(UnknownNameError, match="arm of this map 'middle'"):
            read("middle")
    own = Path(shutil.copytree(small_map.path, tmp_path / "own.zarr"))
    change_attributes(own, step_m=-0.1)
    with pytest.raises(AtlasError, match=r"own\.zarr is damaged: step_m"):
        ReachMap(own)
    grid = small_map.positions
    for arms in ((), ("left", "left")):
        with pytest.raises(AtlasError, match="each once"):
            build_reach_map(tmp_path / "none", robot, grid, small_map.rotations, arms)
