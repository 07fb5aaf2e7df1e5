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


def test_iterates_its_steps_in_order(plan: Plan, steps: tuple[Step, ...]) -> None:
    assert [step.label for step in plan] == [step.label for step in steps]


def test_its_moves_are_the_steps_of_the_arm(plan: Plan) -> None:
    assert [move.label for move in plan.moves] == ["there", "back"]


def test_motion_time_is_the_sum_of_its_moves(
    plan: Plan, there: Trajectory, back: Trajectory
) -> None:
    assert plan.motion_time_s == there.duration + back.duration


def test_clearance_is_the_least_of_its_moves(plan: Plan) -> None:
    assert plan.clearance == Clearance(0.01, "c", "d")


def test_clearance_of_unchecked_moves_is_none(left: Arm, there: Trajectory) -> None:
    assert Plan(state_at(left.neutral), (Move("there", there),)).clearance is None


def test_a_plan_with_a_failure_is_invalid_and_says_stage_and_reason(left: Arm) -> None:
    failure = PlanFailure("pick: descend", "the table is in the way by 3 mm")
    plan = Plan(state_at(left.neutral), (), failure, limb="left")
    assert not plan.is_valid
    assert str(plan.failure) == "pick: descend: the table is in the way by 3 mm"


def test_a_plan_without_failure_is_valid(plan: Plan) -> None:
    assert plan.is_valid


def test_a_plan_of_no_steps_takes_no_time(left: Arm) -> None:
    plan = Plan(state_at(left.neutral), (), limb="left")
    assert plan.is_valid
    assert plan.motion_time_s == 0.0


def test_a_move_that_starts_elsewhere_than_the_one_before_ended_is_refused(
    left: Arm, there: Trajectory
) -> None:
    with pytest.raises(TaskError, match=r"again starts \S+ rad from"):
        Plan(state_at(left.neutral), (Move("there", there), Move("again", there)))


def test_a_first_move_that_starts_elsewhere_than_the_plan_is_refused(
    left: Arm, there: Trajectory
) -> None:
    with pytest.raises(TaskError, match=r"there starts \S+ rad from"):
        Plan(state_at(left.start), (Move("there", there),))


@pytest.mark.parametrize("limb", ["middle", "", None, 5, ["left"], np.zeros(2)])
def test_an_unknown_limb_is_refused(left: Arm, limb: Any) -> None:
    with pytest.raises((TaskError, UnknownNameError), match="limb"):
        Plan(state_at(left.neutral), (), limb=limb)


@pytest.mark.parametrize("start", [None, "start", [0.0] * 7, State(Scene.of(), {"left_s0": 0.1})])
def test_a_start_without_the_arm_is_refused(start: Any) -> None:
    with pytest.raises(TaskError, match=r"start|no joint left_s1"):
        _ = Plan(start, (), limb="left").q_start


def test_the_limb_is_that_of_the_moves(left: Arm, there: Trajectory) -> None:
    assert Plan(state_at(left.neutral), (Move("there", there),)).limb == "left"


def test_a_gripper_action_is_of_the_limb_of_its_plan(left: Arm, there: Trajectory) -> None:
    start, opens = state_at(left.neutral), Grip("open", GripperAction.OPEN)
    plan = Plan(start, (Move("there", there), opens))
    assert [step.limb for step in plan] == ["left", "left"]
    with pytest.raises(TaskError, match="right gripper"):
        Plan(start, (Move("there", there), evolve(opens, limb="right")))


@pytest.mark.parametrize("values", [{"angle_rad": np.nan}, {"angle_rad": "1"}, {1: 0.5}, 5])
def test_a_claim_has_finite_numbers_by_name(values: Any) -> None:
    with pytest.raises(TaskError):
        Claim("upright", values)


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


@pytest.mark.parametrize("steps", [None, 5, "open", [None], ["open"]])
def test_invalid_steps_are_refused(left: Arm, steps: Any) -> None:
    with pytest.raises(TaskError, match="step"):
        Plan(state_at(left.neutral), steps)


class TestOpening:
    """Of a `Grip`."""

    def test_an_open_may_go_to_a_finger_position(self) -> None:
        assert Grip("open", GripperAction.OPEN, opening_m=0.012).opening_m == 0.012

    @pytest.mark.parametrize("opening_m", [-1e-9, math.nan, "wide"])
    def test_an_invalid_finger_position_is_refused(self, opening_m: Any) -> None:
        with pytest.raises(TaskError, match="open"):
            Grip("open", GripperAction.OPEN, opening_m=opening_m)

    def test_a_close_ends_where_the_body_is(self) -> None:
        with pytest.raises(TaskError, match="only an open goes to a finger position"):
            Grip("close", GripperAction.CLOSE, "block", opening_m=0.01)


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


def test_it_reads_as_one_sentence(manipulator: Manipulator, posts: CollisionContext) -> None:
    qs = sample_solutions(manipulator.ik, PICK)
    summary = CollisionSummary.of("pick: descend", qs, posts)
    text = str(summary)
    assert text.startswith(
        f"{summary.colliding} of {summary.solutions} IK solutions collide: left_"
    )
    assert "mm deep" in text


def test_only_the_most_frequent_are_named() -> None:
    counts = tuple(CollisionCount("link", f"post {i}", 9 - i, -0.001) for i in range(5))
    text = str(CollisionSummary("pick: descend", 50, counts))
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
