"""Events and snapshots: what they refuse, keep, and how they are told."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from planner import Body
from planner.grasping import Grasp, Miss, MissKind
from sim import Dwell, Event, EventKind, Observer, Outcome, SimulationError, Snapshot
from sim.events import (
    JOINTS_OF_ROBOT,
    contact_text,
    grasp_text,
    miss_text,
    push_text,
    rest_text,
    stop_text,
)
from sim.world import Contact, GripperState, Push, Rest

OPEN = GripperState(100.0, is_gripping=False, has_missed=False)
BOTH = {"left": OPEN, "right": OPEN}


def test_only_appearing_and_disappearing_change_what_there_is() -> None:
    found = [kind for kind in EventKind if Event(0.0, kind, "").is_of_appearance]
    assert found == [EventKind.SPAWNED, EventKind.DELETED]


def test_events_are_equal_by_what_was_reported_not_by_the_facts_behind(block: Body) -> None:
    first = Event(1.0, EventKind.GRASPED, "block grasped", "left", body=block)
    fall = Rest(block.T_base_body, ("table",), 0.1)
    assert first == Event(1.0, EventKind.GRASPED, "block grasped", "left", detail=fall)
    assert first != Event(1.0, EventKind.GRASPED, "block grasped", "right", body=block)


VALID: dict[Any, dict[str, Any]] = {
    Event: {"time_s": 0.0, "kind": EventKind.ENABLED, "text": ""},
    Snapshot: {
        "time_s": 0.0,
        "q": np.zeros(19),
        "T_base_bodies": {},
        "grippers": BOTH,
        "caption": "",
    },
    Dwell: {},
    Outcome: {"failure": None, "duration_s": 1.0},
}


@pytest.mark.parametrize(
    ("cls", "field", "value"),
    [
        *((Event, "side", side) for side in ("middle", "", 5)),
        *((Event, "time_s", time_s) for time_s in (np.nan, np.inf, None)),
        (Event, "kind", "grasped"),
        (Event, "text", None),
        (Event, "body", "block"),
        (Event, "move", 3),
        (Event, "detail", "hit"),
        *((Snapshot, "q", q) for q in (np.zeros(7), np.zeros(18), np.full(19, np.nan), "q")),
        *((Dwell, name, -1e-9) for name in ("after_grasp_s", "after_release_s")),
        (Dwell, "after_grasp_s", None),
        (Outcome, "failure", 5),
        (Outcome, "duration_s", "long"),
        (Outcome, "hits", ["box"]),
    ],
)
def test_a_field_of_the_wrong_type_or_value_is_refused(cls: Any, field: str, value: Any) -> None:
    with pytest.raises(SimulationError, match=field):
        cls(**{**VALID[cls], field: value})


@pytest.mark.parametrize("joints", JOINTS_OF_ROBOT)
def test_a_snapshot_has_the_joints_of_a_robot_with_or_without_fingers(joints: int) -> None:
    assert Snapshot(0.0, np.zeros(joints), {}, BOTH, "").q.shape == (joints,)


def test_a_snapshot_keeps_what_it_was_given_whatever_becomes_of_that(robot: Baxter) -> None:
    q, grippers = np.array(robot.configuration()), dict(BOTH)
    poses = {"block": pin.SE3.Identity()}
    snapshot = Snapshot(0.0, q, poses, grippers, "")
    q += 1.0
    del poses["block"], grippers["left"]
    assert snapshot.q.tolist() == robot.configuration().tolist()
    assert list(snapshot.T_base_bodies) == ["block"]
    assert list(snapshot.grippers) == ["left", "right"]
    with pytest.raises(ValueError, match="read-only"):
        snapshot.q[0] = 9.0


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_snapshot_names_the_gripper_that_it_lacks(robot: Baxter, side: str) -> None:
    others = {name: state for name, state in BOTH.items() if name != side}
    with pytest.raises(SimulationError, match=f"the grippers lack {side}"):
        Snapshot(0.0, robot.configuration(), {}, others, "")


def test_an_observer_that_overrides_nothing_is_silent(robot: Baxter) -> None:
    observer = Observer()
    observer.on_event(Event(0.0, EventKind.ENABLED, "robot enabled"))
    observer.on_snapshot(Snapshot(0.0, robot.configuration(), {}, BOTH, ""))
    assert repr(observer) == "Observer()"


# What is said of events: names and numbers, in one phrase

ORIGIN = pin.SE3.Identity()


def grasp(*, is_near_edge: bool) -> Grasp:
    return Grasp(0.017, ORIGIN, 0.05, 0.0, 0.0042, 0.018, is_near_edge)


def contact(*, mover: str = "left_wrist", is_held: bool = False, stops: bool = True) -> Contact:
    return Contact(0.5, mover, "table", is_held, 0.001, stops, 0.49)


def push(by: str) -> Push:
    return Push("red", "left", by, 0.020, 0.017, np.array([0.0, 1.0, 0.0]), ORIGIN)


def test_a_grasp_states_the_width_and_near_an_edge_how_near() -> None:
    plain = "b grasped, 50.0 mm between the finger pads (82 % open)"
    assert grasp_text("b", grasp(is_near_edge=False), 82.0) == plain
    assert grasp_text("b", grasp(is_near_edge=True), 82.0) == (
        f"{plain}, near an edge: only 4.2 mm of a finger pad on it, its centre 18.0 mm outside of "
        "them"
    )


def test_a_miss_states_where_the_fingers_stopped_and_why() -> None:
    miss = Miss(MissKind.BLOCKED, "the left finger met post, which does not give way", "post")
    assert miss_text(miss, None, 0.0432, is_closed=False) == (
        "missed: the fingers stopped, 43.2 mm apart, and hold nothing: the left finger met post, "
        "which does not give way"
    )


def test_a_push_states_what_how_far_and_by_what() -> None:
    finger = "the left finger of the right hand"
    assert push_text(push("left finger"), "right") == f"red pushed 3.0 mm by {finger}"
    assert push_text(push("blue"), "right") == (f"red pushed 3.0 mm by blue, which {finger} pushes")


def test_a_contact_states_what_would_pass_through_what() -> None:
    held = contact(mover="red", is_held=True)
    assert stop_text(held, "left") == "the held red would pass through the table"
    assert stop_text(contact(), "left") == (
        "the left arm (left_wrist) would pass through the table"
    )
    hit = contact(mover="l_gripper_l_finger", stops=False)
    assert contact_text(hit, "left") == (
        "the left hand (l_gripper_l_finger) hit table, which is left where it is"
    )


def test_coming_to_rest_states_what_it_tipped_off_and_whether_it_leans() -> None:
    assert rest_text("b", Rest(ORIGIN, ("table",), 0.1)) == "b at rest on table"
    tipped = Rest(ORIGIN, ("floor",), 0.1, fell_off=("red", "table"))
    assert rest_text("b", tipped) == "b at rest on floor; it tipped off red and table"
    leaning = Rest(ORIGIN, ("red",), 0.1, beside_m=0.005)
    assert rest_text("b", leaning).endswith("its centre 5.0 mm outside of what it stands on")
