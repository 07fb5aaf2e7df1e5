"""Free moves: straight where that is clear, around where it is not, explained where neither is."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin.errors import ConfigurationError
from planner import Manipulator, Scene, Trajectory, plan_joint_move
from planner.collision.context import looks_clear, sample_times
from planner.collision.proof import prove_clear
from planner.errors import FreeMoveError, MotionError
from planner.motion.free_move import plan_free_move
from planner.motion.free_search import MAX_SEARCHES, IsClear
from planner.motion.joint_move import POSITION_TOLERANCE_RAD, RATIO_TOLERANCE
from tests.planner import toy_world
from tests.planner.ompl import needs_ompl
from tests.planner.toy_world import (
    ARM_LEFT,
    ARM_LIMITS,
    ARM_RIGHT,
    AROUND_DISC,
    Disc,
    Ring,
    ToySpace,
    least_distance,
)
from tests.planner.walls import DENSE_RAD, Room, wall

FloatArray = NDArray[np.float64]
seeds = st.integers(0, 2**32 - 1)


DISTANT = ToySpace((Disc(0.0, 1.9, 0.2),))
ENCLOSED = ToySpace((Ring(ARM_RIGHT[0], ARM_RIGHT[1], 0.3, 0.1),))


def densely(space: ToySpace) -> IsClear:
    return lambda motion: looks_clear(motion, space.is_free, 1e-3)


PATIENT_S = 60.0
"""On a busy machine a search takes longer than the default allows."""


def plan(
    space: ToySpace = AROUND_DISC, is_clear: IsClear | None = None, **options: Any
) -> Trajectory:
    start, goal = options.pop("q_start", ARM_LEFT), options.pop("q_goal", ARM_RIGHT)
    limits = options.pop("limits", ARM_LIMITS)
    judge = densely(space) if is_clear is None else is_clear
    timed = {"timeout_s": PATIENT_S} | options
    return plan_free_move(start, goal, limits, space, judge, **timed)


def is_straight(motion: Trajectory) -> bool:
    straight = plan_joint_move(motion.q_start, motion.q_goal, motion.limits)
    return np.array_equal(motion.q, straight.q)


def test_goes_straight_where_that_is_clear() -> None:
    assert is_straight(plan(DISTANT))


@needs_ompl
def test_it_is_hardly_slower_than_the_straight_line() -> None:
    """No motion beats that; the disc is passed by joints that have time to spare."""
    straight = plan_joint_move(ARM_LEFT, ARM_RIGHT, ARM_LIMITS).duration

    assert straight <= (plan()).duration <= 1.02 * straight


@needs_ompl
def test_where_the_program_fails_it_stops_at_corners(monkeypatch: pytest.MonkeyPatch) -> None:
    for lead in ("led_around", "led_along"):
        monkeypatch.setattr(f"planner.motion.free_search.{lead}", lambda *_, **__: [])
    motion = plan()

    qs = motion.sample(sample_times(motion, 5e-4)).q
    assert least_distance(AROUND_DISC, qs) > -1e-6
    stops = np.abs(motion.v).max(axis=1) == 0.0
    assert stops.sum() > 2


def test_goes_straight_past_what_is_nearer_than_the_margin() -> None:
    grazing = ToySpace((Disc(0.0, 0.85, 0.799),))

    assert is_straight(plan(grazing, margin_m=0.05))


@pytest.mark.slow
@needs_ompl
@given(seeds)
@settings(max_examples=3)
def test_goes_around_what_is_in_the_way_inside_the_limits_from_rest_to_rest(seed: int) -> None:
    motion = plan(rng=np.random.default_rng(seed))
    assert not is_straight(motion)
    assert max(motion.peak_ratios()) <= 1.0 + RATIO_TOLERANCE
    for q in motion.position_extrema():
        assert not ARM_LIMITS.violations(q, POSITION_TOLERANCE_RAD)
    np.testing.assert_array_equal([motion.q_start, motion.q_goal], [ARM_LEFT, ARM_RIGHT])
    assert not np.any([motion.v[0], motion.v[-1], motion.a[0], motion.a[-1]])
    qs = motion.sample(sample_times(motion, 5e-4)).q
    assert least_distance(AROUND_DISC, qs) > -1e-6


@pytest.mark.slow
@needs_ompl
def test_the_same_numbers_make_the_same_motion() -> None:
    first, second = (plan() for _ in range(2))

    assert np.array_equal(first.q, second.q)
    assert np.array_equal(first.knots_s, second.knots_s)


def test_staying_where_it_is_may_be_refused_too(manipulator: Manipulator) -> None:
    context, q = manipulator.context(Scene.of([])), manipulator.arm.start
    with pytest.raises(FreeMoveError, match="the same"):
        plan_free_move(q, q, manipulator.limits, context, lambda _: False)


@pytest.mark.slow
@given(seeds)
@settings(max_examples=3)
def test_returns_no_motion_that_the_judge_did_not_accept(seed: int) -> None:
    rng = np.random.default_rng(seed)
    accepted: list[Trajectory] = []

    def judge(motion: Trajectory) -> bool:
        is_accepted = bool(rng.random() < 0.3)
        accepted.extend([motion] if is_accepted else [])
        return is_accepted

    found = None
    with suppress(FreeMoveError):
        found = plan(is_clear=judge, rng=rng)

    assert found is min(accepted, key=lambda motion: motion.duration, default=None)


def test_a_straight_line_that_the_judge_refuses_is_gone_around() -> None:
    refused: list[Trajectory] = []

    def judge(motion: Trajectory) -> bool:
        refused.append(motion)
        return len(refused) > 1

    assert plan(DISTANT, judge) is refused[1]


@needs_ompl
def test_a_search_that_fails_says_whether_it_found_ways() -> None:
    asked: list[Trajectory] = []

    def judge(motion: Trajectory) -> bool:
        asked.append(motion)
        return False

    with pytest.raises(FreeMoveError, match="4 ways around the obstacles were found, none proven"):
        plan(is_clear=judge, timeout_s=60.0)
    assert len(asked) > MAX_SEARCHES
    with pytest.raises(FreeMoveError, match=r"no way around was found in 0.2 s"):
        plan(ENCLOSED, timeout_s=0.2)


@pytest.mark.parametrize("which", ["start", "goal"])
def test_an_end_in_collision_is_named_with_the_depth(which: str) -> None:
    ends: dict[str, Any] = {f"q_{which}": np.array([0.3, 0.4, *np.zeros(5)])}
    with pytest.raises(
        FreeMoveError, match=f"^{which} in collision: finger is 300.0 mm inside disc$"
    ):
        plan(**ends)


@needs_ompl
def test_an_end_nearer_than_the_margin_can_be_left() -> None:
    close = np.array([-0.8005, *np.zeros(6)])

    motion = plan(q_start=close, margin_m=0.05)
    assert np.array_equal(motion.q_start, close)


@pytest.mark.parametrize("way_rad", [0.0, 1e-9])
def test_a_move_of_next_to_nothing_is_made(way_rad: float) -> None:
    motion = plan(q_goal=ARM_LEFT + way_rad)
    assert np.array_equal(motion.q_goal, ARM_LEFT + way_rad)
    assert (motion.duration > 0.0) is (way_rad > 0.0)
    assert motion.duration < 0.01


@pytest.mark.parametrize("which", ["q_start", "q_goal"])
def test_an_end_outside_the_limits_is_refused_by_name(which: str) -> None:
    ends: dict[str, Any] = {which: np.array([0.0, 2.5, *np.zeros(5)])}
    with pytest.raises(ConfigurationError, match=f"{which} is outside the joint limits: joint 1"):
        plan(**ends)


@pytest.mark.parametrize(
    "options",
    [
        *({"timeout_s": bad} for bad in (0.0, float("nan"), None)),
        {"rng": 7},
        {"limits": None},
        {"limits": toy_world.LIMITS, "q_start": toy_world.LEFT, "q_goal": toy_world.RIGHT},
    ],
)
def test_refuses_invalid_options(options: dict[str, Any]) -> None:
    with pytest.raises(MotionError):
        plan(**options)


@pytest.fixture(scope="module")
def room(manipulator: Manipulator, scene: Scene) -> Room:
    """The left arm beside a wall."""
    return Room.of(manipulator, scene.with_body(wall()))


@pytest.mark.slow
def test_a_wall_on_the_table_is_passed_and_that_is_proven(room: Room) -> None:
    start, goal = room.beside(0.2), room.beside(-0.2)

    def judge(motion: Trajectory) -> bool:
        return prove_clear(room.checker, motion, room.full(start)).is_clear

    motion = plan_free_move(start, goal, room.manipulator.limits, room.space, judge)
    assert not is_straight(motion)
    assert room.least_distance_m(motion) > 0.0


def test_a_goal_inside_a_wall_is_refused_with_link_body_and_depth(room: Room) -> None:
    start, goal, space = room.beside(0.2), room.beside(0.0), room.space

    def judge(motion: Trajectory) -> bool:
        return looks_clear(motion, space.is_free, DENSE_RAD)

    near = space.clearance(goal)
    reason = f"goal in collision: {near.first} is {-1e3 * near.distance_m:.1f} mm inside wall"
    with pytest.raises(FreeMoveError, match=reason):
        plan_free_move(start, goal, room.manipulator.limits, space, judge)
