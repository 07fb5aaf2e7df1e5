"""The situations of a plan's moves, from the plan alone."""

from __future__ import annotations

from dataclasses import replace

import pytest

from planner import Grip, GripperAction, Manipulator, Move, Plan
from planner.errors import TaskError
from planner.pick_place.tracking.situations import contexts_of

SAME_M = 1e-7
"""Poses that are computed from joint angles instead of given differ by rounding."""


def test_every_move_is_proven_in_its_situation_as_it_was_when_planned(
    tracked_plan: Plan, manipulator: Manipulator
) -> None:
    contexts = contexts_of(tracked_plan, manipulator)
    assert len(contexts) == len(tracked_plan.moves)
    for move, context in zip(tracked_plan.moves, contexts, strict=True):
        found = context.prove(move.trajectory)
        assert found.is_clear, move.label
        assert move.proof is not None
        assert found.nearest.distance_m == pytest.approx(move.proof.nearest.distance_m, abs=SAME_M)


def test_only_moves_next_to_a_grip_may_touch_something(
    tracked_plan: Plan, manipulator: Manipulator
) -> None:
    contexts = contexts_of(tracked_plan, manipulator)
    touching = {
        move.label
        for move, context in zip(tracked_plan.moves, contexts, strict=True)
        if context.checker.may_touch.any()
    }
    lines = {"pick: descend", "pick: retract", "place: descend", "place: retract"}
    assert touching == lines


def test_the_body_is_where_it_was_put_down(tracked_plan: Plan, manipulator: Manipulator) -> None:
    """After the release it counts as any other for what has no reason to come near."""
    last = tracked_plan.moves[-1]
    again = replace(last, label="again", trajectory=last.trajectory.reversed(), is_straight=False)
    plan = replace(tracked_plan, steps=(*tracked_plan.steps, again))
    context = contexts_of(plan, manipulator)[-1]
    assert not context.checker.may_touch.any()
    near = context.prove(again.trajectory).nearest
    assert near.second == "block"
    assert near.distance_m < 0.003


def test_a_grip_that_misses_is_named(tracked_plan: Plan, manipulator: Manipulator) -> None:
    without = tuple(s for s in tracked_plan.steps if not isinstance(s, Move))
    with pytest.raises(TaskError, match="pick: close: the fingers cannot close on block"):
        contexts_of(replace(tracked_plan, steps=without), manipulator)


def test_a_hand_that_is_full_cannot_close(tracked_plan: Plan, manipulator: Manipulator) -> None:
    steps = list(tracked_plan.steps)
    close = next(s for s in steps if isinstance(s, Grip) and s.action is GripperAction.CLOSE)
    steps.insert(steps.index(close), close)
    with pytest.raises(TaskError, match="the fingers cannot close on block"):
        contexts_of(replace(tracked_plan, steps=tuple(steps)), manipulator)


def test_a_plan_without_its_situation_is_refused(
    tracked_plan: Plan, manipulator: Manipulator
) -> None:
    with pytest.raises(TaskError, match="situation"):
        contexts_of(replace(tracked_plan, situation=None), manipulator)
