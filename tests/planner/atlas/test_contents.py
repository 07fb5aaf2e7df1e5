"""What a map holds."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from planner.atlas import ReachMap
from planner.atlas.contents import count_contents
from planner.atlas.reach_search import UNDECIDED, UNREACHABLE


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


def test_what_is_missing_or_half_written_is_told(small_map: ReachMap, tmp_path: Path) -> None:
    found = ReachMap(shutil.copytree(small_map.path, tmp_path / "own.zarr"))
    found.discard_block(found.blocks[0])
    cells = found.read_block(found.blocks[-1])
    assert cells is not None
    cells.margins[3, 5] = -3
    found.write_block(found.blocks[-1], cells)
    left, right = count_contents(found)
    assert (left.missing_blocks, left.damaged) == (1, [])
    assert left.computed < left.cells
    assert right.missing_blocks == 0
    assert "has cells that are not computed" in right.damaged[0]
