"""Checks of maps find what is wrong with them, and nothing in those that are right."""

from __future__ import annotations

import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.parallel import Serial
from planner.atlas import PositionGrid, ReachMap, RotationGrid
from planner.atlas.block_map import Blocks
from planner.atlas.checking.reach_check import (
    MAX_CELLS_A_TASK,
    BlockCounts,
    MapCheck,
    Survey,
    check_map,
)
from planner.atlas.reach_search import UNREACHABLE
from planner.errors import AtlasError
from tests.planner.atlas.maps import chunk, damage

CELLS = 120


def check(path: Path, cells: int) -> MapCheck:
    return check_map(ReachMap(path), cells=cells, engine=Serial())


@pytest.fixture
def own_map(small_map: ReachMap, tmp_path: Path) -> ReachMap:
    """A copy that may be changed."""
    return ReachMap(shutil.copytree(small_map.path, tmp_path / "own.zarr"))


@pytest.mark.slow
def test_a_map_is_right(small_map: ReachMap) -> None:
    blocks, cells = list[None](), list[int]()
    found = check_map(
        small_map,
        cells=CELLS,
        engine=Serial(),
        on_block=lambda: blocks.append(None),
        on_cells=cells.append,
    )
    assert found.is_valid
    assert found.cells == CELLS
    assert min(found.witnesses, found.proofs) > 20
    assert found.proofs > found.proofs_at_boundary > 20
    for power in (found.power, found.power_at_boundary):
        assert power is not None
        assert power >= 0.99
    assert found.undecided_share <= 0.002
    assert (len(blocks), sum(cells)) == (len(small_map.blocks), CELLS)
    assert repr(found).startswith("MapCheck(120 cells, 0 wrong witnesses, 0 false proofs, power ")


@pytest.mark.slow
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
    found = check(own_map.path, 40)
    assert not found.is_valid
    assert len(found.wrong_witnesses) == found.witnesses > 0
    assert 0 < len(found.false_proofs) < found.proofs
    assert found.false_proofs[0].startswith("block (0, ")


def test_damaged_and_missing_blocks_are_told(own_map: ReachMap) -> None:
    damage(chunk(own_map, own_map.blocks[0], 1))
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


# Choosing cells -----------------------------------------------------------------------------------

MANY, CELLS_EACH = 6000, 600_000
"""Of a map with 3.6e9 cells."""


@pytest.fixture(scope="module")
def survey() -> Survey:
    """Blocks of which the first hundred have twice as many cells at the boundary."""
    found = Survey(Blocks((1, MANY, 1, 1)))
    for at in range(MANY):
        edge = 2000 if at < 100 else 1000
        found.add((0, at, 0, 0), BlockCounts(edge, CELLS_EACH - edge, 1))
    return found


def test_as_many_are_chosen_as_are_wanted_half_of_them_at_the_boundary(survey: Survey) -> None:
    assert survey.cells == MANY * CELLS_EACH
    assert survey.undecided == MANY
    tasks = survey.tasks(20_000, 5)
    number = Counter[bool]()
    for task in tasks:
        assert 0 <= task.first < task.last <= task.first + MAX_CELLS_A_TASK
        number[task.is_boundary] += task.last - task.first
    assert number == {True: 10_000, False: 10_000}
    assert tasks == survey.tasks(20_000, 5)
    assert tasks != survey.tasks(20_000, 6)


def test_blocks_are_chosen_by_their_share(survey: Survey) -> None:
    of_first = [
        task.last - task.first
        for seed in range(6)
        for task in survey.tasks(20_000, seed)
        if task.is_boundary and task.block[1] < 100
    ]
    mean = 6 * 10_000 * 200_000 / (MANY * 1000 + 100_000)
    assert sum(of_first) == pytest.approx(mean, abs=4.0 * np.sqrt(mean))


def test_a_small_map_is_checked_whole() -> None:
    found = Survey(Blocks((1, 2, 1, 1)))
    found.add((0, 0, 0, 0), BlockCounts(3, 4, 0))
    found.add((0, 1, 0, 0), BlockCounts(0, 5, 0, "damaged"))
    assert sum(task.last - task.first for task in found.tasks(100, 0)) == 12
    assert found.damaged == {(0, 1, 0, 0): "damaged"}
