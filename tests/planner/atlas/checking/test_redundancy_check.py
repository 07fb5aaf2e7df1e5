"""Checks of redundancy maps find what is wrong with them, and nothing in those that are right."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from baxter_kin.parallel import Serial
from planner.atlas import ReachMap
from planner.atlas.checking.redundancy_check import RedundancyCheck, check_redundancy
from planner.atlas.redundancy import RedundancyDefinition, RedundancyMap, Subset
from planner.errors import AtlasError


def check(path: Path, small_map: ReachMap, cells: int) -> RedundancyCheck:
    found, engine = RedundancyMap(path), Serial()
    return check_redundancy(found, small_map, cells=cells, finders=1, engine=engine)


@pytest.mark.slow
def test_a_map_is_right(redundancy_map: RedundancyMap, small_map: ReachMap) -> None:
    found = check(redundancy_map.path, small_map, 2)
    assert found.is_valid, found.wrong
    assert all(cell.solutions >= 1 for cell in found.cells)
    assert 0.0 < found.power <= 1.0
    assert found.worst("length_rad") < 1e-3
    assert repr(found).startswith("RedundancyCheck(2 cells, 0 wrong, 0 missed pieces, power ")


@pytest.mark.slow
@pytest.mark.parametrize("fault", [(0, "pieces", 1), (3, "margin_rad", 300)])
def test_what_is_wrong_is_found(
    redundancy_map: RedundancyMap, small_map: ReachMap, tmp_path: Path, fault: tuple[int, str, int]
) -> None:
    column, number, off = fault
    own = RedundancyMap(shutil.copytree(redundancy_map.path, tmp_path / "own.zarr"))
    for block in own.blocks:
        freedom = own.read_rows(block)
        freedom[:, column] += np.where(freedom[:, column] >= 0, off, 0)
        own.write_rows(block, (freedom,))
    found = check(own.path, small_map, 1)
    assert not found.is_valid
    assert getattr(found.wrong[0], number) > 0


def test_a_map_of_another_reach_map_or_with_nothing_is_refused(
    redundancy_map: RedundancyMap, small_map: ReachMap, tmp_path: Path
) -> None:
    definition = RedundancyDefinition(small_map, Subset(("left",), (0,), (0,), (0,), (0,)))
    empty = RedundancyMap.create_from(tmp_path / "new", definition)
    with pytest.raises(AtlasError, match=r"no cell of .* is computed and reachable"):
        check_redundancy(empty, small_map, engine=Serial())
    other = ReachMap.create(
        tmp_path / "other",
        small_map.robot,
        small_map.positions,
        small_map.rotations,
        ("left",),
        backend="any",
    )
    with pytest.raises(AtlasError, match="is not of the reach map"):
        check_redundancy(redundancy_map, other, engine=Serial())
