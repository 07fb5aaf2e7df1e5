"""Corners around obstacles, and every trap of the library that finds them."""

from __future__ import annotations

import importlib
import threading
import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import JointLimits
from planner.errors import MotionError
from planner.motion.rrt import EDGE_STEP_RAD, MAX_EDGE_RAD, search_corners
from tests.planner.ompl import needs_ompl
from tests.planner.toy_world import (
    AROUND_DISC,
    DISC,
    LEFT,
    LIMITS,
    RIGHT,
    Ring,
    ToySpace,
    along,
    least_distance,
)

pytestmark = needs_ompl

FloatArray = NDArray[np.float64]
seeds = st.integers(0, 2**32 - 1)

CHORD_DEPTH = (EDGE_STEP_RAD / 2) ** 2 / DISC.radius
"""How deep a chord of the disc, one step long, is inside; twice what it is to first order."""

ENCLOSED = ToySpace((Ring(RIGHT[0], RIGHT[1], 0.3, 0.1),))


def everywhere(_q: FloatArray) -> bool:
    return True


def nowhere(_q: FloatArray) -> bool:
    return False


def search(space: ToySpace = AROUND_DISC, seed: int = 1, **options: Any) -> FloatArray | None:
    arguments: dict[str, Any] = {"timeout_s": 5.0, "rng": np.random.default_rng(seed)}
    arguments |= options
    is_free = arguments.pop("is_free", space.is_free)
    return search_corners(LEFT, RIGHT, arguments.pop("limits", LIMITS), is_free, **arguments)


def found(space: ToySpace = AROUND_DISC, seed: int = 1, **options: Any) -> FloatArray:
    corners = search(space, seed, **options)
    assert corners is not None
    return corners


@given(seeds)
@settings(max_examples=10)
def test_corners_lead_around_a_disc_inside_the_limits(seed: int) -> None:
    corners = found(seed=seed)
    assert least_distance(AROUND_DISC, along(corners)) > -CHORD_DEPTH
    np.testing.assert_array_equal(corners[[0, -1]], [LEFT, RIGHT])
    assert all(not LIMITS.violations(q) for q in corners)


@given(seeds)
@settings(max_examples=4)
def test_the_same_seed_finds_the_same_corners_whatever_was_searched_before(seed: int) -> None:
    first = found(seed=seed)
    found(seed=seed + 1)

    assert np.array_equal(found(seed=seed), first)


def test_seeds_matter() -> None:
    assert len({found(seed=seed).tobytes() for seed in range(5)}) == 5


def test_a_path_that_does_not_reach_an_enclosed_goal_is_none() -> None:
    assert search(ENCLOSED, timeout_s=0.2) is None


def test_a_ring_of_a_tenth_of_ompls_default_step_is_not_jumped() -> None:
    extent = float(np.linalg.norm(LIMITS.q_max - LIMITS.q_min))
    wall = 0.01 * extent / 10  # OMPL steps by 1 % of the extent
    ring = ToySpace((Ring(RIGHT[0], RIGHT[1], 0.3, wall),))

    assert search(ring, timeout_s=0.2, step_rad=wall / 2) is None


def test_a_start_in_collision_is_none() -> None:
    assert search(is_free=lambda q: bool(np.any(q != LEFT))) is None


def test_time_that_is_up_ends_an_edge_in_its_middle(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now_s[0])

    def slow(q: FloatArray) -> bool:
        now_s[0] += 1.0
        return True

    assert search(is_free=slow, timeout_s=20.0) is None
    assert now_s[0] == pytest.approx(20.0)


def test_a_time_limit_of_ages_is_not_over_at_once() -> None:
    assert search(timeout_s=1e300) is not None


@pytest.mark.parametrize("error", [RuntimeError("no shapes"), KeyboardInterrupt()])
def test_what_a_check_raises_reaches_the_caller_and_the_next_search_works(
    error: BaseException, capfd: pytest.CaptureFixture[str]
) -> None:
    def broken(q: FloatArray) -> bool:
        raise error

    with pytest.raises(type(error)):
        search(is_free=broken)
    numpy_answers: Any = lambda q: np.bool_(AROUND_DISC.is_free(q))  # noqa: E731
    assert np.array_equal(found(is_free=numpy_answers), found())
    assert search(is_free=nowhere) is None
    assert capfd.readouterr() == ("", "")  # OMPL prints nothing


def test_a_search_within_a_search_does_not_wait_for_itself() -> None:
    inner: list[FloatArray | None] = []

    def nested(q: FloatArray) -> bool:
        if not inner:
            inner.append(None)
            inner[0] = search()
        return True

    assert search(is_free=nested) is not None
    assert inner[0] is not None


def test_searches_in_threads_find_what_they_find_alone() -> None:
    alone = [found(seed=seed) for seed in range(4)]
    together: dict[int, FloatArray] = {}
    threads = [
        threading.Thread(target=lambda seed=seed: together.update({seed: found(seed=seed)}))
        for seed in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert all(np.array_equal(together[seed], alone[seed]) for seed in range(4))


def test_the_log_level_of_others_is_put_back() -> None:
    from ompl import util  # noqa: PLC0415 - not every Python has it

    level = util.getLogLevel()
    try:
        util.setLogLevel(util.LogLevel.LOG_ERROR)
        search()
        assert util.getLogLevel() == util.LogLevel.LOG_ERROR
    finally:
        util.setLogLevel(level)


def test_no_edge_is_longer_than_the_longest_and_shortcuts_leave_a_shorter_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wide = with_range(LIMITS, 50.0)
    cut = np.linalg.norm(np.diff(found(limits=wide), axis=0), axis=1)
    simplifier = importlib.import_module("ompl.geometric").PathSimplifier
    monkeypatch.setattr(simplifier, "partialShortcutPath", lambda *_: True)
    lengths = np.linalg.norm(np.diff(found(limits=wide), axis=0), axis=1)
    assert lengths.max() <= MAX_EDGE_RAD + 1e-9
    assert cut.sum() < lengths.sum()


def with_range(limits: JointLimits, reach: float) -> JointLimits:
    q_max = np.full(2, reach)
    return JointLimits(limits.names, -q_max, q_max, limits.v_max, limits.a_max, limits.j_max)


@pytest.mark.parametrize("reach", [1e9, 1e308])
def test_refuses_limits_too_wide_to_count_steps_in(reach: float) -> None:
    with pytest.raises(MotionError, match="too wide to search in steps of"):
        search(limits=with_range(LIMITS, reach))


def test_searches_limits_narrower_than_a_step() -> None:
    limits = with_range(LIMITS, 1e-4)
    start, goal = np.full(2, -1e-4), np.full(2, 1e-4)

    corners = search_corners(
        start, goal, limits, everywhere, rng=np.random.default_rng(1), timeout_s=5.0
    )

    assert corners is not None
    assert np.array_equal(corners[-1], goal)
