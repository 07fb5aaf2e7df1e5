"""Sets of blocks, held as runs."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.atlas.blocks import Block, Blocks, BlockTasks

SHAPE = (2, 3, 2, 4)
ALL: list[Block] = [(a, x, y, z) for a, x, y, z in product(*map(range, SHAPE))]


@given(st.sets(st.sampled_from(ALL)))
def test_some_blocks_are_a_sequence_in_order(chosen: set[Block]) -> None:
    some, expected = Blocks.of(SHAPE, chosen), sorted(chosen)
    assert list(some) == [some[i] for i in range(len(some))] == list(some[:]) == expected
    assert [some.index(block) for block in expected] == list(range(len(expected)))
    assert [block in some for block in ALL] == [block in chosen for block in ALL]


@given(st.sets(st.sampled_from(ALL)))
def test_the_others_are_those_that_are_not_among_them(chosen: set[Block]) -> None:
    some = Blocks.of(SHAPE, chosen)
    assert list(some.others()) == sorted(set(ALL) - chosen)
    assert list(some.others().others()) == list(some)


def test_blocks_without_a_choice_are_all_and_take_no_memory() -> None:
    assert list(Blocks(SHAPE)) == ALL
    many = Blocks((2, 10**4, 10**4, 10**4))
    assert len(many) == 2 * 10**12
    assert many[-1] == (1, 9999, 9999, 9999)
    assert many.index(many[123_456_789_012]) == 123_456_789_012
    assert repr(many).startswith("Blocks(2,000,000,000,000 of ")


def test_what_is_not_among_them_is_told() -> None:
    some = Blocks.of(SHAPE, ALL[3:5])
    for other in (ALL[2], ALL[5], "block", (0, 0)):
        assert other not in some
        with pytest.raises(ValueError, match="is not among these blocks"):
            some.index(other)
    with pytest.raises(IndexError):
        some[2]


def test_tasks_name_map_and_block(tmp_path: Path) -> None:
    tasks = BlockTasks(tmp_path, "abc", Blocks(SHAPE))
    assert len(tasks) == len(ALL)
    assert tasks[7] == (str(tmp_path), ALL[7], "abc")
    assert [task.block for task in tasks[2:4]] == ALL[2:4]
