"""What is drawn of a map is what the map says."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from baxter_kin import Baxter
from planner.atlas import PositionGrid, ReachMap, RotationGrid
from planner.atlas.pictures.summary import (
    combined,
    difference,
    layer_at,
    pointing,
    profile,
    summarise,
)
from planner.atlas.reach_search import Cells
from planner.errors import AtlasError

WHOLE = (slice(None),) * 3


@pytest.mark.parametrize("arm", ["left", "right", "either", "both"])
def test_a_summary_counts_cells_one_by_one(small_map: ReachMap, arm: str) -> None:
    summary = summarise(small_map, arm, WHOLE)
    sides = small_map.arms if arm in ("either", "both") else (arm,)
    need, choose = (2, min) if arm == "both" else (1, max)
    by_side = [small_map.margins(side) for side in sides]
    for position in np.ndindex(*small_map.positions.shape):
        of_poses = zip(*(codes[position].tolist() for codes in by_side), strict=True)
        witnessed = [[code for code in codes if code >= 0] for codes in of_poses]
        margins = [choose(codes) for codes in witnessed if len(codes) >= need]
        assert summary.reached[position] == len(margins)
        assert summary.share[position] == pytest.approx(len(margins) / 72)
        greatest = 1e-4 * max(margins) if margins else np.nan
        assert summary.margin_rad[position] == pytest.approx(greatest, nan_ok=True)


def test_two_arms_claim_no_more_than_is_proven() -> None:
    yes, no, open_, unknown = 500, -1, -2, -3
    for one, other, either, both in (
        (no, no, no, no),
        (no, open_, open_, no),
        (no, unknown, unknown, no),
        (open_, unknown, open_, unknown),
        (yes, no, yes, no),
        (yes, open_, yes, open_),
        (yes, 300, yes, 300),
    ):
        for pair in ((one, other), (other, one)):
            a, b = (np.array([code], np.int16) for code in pair)
            assert combined(a, b, is_both=False) == either
            assert combined(a, b, is_both=True) == both


def test_a_profile_counts_area(small_map: ReachMap) -> None:
    heights, areas = profile(small_map, "right", (0.0, 0.5))
    share = summarise(small_map, "right", WHOLE).share
    assert heights == pytest.approx([0.0, 0.1, 0.2])
    assert areas[0] == pytest.approx(0.01 * (share > 0.0).sum(axis=(0, 1)))
    assert areas[1] == pytest.approx(0.01 * (share >= 0.5).sum(axis=(0, 1)))


def test_the_nearest_direction_is_taken_with_all_its_rolls() -> None:
    grid = RotationGrid.hopf(0)
    assert pointing(grid, (0.1, 0.0, -3.0)).tolist() == list(range(6))
    chosen = pointing(grid, (1.0, 1.0, 1.0))
    tools = grid.matrices[chosen][:, :, 2]
    assert np.allclose(tools, tools[0])
    assert (grid.matrices[:, :, 2].sum(axis=1) <= tools[0].sum() + 1e-9).all()


def test_heights_are_those_of_the_nearest_layer(small_map: ReachMap) -> None:
    assert [layer_at(small_map, height) for height in (-0.04, 0.06, 0.2)] == [0, 1, 2]


def test_a_difference_is_signed_and_of_equal_grids(
    robot: Baxter, small_map: ReachMap, tmp_path: Path
) -> None:
    assert (difference(small_map, small_map, WHOLE, "left") == 0.0).all()
    other = ReachMap(shutil.copytree(small_map.path, tmp_path / "other"))
    block = other.blocks[0]
    cells = other.read_block(block)
    assert cells is not None
    margins = cells.margins.copy()
    margins[:, ::2] = -1
    other.write_block(block, Cells(margins, cells.witnesses))
    less = difference(small_map, other, WHOLE, "left")
    part = small_map.grid.slices(block)
    lost = (cells.margins >= 0).sum(axis=1) - (margins >= 0).sum(axis=1)
    assert lost.max() > 0
    assert less[part].reshape(-1) == pytest.approx(-lost / 72)
    assert np.count_nonzero(less) == np.count_nonzero(lost)
    few = ReachMap.create(
        tmp_path / "few", robot, small_map.positions, RotationGrid.of([np.eye(3)]), backend="none"
    )
    with pytest.raises(AtlasError, match="have different rotations"):
        difference(small_map, few, WHOLE, "left")


def test_what_is_not_computed_has_no_share(robot: Baxter, tmp_path: Path) -> None:
    grid = PositionGrid(0.1, (5, 0, 0), (2, 2, 2))
    empty = ReachMap.create(tmp_path / "empty", robot, grid, RotationGrid.hopf(0), backend="none")
    summary = summarise(empty, "either", WHOLE)
    assert np.isnan(summary.share).all()
    assert (summary.missing == 72).all()
