"""Checks of maps find what is wrong with them, and nothing in those that are right."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.parallel import Serial
from planner.atlas import PositionGrid, ReachMap, RotationGrid
from planner.atlas.checking import MapCheck, check_map
from planner.atlas.reach_search import UNREACHABLE
from planner.errors import AtlasError

CELLS = 300


def check(path: Path, cells: int) -> MapCheck:
    return check_map(ReachMap(path), cells=cells, engine=Serial())


@pytest.fixture
def own_map(small_map: ReachMap, tmp_path: Path) -> ReachMap:
    """A copy that may be changed."""
    return ReachMap(shutil.copytree(small_map.path, tmp_path / "own.zarr"))


def test_a_map_is_right(small_map: ReachMap) -> None:
    told: list[tuple[int, int, str]] = []
    found = check_map(small_map, cells=CELLS, engine=Serial(), progress=lambda *at: told.append(at))
    assert found.is_valid
    assert found.cells == CELLS
    assert min(found.witnesses, found.proofs) > 50
    assert found.proofs > found.proofs_at_boundary > 50
    for power in (found.power, found.power_at_boundary):
        assert power is not None
        assert power >= 0.99
    assert found.undecided_share <= 0.002
    assert told[: len(small_map.blocks)] == [(i, 4, "blocks") for i in (1, 2, 3, 4)]
    assert told[-1] == (CELLS, CELLS, "cells")
    assert repr(found).startswith("MapCheck(300 cells, 0 wrong witnesses, 0 false proofs, power ")


def test_the_same_seed_checks_the_same_cells(small_map: ReachMap) -> None:
    checks = [check_map(small_map, cells=20, seed=4, engine=Serial()) for _ in range(2)]
    assert checks[0] == checks[1]


def test_wrong_witnesses_and_false_proofs_are_found(own_map: ReachMap) -> None:
    for block in own_map.blocks:
        cells = own_map.read_block(block)
        assert cells is not None
        is_reachable = cells.margins >= 0
        cells.witnesses[:, 0] += 5000  # 1e-5 rad
        cells.margins[is_reachable & (np.arange(cells.margins.shape[1]) % 2 == 0)] = UNREACHABLE
        own_map.write_block(block, cells)
    found = check(own_map.path, 100)
    assert not found.is_valid
    assert len(found.wrong_witnesses) == found.witnesses > 0
    assert 0 < len(found.false_proofs) < found.proofs
    assert found.false_proofs[0].startswith("block (0, ")


def test_damaged_and_missing_blocks_are_told(own_map: ReachMap) -> None:
    file = own_map.path / "witnesses/c/0/0/0/0/0/0"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    file.write_bytes(content)
    own_map.discard_block(own_map.blocks[-1])
    found = check(own_map.path, 10)
    assert not found.is_valid
    assert len(found.damaged) == 1
    assert "block (0, 0, 0, 0) of the map" in found.damaged[0]
    assert found.missing == 1


def test_a_map_with_nothing_computed_is_refused(
    robot: Baxter, small_grid: PositionGrid, tmp_path: Path
) -> None:
    empty = ReachMap.create(
        tmp_path / "empty", robot, small_grid, RotationGrid.hopf(0), backend="casadi"
    )
    with pytest.raises(AtlasError, match=r"nothing of the map at .* is computed"):
        check_map(empty, engine=Serial())


def test_a_margin_that_is_not_that_of_the_witness_is_found(own_map: ReachMap) -> None:
    for block in own_map.blocks:
        cells = own_map.read_block(block)
        assert cells is not None
        cells.margins[cells.margins >= 0] += 1
        own_map.write_block(block, cells)
    found = check_map(own_map, cells=20, engine=Serial())
    assert len(found.wrong_witnesses) == found.witnesses > 0
