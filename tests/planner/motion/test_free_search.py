"""Free moves of both arms, compared with distances by Pinocchio and coal at dense instants."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter, JointLimits
from baxter_kin.validation import FloatArray
from planner import (
    Body,
    Manipulator,
    Scene,
    State,
    context_of_both,
    limits_of_both,
    plan_free_move,
    plan_joint_move,
)
from planner.clearance import ContinuousProof
from planner.collision.checker import ClearanceChecker
from planner.collision.context import CollisionContext, Touches, sample_times
from planner.errors import FreeMoveError, MotionError, SceneError
from planner.motion.joint_move import RATIO_TOLERANCE
from planner.motion.upright import Upright
from tests.planner.ompl import needs_ompl

DENSE_RAD = 0.01

GJK_M = 1e-5
"""Difference of distances by coal and of the proof's clusters."""


@pytest.fixture(scope="module")
def manipulators(robot: Baxter) -> dict[str, Manipulator]:
    return {side: Manipulator.of(robot, side) for side in ("left", "right")}


@pytest.fixture(scope="module")
def limits(manipulators: dict[str, Manipulator]) -> JointLimits:
    return limits_of_both(manipulators)


@pytest.fixture(scope="module")
def context(manipulators: dict[str, Manipulator], table: Body) -> CollisionContext:
    return context_of_both(manipulators, State.of(manipulators["left"], Scene.of([table])))


def ends_near_neutral(robot: Baxter, limits: JointLimits, seed: int) -> tuple[FloatArray, ...]:
    """Random configurations of both arms in front of the robot, where they often meet."""
    rng = np.random.default_rng(seed)
    neutral = np.concatenate([robot.arm(side).neutral for side in ("left", "right")])
    first, last = ((neutral + rng.uniform(-1.2, 1.2, 14)) for _ in range(2))
    return first.clip(limits.q_min, limits.q_max), last.clip(limits.q_min, limits.q_max)


@needs_ompl
@pytest.mark.parametrize("seed", [13, 39, 70, 156, 174])
def test_two_arms_whose_straight_lines_meet_pass_each_other_at_a_proven_distance(
    robot: Baxter, limits: JointLimits, context: CollisionContext, seed: int
) -> None:
    """Its duration is hardly more than that of the straight lines, which is a bound."""
    q_start, q_goal = ends_near_neutral(robot, limits, seed)
    straight = plan_joint_move(q_start, q_goal, limits)
    assert not context.is_clear(straight)
    motion = plan_free_move(q_start, q_goal, limits, context)
    assert straight.duration <= motion.duration <= 1.15 * straight.duration
    np.testing.assert_array_equal([motion.q_start, motion.q_goal], [q_start, q_goal])
    assert max(motion.peak_ratios()) <= 1.0 + RATIO_TOLERANCE
    proof = context.prove(motion)
    assert isinstance(proof, ContinuousProof)
    assert proof.proven_m > 0.0
    touches = Touches(context.checker, max(proof.proven_m - GJK_M - thickness(context), 0.0))
    full = context.q_others
    where = list(robot.indices(limits.names))
    for q in motion.sample(sample_times(motion, DENSE_RAD)).q:
        full[where] = q
        assert not touches(full)


def thickness(context: CollisionContext) -> float:
    """Maximum distance of meshes outside coal's shapes, which proofs count and contacts do not."""
    return float(context.checker.checked.thickness_m.max())


def test_arms_that_do_not_meet_move_as_if_alone(
    robot: Baxter, limits: JointLimits, context: CollisionContext
) -> None:
    """Each arm's clear straight line, and so the straight line of all joints."""
    q_start = np.concatenate([robot.arm(side).neutral for side in ("left", "right")])
    q_goal = q_start + 0.2
    motion = plan_free_move(q_start, q_goal, limits, context)
    np.testing.assert_array_equal(motion.q, plan_joint_move(q_start, q_goal, limits).q)


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({"upright": Upright()}, MotionError),
        ({"q_goal": np.zeros(7)}, ValueError),
        ({"q_start": "hands crossed"}, FreeMoveError),
    ],
)
def test_refuses_what_both_arms_cannot_do(
    robot: Baxter,
    limits: JointLimits,
    context: CollisionContext,
    changes: dict[str, Any],
    error: type[Exception],
) -> None:
    neutral = np.concatenate([robot.arm(side).neutral for side in ("left", "right")])
    crossed = neutral.copy()
    crossed[[0, 7]] = -1.2, 1.2
    given = {"q_start": neutral, "q_goal": neutral + 0.1, "limits": limits, "context": context}
    given |= changes
    if isinstance(given["q_start"], str):
        given["q_start"] = crossed
    with pytest.raises(error):
        plan_free_move(**given)  # type: ignore[arg-type]


def test_one_arm_alone_is_free_where_only_the_other_is_in_the_way(
    robot: Baxter, limits: JointLimits, context: CollisionContext
) -> None:
    """Also while the other arm stands where it is out of the way."""
    crossed = np.concatenate([robot.arm(side).neutral for side in ("left", "right")])
    crossed[[0, 7]] = -1.2, 1.2
    assert not context.is_free(crossed)
    left, right = np.split(crossed, 2)
    assert context.alone("left").is_free(left)
    assert context.alone("right").is_free(right)
    assert not context.alone("left", right).is_free(left)
    assert context.alone("left", robot.arm("right").neutral).is_free(left)


def test_two_moving_hands_have_no_touchable_body(context: CollisionContext, table: Body) -> None:
    checker = context.checker
    with pytest.raises(SceneError, match="both arms move"):
        ClearanceChecker(checker.shapes, checker.mover, Scene.of([table]), touchable=table.name)
