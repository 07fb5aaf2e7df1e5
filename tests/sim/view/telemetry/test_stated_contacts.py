from __future__ import annotations

import pytest

from planner import Body, Move, Plan
from planner.scene.contact import Contact
from sim.events import Event, EventKind
from sim.recording.recorded_motion import RecordedMove
from sim.view.telemetry.stated_contacts import Contacts, StatedContacts

BOTH = frozenset(["left", "right"])


@pytest.fixture
def contacts() -> StatedContacts:
    return StatedContacts()


def event(kind: EventKind, body: Body) -> Event:
    return Event(0.0, kind, "", "left", body=body)


def recorded(move: Move) -> RecordedMove:
    return RecordedMove(0.0, move.label, move.trajectory, contacts=move.contacts)


def test_at_first_nothing_is_held_and_nothing_known(contacts: StatedContacts) -> None:
    assert contacts.now == Contacts(unknown=BOTH)


def test_a_move_says_what_may_touch_until_the_next(contacts: StatedContacts, plan: Plan) -> None:
    away, down = (recorded(move) for move in plan.moves[:2])
    contacts.on_move(away)
    assert contacts.now == Contacts(unknown=frozenset(["right"]))
    contacts.on_move(down)
    assert contacts.now.of_hand("left", "block")
    assert not contacts.now.of_hand("left", "table")
    contacts.on_move(away)
    assert not contacts.now.of_hand("left", "block")


def test_a_move_of_an_old_file_leaves_it_unknown(contacts: StatedContacts, plan: Plan) -> None:
    contacts.on_move(recorded(plan.moves[1]))
    contacts.on_move(RecordedMove(0.0, "older", plan.moves[1].trajectory))
    assert contacts.now == Contacts(unknown=BOTH)
    assert contacts.now.of_hand("left", "anything")


def test_what_a_hand_has_just_taken_may_touch_anything_until_it_moves(
    contacts: StatedContacts, plan: Plan, block: Body
) -> None:
    contacts.on_move(recorded(plan.moves[1]))
    contacts.on_event(event(EventKind.GRASPED, block))
    assert contacts.now.holder("block") == "left"
    assert contacts.now.of_bodies(("block", 0), ("table", 0))
    contacts.on_move(recorded(plan.moves[2]))
    assert contacts.now.of_bodies(("block", 0), ("table", 0))
    assert not contacts.now.of_bodies(("block", 0), ("wall", 0))
    contacts.on_event(event(EventKind.RELEASED, block))
    assert contacts.now.holder("block") is None


def test_a_contact_is_of_parts_in_either_order() -> None:
    held = frozenset([("left", "tee")])
    contacts = Contacts(held, frozenset([Contact("tee", "bin", 1, 3)]))
    assert contacts.of_bodies(("tee", 1), ("bin", 3))
    assert contacts.of_bodies(("bin", 3), ("tee", 1))
    assert not contacts.of_bodies(("tee", 0), ("bin", 3))
    assert not contacts.of_bodies(("tee", 1), ("bin", 2))
