"""States and contacts of the steps of a plan, from its start and its steps alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin.fields import evolve
from planner import Grip, GripperAction, Manipulator, Move, Plan, Scene, State
from planner.completion import complete, move_contexts
from planner.errors import TaskError

SAME_M = 1e-7
"""Poses that are computed from joint angles instead of given differ by rounding."""


def test_every_move_is_proven_in_its_situation_as_it_was_when_planned(
    tracked_plan: Plan, manipulator: Manipulator
) -> None:
    contexts = move_contexts(tracked_plan, manipulator)
    assert len(contexts) == len(tracked_plan.moves)
    for move, context in zip(tracked_plan.moves, contexts, strict=True):
        found = context.prove(move.trajectory)
        assert found.is_clear, move.label
        assert move.proof is not None
        assert found.nearest.distance_m == pytest.approx(move.proof.nearest.distance_m, abs=SAME_M)


def test_only_moves_next_to_a_grip_may_touch_something(
    tracked_plan: Plan, manipulator: Manipulator
) -> None:
    contexts = move_contexts(tracked_plan, manipulator)
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
    again = evolve(last, label="again", trajectory=last.trajectory.reversed(), is_straight=False)
    plan = evolve(tracked_plan, steps=(*tracked_plan.steps, again))
    context = move_contexts(plan, manipulator)[-1]
    assert not context.checker.may_touch.any()
    near = context.prove(again.trajectory).nearest
    assert near.second == "block"
    assert near.distance_m < 0.003


def test_a_grip_that_misses_or_is_repeated_is_refused(
    tracked_plan: Plan, manipulator: Manipulator
) -> None:
    steps = list(tracked_plan.steps)
    close = next(s for s in steps if isinstance(s, Grip) and s.action is GripperAction.CLOSE)
    without = [s for s in steps if not isinstance(s, Move)]
    steps.insert(steps.index(close), close)
    for changed in (without, steps):
        with pytest.raises(TaskError, match="pick: close: the fingers cannot close on block"):
            move_contexts(evolve(tracked_plan, steps=tuple(changed)), manipulator)


def bare(plan: Plan) -> Plan:
    """As somebody writes it by hand."""
    return evolve(plan, steps=tuple(evolve(step, state=None) for step in plan))


def test_a_plan_written_by_hand_gets_what_the_planner_states(
    tracked_plan: Plan, manipulator: Manipulator
) -> None:
    found = complete(bare(tracked_plan), manipulator=manipulator)
    for step, planned in zip(found, tracked_plan, strict=True):
        assert step.contacts == planned.contacts, step.label
        assert step.state is not None
        assert planned.state is not None
        assert step.state.joints == planned.state.joints
        for body in step.state.scene:
            T = planned.state.scene[body.name].T_base_body
            assert np.array_equal(body.T_base_body.homogeneous, T.homogeneous)


def test_each_state_is_that_at_the_end_of_the_step_before(
    tracked_plan: Plan, manipulator: Manipulator
) -> None:
    arm, labels = manipulator.arm, [step.label for step in tracked_plan]
    states = dict(zip(labels, [step.state for step in tracked_plan], strict=True))
    assert states[labels[0]] is tracked_plan.start
    for move in tracked_plan.moves:
        assert move.state is not None
        assert move.state.q(arm.joint_names) == pytest.approx(move.trajectory.q_start)
    lifted, put = states["place: approach"], states["place: retract"]
    assert lifted is not None
    assert put is not None
    (held,) = lifted.attachments
    T_base_tip = arm.T_base_tip(lifted.q(arm.joint_names))
    assert lifted.scene["block"].T_base_body.isApprox(T_base_tip * held.T_link_body)
    assert put.attachments == ()
    assert put.joints["l_gripper_l_finger_joint"] > lifted.joints["l_gripper_l_finger_joint"]


def test_contacts_last_as_long_as_their_step(tracked_plan: Plan) -> None:
    for move in tracked_plan.moves:
        assert all(each.end_s == move.trajectory.duration for each in move.contacts)
    pairs = {step.label: [each.pair for each in step.contacts] for step in tracked_plan}
    assert pairs["pick: approach"] == pairs["place: approach"] == []
    assert pairs["pick: retract"] == ["block, part 1 and table, part 1"]
    assert pairs["pick: descend"][0] == "block and left hand"


def test_a_plan_for_another_world_is_completed_for_it(
    tracked_plan: Plan, manipulator: Manipulator
) -> None:
    start = tracked_plan.start.moved(manipulator.robot, {"head_pan": 0.1})
    found = complete(tracked_plan, start, manipulator=manipulator)
    assert {step.state.joints["head_pan"] for step in found if step.state} == {0.1}


@pytest.mark.parametrize("plan", [None, set(), True, np.zeros(3)], ids=str)
def test_only_plans_are_completed(plan: Any, manipulator: Manipulator, scene: Scene) -> None:
    with pytest.raises(TaskError):
        complete(plan, State.of(manipulator, scene), manipulator=manipulator)
