"""What stops a build of a redundancy map, and what of it stays."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from baxter_kin.parallel import Engine, LocalPool, Serial
from planner.atlas import ReachMap
from planner.atlas.redundancy import RedundancyMap, Subset, build_redundancy_map
from planner.errors import AtlasError
from tests.planner.atlas.test_building import digests
from tests.planner.atlas.test_interruptions import small_files

ROOM = 200
"""Bytes: less than a block."""


@pytest.fixture
def own(redundancy_map: RedundancyMap, tmp_path: Path) -> RedundancyMap:
    """A copy of the shared map that may be changed, without its first block."""
    own = RedundancyMap(shutil.copytree(redundancy_map.path, tmp_path / "own.zarr"))
    own.discard_block(own.blocks[0])
    return own


@pytest.mark.parametrize("engine", [Serial(), LocalPool(1)], ids=["serial", "pool"])
def test_a_full_disk_is_told_and_what_is_stored_stays_whole(
    own: RedundancyMap,
    redundancy_map: RedundancyMap,
    small_map: ReachMap,
    subset: Subset,
    engine: Engine,
) -> None:
    with (
        small_files(ROOM),
        pytest.raises(AtlasError, match=r"cannot be .* written: File too large"),
    ):
        build_redundancy_map(own.path, small_map, subset, engine=engine)
    assert own.missing_blocks() == own.blocks[:1]
    assert not list(own.path.rglob("*.partial"))
    build_redundancy_map(own.path, small_map, subset, engine=Serial())
    assert digests(own.path) == digests(redundancy_map.path)


def test_what_a_worker_that_is_killed_leaves_is_gone_at_the_end_of_the_build(
    own: RedundancyMap, redundancy_map: RedundancyMap, small_map: ReachMap, subset: Subset
) -> None:
    def leave(*_: object) -> None:
        (own.path / "freedom/c/0/0/0/0/0/0.f00d.partial").write_bytes(b"half")

    build_redundancy_map(own.path, small_map, subset, engine=Serial(), progress=leave)
    assert digests(own.path) == digests(redundancy_map.path)


def test_a_map_whose_making_was_stopped_is_made_by_the_same_call(
    redundancy_map: RedundancyMap, small_map: ReachMap, subset: Subset, tmp_path: Path
) -> None:
    path = tmp_path / "begun.zarr"
    shutil.copytree(redundancy_map.path / "rotations", path / "rotations")
    (path / "rotations" / "zarr.json").unlink()
    (path / "zarr.0123.partial").write_bytes(b"{")
    build_redundancy_map(path, small_map, subset, engine=Serial())
    assert digests(path) == digests(redundancy_map.path)


def test_a_block_that_lost_its_bytes_is_missing(own: RedundancyMap) -> None:
    (own.path / "freedom/c/0/0/1/0/0/0").write_bytes(b"")
    assert own.missing_blocks() == own.blocks[:2]
