"""The referee of both arms contradicts plans that are wrong in known ways, and no right one."""

from __future__ import annotations

import importlib
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import LIMBS
from planner import (
    Attachment,
    Body,
    Box,
    Manipulator,
    Move,
    Part,
    Plan,
    Scene,
    State,
    TwoArmPlan,
    plan_handover,
    plan_joint_move,
    plan_pair_carry,
    plan_together,
)
from planner.clearance import Clearance, ContinuousProof
from planner.motion.paths.straight_line import DEFAULT_TOLERANCE
from planner.two_arms.pair import PairSearch
from planner.two_arms.problem import Problem, Requirements
from planner.two_arms.together import DEFAULT_GRIP_S
from tests.conftest import at
from tests.planner.two_arms.pair_moves import carries
from tests.planner.two_arms.pairs import handover_of_stick, pair, started

TURN_RAD = 0.25
"""Of the shoulder: then the forearms meet."""

CLOSER = "closer than the margin"


@pytest.fixture(scope="module")
def manipulators(robot: Baxter) -> dict[str, Manipulator]:
    return {side: Manipulator.of(robot, side) for side in LIMBS}


@pytest.fixture(scope="module")
def plan(manipulators: dict[str, Manipulator]) -> TwoArmPlan:
    """Each arm works on its own side."""
    left, right = ((0.65, 0.2, 0.0), (0.75, 0.4, 0.5)), ((0.75, -0.2, 0.3), (0.65, -0.4, 0.0))
    return plan_together(*pair(manipulators, left, right).arguments)


def check(plan: TwoArmPlan, **options: float) -> list[Any]:
    both_arms = importlib.import_module("referee.both_arms")
    found: list[Any] = both_arms.check_two_arm_plan(plan, **options)
    return found


@pytest.mark.slow
def test_a_right_plan_is_not_contradicted_nor_is_its_proof(plan: TwoArmPlan) -> None:
    assert plan.proof is not None
    assert check(plan, apart_m=plan.proof.proven_m) == []


@pytest.mark.slow
def test_a_plan_in_turn_is_not_contradicted_nor_is_its_proof(
    manipulators: dict[str, Manipulator],
) -> None:
    left, right = ((0.65, 0.2, 0.0), (0.75, 0.4, 0.5)), ((0.75, -0.2, 0.3), (0.65, -0.4, 0.0))
    tasks, arms, state = pair(manipulators, left, right)
    handled = {side: frozenset({side}) for side in LIMBS}
    requirements = Requirements(0.0, DEFAULT_GRIP_S, DEFAULT_TOLERANCE)
    plan = PairSearch(Problem(arms, state, handled, requirements), tasks).in_turn("as a test")
    assert plan.proof is not None
    assert plan.in_turn
    assert check(plan, apart_m=plan.proof.proven_m) == []


@pytest.mark.slow
def test_the_nearest_pair_of_a_proof_is_found_on_the_meshes(plan: TwoArmPlan) -> None:
    assert plan.proof is not None
    nearest = plan.proof.nearest
    found = check(plan, apart_m=nearest.distance_m + 2e-3)
    assert {each.kind for each in found} == {CLOSER}
    assert {nearest.first, nearest.second} in [{each.first, each.second} for each in found]
    assert min(each.amount for each in found) == pytest.approx(nearest.distance_m, abs=2e-3)


@pytest.mark.slow
def test_a_fault_of_one_arm_alone_is_said_with_the_arm(plan: TwoArmPlan) -> None:
    """The right arm's table is 2 cm higher than planned for, in its own world."""
    own = plan.plans["right"]
    table = own.start.scene["table"].T_base_body.copy()
    table.translation[2] += 0.02
    start = evolve(own.start, scene=own.start.scene.moved("table", table))
    broken = evolve(plan, plans={**plan.plans, "right": evolve(own, start=start)})
    found = check(broken)
    assert {each.label.split(",")[0] for each in found} == {"right arm"}
    assert "right" in {each.first for each in found} | {each.second for each in found}


@pytest.mark.slow
def test_a_step_that_begins_before_the_last_has_ended_is_found(plan: TwoArmPlan) -> None:
    early = dict(plan.begins_s)
    early["left"] = tuple(0.99 * begin_s for begin_s in early["left"])
    broken = evolve(plan)
    object.__setattr__(broken, "begins_s", early)  # it refuses them itself
    found = [each for each in check(broken) if each.kind == "begins too early"]
    assert {each.first for each in found} == {"left arm"}


def turning(start: State, robot: Baxter, turn_rad: float, wait_s: float) -> TwoArmPlan:
    """Both arms turn to the middle and back, the right one later; the proof is a lie."""
    plans = {}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        arm = robot.arm(side)
        q = np.array([arm.start, arm.start - sign * turn_rad * np.eye(7)[0], arm.start])
        ways = [plan_joint_move(*ends, arm.limits) for ends in pairwise(q)]
        plans[side] = Plan(start, tuple(Move("turn", way) for way in ways), limb=side)
    duration_s = plans["left"].moves[0].trajectory.duration
    begins = {"left": (0.0, duration_s), "right": (wait_s, wait_s + duration_s)}
    proof = ContinuousProof(0.01, Clearance(0.02, "left_hand", "right_hand", 1.0), 0.0, 10, 5)
    return TwoArmPlan(start, plans, begins, 0.5, proof)


def test_arms_that_meet_on_the_clock_are_found_and_not_where_they_take_turns(
    robot: Baxter, manipulators: dict[str, Manipulator]
) -> None:
    start = started(manipulators, Scene.of())
    found = check(turning(start, robot, TURN_RAD, 0.0))
    assert {each.kind for each in found} == {"touches"}
    forearms = {"left_lower_forearm", "right_lower_forearm"}
    assert forearms in [{each.first, each.second} for each in found]
    in_turn = turning(start, robot, TURN_RAD, 2.0)
    assert in_turn.begins_s["right"][0] > 2.0 * in_turn.begins_s["left"][1]
    assert check(in_turn) == []


def test_what_the_hands_hold_moves_with_them(
    robot: Baxter, manipulators: dict[str, Manipulator]
) -> None:
    """Two plates meet before the hands do, which turn halfway."""
    bodies, held = [], []
    for side, manipulator in manipulators.items():
        plate = Part(Box((0.23, 0.23, 0.01)), pin.SE3.Identity())
        arm, T_tip_plate = manipulator.arm, at(0.0, 0.0, 0.05)
        pose = arm.T_base_tip(arm.start) * T_tip_plate
        bodies.append(Body(f"{side} plate", (plate,), pose, is_movable=True))
        held.append(Attachment(f"{side} plate", arm.tip_frame, T_tip_plate))
    start = evolve(started(manipulators, Scene.of(bodies)), attachments=tuple(held))
    (found,) = check(turning(start, robot, TURN_RAD / 2.0, 0.0))
    assert (found.first, found.second) == ("left plate", "right plate")
    assert found.time_s > 0.1
    assert check(turning(start, robot, TURN_RAD / 2.0, 2.0)) == []


# A body that both arms handle


@pytest.fixture(scope="module")
def handover(manipulators: dict[str, Manipulator]) -> TwoArmPlan:
    """From the left hand to the right one."""
    return plan_handover(*handover_of_stick(manipulators))


@pytest.fixture(scope="module")
def carry(manipulators: dict[str, Manipulator]) -> TwoArmPlan:
    """A bar in both hands."""
    task, state = carries.bar(manipulators)
    return plan_pair_carry(task, manipulators, state)


def shifted(plan: TwoArmPlan, side: str, first: str, by_s: float, last: str = "") -> TwoArmPlan:
    """An arm does what it does from one step on, up to another one, later than planned."""
    labels = [step.label for step in plan.plans[side].steps]
    begins, end = list(plan.begins_s[side]), labels.index(last) if last else len(labels)
    for number in range(labels.index(first), end):
        begins[number] += by_s
    return evolve(plan, begins_s={**plan.begins_s, side: tuple(begins)})


def kinds(plan: TwoArmPlan) -> set[str]:
    return {each.kind for each in check(plan)}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["handover", "carry"])
def test_a_right_plan_of_one_body_is_not_contradicted_nor_is_its_proof(
    request: pytest.FixtureRequest, name: str
) -> None:
    plan: TwoArmPlan = request.getfixturevalue(name)
    assert plan.proof is not None
    assert check(plan, apart_m=plan.proof.proven_m) == []


@pytest.mark.slow
def test_a_body_that_is_released_before_the_other_hand_holds_it_is_found(
    handover: TwoArmPlan,
) -> None:
    for late in (
        shifted(handover, "right", "pick: close", 0.005),
        shifted(handover, "left", "place: open", -0.2),
    ):
        (found,) = check(late)
        assert (found.kind, found.first) == ("is held by nothing", "stick")
        assert found.amount > 0.05
        assert found.time_s == pytest.approx(release_s(late), abs=1e-3)


def release_s(plan: TwoArmPlan) -> float:
    """When the giver's hand opens."""
    return next(s.begin_s for s in plan.steps_of("left") if s.step.label == "place: open")


@pytest.mark.slow
def test_a_hand_that_moves_on_while_the_other_one_holds_the_body_is_found(
    handover: TwoArmPlan,
) -> None:
    closed_s = next(s.end_s for s in handover.steps_of("right") if s.step.label == "pick: close")
    leave_s = next(
        s.begin_s for s in handover.steps_of("right") if s.step.label == "place: approach"
    )
    early = shifted(handover, "right", "place: approach", closed_s - leave_s)
    found = next(each for each in check(early) if each.kind == "is held at two poses")
    assert closed_s < found.time_s < release_s(handover) + handover.grip_s


@pytest.mark.slow
def test_a_hand_in_the_way_of_the_body_is_found(handover: TwoArmPlan) -> None:
    """The right hand is where it takes the body before that comes."""
    early = shifted(handover, "right", "pick: approach", -1.0, "pick: close")
    found = check(early)
    assert {each.kind for each in found} == {"touches"}
    assert {each.first for each in found} == {"stick"}
    assert {each.second[:2] for each in found} == {"r_"}


@pytest.mark.slow
def test_a_hand_that_takes_the_body_elsewhere_than_planned_is_found(handover: TwoArmPlan) -> None:
    own = handover.plans["right"]
    T = own.start.scene["stick"].T_base_body * at(0.0, 0.0, 1e-4)
    start = evolve(own.start, scene=own.start.scene.moved("stick", T))
    broken = evolve(handover, plans={**handover.plans, "right": evolve(own, start=start)})
    assert kinds(broken) == {"is taken elsewhere than planned"}


@pytest.mark.slow
@pytest.mark.parametrize("first", ["pick: open", "place: approach"])
def test_hands_that_carry_one_body_at_different_times_are_found(
    carry: TwoArmPlan, first: str
) -> None:
    for late_s in (0.005, 0.1):
        assert "is held at two poses" in kinds(shifted(carry, "right", first, late_s))


@pytest.mark.slow
def test_a_hand_that_never_opens_is_refused(handover: TwoArmPlan) -> None:
    own, begins = handover.plans["left"], handover.begins_s["left"]
    kept = evolve(
        handover,
        plans={**handover.plans, "left": evolve(own, steps=own.steps[:-2])},
        begins_s={**handover.begins_s, "left": begins[:-2]},
    )
    with pytest.raises(ValueError, match="both arms handle stick"):
        check(kept)
