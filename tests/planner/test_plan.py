"""Plan: steps that fit together, or none at all."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from baxter_kin import Arm
from baxter_kin.errors import ConfigurationError, UnknownNameError
from baxter_kin.fields import evolve
from baxter_kin.ik import sample_solutions
from planner import (
    Body,
    Box,
    Claim,
    Grip,
    GripperAction,
    Manipulator,
    Move,
    Part,
    Plan,
    PlanFailure,
    Scene,
    State,
    Trajectory,
    plan_joint_move,
)
from planner.clearance import ContinuousContact
from planner.collision import Clearance
from planner.collision.context import CollisionContext
from planner.errors import TaskError
from planner.plan import MAX_MEASURED, MAX_NAMED, CollisionCount, CollisionSummary, Step
from tests.conftest import at, overhead, state_at


@pytest.fixture(scope="module")
def there(left: Arm) -> Trajectory:
    return plan_joint_move(left.neutral, left.start, left.limits)


@pytest.fixture(scope="module")
def back(left: Arm) -> Trajectory:
    return plan_joint_move(left.start, left.neutral, left.limits)


@pytest.fixture(scope="module")
def steps(there: Trajectory, back: Trajectory) -> tuple[Step, ...]:
    return (
        Grip("open", GripperAction.OPEN),
        Move("there", there, clearance=Clearance(0.02, "a", "b")),
        Grip("close", GripperAction.CLOSE, "block"),
        Move("back", back, clearance=Clearance(0.01, "c", "d")),
    )


@pytest.fixture(scope="module")
def plan(left: Arm, steps: tuple[Step, ...]) -> Plan:
    return Plan(state_at(left.neutral), steps)


def test_a_plan_sums_up_its_moves(
    plan: Plan, steps: tuple[Step, ...], there: Trajectory, back: Trajectory
) -> None:
    assert [step.label for step in plan] == [step.label for step in steps]
    assert [move.label for move in plan.moves] == ["there", "back"]
    assert plan.motion_time_s == there.duration + back.duration
    assert plan.clearance == Clearance(0.01, "c", "d")
    assert plan.limb == "left"
    assert plan.is_valid


def test_a_plan_without_moves_or_checks(left: Arm, there: Trajectory) -> None:
    failure = PlanFailure("pick: descend", "the table is in the way by 3 mm")
    for failed in (None, failure):
        empty = Plan(state_at(left.neutral), (), failed, limb="left")
        assert empty.is_valid is (failed is None)
        assert empty.motion_time_s == 0.0
    assert str(failure) == "pick: descend: the table is in the way by 3 mm"
    assert Plan(state_at(left.neutral), (Move("there", there),)).clearance is None


def test_moves_begin_where_the_arm_is(left: Arm, there: Trajectory) -> None:
    with pytest.raises(TaskError, match="again starts"):
        Plan(state_at(left.neutral), (Move("there", there), Move("again", there)))
    with pytest.raises(TaskError, match="there starts"):
        Plan(state_at(left.start), (Move("there", there),))


@pytest.mark.parametrize(
    "make",
    [
        *(lambda start, x=x: Plan(start, (), limb=x) for x in ("middle", "", None, 5, np.zeros(2))),
        *(lambda start, x=x: Plan(start, x) for x in (None, 5, "open", [None], ["open"])),
        *(
            lambda _, x=x: Claim("upright", x)
            for x in ({"angle_rad": np.nan}, {"angle_rad": "1"}, {1: 0.5}, 5)
        ),
        *(
            lambda _, x=x: Grip("open", GripperAction.OPEN, opening_m=x)
            for x in (-1e-9, math.nan, "wide")
        ),
        lambda _: Grip("close", GripperAction.CLOSE, "block", opening_m=0.01),
    ],
)
def test_refuses_invalid_limbs_steps_claims_and_openings(left: Arm, make: Any) -> None:
    with pytest.raises((TaskError, UnknownNameError)):
        make(state_at(left.neutral))
    assert Grip("open", GripperAction.OPEN, opening_m=0.012).opening_m == 0.012


@pytest.mark.parametrize("start", [None, "start", [0.0] * 7, State(Scene.of(), {"left_s0": 0.1})])
def test_a_start_without_the_arm_is_refused(start: Any) -> None:
    with pytest.raises(TaskError, match=r"start|no joint left_s1"):
        _ = Plan(start, (), limb="left").q_start


def test_a_gripper_action_is_of_the_limb_of_its_plan(left: Arm, there: Trajectory) -> None:
    start, opens = state_at(left.neutral), Grip("open", GripperAction.OPEN)
    plan = Plan(start, (Move("there", there), opens))
    assert [step.limb for step in plan] == ["left", "left"]
    with pytest.raises(TaskError, match="right gripper"):
        Plan(start, (Move("there", there), evolve(opens, limb="right")))


def test_states_are_kept_only_where_they_follow_from_the_start(
    left: Arm, there: Trajectory, back: Trajectory
) -> None:
    start, at_goal = state_at(there.q_start), state_at(there.q_goal)
    known = Move("there", there, state=start), Move("back", back, state=at_goal)
    assert [move.state for move in Plan(start, known)] == [start, at_goal]
    assert [move.state for move in Plan(state_at(left.neutral), known)] == [None, None]
    assert [move.state for move in Plan(start, (known[0], evolve(known[1], state=start)))] == [
        *(None, None),
    ]
    partly = evolve(known[0]), evolve(known[1], state=None)
    assert [move.state for move in Plan(start, partly)] == [None, None]


def test_a_failure_names_all_collisions_of_its_attempts() -> None:
    contact = ContinuousContact(Clearance(-0.01, "left_wrist", "table", 0.5), 0.0, 1.0, 9, 9)
    counts = CollisionCount("left_hand", "wall", 3, -0.02), CollisionCount("a", "wall", 1, -0.1)
    tallies = (CollisionSummary("place: descend", 9, counts),)
    tried = (PlanFailure("pick: descend", "blocked", contact=contact),)
    failure = PlanFailure("place: descend", "blocked", tried=tried, tallies=tallies)
    assert failure.colliding == {"left_wrist", "table", "left_hand", "wall", "a"}
    assert PlanFailure("open", "no reason").colliding == frozenset()


COAL_M = 1e-6
"""Where coal's iterations end; they start from where the last query ended."""

PICK = overhead(0.70, 0.15, -0.129)


def post(name: str, x: float, y: float) -> Body:
    return Body(name, (Part(Box((0.03, 0.03, 0.6)), at(0.0, 0.0, 0.0)),), at(x, y, 0.2))


@pytest.fixture
def posts(manipulator: Manipulator, scene: Scene) -> CollisionContext:
    crowded = scene.with_body(post("front", 0.45, 0.25)).with_body(post("side", 0.6, 0.42))
    return manipulator.context(crowded, finger_m=manipulator.hand.stroke_m, touchable="block")


def test_counts_are_those_of_a_check_pair_by_pair(
    manipulator: Manipulator, posts: CollisionContext
) -> None:
    qs = sample_solutions(manipulator.ik, PICK)
    summary = CollisionSummary.of("pick: descend", qs, posts)
    nearest = [posts.clearance(q) for q in qs]
    blocked = [near for near in nearest if near.distance_m <= 0.0]
    assert summary.solutions == len(qs) <= MAX_MEASURED
    assert 0 < summary.colliding < summary.solutions
    assert summary.colliding == len(blocked)
    for collision in summary.collisions:
        alike = [n for n in blocked if (n.first, n.second) == (collision.first, collision.second)]
        assert collision.count == len(alike)
        nearest_m = max(near.distance_m for near in alike)
        assert collision.distance_m == pytest.approx(nearest_m, abs=COAL_M)


def test_a_summary_is_a_sentence_that_names_the_most_frequent(
    manipulator: Manipulator, posts: CollisionContext
) -> None:
    summary = CollisionSummary.of("pick: descend", sample_solutions(manipulator.ik, PICK), posts)
    counts = f"{summary.colliding} of {summary.solutions} IK solutions collide: left_"
    assert str(summary).startswith(counts)
    assert "mm deep" in str(summary)
    many = tuple(CollisionCount("link", f"post {i}", 9 - i, -0.001) for i in range(5))
    text = str(CollisionSummary("pick: descend", 50, many))
    assert text.count("link with post") == MAX_NAMED
    assert text.endswith("; 2 other pairs")


def test_a_summary_with_a_margin_states_the_distance(
    manipulator: Manipulator, scene: Scene
) -> None:
    around = manipulator.context(
        scene, finger_m=manipulator.hand.stroke_m, touchable="block", margin_m=0.05
    )
    text = str(CollisionSummary.of("pick: descend", sample_solutions(manipulator.ik, PICK), around))
    assert "finger_tip with table, at best 22.1 mm apart" in text


def test_many_solutions_are_thinned_evenly(
    manipulator: Manipulator, posts: CollisionContext
) -> None:
    qs = sample_solutions(manipulator.ik, PICK, turns=400)
    assert len(qs) > MAX_MEASURED
    assert CollisionSummary.of("pick: descend", qs, posts).solutions == MAX_MEASURED


def test_malformed_solutions_are_refused(posts: CollisionContext) -> None:
    for bad in ("qs", [[np.nan] * 7], [[0.0] * 6]):
        with pytest.raises(ConfigurationError):
            CollisionSummary.of("pick: descend", bad, posts)
