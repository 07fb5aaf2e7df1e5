"""What can be read from redundancy maps."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from baxter_kin.errors import UnknownNameError
from baxter_kin.fields import field_names
from baxter_kin.parallel import Serial
from planner.atlas import ReachMap
from planner.atlas.redundancy import (
    RedundancyDefinition,
    RedundancyMap,
    RedundancySearch,
    Subset,
    build_redundancy_map,
)
from planner.atlas.redundancy.freedom import MEASURES
from planner.errors import AtlasError


def test_cells_have_the_freedom_of_their_poses(
    redundancy_map: RedundancyMap, search: RedundancySearch
) -> None:
    """Recomputed pose by pose, without what rolls share."""
    reachable = np.argwhere(redundancy_map.codes("left") == 0)
    assert len(reachable) > 20
    subset = redundancy_map.subset
    for x, y, z, rotation in reachable[::7].tolist():
        at = subset.x[x], subset.y[y], subset.z[z]
        cell = redundancy_map.cell("left", at, subset.rotations[rotation])
        alone = search.at(cell.T_base_tip)
        assert cell.freedom is not None
        assert cell.freedom.pieces == alone.pieces
        steps = 1.5 * np.array(list(MEASURES.values()))
        steps[-1] = 0.01
        for name, step in zip(field_names(alone), steps, strict=True):
            assert abs(getattr(cell.freedom, name) - getattr(alone, name)) <= step, name
        assert cell.freedom.margin_rad <= alone.margin_rad + 1e-4


def test_what_the_reach_map_says_is_not_reachable_has_no_freedom(
    redundancy_map: RedundancyMap, small_map: ReachMap
) -> None:
    subset = redundancy_map.subset
    margins = small_map.margins("left")[np.ix_(subset.x, subset.y, subset.z, subset.rotations)]
    codes = redundancy_map.codes("left")
    assert np.array_equal(codes, np.minimum(margins, 0))
    assert (codes == 0).any()
    assert (codes < 0).any()
    for measure in MEASURES:
        values = redundancy_map.values(measure, "left")
        assert np.array_equal(np.isnan(values), codes < 0)
        assert np.nanmin(values) >= 0.0
    x, y, z, rotation = np.argwhere(codes < 0)[0]
    at = subset.x[x], subset.y[y], subset.z[z]
    cell = redundancy_map.cell("left", at, subset.rotations[rotation])
    assert cell.freedom is None
    assert cell.status == "unreachable"


def test_no_witness_has_a_greater_margin_than_its_self_motion(
    redundancy_map: RedundancyMap, small_map: ReachMap
) -> None:
    subset = redundancy_map.subset
    margins = small_map.margins("left")[np.ix_(subset.x, subset.y, subset.z, subset.rotations)]
    found = redundancy_map.values("margin_rad", "left")
    is_there = margins >= 0
    assert (found[is_there] >= 1e-4 * (margins[is_there] - 1)).all()


def test_numbers_hang_together(redundancy_map: RedundancyMap) -> None:
    values = {name: redundancy_map.values(name, "left") for name in MEASURES}
    is_there = redundancy_map.codes("left") == 0
    pieces, length, longest = (
        values[name][is_there] for name in ("pieces", "length_rad", "longest_rad")
    )
    assert (pieces >= 1).all()
    assert (longest <= length + 1e-4).all()
    assert (length <= pieces * longest + 1e-3).all()
    assert (values["free_share"][is_there] <= 1.0).all()


def test_points_and_nearest_cells(redundancy_map: RedundancyMap) -> None:
    points = redundancy_map.points()
    assert points.shape == (2, 10, 1, 3)
    cell = redundancy_map.cell("left", (2, 4, 1), 3)
    assert np.allclose(cell.T_base_tip.translation, points[1, 4, 0])
    assert np.allclose(cell.T_base_tip.rotation, redundancy_map.rotations[3])
    near = cell.T_base_tip.copy()
    near.translation = near.translation + np.array([0.03, -0.02, 0.04])
    assert redundancy_map.nearest_cell("left", near).T_base_tip == cell.T_base_tip
    assert len(redundancy_map) == 120


def test_what_is_not_there_is_refused(redundancy_map: RedundancyMap) -> None:
    with pytest.raises(UnknownNameError, match="measure"):
        redundancy_map.values("lenght_rad", "left")
    with pytest.raises(UnknownNameError, match="arm of this map"):
        redundancy_map.codes("right")
    with pytest.raises(UnknownNameError, match="arm of this map"):
        redundancy_map.cell("right", (2, 4, 1), 3)
    with pytest.raises(AtlasError, match="is not one of this map's poses"):
        redundancy_map.cell("left", (1, 4, 1), 3)


def test_a_new_map_has_nothing(small_map: ReachMap, tmp_path: Path) -> None:
    subset = Subset(("right",), (0,), (0,), (0,), (0, 1))
    definition = RedundancyDefinition(small_map, subset)
    empty = RedundancyMap.create_from(tmp_path / "new", definition)
    assert list(empty.missing_blocks()) == list(empty.blocks) == [(0, 0, 0, 0)]
    assert empty.cell("right", (0, 0, 0), 1).status == "not computed"
    assert np.isnan(empty.values("pieces", "right")).all()
    assert repr(empty) == "RedundancyMap(right, 1 x 1 x 1 points, 2 rotations)"


def test_what_a_cell_has_does_not_depend_on_the_subset(
    redundancy_map: RedundancyMap, small_map: ReachMap, tmp_path: Path
) -> None:
    """Nor on the map that was at the path before, of which a process keeps what is slow to make."""
    path = tmp_path / "here.zarr"
    for subset in (
        Subset(("left",), (2,), (1, 4), (1,), (2, 9)),
        Subset(("left",), (0,), (4,), (1,), (2,)),
    ):
        found = build_redundancy_map(path, small_map, subset, engine=Serial())
        for y in subset.y:
            at = subset.x[0], y, 1
            cells = found.cell("left", at, 2), redundancy_map.cell("left", at, 2)
            assert cells[0].freedom == cells[1].freedom
        shutil.rmtree(path)
