"""What is said of events: names and numbers, in one phrase."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from planner.grasping import Grasp, Miss, MissKind
from sim.events import contact_text, grasp_text, miss_text, push_text, rest_text, stop_text
from sim.world import Contact, Push, Rest

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
