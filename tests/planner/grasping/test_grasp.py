"""Results of closing a hand: reasons of a miss, and the overlap of pads with a held body."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from baxter_kin import Baxter
from planner import Body, Box, Hand, Part, RobotShapes, make_block
from planner.collision.robot.robot_body import RobotBody
from planner.grasping import Grasp, Miss, MissKind
from planner.grasping.grasp import MIN_PAD_M, NEAR_EDGE_M
from planner.scene.bodies import Sphere
from tests.conftest import at

ROUNDING_M = 1e-9
PAD_TOP_M, PAD_BOTTOM_M = -0.0335, 0.0035
"""Ends of the pads along z of the tip."""

ORIGIN = at(0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def hand(robot: Baxter, plain: RobotBody) -> Hand:
    """The left hand with boxes as pads, its tip at the origin of base."""
    return Hand.of(robot, robot.arm("left"), RobotShapes(robot, plain))


def closed_on(hand: Hand, body: Body) -> Grasp | Miss:
    return hand.close_on(ORIGIN, body, hand.stroke_m)


def lower(pad_m: float, edge_m: float = 0.04) -> Body:
    """A cube with `pad_m` of it between the pads, the rest below them."""
    return make_block("cube", at(0.0, 0.0, PAD_BOTTOM_M - pad_m + edge_m / 2), edge_m=edge_m)


@given(st.floats(MIN_PAD_M + 1e-6, 0.036))
def test_a_grasp_states_the_length_of_a_pad_on_the_body(hand: Hand, pad_m: float) -> None:
    assume(abs(pad_m - NEAR_EDGE_M) > ROUNDING_M)
    grasp = closed_on(hand, lower(pad_m))
    assert isinstance(grasp, Grasp)
    assert grasp.pad_m == pytest.approx(pad_m, abs=ROUNDING_M)
    assert grasp.is_near_edge == (pad_m < NEAR_EDGE_M)


@given(st.floats(1e-4, MIN_PAD_M - 1e-6))
def test_too_little_of_a_pad_on_the_body_is_a_miss_with_that_length(
    hand: Hand, pad_m: float
) -> None:
    miss = closed_on(hand, lower(pad_m))
    assert isinstance(miss, Miss)
    assert miss.kind is MissKind.EDGE
    assert miss.amount_m == pytest.approx(pad_m, abs=ROUNDING_M)
    assert f"only {1e3 * pad_m:.1f} mm of a finger pad on cube" in str(miss)


@given(st.floats(-0.03, 0.03), st.floats(-0.02, 0.01))
def test_the_centre_is_off_the_pads_by_its_distance_beside_them(
    hand: Hand, x: float, z: float
) -> None:
    grasp = closed_on(hand, make_block("cube", at(x, 0.0, z), edge_m=0.045))
    assert isinstance(grasp, Grasp)
    beside = max(abs(x) - 0.021, 0.0), max(z - PAD_BOTTOM_M, 0.0)
    assert grasp.centre_off_m == pytest.approx(np.hypot(*beside), abs=ROUNDING_M)


@pytest.mark.parametrize(
    ("body", "kind", "text"),
    [
        (make_block("b", at(0, 0, -0.015), edge_m=0.06), MissKind.TOO_WIDE, "60.0 mm across"),
        (make_block("b", at(0, 0, -0.015), edge_m=0.01), MissKind.TOO_THIN, "10.0 mm across"),
        (make_block("b", at(0.2, 0, 0.05), edge_m=0.04), MissKind.NOTHING, "200 mm to the side"),
        (make_block("b", at(0, 0.012, -0.015)), MissKind.NOT_BETWEEN, "reaches into a finger"),
    ],
)
def test_a_miss_states_its_kind_and_names_the_body(
    hand: Hand, body: Body, kind: MissKind, text: str
) -> None:
    miss = closed_on(hand, body)
    assert isinstance(miss, Miss)
    assert (miss.kind, miss.body) == (kind, "b")
    assert text in str(miss)


def test_only_the_part_that_is_touched_counts(hand: Hand) -> None:
    parts = (Part(Box((0.04, 0.04, 0.04)), at(0, 0, 0)), Part(Sphere(0.005), at(0, 0, -0.025)))
    body = Body("knob", parts, at(0.0, 0.0, PAD_BOTTOM_M + 0.016), is_movable=True)
    grasp = closed_on(hand, body)
    assert isinstance(grasp, Grasp)
    assert grasp.pad_m == pytest.approx(0.004, abs=ROUNDING_M)
    whole = closed_on(hand, make_block("plate", at(0.0, 0.0, -0.015), edge_m=(0.03, 0.03, 0.001)))
    assert isinstance(whole, Grasp)
    assert not whole.is_near_edge
