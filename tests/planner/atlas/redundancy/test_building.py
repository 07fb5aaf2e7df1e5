"""Redundancy maps are built, resumed and kept whole."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.distribution.software import versions
from baxter_kin.parallel import LocalPool, Serial
from planner.atlas import PositionGrid, ReachMap, RotationGrid, continuing
from planner.atlas.redundancy import (
    RedundancyMap,
    RedundancyReport,
    Subset,
    build_redundancy_map,
)
from planner.errors import AtlasError
from tests.planner.atlas.test_building import digests


def test_another_process_writes_the_same_bytes(
    redundancy_map: RedundancyMap, small_map: ReachMap, subset: Subset, tmp_path: Path
) -> None:
    path = tmp_path / "pool.zarr"
    build_redundancy_map(path, small_map, subset, engine=LocalPool(1))
    assert digests(path) == digests(redundancy_map.path)


def test_what_is_missing_or_damaged_is_computed_again_and_nothing_else(
    redundancy_map: RedundancyMap, small_map: ReachMap, subset: Subset, tmp_path: Path
) -> None:
    path = shutil.copytree(redundancy_map.path, tmp_path / "own.zarr")
    file = path / "freedom/c/0/0/1/0/0/0"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    file.write_bytes(content)
    (path / "freedom" / "c" / "left.abc.partial").write_bytes(b"half")
    own = RedundancyMap(path)
    with pytest.raises(AtlasError, match=r"the map .* is damaged"):
        own.values("pieces", "left")
    own.discard_block((0, 0, 1, 0))
    assert own.missing_blocks() == ((0, 0, 1, 0),)
    told: list[tuple[int, int, RedundancyReport]] = []
    build_redundancy_map(
        path, small_map, subset, engine=Serial(), progress=lambda *at: told.append(at)
    )
    assert [(done, total) for done, total, _ in told] == [(3, 3)]
    assert told[0][2].cells == 2 * 4 * 6
    assert 0 < told[0][2].reachable <= told[0][2].pieces
    assert digests(path) == digests(redundancy_map.path)


def test_what_a_cell_has_does_not_depend_on_the_subset(
    redundancy_map: RedundancyMap, small_map: ReachMap, tmp_path: Path
) -> None:
    other = Subset(("left",), (2,), (1, 4), (1,), (2, 9))
    found = build_redundancy_map(tmp_path / "other.zarr", small_map, other, engine=Serial())
    for y in other.y:
        assert (
            found.cell("left", (2, y, 1), 2).freedom
            == redundancy_map.cell("left", (2, y, 1), 2).freedom
        )


def test_another_map_at_the_path_of_one_that_was_removed_is_its_own(
    redundancy_map: RedundancyMap, small_map: ReachMap, tmp_path: Path
) -> None:
    """In one process, which keeps what is slow to make."""
    path = tmp_path / "here.zarr"
    for x in (0, 2):
        subset = Subset(("left",), (x,), (4,), (1,), (3,))
        found = build_redundancy_map(path, small_map, subset, engine=Serial())
        expected = redundancy_map.cell("left", (x, 4, 1), 3).freedom
        assert found.cell("left", (x, 4, 1), 3).freedom == expected
        shutil.rmtree(path)


def test_another_map_is_refused_and_nothing_changed(
    redundancy_map: RedundancyMap, small_map: ReachMap, subset: Subset
) -> None:
    before, path = digests(redundancy_map.path), redundancy_map.path
    other = Subset(("left",), (0,), (0,), (0,), (0,))
    with pytest.raises(AtlasError, match="of another subset; nothing was changed"):
        build_redundancy_map(path, small_map, other, engine=Serial())
    moved = small_map.robot.configuration({"right_s0": 0.3})
    with pytest.raises(AtlasError, match="of another posture of the other arm"):
        build_redundancy_map(path, small_map, subset, q_others=moved, engine=Serial())
    with pytest.raises(AtlasError, match=r"is a Zarr group, but no redundancy map"):
        build_redundancy_map(small_map.path, small_map, subset, engine=Serial())
    with pytest.raises(AtlasError, match=r"is a Zarr group, but no reach map"):
        ReachMap(path)
    assert digests(path) == before


def test_other_software_is_refused_where_something_is_missing(
    redundancy_map: RedundancyMap,
    small_map: ReachMap,
    subset: Subset,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    own = RedundancyMap(shutil.copytree(redundancy_map.path, tmp_path / "own.zarr"))
    assert own.software == versions()
    monkeypatch.setattr(continuing, "versions", lambda: {**versions(), "pin": "1.0"})
    build_redundancy_map(own.path, small_map, subset, engine=Serial())
    own.discard_block(own.blocks[0])
    before = digests(own.path)
    with pytest.raises(AtlasError, match=r"begun with other software: pin .* there and 1\.0 here"):
        build_redundancy_map(own.path, small_map, subset, engine=Serial())
    assert digests(own.path) == before


def test_a_map_that_names_no_software_is_read_and_not_gone_on_with(
    redundancy_map: RedundancyMap, small_map: ReachMap, subset: Subset, tmp_path: Path
) -> None:
    """As those of earlier versions are, which named the toolkit alone."""
    path = shutil.copytree(redundancy_map.path, tmp_path / "own.zarr")
    facts = json.loads((path / "zarr.json").read_text())
    facts["attributes"]["baxter_kin"] = facts["attributes"].pop("software")["baxter-kin"]
    (path / "zarr.json").write_text(json.dumps(facts))
    own = RedundancyMap(path)
    assert not own.software
    pieces = own.values("pieces", "left")
    assert np.array_equal(pieces, redundancy_map.values("pieces", "left"), equal_nan=True)
    assert build_redundancy_map(path, small_map, subset, engine=Serial()).path == path
    own.discard_block(own.blocks[0])
    with pytest.raises(AtlasError, match="other software: versions that it does not name"):
        build_redundancy_map(path, small_map, subset, engine=Serial())


def test_another_reach_map_or_robot_is_refused(
    redundancy_map: RedundancyMap, small_map: ReachMap, subset: Subset, tmp_path: Path
) -> None:
    robot = Baxter.load(hands={"left": None})
    reach_map = ReachMap.create(
        tmp_path / "bare.zarr", robot, small_map.positions, small_map.rotations, backend="any"
    )
    for block in small_map.blocks:
        cells = small_map.read_block(block)
        assert cells is not None
        reach_map.write_block(block, cells)
    with pytest.raises(AtlasError, match="another robot and another reach map"):
        build_redundancy_map(redundancy_map.path, reach_map, subset, engine=Serial())


def test_what_the_reach_map_lacks_is_told(
    robot: Baxter, small_grid: PositionGrid, tmp_path: Path
) -> None:
    empty = ReachMap.create(
        tmp_path / "empty", robot, small_grid, RotationGrid.hopf(0), backend="any"
    )
    with pytest.raises(AtlasError, match=r"block \(0, 0, 0, 0\) of the reach map .* is not comp"):
        build_redundancy_map(tmp_path / "none", empty, engine=Serial())
    assert not (tmp_path / "none").exists()


def test_too_many_cells_are_refused(small_map: ReachMap, tmp_path: Path) -> None:
    with pytest.raises(AtlasError, match=r"would have 1.73e\+04 cells, and at most 100 are"):
        build_redundancy_map(tmp_path / "none", small_map, most_cells=100)
    assert not (tmp_path / "none").exists()


def test_what_is_no_map_is_refused(small_map: ReachMap, subset: Subset, tmp_path: Path) -> None:
    with pytest.raises(AtlasError, match="there is no map at"):
        RedundancyMap(tmp_path / "nothing")
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(AtlasError, match="exists and is no map"):
        build_redundancy_map(tmp_path, small_map, subset, engine=Serial())
    assert list(tmp_path.iterdir()) == [tmp_path / "notes.txt"]
