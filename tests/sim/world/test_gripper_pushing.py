"""Fingers on their way: what they meet, what they take along, and where it ends."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Baxter
from planner import Body, Box, Part
from planner.collision.robot.robot_body import RobotBody
from sim import SimulationError, World
from sim.world import Push
from sim.world.gripper import Slider, Squeeze
from tests.conftest import at

CONTACT_M = 1e-6
ROUNDING = 1e-12
EDGE_M = 0.03
PAD_Z_M = -0.015
"""Middle of the pads, seen from the tip."""

CLOSED_GAP_M = 0.016
"""Between the plain pads of closed fingers."""

T_BEGIN = pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.3])), np.array([0.7, 0.1, 0.0]))
AXIS = np.array([0.6, 0.0, 0.8])


@pytest.fixture
def world(robot: Baxter, plain: RobotBody) -> World:
    """Nothing but the robot with boxes for fingers."""
    return World(robot, plain)


def put(world: World, name: str, y: float, width: float = EDGE_M, *, movable: bool = True) -> None:
    """A box in the air between the pads, its centre so far along y of the tip."""
    part = Part(Box((0.02, width, 0.01)), at(0.0, 0.0, 0.0))
    T = world.T_base_tip("left") * at(0.0, y, PAD_Z_M)
    world.spawn(Body(name, (part,), T, is_movable=movable))
    world.place_body(name, T)


def squeezed(world: World) -> tuple[Squeeze, set[str]]:
    """The fingers where they stop, and the names of what met what."""
    squeeze = Squeeze(world, "left")
    meeting = squeeze.run()
    return squeeze, set() if meeting is None else {slider.name for slider in meeting}


@given(st.floats(0.0, 0.02), st.floats(0.0, 0.02), st.floats(0.0, 0.02))
def test_a_pushed_body_goes_with_the_finger_from_touch_to_stop(
    begin_m: float, end_m: float, finger_m: float
) -> None:
    begin_m, end_m = max(begin_m, end_m), min(begin_m, end_m)
    push = Push("b", "left", "left finger", begin_m, end_m, AXIS, T_BEGIN)
    way = push.pose(finger_m).translation - T_BEGIN.translation
    wanted_m = float(np.clip(begin_m - finger_m, 0.0, begin_m - end_m))
    assert way == pytest.approx(wanted_m * AXIS, abs=ROUNDING)
    assert np.array_equal(push.pose(finger_m).rotation, T_BEGIN.rotation)
    assert push.distance_m == pytest.approx(
        np.linalg.norm(push.pose(0.0).translation - T_BEGIN.translation), abs=ROUNDING
    )


def test_a_push_needs_a_position_and_an_axis() -> None:
    push = Push("b", "left", "left finger", 0.02, 0.01, AXIS, T_BEGIN)
    with pytest.raises(SimulationError, match="finger position"):
        push.pose(np.nan)
    with pytest.raises(SimulationError, match="axis_base"):
        Push("b", "left", "left finger", 0.02, 0.01, np.zeros(2), T_BEGIN)


def test_a_body_in_the_middle_is_held_without_a_push(world: World) -> None:
    put(world, "b", 0.0)
    squeeze, met = squeezed(world)
    assert "b" in met
    assert squeeze.finger_m == pytest.approx((EDGE_M - CLOSED_GAP_M) / 2, abs=CONTACT_M)
    assert max((push.distance_m for push in squeeze.pushes), default=0.0) <= CONTACT_M


@pytest.mark.parametrize("y", [0.004, -0.004])
def test_the_nearer_finger_pushes_a_body_to_the_middle(world: World, y: float) -> None:
    put(world, "b", y)
    squeeze, met = squeezed(world)
    (push,) = squeeze.pushes
    nearer, other = ("left", "right") if y > 0.0 else ("right", "left")
    assert met == {"b", f"{other} finger"}
    assert (push.finger, push.by) == (nearer, f"{nearer} finger")
    assert push.distance_m == pytest.approx(abs(y), abs=CONTACT_M)
    along = world.T_base_tip("left").rotation[:, 1]
    assert push.axis_base == pytest.approx(-np.sign(y) * along, abs=ROUNDING)
    assert squeeze.finger_m == pytest.approx((EDGE_M - CLOSED_GAP_M) / 2, abs=CONTACT_M)


def test_a_body_pushes_the_next_one(world: World) -> None:
    put(world, "near", 0.018, 0.01)
    put(world, "far", 0.006, 0.01)
    squeeze, _ = squeezed(world)
    pushes = {push.body: push for push in squeeze.pushes}
    assert pushes["near"].by == "left finger"
    assert pushes["far"].by == "near"
    assert pushes["far"].finger == "left"
    assert pushes["near"].begin_m - pushes["far"].begin_m == pytest.approx(0.002, abs=CONTACT_M)


def test_what_stands_on_a_pushed_body_rides_along(world: World) -> None:
    put(world, "b", 0.004)
    top = Part(Box((0.01, 0.01, 0.01)), at(0.0, 0.0, 0.0))
    world.spawn(Body("rider", (top,), at(0.0, 0.0, 5.0)))
    world.supports["rider"] = ("b",)  # far from all fingers, and yet on it
    pushes = {push.body: push for push in squeezed(world)[0].pushes}
    assert (pushes["rider"].is_riding, pushes["b"].is_riding) == (True, False)
    assert pushes["rider"].by == "b"
    assert pushes["rider"].distance_m == pushes["b"].distance_m


@given(st.floats(0.0, 0.02))
def test_fingers_and_what_they_push_go_the_same_way(finger_m: float) -> None:
    finger = Slider("left finger", [], is_finger=True, sign=-1)
    body = Slider("b", [], sign=-1, begin_m=0.02)
    ways = [slider.offset_m(0.02 - finger_m) - slider.offset_m(0.02) for slider in (finger, body)]
    assert ways == pytest.approx([-finger_m, -finger_m], abs=ROUNDING)
    assert Slider("still", []).offset_m(finger_m) == 0.0
