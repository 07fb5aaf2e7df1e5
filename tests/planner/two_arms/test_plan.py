"""TwoArmPlan: the laws of the clock, and what it refuses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from planner import Grip, GripperAction, Move, Plan, PlanFailure, TwoArmPlan, plan_joint_move
from planner.clearance import Clearance, ContinuousProof
from planner.errors import TaskError
from planner.trajectory import between
from tests.conftest import state_at

PROOF = ContinuousProof(0.01, Clearance(0.02, "left_hand", "right_hand", 1.0), 0.0, 10, 5)
GRIP_S = 0.5
FAILURE = PlanFailure("pick: close", "both hands cannot be there at once")


@pytest.fixture(scope="module")
def plans(robot: Baxter) -> dict[str, Plan]:
    """Each arm opens its hand and moves, the right one to and fro."""
    found = {}
    for side in ("right", "left"):
        arm = robot.arm(side)
        there = plan_joint_move(arm.neutral, arm.start, arm.limits)
        moves = [Move("there", there), Move("back", there.reversed())]
        grip = Grip("open", GripperAction.OPEN)
        found[side] = Plan(state_at(arm.neutral, side), (grip, *moves[: 1 + (side == "right")]))
    return found


@pytest.fixture(scope="module")
def begins(plans: dict[str, Plan]) -> dict[str, tuple[float, ...]]:
    back_s = 1.0 + plans["right"].moves[0].trajectory.duration + 0.3
    return {"left": (0.25, 0.9), "right": (0.0, 1.0, back_s)}


@pytest.fixture(scope="module")
def plan(plans: dict[str, Plan], begins: dict[str, tuple[float, ...]]) -> TwoArmPlan:
    return TwoArmPlan(plans["left"].start, plans, begins, GRIP_S, PROOF)


def test_the_trajectory_is_both_arms_on_the_clock(plan: TwoArmPlan) -> None:
    motion = plan.trajectory
    assert motion.duration == pytest.approx(plan.duration_s, abs=1e-9)
    assert list(plan.plans) == ["left", "right"]
    for begin_s, end_s, side, step in plan.steps:
        if isinstance(step, Move):
            times = np.linspace(0.0, step.trajectory.duration, 200)
            found = motion.sample(np.minimum(begin_s + times, motion.duration))
            expected, columns = step.trajectory.sample(times), slice(0, 7)
            if side == "right":
                columns = slice(7, 14)
            np.testing.assert_allclose(found.q[:, columns], expected.q, atol=1e-9)
            np.testing.assert_allclose(found.v[:, columns], expected.v, atol=1e-7)
            assert end_s - begin_s == pytest.approx(step.trajectory.duration)
        else:
            assert end_s - begin_s == GRIP_S
            where = slice(0, 7) if side == "left" else slice(7, 14)
            speeds = motion.sample(np.linspace(begin_s, end_s, 50)).v[:, where]
            np.testing.assert_allclose(speeds, 0.0, atol=1e-9)
    assert max(motion.peak_ratios()) <= 1.0 + 1e-9


def test_a_part_of_the_clock_is_the_same_motion(plan: TwoArmPlan) -> None:
    motion = plan.trajectory
    part = between(motion, 0.7, 2.1)
    times = np.linspace(0.0, 1.4, 100)
    np.testing.assert_allclose(part.sample(times).q, motion.sample(0.7 + times).q, atol=1e-12)


def test_steps_are_in_the_order_of_the_clock(plan: TwoArmPlan) -> None:
    assert [(each.side, each.step.label) for each in plan.steps] == [
        ("right", "open"),
        ("left", "open"),
        ("left", "there"),
        ("right", "there"),
        ("right", "back"),
    ]
    assert plan.is_valid
    assert repr(plan).startswith("TwoArmPlan(")


@pytest.mark.parametrize(
    "changes",
    [
        {"begins_s": {"left": (0.0, 0.4), "right": (0.0, 1.0, 9.0)}},  # while the hand opens
        {"begins_s": {"left": (0.0, 1.0), "right": (0.0, 1.0, 1.1)}},  # before a move has ended
        {"begins_s": {"left": (-0.1, 1.0), "right": (0.0, 1.0, 9.0)}},
        {"begins_s": {"left": (0.0,), "right": (0.0, 1.0, 9.0)}},
        {"begins_s": {"left": (0.0, 1.0)}},
        {"begins_s": {"left": (0.0, np.nan), "right": (0.0, 1.0, 9.0)}},
        {"begins_s": {"left": ("0", "1"), "right": (0.0, 1.0, 9.0)}},
        {"grip_s": -1.0},
        {"grip_s": np.inf},
        {"proof": None},
        {"plans": {}},
        {"in_turn": None},
        {"failure": "none"},
        {"start": None},
    ],
)
def test_what_is_no_plan_of_both_arms(plan: TwoArmPlan, changes: dict[str, Any]) -> None:
    with pytest.raises(TaskError):
        evolve(plan, **changes)


def test_plans_of_the_wrong_arm_or_invalid_ones_are_refused(plan: TwoArmPlan) -> None:
    left, right = plan.plans["left"], plan.plans["right"]
    with pytest.raises(TaskError):
        evolve(plan, plans={"left": right, "right": left})
    failed = {"left": evolve(left, failure=FAILURE), "right": right}
    with pytest.raises(TaskError):
        evolve(plan, plans=failed)
    assert not evolve(plan, plans=failed, failure=FAILURE, proof=None).is_valid
