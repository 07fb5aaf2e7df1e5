"""The guard: an arm that it lets pass keeps its clearance, wherever it is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.kinematics.arm import JOINTS
from baxter_kin.validation import FloatArray
from planner import Manipulator, Plan
from sim.ros1.execution.guard.path_guard import (
    GROWTH_RAD,
    KEPT_M,
    WINDOW_S,
    PathGuard,
)
from sim.ros1.execution.guard.stages import MOST_OFF_RAD, MoveStage
from sim.ros1.execution.ready_plan import ReadyPlan
from sim.ros1.execution.stops import StopCause

ACCURACY_M = 2e-5
"""Of distances, twice that of the planner's proof."""

OFFSETS = st.lists(st.floats(-1.0, 1.0), min_size=7, max_size=7)


@pytest.fixture(scope="module")
def stage(ready: ReadyPlan) -> MoveStage:
    """The approach and the descent to the block."""
    return next(stage for stage in ready.stages if isinstance(stage, MoveStage))


def guarded(stage: MoveStage, upto_s: float) -> tuple[PathGuard, FloatArray]:
    """A guard to whom the first move was shown until then, and where that is."""
    guard, move = PathGuard(stage.context, JOINTS), stage.moves[0]
    for t in np.arange(0.0, upto_s, 0.01):
        guard.passes(float(t), move.trajectory.sample(float(t)).q, stage.rooms[0])
    q: FloatArray = move.trajectory.sample(upto_s).q
    guard.passes(upto_s, q, stage.rooms[0])
    return guard, q


def distance_m(stage: MoveStage, q: FloatArray) -> float:
    """What the arm really keeps, by the planner's distances."""
    return stage.context.clearance(q).distance_m


@given(offsets=OFFSETS, scale=st.floats(0.0, 0.1))
def test_what_it_lets_pass_keeps_its_distance(
    stage: MoveStage, offsets: list[float], scale: float
) -> None:
    guard, q = guarded(stage, stage.moves[0].trajectory.duration)
    moved = q + scale * np.array(offsets)
    if guard.look(moved, q) is None:
        assert distance_m(stage, moved) >= KEPT_M - ACCURACY_M


def test_it_stops_an_arm_before_it_touches_and_says_where(stage: MoveStage) -> None:
    """Straight towards the block, in steps of a milliradian."""
    guard, q = guarded(stage, stage.moves[0].trajectory.duration)
    for step in range(1, 200):
        moved = q + 1e-3 * step * np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # s1: down
        alarm = guard.look(moved, q)
        if alarm is not None:
            assert alarm.cause is StopCause.OFF_PATH
            assert alarm.subject == "pick: approach"
            assert alarm.value > alarm.bound
            assert alarm.bound == pytest.approx(stage.rooms[0].clear_m[0] - 0.003)
            return
        assert distance_m(stage, moved) > 0.0
    pytest.fail("it let the arm pass into the table")


@given(late_s=st.floats(0.0, 0.9))
def test_an_arm_that_is_late_on_its_path_is_let_pass(stage: MoveStage, late_s: float) -> None:
    end_s = stage.moves[0].trajectory.duration
    guard, q = guarded(stage, end_s)
    late = stage.moves[0].trajectory.sample(max(0.0, end_s - late_s)).q
    alarm = guard.look(late, q)
    is_far = float(np.abs(late - q).max()) > MOST_OFF_RAD
    assert (alarm is not None) == is_far
    if alarm is not None:
        assert alarm.cause is StopCause.JOINT_OFF


def test_the_path_is_forgotten_after_a_while(stage: MoveStage) -> None:
    trajectory = stage.moves[0].trajectory
    guard = PathGuard(stage.context, JOINTS)
    begin, end = trajectory.sample(0.0).q, trajectory.sample(0.5).q
    guard.passes(0.0, begin, stage.rooms[0])
    guard.passes(0.1, end, stage.rooms[0])
    assert guard.look(begin, begin) is None
    for number in range(20):
        guard.passes(0.1 + WINDOW_S + 0.1 * number, end + 1e-6 * number, stage.rooms[0])
    alarm = guard.look(begin, begin)
    assert alarm is not None
    assert alarm.cause is StopCause.OFF_PATH


def test_an_arm_that_leaves_a_set_point_that_stands_is_stopped(stage: MoveStage) -> None:
    guard, q = guarded(stage, 0.5)
    for number in range(20):
        guard.passes(0.5 + 0.01 * number, q, stage.rooms[0])
        assert guard.look(q + 0.005, q) is None  # gravity, say
    away = q + 0.005 + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.1 * GROWTH_RAD])
    alarm = guard.look(away, q)
    assert alarm is not None
    assert (alarm.cause, alarm.subject) == (StopCause.RUNNING_AWAY, "w2")


def test_the_guard_looks_at_the_path_and_not_ahead_of_it(
    stage: MoveStage, demo_plan: Plan, manipulator: Manipulator
) -> None:
    """A set-point that leads is no place that was proven clear."""
    guard, q = guarded(stage, 0.6)
    v = stage.moves[0].trajectory.sample(0.6).v
    alarm = guard.look(q + 0.2 * v, q)
    assert alarm is not None
