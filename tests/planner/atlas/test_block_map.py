"""Blocks and their files, for every kind of map."""

from __future__ import annotations

import shutil
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.distribution.software import versions
from planner.atlas import ReachMap
from planner.atlas.block_map import EDGE, MIN_LARGE_BLOCKS, Block, BlockGrid, Blocks
from planner.atlas.redundancy import RedundancyMap
from planner.atlas.rotations import MOST_ROTATIONS
from planner.errors import AtlasError
from tests.planner.atlas.maps import BuiltMap, change_attributes, chunk, damage, digests

SHAPE = (2, 3, 2, 4)
ALL: list[Block] = [(a, x, y, z) for a, x, y, z in product(*map(range, SHAPE))]


@given(st.sets(st.sampled_from(ALL)))
def test_some_blocks_are_a_sequence_in_order(chosen: set[Block]) -> None:
    some, expected = Blocks.of(SHAPE, chosen), sorted(chosen)
    assert list(some) == [some[i] for i in range(len(some))] == list(some[:]) == expected
    assert list(map(tuple, some.as_array().tolist())) == expected
    assert [some.index(block) for block in expected] == list(range(len(expected)))
    assert [block in some for block in ALL] == [block in chosen for block in ALL]
    assert list(some.others()) == sorted(set(ALL) - chosen)
    assert list(some.others().others()) == expected


def test_blocks_without_a_choice_are_all_and_take_no_memory() -> None:
    assert list(Blocks(SHAPE)) == ALL
    many = Blocks((2, 10**4, 10**4, 10**4))
    assert len(many) == 2 * 10**12
    assert many[-1] == (1, 9999, 9999, 9999)
    assert many.index(many[123_456_789_012]) == 123_456_789_012
    assert repr(many).startswith("Blocks(2,000,000,000,000 of ")


def test_a_block_that_is_not_among_some_has_no_place() -> None:
    some = Blocks.of(SHAPE, ALL[3:5])
    for other in (ALL[2], ALL[5], "block", (0, 0)):
        assert other not in some
        with pytest.raises(ValueError, match="is not among these blocks"):
            some.index(other)
    with pytest.raises(IndexError):
        some[2]


@given(st.tuples(st.integers(1, 2), *[st.integers(1, 9)] * 3), st.integers(1, 5), st.data())
def test_blocks_hold_every_position_once(
    shape: tuple[int, ...], edge: int, data: st.DataObject
) -> None:
    grid, seen = BlockGrid(shape, edge), np.zeros(shape, int)
    for block in grid.blocks:
        x, y, z = grid.indices(block).T
        seen[block[0], x, y, z] += 1
        assert np.array_equal(np.ravel(seen[(block[0], *grid.slices(block))]), np.ones(len(x)))
    assert (seen == 1).all()
    chosen = data.draw(st.sets(st.sampled_from(list(grid.blocks))))
    size = sum(len(grid.indices(block)) for block in chosen)
    assert grid.positions_of(Blocks.of(grid.blocks.shape, chosen)) == size


@given(
    st.tuples(st.just(2), *[st.integers(1, 10_000)] * 3),
    st.integers(1, MOST_ROTATIONS),
    st.sampled_from([1000, 600_000]),
)
def test_blocks_fit_into_memory_and_are_as_few_as_allowed(
    shape: tuple[int, ...], rotations: int, max_cells: int
) -> None:
    edge = BlockGrid.of(shape, rotations, max_cells).edge
    assert edge == 1 or edge**3 * rotations <= max_cells
    if edge < EDGE:
        assert (2 * edge) ** 3 * rotations > max_cells
    if edge > EDGE:
        assert np.prod(shape[1:]) >= MIN_LARGE_BLOCKS * edge**3


def test_the_largest_grids_have_millions_of_blocks_at_most() -> None:
    """Of 10^12 cells, for any number of rotations."""
    for rotations, side in ((1, 10_000), (72, 2_404), (576, 1_202), (MOST_ROTATIONS, 149)):
        assert len(BlockGrid.of((1, *[side] * 3), rotations, 600_000).blocks) < 5e6


def test_a_block_is_read_as_it_was_written_and_whole(built: BuiltMap, tmp_path: Path) -> None:
    own = built.copied(tmp_path / "own.zarr").map
    block = own.blocks[1]
    rows = tuple(own.read_rows(block, layer) for layer in range(len(own.KIND.layers)))
    assert all(len(part) == len(own.grid.indices(block)) for part in rows)
    own.discard_block(block)
    assert list(own.missing_blocks()) == [block]
    own.write_rows(block, rows)
    assert digests(own.path) == digests(built.path)


@pytest.mark.slow
def test_a_block_without_its_bytes_or_with_others_is_not_used(
    built: BuiltMap, tmp_path: Path
) -> None:
    """A file is empty where the power was lost."""
    own = built.copied(tmp_path / "own.zarr").map
    lost, damaged = own.blocks[0], own.blocks[1]
    chunk(own, lost).write_bytes(b"")
    damage(chunk(own, damaged))
    assert list(own.missing_blocks()) == [lost]
    with pytest.raises(AtlasError, match=r"block \(0, .*\) of the map .* is damaged"):
        own.read_rows(damaged)
    own.discard_block(damaged)
    built.build(own.path)
    assert digests(own.path) == digests(built.path)


def test_a_map_whose_creation_was_stopped_is_created_by_the_same_call(
    built: BuiltMap, tmp_path: Path
) -> None:
    """The group, which makes a map of the arrays, is written last."""
    path = tmp_path / "begun.zarr"
    arrays = sorted(each.name for each in built.path.iterdir() if each.is_dir())
    assert arrays == sorted([*built.definition.constants, *built.definition.layers])
    for name in arrays[1:]:
        shutil.copytree(built.path / name, path / name)
    (path / arrays[1] / "zarr.json").unlink()
    (path / "zarr.0123.partial").write_bytes(b"{")
    found = type(built.map).create_from(path, built.definition)
    assert found.identity == built.map.identity


def test_another_kind_of_machine_is_noted_and_the_map_stays_the_same_one(
    built: BuiltMap, tmp_path: Path
) -> None:
    own = built.copied(tmp_path / "noted.zarr").map
    assert not own.note_machine(own.machine)
    assert own.note_machine("another")
    assert not own.note_machine("another")
    again = type(own)(own.path)
    assert again.other_machines == ("another",)
    assert again.identity == built.map.identity


@pytest.mark.parametrize(
    ("software", "words"),
    [
        ({**versions(), "numpy": "1.0"}, r"numpy 1\.0 there and .* here; nothing was changed"),
        (None, "versions that it does not name; nothing was changed"),
    ],
    ids=["other", "unnamed"],
)
def test_only_missing_blocks_ask_for_the_same_software(
    built: BuiltMap, software: dict[str, str] | None, words: str, tmp_path: Path
) -> None:
    """Maps of early versions do not name it."""
    path = built.copied(tmp_path / "own.zarr").path
    change_attributes(path, software=software)
    own = type(built.map)(path)
    assert built.build(path).software == (software or {})
    own.discard_block(own.blocks[0])
    before = digests(path)
    with pytest.raises(AtlasError, match=f"begun with other software: {words}"):
        built.build(path)
    assert digests(path) == before


def test_what_is_no_map_is_refused_and_stays(built: BuiltMap, tmp_path: Path) -> None:
    with pytest.raises(AtlasError, match="there is no map at"):
        type(built.map)(tmp_path / "nothing")
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(AtlasError, match="exists and is no map"):
        built.build(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["notes.txt"]
    other = RedundancyMap if isinstance(built.map, ReachMap) else ReachMap
    with pytest.raises(AtlasError, match=r"is a Zarr group, but no .* map of this toolkit"):
        other(built.path)
    change_attributes(built.copied(tmp_path / "own.zarr").path, arms=None, subset=None)
    with pytest.raises(AtlasError, match=r"own\.zarr is damaged"):
        type(built.map)(tmp_path / "own.zarr")
