"""Both hands pick a body up, carry it, and put it down; and what they refuse."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.errors import ConfigurationError, PoseError
from baxter_kin.fields import evolve
from planner import (
    Attachment,
    Body,
    Box,
    Line,
    Manipulator,
    Move,
    PairCarry,
    Part,
    TwoArmPlan,
    plan_pair_carry,
)
from planner.completion import after, state_of
from planner.errors import MotionError, SceneError, TaskError
from tests.conftest import at
from tests.planner.two_arms.pair_moves import carries
from tests.planner.two_arms.pairs import SIDES

PLANS = ("bar_plan", "tray_plan")
TASKS = {"bar_plan": carries.bar, "tray_plan": carries.tray}

PLACE_M = 1e-5
"""Bodies end where they were asked to within this; a body settles to 1e-5 m."""


@pytest.mark.parametrize("name", PLANS)
def test_both_hands_do_the_same_at_the_same_times(
    request: pytest.FixtureRequest, manipulators: Mapping[str, Manipulator], name: str
) -> None:
    plan: TwoArmPlan = request.getfixturevalue(name)
    assert plan.is_valid, plan.failure
    left, right = (plan.steps_of(side) for side in SIDES)
    assert [each.begin_s for each in left] == [each.begin_s for each in right]
    assert [each.step.label for each in left] == [each.step.label for each in right]
    task, state = TASKS[name](manipulators)
    for side in SIDES:
        steps = plan.plans[side].steps
        assert all(step.proof is not None for step in steps)
        end = after(steps[-1], state_of(steps[-1]), manipulators[side]).scene[task.body]
        assert np.allclose(end.T_base_body, task.T_base_place, atol=PLACE_M)
    assert plan.start.scene[task.body].T_base_body == state.scene[task.body].T_base_body


@pytest.mark.parametrize("name", PLANS)
def test_the_body_is_lifted_and_lowered_straight(
    request: pytest.FixtureRequest,
    robot: Baxter,
    manipulators: Mapping[str, Manipulator],
    name: str,
) -> None:
    plan: TwoArmPlan = request.getfixturevalue(name)
    task, state = TASKS[name](manipulators)
    start, place = state.scene[task.body].T_base_body, task.T_base_place
    for label, at_rest in (("pick: retract", start), ("place: descend", place)):
        for side in SIDES:
            move = next(step for step in plan.plans[side].moves if step.label == label)
            T_tip_body = task.T_body_tips[side].inverse()
            qs = move.trajectory.sample(np.linspace(0.0, move.trajectory.duration, 200)).q
            poses = robot.arm(side).T_base_tips(qs) @ T_tip_body.homogeneous
            off = poses[:, :3, 3] - at_rest.translation
            assert np.abs(off[:, :2]).max() < 2e-4
            assert off[:, 2].max() == pytest.approx(task.clear_m, abs=1e-5)
            assert any(claim.kind == "straight" for claim in move.claims)


def lower(tips: Mapping[str, pin.SE3], by_m: float) -> dict[str, pin.SE3]:
    """Grasps that are not in the middle between the fingers."""
    return {side: T * at(0.0, by_m, 0.0) for side, T in tips.items()}


def test_a_task_that_cannot_be_done_says_why(manipulators: dict[str, Manipulator]) -> None:
    task, state = carries.bar(manipulators)
    block = Body(
        "block",
        (Part(Box((0.03, 0.03, 0.03)), pin.SE3.Identity()),),
        at(0.6, 0.0, task.T_base_place.translation[2] + 0.03),
        is_movable=True,
    )
    loaded = evolve(state, scene=state.scene.with_body(block))
    for other, given, stage, reason in (
        (evolve(task, T_body_tips=lower(task.T_body_tips, 1e-3)), state, "pick: close", "push"),
        (evolve(task, T_body_tips=lower(task.T_body_tips, 0.1)), state, "pick: close", "miss"),
        (evolve(task, T_base_place=at(0.7, 0.1, 0.2)), state, "place: open", "fall"),
        (evolve(task, T_base_place=at(1.25, 0.0, -0.14)), state, "place: ", "reach|beyond"),
        (task, loaded, "pick: retract", "block stands on bar"),
    ):
        plan = plan_pair_carry(other, manipulators, given)
        assert plan.failure is not None
        assert plan.failure.stage.startswith(stage)
        assert any(word in plan.failure.reason for word in reason.split("|")), plan.failure.reason
        assert not any(each.steps for each in plan.plans.values())


def test_moves_are_those_of_plain_plans(tray_plan: TwoArmPlan) -> None:
    labels = [step.label for step in tray_plan.plans["left"] if isinstance(step, Move)]
    assert labels == [
        "pick: approach",
        "pick: descend",
        "pick: retract",
        "place: approach",
        "place: descend",
        "place: retract",
    ]


T = at(0.7, 0.1, -0.14)


@pytest.mark.parametrize(
    ("values", "error"),
    [
        ({"body": 3}, TaskError),
        ({"T_body_tips": {"left": T}}, TaskError),
        ({"T_body_tips": [T, T]}, TaskError),
        ({"T_body_tips": {"left": T, "right": "there"}}, PoseError),
        ({"T_base_place": None}, PoseError),
        ({"clear_m": 0.0}, TaskError),
        ({"clear_m": 1e4}, TaskError),
        ({"approach": 0.1}, TaskError),
        ({"is_straight": "yes"}, TaskError),
        ({"upright": 0.1}, TaskError),
    ],
)
def test_refused_tasks(values: dict[str, Any], error: type[Exception]) -> None:
    given = {"body": "bar", "T_body_tips": carries.BAR_TIPS, "T_base_place": T}
    assert PairCarry(**given).approach == Line("tool", 0.08)
    with pytest.raises(error):
        PairCarry(**{**given, **values})


def test_refused_arguments(manipulators: dict[str, Manipulator]) -> None:
    task, state = carries.bar(manipulators)
    link = manipulators["left"].arm.tip_frame
    held = evolve(state, attachments=(Attachment("bar", link, pin.SE3.Identity()),))
    outside = evolve(state, joints={**state.joints, "left_e1": 4.0})
    for arguments, options, error in (
        (("carry", manipulators, state), {}, TaskError),
        ((task, {"left": manipulators["left"]}, state), {}, TaskError),
        ((task, manipulators, "here"), {}, TaskError),
        ((task, manipulators, held), {}, TaskError),
        ((task, manipulators, outside), {}, ConfigurationError),
        ((evolve(task, body="table"), manipulators, state), {}, TaskError),
        ((evolve(task, body="rod"), manipulators, state), {}, SceneError),
        ((task, manipulators, state), {"grip_s": 0.1}, TaskError),
        ((task, manipulators, state), {"margin_m": -0.1}, MotionError),
    ):
        with pytest.raises(error):
            plan_pair_carry(*arguments, **options)  # type: ignore[arg-type]
