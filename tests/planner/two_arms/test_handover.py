"""Handovers: the plan, its independent check, and what is refused."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, BaxterError
from baxter_kin.errors import UnknownNameError
from baxter_kin.fields import evolve
from planner import (
    Grip,
    GripperAction,
    Handover,
    Manipulator,
    Move,
    Plan,
    TwoArmPlan,
    load_two_arm_plan,
    overhead_grasp,
    plan_handover,
    save_two_arm_plan,
    verify,
    verify_both,
)
from planner.certificate.checking import check_both
from planner.certificate.errors import NotCertifiedError
from planner.completion import after, complete, state_of
from planner.errors import TaskError
from planner.motion.joint_move import rest_to_rest_s
from planner.two_arms.handover.meeting import Ends, meetings
from planner.two_arms.plan import TimedStep
from planner.two_arms.plan_file import two_arm_document
from planner.verification import certificate_of_both
from tests.planner.two_arms.pairs import HandoverCase, handover_of_stick

Data = dict[str, Any]
Change = Callable[[Data], None]


def grips(plan: TwoArmPlan, side: str) -> list[TimedStep]:
    """The gripper actions of an arm on a body."""
    return [s for s in plan.steps_of(side) if isinstance(s.step, Grip) and s.step.body is not None]


def q_at(plan: TwoArmPlan, side: str, time_s: float) -> np.ndarray:
    """The configuration of an arm at a time, from its moves alone."""
    q = plan.plans[side].q_start
    for timed in plan.steps_of(side):
        if isinstance(timed.step, Move) and timed.begin_s <= time_s:
            motion = timed.step.trajectory
            q = motion.sample(min(time_s - timed.begin_s, motion.duration)).q
    return q


def test_the_other_arm_brings_it_where_the_first_one_cannot(
    stick_handover: HandoverCase, handover_plan: TwoArmPlan
) -> None:
    task, manipulators, state = stick_handover
    giver = manipulators["left"]
    placed = state.scene["stick"].at(task.T_base_goal)
    assert not giver.ik.solve(overhead_grasp(giver.hand, placed)).is_valid
    assert handover_plan.is_valid
    last = handover_plan.plans["right"].steps[-1]
    end = after(last, state_of(last), manipulators["right"]).scene["stick"]
    np.testing.assert_allclose(end.T_base_body.homogeneous, task.T_base_goal.homogeneous, atol=1e-6)


def test_both_hands_hold_it_at_one_place_when_one_lets_go(
    robot: Baxter, handover_plan: TwoArmPlan
) -> None:
    gives, takes = grips(handover_plan, "left")[-1], grips(handover_plan, "right")[0]
    assert isinstance(gives.step, Grip)
    assert gives.step.receiver == "right"
    assert takes.end_s <= gives.begin_s + 1e-9
    still = [q_at(handover_plan, "left", t) for t in (takes.begin_s, gives.end_s)]
    np.testing.assert_array_equal(still[0], still[1])
    still = [q_at(handover_plan, "right", t) for t in (takes.end_s, gives.end_s)]
    np.testing.assert_array_equal(still[0], still[1])
    held = []
    for side, grip in (("left", grips(handover_plan, "left")[0]), ("right", takes)):
        state = after(grip.step, state_of(grip.step), Manipulator.of(robot, side))
        attached = state.holding(side)
        assert attached is not None
        T_base_tip = robot.arm(side).T_base_tip(q_at(handover_plan, side, gives.begin_s))
        held.append((T_base_tip * attached.T_link_body).homogeneous)
    np.testing.assert_allclose(held[0], held[1], atol=1e-6)


def test_it_is_certified_and_kept_in_a_file(handover_plan: TwoArmPlan, tmp_path: Path) -> None:
    certificate = verify_both(handover_plan)
    assert certificate.is_valid, certificate.verdict
    assert handover_plan.proof is not None
    assert certificate.clearance_m > 0.0
    save_two_arm_plan(handover_plan, tmp_path / "handover.json")
    read = load_two_arm_plan(tmp_path / "handover.json")
    assert two_arm_document(read) == two_arm_document(handover_plan)


@pytest.fixture(scope="module")
def document(handover_plan: TwoArmPlan) -> Data:
    return {**two_arm_document(handover_plan), "certificate": certificate_of_both(handover_plan)}


def release_of(document: Data) -> Data:
    """The release to the other hand."""
    steps = document["plan"]["plans"]["left"]["steps"]
    found: Data = next(step for step in steps if step.get("receiver"))
    return found


def opens_earlier(by_s: float) -> Change:
    """Let the giver let go, and leave, earlier."""

    def change(document: Data) -> None:
        steps = document["plan"]["plans"]["left"]["steps"]
        begins = document["plan"]["begins_s"]["left"]
        first = steps.index(release_of(document))
        document["plan"]["begins_s"]["left"] = [
            begin_s - by_s * (number >= first) for number, begin_s in enumerate(begins)
        ]

    return change


def leaves_earlier(by_s: float) -> Change:
    """Let the taker leave earlier."""

    def change(document: Data) -> None:
        steps = document["plan"]["plans"]["right"]["steps"]
        begins = document["plan"]["begins_s"]["right"]
        close = next(k for k, step in enumerate(steps) if step.get("action") == "CLOSE")
        document["plan"]["begins_s"]["right"] = [
            begin_s - by_s * (number > close) for number, begin_s in enumerate(begins)
        ]

    return change


def elsewhere(by_m: float) -> Change:
    """Let the body of the taker's world stand beside where the giver holds it."""

    def change(document: Data) -> None:
        start = document["plan"]["plans"]["right"]["start"]
        start["scene"]["bodies"]["stick"]["T_base_body"]["translation"][0] += by_m

    return change


def put_down(document: Data) -> None:
    """Let the giver put it down, with nothing below."""
    release_of(document)["receiver"] = ""


def hardly_opens(document: Data) -> None:
    """Let the giver's fingers open by a nanometre, so that they still hold the body."""
    closed = next(
        change["joints"]["l_gripper_l_finger_joint"]
        for change in document["states"]["left"]
        if change["attachments"]
    )
    release_of(document)["opening_m"] = closed + 1e-9


def to_itself(document: Data) -> None:
    release_of(document)["receiver"] = "left"


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        pytest.param(opens_earlier(0.05), "order", id="the giver lets go before the taker closes"),
        pytest.param(leaves_earlier(0.6), "order", id="the taker leaves while the giver opens"),
        pytest.param(elsewhere(1e-4), "stick", id="the hands hold it at two places"),
        pytest.param(put_down, "fall", id="nobody holds it"),
        pytest.param(hardly_opens, "do not open so", id="a hand opens and holds on"),
        pytest.param(to_itself, "hands a body over to", id="a hand gives to itself"),
    ],
)
def test_another_handover_is_refused(
    robot: Baxter, document: Data, change: Change, reason: str
) -> None:
    edited = copy.deepcopy(document)
    change(edited)
    with pytest.raises(NotCertifiedError, match=reason):
        check_both(edited, robot.description.text)


def test_the_plan_of_one_arm_hands_nothing_over(handover_plan: TwoArmPlan) -> None:
    assert not verify(handover_plan.plans["left"]).is_valid


def test_it_happens_where_it_is_asked_to(stick_handover: HandoverCase) -> None:
    task, manipulators, state = stick_handover
    plan = plan_handover(evolve(task, where=(0.7, 0.05, 0.15)), manipulators, state)
    assert plan.is_valid, plan.failure
    handed = plan.plans["right"].start.scene["stick"].T_base_body
    np.testing.assert_allclose(handed.translation, [0.7, 0.05, 0.15], atol=2e-4)


def test_a_body_that_two_hands_cannot_hold_is_refused(
    manipulators: dict[str, Manipulator],
) -> None:
    plan = plan_handover(*handover_of_stick(manipulators, (0.04, 0.04, 0.04)))
    assert not plan.is_valid
    assert plan.failure is not None
    assert "grasps" in plan.failure.reason


def test_meetings_take_as_long_as_their_slowest_joints(stick_handover: HandoverCase) -> None:
    task, manipulators, state = stick_handover
    both = manipulators["left"], manipulators["right"]
    body, half = state.scene["stick"], pin.utils.rotate("y", np.pi)
    grasp = pin.SE3(half, np.array([-0.035, 0.0, 0.0]))
    other = pin.SE3(np.array([[0, 0, -1.0], [0, 1.0, 0], [1.0, 0, 0]]), np.array([0.045, 0, 0]))
    ends = Ends(
        (both[0].arm.start, both[1].arm.start),
        (body.T_base_body, task.T_base_goal),
        (grasp.inverse(), other.inverse()),
        0.08,
    )
    found = next(meetings(both, ends))
    giver, taker = (each.arm.T_base_tip(q) for each, q in zip(both, found.q, strict=True))
    np.testing.assert_allclose(
        (giver * grasp.inverse()).homogeneous, (taker * other.inverse()).homogeneous, atol=1e-3
    )
    least_s = rest_to_rest_s(found.q[1] - both[1].arm.start, both[1].limits)
    assert found.duration_s >= 0.9 * float(least_s)


def test_a_body_that_another_hand_holds_does_not_fall(
    handover_plan: TwoArmPlan, manipulators: dict[str, Manipulator]
) -> None:
    plan = handover_plan.plans["left"]
    number = next(k for k, s in enumerate(plan) if isinstance(s, Grip) and s.receiver)
    release = plan.steps[number]
    assert isinstance(release, Grip)
    before = state_of(release)
    kept = after(release, before, manipulators["left"]).scene["stick"].T_base_body
    np.testing.assert_allclose(
        kept.homogeneous, before.scene["stick"].T_base_body.homogeneous, atol=1e-9
    )
    alone = evolve(release, receiver="")
    dropped = after(alone, before, manipulators["left"]).scene["stick"].T_base_body
    assert dropped.translation[2] < kept.translation[2] - 0.05


def test_a_plan_without_states_gets_those_of_the_handover(
    handover_plan: TwoArmPlan, manipulators: dict[str, Manipulator]
) -> None:
    plan = handover_plan.plans["left"]
    bare = Plan(plan.start, tuple(evolve(s, state=None, contacts=()) for s in plan), limb="left")
    again = complete(bare, manipulator=manipulators["left"])
    for step, other in zip(plan, again, strict=True):
        one, two = (state_of(each).scene["stick"].T_base_body for each in (step, other))
        np.testing.assert_allclose(one.homogeneous, two.homogeneous, atol=1e-9)


@pytest.mark.parametrize(
    ("make", "error"),
    [
        pytest.param(lambda: Handover("a", pin.SE3.Identity(), "both"), UnknownNameError, id="arm"),
        pytest.param(
            lambda: Handover("a", pin.SE3.Identity(), where=(0.1, np.nan, 0.0)),
            TaskError,
            id="place",
        ),
        pytest.param(
            lambda: Handover("a", pin.SE3.Identity(), reach_m=-0.1), TaskError, id="length"
        ),
        pytest.param(
            lambda: Grip("close", GripperAction.CLOSE, "a", receiver="left"), TaskError, id="close"
        ),
        pytest.param(
            lambda: Grip("open", GripperAction.OPEN, receiver="left"), TaskError, id="nothing"
        ),
        pytest.param(
            lambda: Grip("open", GripperAction.OPEN, "a", receiver="me"), TaskError, id="receiver"
        ),
    ],
)
def test_bad_input_is_refused(make: Callable[[], object], error: type[BaxterError]) -> None:
    with pytest.raises(error):
        make()
