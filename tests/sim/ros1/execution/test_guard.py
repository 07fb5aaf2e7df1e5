"""The guard: moves keep what their clearances state, and so does an arm that it lets pass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import JOINTS
from baxter_kin.validation import FloatArray
from planner import Body, Box, Manipulator, Move, Part, Plan
from planner.collision.context import CollisionContext
from planner.completion import complete, state_of
from sim.ros1.execution.guard import (
    KEPT_M,
    MAX_GROWTH_RAD,
    MAX_OFF_RAD,
    WINDOW_S,
    MoveClearance,
    NotClearError,
    PathGuard,
    clearances_of,
    shared_joints,
)
from sim.ros1.execution.readiness.ready import ReadyPlan
from sim.ros1.execution.stops import StopCause
from tests.conftest import at

ACCURACY_M = 2e-5
"""Of distances, twice that of the planner's proof."""

OFFSETS = st.lists(st.floats(-1.0, 1.0), min_size=7, max_size=7)


@dataclass(frozen=True)
class Approach:
    """The approach to the block, and what it is clear of."""

    move: Move
    clearance: MoveClearance
    context: CollisionContext


@pytest.fixture(scope="module")
def approach(ready: ReadyPlan) -> Approach:
    move = ready.plan.moves[0]
    return Approach(move, ready.clearances[0], ready.manipulator.at(state_of(move)))


@pytest.fixture(scope="module")
def clearances(ready: ReadyPlan) -> dict[str, MoveClearance]:
    return {each.label: each for each in ready.clearances}


def test_every_clearance_agrees_with_what_the_plan_proved(
    clearances: dict[str, MoveClearance], demo_plan: Plan
) -> None:
    assert list(clearances) == [move.label for move in demo_plan.moves]
    for move in demo_plan.moves:
        assert move.proof is not None
        nearest_m = move.proof.nearest.distance_m
        assert 0.85 * nearest_m < min(clearances[move.label].clear_m) <= nearest_m + ACCURACY_M


def test_intended_contacts_are_reported_and_nothing_else(
    clearances: dict[str, MoveClearance],
) -> None:
    intended = {label: each.intended for label, each in clearances.items()}
    assert intended["pick: approach"] is None
    assert intended["place: approach"] is None
    for label in ("pick: descend", "place: retract"):
        near = intended[label]
        assert near is not None
        assert "block" in (near.first, near.second)
    for label in ("pick: retract", "place: descend"):
        near = intended[label]
        assert near is not None
        assert {near.first, near.second} == {"block", "table"}


@pytest.mark.slow
def test_samples_of_every_pair_keep_the_clearance(approach: Approach) -> None:
    """By distances at instants, where clearances are proven over intervals."""
    checker, move = approach.context.checker, approach.move
    full, inner = np.array(approach.context.q_others), shared_joints(checker)
    least = np.full(len(JOINTS) + 1, np.inf)
    for t in np.linspace(0.0, move.trajectory.duration, 13).tolist():
        full[checker.motion_bounds.q_index] = move.trajectory.sample(t).q
        found = checker.distances_m(full, range(len(inner)))
        for joint, distance_m in zip(inner.tolist(), found, strict=True):
            least[joint] = min(least[joint], distance_m)
    assert (np.array(approach.clearance.clear_m) <= least + ACCURACY_M).all()


def test_a_body_in_the_way_is_named(demo_plan: Plan, manipulator: Manipulator) -> None:
    """A pole where the plan knows none."""
    known = demo_plan.start
    middle = demo_plan.moves[0].trajectory.sample(0.5).q
    where = manipulator.arm.T_base_tip(middle).translation
    pole = Body("pole", (Part(Box((0.02, 0.02, 0.02)), at(0.0, 0.0, 0.0)),), at(*where))
    changed = evolve(known, scene=known.scene.with_body(pole))
    with pytest.raises(NotClearError, match=r"pick: approach.*pole"):
        clearances_from(evolve(demo_plan, start=changed), manipulator)


def test_a_held_body_may_touch_its_old_support_in_the_first_move_alone(
    demo_plan: Plan, manipulator: Manipulator
) -> None:
    """It is lifted, put back on the table without being let go, and lifted again."""
    steps = list(demo_plan.steps)
    at_retract = next(i for i, step in enumerate(steps) if step.label == "pick: retract")
    lift = steps[at_retract]
    assert isinstance(lift, Move)
    back = evolve(lift, label="back", trajectory=lift.trajectory.reversed())
    again = evolve(lift, label="again")
    steps[at_retract : at_retract + 1] = [lift, back, again]
    touching = evolve(demo_plan, steps=tuple(steps))
    with pytest.raises(NotClearError, match=r"back: .*block.*table"):
        clearances_from(touching, manipulator)


def clearances_from(plan: Plan, manipulator: Manipulator) -> tuple[MoveClearance, ...]:
    """Of a plan that is completed for its start."""
    return clearances_of(complete(plan, manipulator=manipulator), manipulator)


def guarded(approach: Approach, upto_s: float) -> tuple[PathGuard, FloatArray]:
    """A guard to whom the first move was shown until then, and where that is."""
    guard, move = PathGuard(approach.context, JOINTS), approach.move
    for t in np.arange(0.0, upto_s, 0.01):
        guard.advance(float(t), move.trajectory.sample(float(t)).q, approach.clearance)
    q: FloatArray = move.trajectory.sample(upto_s).q
    guard.advance(upto_s, q, approach.clearance)
    return guard, q


def distance_m(approach: Approach, q: FloatArray) -> float:
    """What the arm really keeps, by the planner's distances."""
    return approach.context.clearance(q).distance_m


@settings(max_examples=25)
@given(offsets=OFFSETS, scale=st.floats(0.0, 0.1))
def test_what_it_lets_pass_keeps_its_distance(
    approach: Approach, offsets: list[float], scale: float
) -> None:
    guard, q = guarded(approach, approach.move.trajectory.duration)
    moved = q + scale * np.array(offsets)
    if guard.check(moved, q) is None:
        assert distance_m(approach, moved) >= KEPT_M - ACCURACY_M


def test_it_stops_an_arm_before_it_touches_and_says_where(approach: Approach) -> None:
    """Straight towards the block, in steps of a milliradian."""
    guard, q = guarded(approach, approach.move.trajectory.duration)
    for step in range(1, 200):
        moved = q + 1e-3 * step * np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # s1: down
        stop = guard.check(moved, q)
        if stop is not None:
            assert stop.cause is StopCause.OFF_PATH
            assert stop.subject == "pick: approach"
            assert stop.value > stop.bound
            assert stop.bound == pytest.approx(approach.clearance.clear_m[0] - 0.003)
            return
        assert distance_m(approach, moved) > 0.0
    pytest.fail("it let the arm pass into the table")


@settings(max_examples=25)
@given(late_s=st.floats(0.0, 0.9))
def test_an_arm_that_is_late_on_its_path_is_let_pass(approach: Approach, late_s: float) -> None:
    end_s = approach.move.trajectory.duration
    guard, q = guarded(approach, end_s)
    late = approach.move.trajectory.sample(max(0.0, end_s - late_s)).q
    stop = guard.check(late, q)
    is_far = float(np.abs(late - q).max()) > MAX_OFF_RAD
    assert (stop is not None) == is_far
    if stop is not None:
        assert stop.cause is StopCause.JOINT_OFF


def test_a_measurement_is_compared_with_the_path_of_its_own_time(approach: Approach) -> None:
    """An arm right on its path is not taken to be off it because its measurement is old."""
    guard, q = guarded(approach, 0.6)
    guard.advance(0.601, q, evolve(approach.clearance, max_off_rad=0.01))
    then = approach.move.trajectory.sample(0.4).q
    assert np.abs(then - q).max() > 0.01
    assert guard.check(then, q) is not None
    assert guard.check(then, guard.path_at(0.41)) is None
    assert guard.path_at(-1.0).tolist() == approach.move.trajectory.sample(0.0).q.tolist()
    assert guard.path_at(1.0).tolist() == q.tolist()


def test_the_path_is_forgotten_after_a_while(approach: Approach) -> None:
    trajectory = approach.move.trajectory
    guard = PathGuard(approach.context, JOINTS)
    begin, end = trajectory.sample(0.0).q, trajectory.sample(0.5).q
    guard.advance(0.0, begin, approach.clearance)
    guard.advance(0.1, end, approach.clearance)
    assert guard.check(begin, begin) is None
    for number in range(20):
        guard.advance(0.1 + WINDOW_S + 0.1 * number, end + 1e-6 * number, approach.clearance)
    stop = guard.check(begin, begin)
    assert stop is not None
    assert stop.cause is StopCause.OFF_PATH


def test_an_arm_that_leaves_a_set_point_that_stands_is_stopped(approach: Approach) -> None:
    guard, q = guarded(approach, 0.5)
    for number in range(20):
        guard.advance(0.5 + 0.01 * number, q, approach.clearance)
        assert guard.check(q + 0.005, q) is None  # gravity, say
    away = q + 0.005 + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.1 * MAX_GROWTH_RAD])
    stop = guard.check(away, q)
    assert stop is not None
    assert (stop.cause, stop.subject) == (StopCause.RUNNING_AWAY, "w2")


def test_the_guard_compares_with_the_path_and_not_ahead_of_it(approach: Approach) -> None:
    """A set-point that leads is no place that was proven clear."""
    guard, q = guarded(approach, 0.6)
    v = approach.move.trajectory.sample(0.6).v
    stop = guard.check(q + 0.2 * v, q)
    assert stop is not None


def test_the_bound_on_a_joint_is_that_of_the_move_from_its_start_on(approach: Approach) -> None:
    """Where the last move ended the next one begins."""
    guard, q = guarded(approach, 0.5)
    off = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.05])
    guard.advance(0.51, q, approach.clearance)
    assert guard.check(q + off, q) is None
    guard.advance(0.52, q, evolve(approach.clearance, label="next", max_off_rad=0.02))
    stop = guard.check(q + off, q)
    assert stop is not None
    assert (stop.cause, stop.bound) == (StopCause.JOINT_OFF, 0.02)
