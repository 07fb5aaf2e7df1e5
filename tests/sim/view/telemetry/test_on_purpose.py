from __future__ import annotations

import numpy as np
import pytest

from baxter_kin import Baxter
from planner import Body, Plan
from planner.collision.robot.robot_shapes import RobotShapes
from sim.events import Event, EventKind
from sim.view.telemetry.nearest import Contacts
from sim.view.telemetry.on_purpose import ContactsOnPurpose, Moment
from tests.conftest import at


@pytest.fixture
def contacts(robot: Baxter, table: Body, block: Body) -> ContactsOnPurpose:
    made = ContactsOnPurpose(RobotShapes(robot))
    made.bodies.update({"table": table, "block": block})
    return made


@pytest.fixture
def moment(robot: Baxter, plan: Plan) -> Moment:
    """The left arm where the plan begins, table and block where it has them."""
    assert plan.situation is not None
    q = np.array([plan.situation.joints[name] for name in robot.joint_names])
    q[list(robot.indices(robot.arm("left").joint_names))] = plan.q_start
    return Moment(q, {b.name: b.T_base_body.homogeneous for b in plan.situation.scene})


def event(kind: EventKind, body: Body) -> Event:
    return Event(0.0, kind, "", "left", body=body)


def test_nothing_touches_at_first(contacts: ContactsOnPurpose, moment: Moment) -> None:
    assert contacts.at(moment).key == Contacts().key


def test_a_move_above_the_block_touches_nothing(
    contacts: ContactsOnPurpose, moment: Moment, plan: Plan
) -> None:
    contacts.begin("left", plan.moves[0].trajectory.q_goal, moment)
    assert contacts.at(moment).key == Contacts().key


def test_a_hand_may_touch_what_its_move_ends_around(
    contacts: ContactsOnPurpose, moment: Moment, plan: Plan
) -> None:
    contacts.begin("left", plan.moves[1].trajectory.q_goal, moment)
    assert contacts.at(moment).by_hand == {("left", "block")}


def test_a_held_body_may_touch_what_it_stood_on_until_the_next_move_ends(
    contacts: ContactsOnPurpose, moment: Moment, plan: Plan, block: Body
) -> None:
    contacts.hear(event(EventKind.GRASPED, block), moment)
    told = contacts.at(moment)
    assert dict(told.held) == {"left": "block"}
    assert told.by_body == {("block", "table")}
    lifted = Moment(moment.q, {**moment.T_base_bodies, "block": at(0.7, 0.1, 0.2).homogeneous})
    contacts.begin("left", plan.q_start, lifted)
    assert contacts.at(lifted).by_body == frozenset()


def test_what_stands_on_a_held_body_goes_along(
    contacts: ContactsOnPurpose, moment: Moment, block: Body
) -> None:
    top = block.at(block.T_base_body * at(0.0, 0.0, 0.05))
    rider = Body("rider", top.parts, top.T_base_body, is_movable=True)
    contacts.bodies["rider"] = rider
    laden = Moment(moment.q, {**moment.T_base_bodies, "rider": rider.T_base_body.homogeneous})
    contacts.hear(event(EventKind.GRASPED, block), laden)
    assert ("block", "rider") in contacts.at(laden).by_body


def test_a_body_that_was_let_go_may_still_be_touched(
    contacts: ContactsOnPurpose, moment: Moment, block: Body
) -> None:
    contacts.hear(event(EventKind.GRASPED, block), moment)
    contacts.hear(event(EventKind.RELEASED, block), moment)
    told = contacts.at(moment)
    assert not told.held
    assert told.by_hand == {("left", "block")}


def test_a_body_between_the_pads_may_be_touched_without_any_event(
    contacts: ContactsOnPurpose, moment: Moment, robot: Baxter, plan: Plan
) -> None:
    T_base_tip = robot.arm("left").T_base_tip(plan.q_start)
    around = Moment(moment.q, {"block": at(*T_base_tip.translation).homogeneous})
    assert contacts.at(around).by_hand == {("left", "block")}


def test_what_does_not_move_is_nothing_to_grasp(
    contacts: ContactsOnPurpose, moment: Moment, robot: Baxter, plan: Plan
) -> None:
    tip = robot.arm("left").T_base_tip(plan.q_start).translation
    around = Moment(moment.q, {"table": at(*tip).homogeneous})
    assert contacts.at(around).by_hand == frozenset()
