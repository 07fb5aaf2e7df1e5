"""Pairs over intervals: none is lost when they are halved or chosen."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.collision.continuous.tasks import Tasks

seeds = st.integers(0, 2**32 - 1)


def random_tasks(seed: int) -> Tasks:
    """Some pairs over some intervals of one motion, a few of them left out."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.1, 1.0, rng.integers(2, 8)))
    pairs = rng.permutation(20)[: rng.integers(1, 6)]
    tasks = Tasks.of(times[:-1], times[1:], pairs)
    return tasks.only(rng.random(len(tasks.pair)) < 0.7)


def spans(tasks: Tasks) -> Iterator[tuple[int, float, float]]:
    """Which pair from when to when."""
    for interval, pair in zip(tasks.interval.tolist(), tasks.pair.tolist(), strict=True):
        yield pair, float(tasks.starts_s[interval]), float(tasks.ends_s[interval])


def test_every_pair_is_asked_about_over_every_interval() -> None:
    tasks = Tasks.of(np.array([0.0, 1.0]), np.array([1.0, 3.0]), np.array([7, 4]))
    assert set(spans(tasks)) == {(7, 0, 1), (4, 0, 1), (7, 1, 3), (4, 1, 3)}
    assert tasks.middles_s.tolist() == [0.5, 2.0]


@given(seeds)
def test_halves_together_are_what_was_halved(seed: int) -> None:
    tasks = random_tasks(seed)
    halves = [
        half
        for pair, start, end in spans(tasks)
        for half in ((pair, start, (start + end) / 2), (pair, (start + end) / 2, end))
    ]
    assert sorted(spans(tasks.halved())) == sorted(halves)


@given(seeds)
def test_tasks_of_one_interval_lie_together(seed: int) -> None:
    for tasks in (random_tasks(seed), random_tasks(seed).halved()):
        assert (np.diff(tasks.interval) >= 0).all()


@given(seeds)
def test_intervals_that_nothing_is_asked_about_are_dropped_when_halved(seed: int) -> None:
    tasks = random_tasks(seed)
    halved = tasks.halved()
    assert len(halved.starts_s) == len(halved.ends_s) == 2 * len(set(tasks.interval.tolist()))


@pytest.mark.parametrize("pairs", [0, 3])
def test_what_is_done_leaves_nothing_to_halve(pairs: int) -> None:
    tasks = Tasks.of(np.zeros(2), np.ones(2), np.arange(pairs)).only(
        np.zeros(2 * pairs, dtype=bool)
    )
    assert not list(spans(tasks.halved()))
