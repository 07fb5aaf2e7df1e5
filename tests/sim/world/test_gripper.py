"""Gripper: what a close finds, what it reports, how long its fingers take."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.errors import UnknownNameError
from planner import Body, Box, Part
from sim import SimulationError, World
from sim.world import Gripper, GripperState
from sim.world.gripper import Closing
from tests.conftest import at

CONTACT_M = 1e-7
ORIGIN = at(0.0, 0.0, 0.0)


@pytest.fixture
def world(robot: Baxter) -> World:
    return World(robot)


@pytest.fixture
def gripper(world: World) -> Gripper:
    return Gripper(world, "left")


def put_between_fingers(
    world: World, name: str, edge: float, y: float = 0.0, *, is_movable: bool = True
) -> None:
    """A cube between the pads of the left hand."""
    part = Part(Box((edge, edge, edge)), ORIGIN)
    world.spawn(Body(name, (part,), ORIGIN, is_movable))
    world.place_body(name, world.T_base_tip("left") * at(0.0, y, -0.015))


def close(gripper: Gripper) -> Closing:
    closing = gripper.closing()
    gripper.finish(closing)
    return closing


@pytest.mark.parametrize("share", [0.0, 0.37, 1.0])
def test_it_reports_its_position(world: World, gripper: Gripper, share: float) -> None:
    state = gripper.state
    assert (state.is_gripping, state.has_missed) == (False, False)
    assert state.percent == pytest.approx(100.0)
    world.set_fingers("left", share * gripper.open_m)
    assert gripper.state.percent == pytest.approx(100.0 * share, abs=1e-9)
    assert f"fingers at {1e3 * share * gripper.open_m:.1f} mm" in repr(gripper)


@pytest.mark.parametrize(
    ("side", "closed", "opened"), [("left", 15.298, 56.964), ("right", 15.298, 56.964)]
)
def test_the_gap_is_that_of_the_pads(world: World, side: str, closed: float, opened: float) -> None:
    gripper = Gripper(world, side)
    assert 1e3 * gripper.gap_m == pytest.approx(opened, abs=5e-3)
    world.set_fingers(side, 0.0)
    assert 1e3 * gripper.gap_m == pytest.approx(closed, abs=5e-3)


def test_a_close_on_a_block_grips_it_at_its_width_until_it_opens(
    world: World, gripper: Gripper
) -> None:
    put_between_fingers(world, "block", 0.05, y=0.003)
    q, pose = world.q.tolist(), world.body("block").T_base_body
    gripper.closing()  # planning moves nothing
    assert world.q.tolist() == q
    assert world.body("block").T_base_body == pose
    assert world.holding("left") is None
    closing = close(gripper)
    assert closing.body == "block"
    assert gripper.gap_m == pytest.approx(0.05, abs=CONTACT_M)
    holding = world.holding("left")
    assert holding is not None
    assert holding.body == "block"
    state = gripper.state
    assert (state.is_gripping, state.has_missed) == (True, False)
    assert state.percent == pytest.approx(100 * (0.05 - 0.015298) / 2 / 0.020833, abs=1e-3)
    held = world.T_base_tip("left").inverse() * world.body("block").T_base_body
    assert held.translation == pytest.approx([0.0, 0.0, -0.015], abs=CONTACT_M)
    with pytest.raises(SimulationError, match="'block'"):
        gripper.closing()  # a full hand
    assert gripper.release() == "block"
    assert world.holding("left") is None
    assert not gripper.state.is_gripping


def test_a_close_on_nothing_is_a_miss_until_it_opens(gripper: Gripper) -> None:
    closing = close(gripper)
    assert (closing.body, closing.grasp, closing.finger_m) == (None, None, 0.0)
    assert gripper.state == GripperState(0.0, is_gripping=False, has_missed=True)
    assert gripper.release() is None
    assert not gripper.state.has_missed


@pytest.mark.parametrize(("edge", "y"), [(0.015, 0.0), (0.06, 0.0), (0.04, 0.2), (0.05, 0.012)])
def test_what_is_too_thin_too_wide_or_beside_the_pads_is_missed(
    world: World, gripper: Gripper, edge: float, y: float
) -> None:
    put_between_fingers(world, "block", edge, y)
    assert close(gripper).body is None
    assert gripper.state.has_missed


def test_what_cannot_be_moved_is_not_gripped(world: World, gripper: Gripper) -> None:
    put_between_fingers(world, "post", 0.05, is_movable=False)
    assert close(gripper).body is None


def test_the_widest_of_several_bodies_stops_the_fingers(world: World, gripper: Gripper) -> None:
    for name, edge in (("thin", 0.03), ("wide", 0.05), ("middle", 0.04)):
        put_between_fingers(world, name, edge)
    assert gripper.closing().body == "wide"


def test_a_hand_that_was_closed_finds_nothing(world: World, gripper: Gripper) -> None:
    world.set_fingers("left", 0.0)
    put_between_fingers(world, "block", 0.05)
    assert gripper.closing().body is None


@pytest.mark.parametrize(
    "call",
    [
        lambda gripper: gripper.closing(["block"]),
        lambda gripper: gripper.finish(None),
        lambda gripper: gripper.finish(Closing(np.nan)),
        lambda gripper: gripper.finish(Closing(1.0)),
        lambda _: Gripper(None, "left"),  # type: ignore[arg-type]
        lambda _: Closing("open"),  # type: ignore[arg-type]
    ],
)
def test_invalid_arguments_are_refused(gripper: Gripper, call: Callable[[Any], Any]) -> None:
    with pytest.raises(SimulationError):
        call(gripper)


def test_an_unknown_side_is_refused(world: World) -> None:
    side: Any
    for side in ("middle", None, ["left"]):
        with pytest.raises(UnknownNameError, match="left, right"):
            Gripper(world, side)
