"""Checks of redundancy maps find what is wrong with them, and nothing in those that are right."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from baxter_kin.parallel import Serial
from planner.atlas import ReachMap
from planner.atlas.redundancy import RedundancyMap, Subset, checking
from planner.atlas.redundancy.checking import RedundancyCheck, check_redundancy
from planner.errors import AtlasError


@pytest.fixture(autouse=True)
def one_finder(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each takes a while to make."""
    monkeypatch.setattr(checking, "FINDERS", 1)


def check(path: Path, small_map: ReachMap, cells: int) -> RedundancyCheck:
    return check_redundancy(RedundancyMap(path), small_map, cells=cells, engine=Serial())


def test_a_map_is_right(redundancy_map: RedundancyMap, small_map: ReachMap) -> None:
    found = check(redundancy_map.path, small_map, 2)
    assert found.is_valid, found.wrong
    assert all(cell.solutions >= 1 for cell in found.cells)
    assert 0.0 < found.power <= 1.0
    assert found.worst("length_rad") < 1e-3
    assert repr(found).startswith("RedundancyCheck(2 cells, 0 wrong, 0 missed pieces, power ")


def test_what_is_wrong_is_found(
    redundancy_map: RedundancyMap, small_map: ReachMap, tmp_path: Path
) -> None:
    own = RedundancyMap(shutil.copytree(redundancy_map.path, tmp_path / "own.zarr"))
    for measure, (number, off) in {0: ("pieces", 1), 3: ("margin_rad", 300)}.items():
        changed = np.asarray(own._freedom[...])
        changed[:, :, :, :, measure] += np.where(changed[:, :, :, :, measure] >= 0, off, 0)
        for block in own.blocks:
            part = own.subset.block_slices(block[1:])
            freedom = changed[block[0]][part]
            own.write_block(block, freedom.reshape(-1, *freedom.shape[3:]))
        found = check(own.path, small_map, 1)
        assert not found.is_valid
        assert getattr(found.wrong[0], number) > 0


def test_a_map_of_another_reach_map_or_with_nothing_is_refused(
    redundancy_map: RedundancyMap, small_map: ReachMap, tmp_path: Path
) -> None:
    others = small_map.robot.configuration()
    subset = Subset(("left",), (0,), (0,), (0,), (0,))
    empty = RedundancyMap.create(tmp_path / "new", small_map, subset, others, backend="any")
    with pytest.raises(AtlasError, match=r"no cell of .* is computed and reachable"):
        check_redundancy(empty, small_map)
    other = ReachMap.create(
        tmp_path / "other",
        small_map.robot,
        small_map.positions,
        small_map.rotations,
        ("left",),
        backend="any",
    )
    with pytest.raises(AtlasError, match="is not of the reach map"):
        check_redundancy(redundancy_map, other)
