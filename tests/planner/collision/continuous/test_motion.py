"""How the shapes of a moving arm come about: bounds against distances at many instants."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin.validation import FloatArray, Indices
from planner import Manipulator, Scene, Trajectory, plan_joint_move
from planner.collision.continuous.motion import ArmShapeMotion
from planner.trajectory import CONTINUITY_TOLERANCE
from tests.planner.walls import Room, wall

GJK_M = 2e-6
"""Two runs of coal on the same pair."""

LOOKS = 5
FARTHEST_M = 2.0
"""No point of the arm is farther from a joint's axis."""

seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def room(manipulator: Manipulator, scene: Scene) -> Room:
    return Room.of(manipulator, scene.with_body(wall()))


def swing(room: Room, seed: int) -> Trajectory:
    rng, arm = np.random.default_rng(seed), room.manipulator.arm
    q_start, q_goal = (arm.random_configuration(rng) for _ in range(2))
    return plan_joint_move(q_start, q_goal, arm.limits)


def motion_of(room: Room, trajectory: Trajectory) -> ArmShapeMotion:
    return ArmShapeMotion(room.checker, trajectory, room.full(trajectory.q_start))


def distances_m(room: Room, q: FloatArray, pairs: Indices) -> FloatArray:
    return np.array(room.checker.distances_m(room.full(q), pairs.tolist()))


def some_pairs(room: Room, seed: int) -> Indices:
    every = np.random.default_rng(seed).permutation(len(room.checker.pairs))
    return np.sort(every[:40])


def test_it_takes_as_long_as_the_trajectory(room: Room) -> None:
    trajectory = swing(room, 0)
    assert motion_of(room, trajectory).duration_s == trajectory.duration


@settings(max_examples=8)
@given(seeds)
def test_no_pair_comes_nearer_than_its_distance_in_the_middle_less_its_motion(
    room: Room, seed: int
) -> None:
    trajectory, pairs = swing(room, seed), some_pairs(room, seed)
    rng = np.random.default_rng(seed)
    middle_s = rng.uniform(0.0, trajectory.duration)
    half_s = min(0.05, middle_s, trajectory.duration - middle_s)
    start, end = np.array([middle_s - half_s]), np.array([middle_s + half_s])
    around = motion_of(room, trajectory).around(start, end)
    motions_m = around.motions_m(np.zeros_like(pairs), pairs)
    in_middle = distances_m(room, trajectory.sample(middle_s).q, pairs)
    bound_m = in_middle - motions_m
    for time_s in np.linspace(start[0], end[0], LOOKS).tolist():
        found = distances_m(room, trajectory.sample(time_s).q, pairs)
        assert (found >= bound_m - GJK_M)[bound_m > 0.0].all()


@settings(max_examples=8)
@given(seeds)
def test_gaps_are_no_greater_than_the_distances_in_the_middle(room: Room, seed: int) -> None:
    trajectory, pairs = swing(room, seed), some_pairs(room, seed)
    ends = np.array([trajectory.duration])
    gaps = motion_of(room, trajectory).around(np.zeros(1), ends).gaps_m(np.zeros_like(pairs), pairs)
    apart = distances_m(room, trajectory.sample(trajectory.duration / 2).q, pairs)
    assert (gaps <= np.maximum(apart, 0.0) + GJK_M).all()
    assert (gaps > 0.0).any()


def test_at_an_instant_nothing_moves(room: Room) -> None:
    """But for what positions may jump by at a knot."""
    trajectory, pairs = swing(room, 1), np.arange(len(room.checker.pairs))
    instant = np.array([trajectory.duration / 3])
    around = motion_of(room, trajectory).around(instant, instant)
    moved = around.motions_m(np.zeros_like(pairs), pairs)
    assert moved.max() <= 7 * FARTHEST_M * CONTINUITY_TOLERANCE


def test_a_longer_interval_moves_every_pair_by_no_less(room: Room) -> None:
    trajectory, pairs = swing(room, 2), np.arange(len(room.checker.pairs))
    middle_s, motion = trajectory.duration / 2, motion_of(room, trajectory)
    moved = [
        motion.around(np.array([middle_s - half_s]), np.array([middle_s + half_s])).motions_m(
            np.zeros_like(pairs), pairs
        )
        for half_s in (0.01, 0.05, 0.2)
    ]
    assert (np.diff(moved, axis=0) >= 0.0).all()


def test_intervals_are_as_one_after_the_other(room: Room) -> None:
    trajectory, pairs = swing(room, 3), np.arange(len(room.checker.pairs))
    times, motion = np.linspace(0.0, trajectory.duration, 5), motion_of(room, trajectory)
    together = motion.around(times[:-1], times[1:])
    for number in range(4):
        alone = motion.around(times[number : number + 1], times[number + 1 : number + 2])
        for name in ("gaps_m", "motions_m"):
            expected = getattr(alone, name)(np.zeros_like(pairs), pairs)
            found = getattr(together, name)(np.full_like(pairs, number), pairs)
            np.testing.assert_allclose(found, expected, atol=1e-12)
