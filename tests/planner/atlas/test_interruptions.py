"""What stops a build, and what of it stays."""

from __future__ import annotations

import resource
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from baxter_kin import Baxter
from baxter_kin.distribution.software import versions
from baxter_kin.parallel import Engine, LocalPool, Serial
from planner.atlas import PositionGrid, ReachMap, RotationGrid, build_reach_map, continuing
from planner.errors import AtlasError
from tests.planner.atlas.test_building import digests

ROOM = 2000
"""Bytes: less than the witnesses of a block."""


@contextmanager
def small_files(room: int = ROOM) -> Iterator[None]:
    """The system itself refuses to write more into a file, here and in processes that begin."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_other_software_is_refused_and_nothing_changed(
    small_map: ReachMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = ReachMap(shutil.copytree(small_map.path, tmp_path / "begun.zarr"))
    found.discard_block(found.blocks[1])
    before, here = digests(found.path), dict(versions())
    monkeypatch.setattr(continuing, "versions", lambda: {**here, "numpy": "1.0"})
    with pytest.raises(
        AtlasError, match=r"begun with other software: numpy .* there and 1\.0 here"
    ):
        build_reach_map(found.path, found.robot, found.positions, found.rotations, engine=Serial())
    assert digests(found.path) == before


@pytest.mark.parametrize("engine", [Serial(), LocalPool(1)], ids=["serial", "pool"])
def test_a_full_disk_is_told_and_what_is_stored_stays_whole(
    small_map: ReachMap, tmp_path: Path, engine: Engine
) -> None:
    path = Path(shutil.copytree(small_map.path, tmp_path / "full.zarr"))
    found, (first, *_) = ReachMap(path), small_map.blocks
    found.discard_block(first)
    with small_files(), pytest.raises(AtlasError, match=r"cannot be .* written: File too large"):
        build_reach_map(path, found.robot, found.positions, found.rotations, engine=engine)
    assert list(found.missing_blocks()) == [first]
    assert not list(path.rglob("*.partial"))
    build_reach_map(path, found.robot, found.positions, found.rotations, engine=Serial())
    assert digests(path) == digests(small_map.path)


def test_a_map_whose_making_was_stopped_is_made_by_the_same_call(
    robot: Baxter, small_map: ReachMap, small_grid: PositionGrid, tmp_path: Path
) -> None:
    path = tmp_path / "begun.zarr"
    for name in ("directions", "margins"):
        shutil.copytree(small_map.path / name, path / name)
    (path / "margins" / "zarr.json").unlink()
    (path / "zarr.0123.partial").write_bytes(b"{")
    build_reach_map(path, robot, small_grid, RotationGrid.hopf(0), engine=Serial())
    assert digests(path) == digests(small_map.path)


def test_a_block_that_lost_its_bytes_is_missing(small_map: ReachMap, tmp_path: Path) -> None:
    path = Path(shutil.copytree(small_map.path, tmp_path / "empty.zarr"))
    (path / "margins/c/0/0/0/0/0").write_bytes(b"")
    assert list(ReachMap(path).missing_blocks()) == [(0, 0, 0, 0)]


def test_another_kind_of_machine_is_noted_and_the_map_stays_the_same_one(
    small_map: ReachMap, tmp_path: Path
) -> None:
    found = ReachMap(shutil.copytree(small_map.path, tmp_path / "noted.zarr"))
    assert not found.note_machine(found.machine)
    assert found.note_machine("another")
    assert not found.note_machine("another")
    again = ReachMap(found.path)
    assert again.other_machines == ("another",)
    assert again.identity == small_map.identity
