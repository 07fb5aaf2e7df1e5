"""Collision checks compared with distances computed pair by pair, and the samples of a motion."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from baxter_kin import Arm
from baxter_kin.errors import ConfigurationError
from planner import Body, Box, Manipulator, Part, Scene, Trajectory, plan_joint_move
from planner.collision import ClearanceChecker, ContinuousProof
from planner.collision.context import (
    SCREENING_STEP_RAD,
    CollisionContext,
    Touches,
    bisecting,
    looks_clear,
    sample_times,
)
from planner.errors import MotionError, SceneError, TrajectoryError
from planner.scene.bodies import Attachment
from planner.scene.coal_shapes import has_depth
from planner.scene.contact import PRESSING_TOLERANCE_M
from tests.conftest import at, overhead
from tests.planner.toy_world import DISC, LEFT, LIMITS, RIGHT
from tests.planner.walls import Room, wall

FloatArray = NDArray[np.float64]
seeds = st.integers(0, 2**32 - 1)

BODY_M = 2e-3
"""Twice half a millimetre for each of two links: the planner's shapes contain their meshes."""

DISTANCE_TOLERANCE_M = 2e-6
"""Difference of two runs of GJK on one pair; its default tolerance is 1e-6."""

MARGIN_M = 0.03


@pytest.fixture(scope="module")
def room(manipulator: Manipulator, scene: Scene) -> Room:
    return Room.of(manipulator, scene.with_body(wall()))


@pytest.fixture(scope="module")
def space(room: Room) -> CollisionContext:
    return room.space


@pytest.fixture(scope="module")
def checker(room: Room) -> ClearanceChecker:
    """A checker with the wall alone."""
    return ClearanceChecker(room.manipulator.shapes, room.manipulator.arm, Scene.of([wall()]))


def near(room: Room, seed: int) -> FloatArray:
    """A random configuration, every other one near the table, the wall and the block."""
    rng = np.random.default_rng(seed)
    arm = room.manipulator.arm
    if rng.random() < 0.5:
        return arm.random_configuration(rng)
    low, high = arm.limits.q_min, arm.limits.q_max
    return np.clip(room.beside(0.15) + rng.normal(0.0, 0.1, 7), low, high)


@settings(max_examples=20)
@given(seeds)
def test_a_configuration_is_free_exactly_where_its_clearance_is_above_zero(
    room: Room, space: CollisionContext, seed: int
) -> None:
    q = near(room, seed)

    assert space.is_free(q) == (room.distance_m(q) > 0.0)


@settings(max_examples=20)
@given(seeds, st.sampled_from([0.0, 0.002, 0.03]))
def test_a_margin_is_kept_exactly_where_the_clearance_is_above_it(
    room: Room, space: CollisionContext, seed: int, margin_m: float
) -> None:
    q = near(room, seed)
    distance = room.distance_m(q)

    if abs(distance - margin_m) > DISTANCE_TOLERANCE_M:
        assert space.with_margin(margin_m).is_free(q) == (distance > margin_m)


@pytest.mark.slow
@settings(max_examples=8)  # each measures every pair
@given(seeds, st.sampled_from([-PRESSING_TOLERANCE_M, -0.02]))
def test_a_negative_margin_allows_a_depth(
    room: Room, checker: ClearanceChecker, seed: int, margin_m: float
) -> None:
    full = next(room.manipulator.configurations(near(room, seed)[None], 0.02))
    shapes = checker.geometry.geometryObjects
    distances = np.array(checker.distances_m(full, range(len(checker.pairs))))
    deep = [
        distance < (margin_m if all(has_depth(shapes[i].geometry) for i in pair) else 0.0)
        for distance, pair in zip(distances, checker.pairs.tolist(), strict=True)
    ]
    if np.abs(distances[:, None] - [margin_m, 0.0]).min() > DISTANCE_TOLERANCE_M:
        touches = Touches(checker, margin_m)
        assert touches(full) == any(deep)
        assert touches.pairs(full) == np.flatnonzero(deep).tolist()
        assert not Touches(checker, margin_m, left_out=touches.pairs(full))(full)


@settings(max_examples=10)
@given(seeds, seeds)
def test_free_ends_stay_free_under_any_margin(
    room: Room, space: CollisionContext, seed: int, other: int
) -> None:
    ends = [q for q in (near(room, seed), near(room, other)) if space.is_free(q)]
    guarded = space.with_margin(0.05, *ends)

    assert all(guarded.is_free(q) for q in ends)


def nearing(room: Room, body: str, within_m: float) -> FloatArray:
    """A configuration near that body and farther from all others."""
    ends = {"wall": ((0.2, 0.1), (0.0, 0.1)), "table": ((0.3, -0.1), (0.3, -0.18))}
    for y, z in np.linspace(*ends[body], 80):
        q = room.beside(y, z)
        if 0.0 < room.distance_m(q) < within_m:
            assert room.checker.clearance(room.full(q)).second == body
            return q
    raise AssertionError(f"the hand comes near no {body}")


def test_an_end_weakens_the_margin_only_of_near_shapes(room: Room, space: CollisionContext) -> None:
    near_table, near_wall = nearing(room, "table", 0.01), nearing(room, "wall", 0.01)
    guarded = space.with_margin(0.02, near_table)

    assert not space.with_margin(0.02).is_free(near_table)
    assert guarded.is_free(near_table)
    assert not guarded.is_free(near_wall)
    assert space.with_margin(0.02, near_table, near_wall).is_free(near_wall)


def test_clearance_is_that_of_the_checker(room: Room, space: CollisionContext) -> None:
    q = room.beside(0.0)
    found, expected = space.clearance(q), room.checker.clearance(room.full(q))

    assert (found.first, found.second) == (expected.first, expected.second)
    assert found.distance_m == pytest.approx(expected.distance_m, abs=DISTANCE_TOLERANCE_M)
    assert found.distance_m < 0.0
    assert found.second == "wall"


def test_contexts_on_one_checker_are_independent(room: Room) -> None:
    qs = [near(room, seed) for seed in range(30)]
    first = room.space
    before = [first.is_free(q) for q in qs]
    others = [room.space.with_margin(0.05) for _ in range(3)]
    for q in qs:
        room.distance_m(q)
        assert not any(other.is_free(q) and not first.is_free(q) for other in others)

    assert [first.is_free(q) for q in qs] == before


def test_fingers_may_touch_a_grasped_body_but_not_press_into_it(
    manipulator: Manipulator, scene: Scene, block: Body
) -> None:
    grasp = manipulator.ik.solve(overhead(0.7, 0.15, -0.129)).q
    checker = ClearanceChecker(manipulator.shapes, manipulator.arm, scene, touchable="block")
    for finger_m in np.linspace(0.0, manipulator.hand.stroke_m, 12):
        full = next(manipulator.configurations(grasp[None], finger_m))
        space = CollisionContext(checker, full)
        assert space.is_free(grasp) == (checker.clearance(full).distance_m > 0.0)


@pytest.mark.parametrize(
    "gap", [2 * PRESSING_TOLERANCE_M, 0.0, -PRESSING_TOLERANCE_M / 2, -2 * PRESSING_TOLERANCE_M]
)
def test_a_held_body_may_touch_its_support_but_not_press_into_it(
    manipulator: Manipulator, table: Body, block: Body, gap: float
) -> None:
    T_base_tip = overhead(0.7, 0.15, -0.125)
    low = block.extent_m([0.0, 0.0, 1.0])[0]
    lift = table.extent_m([0.0, 0.0, 1.0])[1] - low + gap
    raised = block.at(at(0.0, 0.0, lift) * block.T_base_body)
    held = Attachment("block", "left_gripper", T_base_tip.inverse() * raised.T_base_body)
    scene = Scene.of([table, raised])
    context = manipulator.context(
        scene, finger_m=0.0208, held=held, supports=["table"], margin_m=0.003
    )
    q = manipulator.ik.solve(T_base_tip).q

    assert context.is_free(q) == (gap > -PRESSING_TOLERANCE_M)


@pytest.mark.parametrize(
    "q",
    [
        np.zeros(6),
        np.full(7, np.nan),
        np.full(7, np.inf),
        np.full(7, 1e9),
        np.full(7, 1e300),
        np.full(7, 1j),
        np.full(7, "1"),
        [0.0] * 8,
        "abcdefg",
        None,
    ],
)
def test_refuses_an_invalid_configuration(space: CollisionContext, q: Any) -> None:
    for ask in (space.is_free, space.clearance, space.with_margin(0.01).is_free):
        with pytest.raises(ConfigurationError):
            ask(q)
    with pytest.raises(ConfigurationError):
        space.with_margin(0.01, q)


@pytest.mark.parametrize("margin", [-0.001, float("nan"), "1", None])
def test_refuses_an_invalid_margin(
    manipulator: Manipulator, space: CollisionContext, margin: Any
) -> None:
    for ask in (
        lambda: space.with_margin(margin),
        lambda: space.obstacles(margin, np.zeros(7)),
        lambda: manipulator.context(Scene.of(), margin_m=margin),
    ):
        with pytest.raises(MotionError, match="margin"):
            ask()


def test_refuses_arguments_of_another_class(room: Room, space: CollisionContext) -> None:
    bad: Any = "left"
    asked: list[tuple[Any, type[Exception]]] = [
        (lambda: CollisionContext(bad, room.full(np.zeros(7))), SceneError),
        (lambda: CollisionContext(room.checker, np.zeros(7)), ConfigurationError),
        (lambda: room.manipulator.context(Scene.of(), finger_m=1.0), ConfigurationError),
        (lambda: space.is_clear(bad), TrajectoryError),
        (lambda: space.prove(bad), TrajectoryError),
    ]
    for ask, error in asked:
        with pytest.raises(error):
            ask()


@given(seed=seeds)
@settings(max_examples=6)
def test_a_clear_motion_is_proven(manipulator: Manipulator, table: Body, seed: int) -> None:
    bodies = Scene.of([table, wall()])
    context = manipulator.context(bodies, margin_m=MARGIN_M)
    rng = np.random.default_rng(seed)
    start, goal = (manipulator.arm.random_configuration(rng) for _ in range(2))
    motion = plan_joint_move(start, goal, manipulator.limits)
    proof = context.prove(motion)
    assert context.is_clear(motion) == proof.is_clear


def test_a_motion_is_clear_beside_the_table_and_not_through_the_wall(
    manipulator: Manipulator, table: Body
) -> None:
    context = manipulator.context(Scene.of([table, wall()]), margin_m=MARGIN_M)
    q = manipulator.arm.start
    beside = plan_joint_move(q, q + 0.1, manipulator.limits)
    assert context.is_clear(beside)
    assert looks_clear(beside, context.is_free, SCREENING_STEP_RAD)
    q_left, q_right = (manipulator.ik.solve(overhead(0.70, y, 0.0)).q for y in (0.35, -0.10))
    through = plan_joint_move(q_left, q_right, manipulator.limits)
    assert not context.is_clear(through)


@given(seed=seeds)
@settings(max_examples=12)
def test_the_smallest_distance_of_a_proof_is_the_clearance_at_its_time(
    manipulator: Manipulator, seed: int
) -> None:
    rng, arm = np.random.default_rng(seed), manipulator.arm
    sizes, places = rng.uniform(0.02, 0.3, (3, 3)), rng.uniform(-0.6, 1.0, (3, 3))
    bodies = [
        Body(f"box {i}", (Part(Box((x, y, z)), at(0.0, 0.0, 0.0)),), at(*place))
        for i, ((x, y, z), place) in enumerate(zip(sizes.tolist(), places.tolist(), strict=True))
    ]
    context = manipulator.context(Scene.of(bodies))
    start = arm.random_configuration(rng)
    goal = np.clip(start + rng.normal(0.0, 0.3, 7), arm.limits.q_min, arm.limits.q_max)
    motion = plan_joint_move(start, goal, manipulator.limits)
    proof = context.prove(motion)
    assume(isinstance(proof, ContinuousProof))
    found = context.clearance(motion.sample(proof.nearest.time_s or 0.0).q)
    least_m = found.distance_m - DISTANCE_TOLERANCE_M
    assert least_m <= proof.nearest.distance_m <= found.distance_m + BODY_M


MOVE = plan_joint_move(LEFT, RIGHT, LIMITS)


def everywhere(_q: FloatArray) -> bool:
    return True


def nowhere(_q: FloatArray) -> bool:
    return False


def moving_move(arm: Arm, seed: int) -> Trajectory:
    """A motion between two moving states, or where none exists, between two resting ones."""
    rng = np.random.default_rng(seed)
    start, goal = (arm.random_configuration(rng) for _ in range(2))
    v = [0.3 * rng.uniform(-1, 1, 7) * arm.limits.v_max for _ in range(2)]
    try:
        return plan_joint_move(start, goal, arm.limits, v_start=v[0], v_goal=v[1])
    except MotionError:
        return plan_joint_move(start, goal, arm.limits)


@settings(max_examples=25)
@given(seeds, st.floats(0.02, 0.5))
def test_no_joint_moves_farther_than_a_step_between_two_samples(
    left: Arm, seed: int, step_rad: float
) -> None:
    move = moving_move(left, seed)
    times = sample_times(move, step_rad)
    assert (times[0], times[-1]) == (0.0, move.duration)

    for start, end in pairwise(times):
        qs = move.sample(np.linspace(start, end, 10)).q
        assert np.ptp(qs, axis=0).max() <= step_rad * (1 + 1e-9)


def test_a_motion_without_duration_is_one_sample() -> None:
    assert sample_times(Trajectory.stay(LEFT, LIMITS), 0.1).tolist() == [0.0]


def test_a_motion_that_rests_is_sampled_too() -> None:
    none = np.zeros((2, 2))
    wait = Trajectory(LIMITS, np.array([0.0, 1.0]), none, none, none, np.zeros((1, 2)))

    assert looks_clear(wait, everywhere, 0.1)
    assert not looks_clear(wait, nowhere, 0.1)


@given(st.integers(0, 200))
def test_bisection_contains_every_number_once(count: int) -> None:
    assert sorted(bisecting(count)) == list(range(count))
    assert bisecting(9)[:5] == (0, 8, 4, 2, 6)


def test_the_middle_of_an_obstacle_is_found_with_the_third_sample() -> None:
    asked: list[float] = []

    def is_free(q: FloatArray) -> bool:
        asked.append(DISC.distance(q))
        return asked[-1] > 0.0

    assert not looks_clear(MOVE, is_free, 0.01)
    assert len(asked) == 3


@pytest.mark.parametrize("end", [LEFT, RIGHT])
def test_a_motion_with_an_end_in_collision_is_rejected(end: FloatArray) -> None:
    def elsewhere(q: FloatArray) -> bool:
        return not np.array_equal(q, end)

    assert not looks_clear(MOVE, elsewhere, 0.01)
