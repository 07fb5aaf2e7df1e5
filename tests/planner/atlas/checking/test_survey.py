"""Cells are chosen at random from maps of any size."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from planner.atlas import ReachMap
from planner.atlas.blocks import Blocks
from planner.atlas.checking.survey import PIECE, Survey, Surveys

BLOCKS, CELLS = 6000, 600_000
"""Of a map with 3.6e9 cells."""


@pytest.fixture(scope="module")
def surveys() -> Surveys:
    """Blocks of which the first hundred have twice as many cells at the boundary."""
    found = Surveys(Blocks((1, BLOCKS, 1, 1)))
    for at in range(BLOCKS):
        edge = 2000 if at < 100 else 1000
        found.add((0, at, 0, 0), Survey(edge, CELLS - edge, 1))
    return found


def test_as_many_are_chosen_as_are_wanted_half_of_them_at_the_boundary(
    surveys: Surveys, small_map: ReachMap
) -> None:
    assert surveys.cells == BLOCKS * CELLS
    assert surveys.undecided == BLOCKS
    tasks = surveys.tasks(small_map, 20_000, 5)
    number = Counter[bool]()
    for task in tasks:
        assert 0 <= task.first < task.last <= task.first + PIECE
        number[task.is_boundary] += task.last - task.first
    assert number == {True: 10_000, False: 10_000}
    assert tasks == surveys.tasks(small_map, 20_000, 5)
    assert tasks != surveys.tasks(small_map, 20_000, 6)


def test_blocks_are_chosen_by_their_share(surveys: Surveys, small_map: ReachMap) -> None:
    of_first = [
        task.last - task.first
        for seed in range(6)
        for task in surveys.tasks(small_map, 20_000, seed)
        if task.is_boundary and task.block.block[1] < 100
    ]
    mean = 6 * 10_000 * 200_000 / (BLOCKS * 1000 + 100_000)
    assert sum(of_first) == pytest.approx(mean, abs=4.0 * np.sqrt(mean))


def test_a_small_map_is_checked_whole(small_map: ReachMap) -> None:
    found = Surveys(Blocks((1, 2, 1, 1)))
    found.add((0, 0, 0, 0), Survey(3, 4, 0))
    found.add((0, 1, 0, 0), Survey(0, 5, 0, "damaged"))
    assert sum(task.last - task.first for task in found.tasks(small_map, 100, 0)) == 12
    assert found.damaged == {(0, 1, 0, 0): "damaged"}
