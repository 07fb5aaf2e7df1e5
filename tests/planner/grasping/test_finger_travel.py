"""Travelling fingers: they touch nothing, and push no body into another."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from baxter_kin import Baxter, pose_from_quaternion
from planner import (
    Body,
    Box,
    Grip,
    Manipulator,
    Part,
    PickAndPlace,
    Plan,
    Scene,
    plan_pick_and_place,
)
from planner.clearance import ContinuousProof
from planner.collision.robot.robot_body import RobotBody
from planner.grasping import Grasp
from planner.grasping.finger_travel import FingerTravel, TravelCheck, closing_travel, prove_travel
from planner.grasping.overhead import MIN_FINGER_CLEARANCE_M
from planner.scene.contact import PRESSING_TOLERANCE_M, gap_m
from tests.conftest import at

DOWN = (0.0, 1.0, 0.0, 0.0)
PICK = pose_from_quaternion((0.7, 0.15, -0.139), DOWN)
PLACE = pose_from_quaternion((0.75, 0.0, -0.139), DOWN)
Z_TABLE = -0.155
SAMPLES = 80
PROOF_M, ROUNDING_M = 2e-5, 1e-9
"""Difference of two runs of GJK, and the accuracy that a proof allows for."""

BODY_M = 1e-3
"""Twice half a millimetre: proofs use the fingers' meshes, which their convex pieces contain."""


def box(name: str, size: tuple[float, float, float], x: float, y: float, z: float) -> Body:
    return Body(name, (Part(Box(size), at(0.0, 0.0, 0.0)),), at(x, y, z))


def cube(edge: float = 0.02, x: float = 0.7, y: float = 0.15) -> Body:
    size = (edge, edge, edge)
    body = box("cube", size, x, y, Z_TABLE + edge / 2)
    return Body(body.name, body.parts, body.T_base_body, is_movable=True)


def post(across_m: float, along_m: float, name: str = "post") -> Body:
    """A post of 8 x 10 x 50 mm beside the cube, offset along the closing axis and across it."""
    return box(name, (0.010, 0.008, 0.05), 0.7 + across_m, 0.15 + along_m, Z_TABLE + 0.025)


def planned(manipulator: Manipulator, *bodies: Body, margin_m: float = 0.0) -> Plan:
    task = PickAndPlace("cube", PICK, PLACE)
    start = manipulator.arm.start
    return plan_pick_and_place(task, manipulator, Scene.of(bodies), start, margin_m=margin_m)


def openings(plan: Plan) -> list[float | None]:
    return [step.opening_m for step in plan if isinstance(step, Grip)]


class TestFalsePlans:
    """Plans that were wrong about fingers once."""

    def test_fingers_open_only_as_far_as_a_post_allows(
        self, manipulator: Manipulator, table: Body
    ) -> None:
        plan = planned(manipulator, table, cube(), post(0.015, 0.0226))
        assert plan.is_valid, str(plan.failure)
        opening_m = openings(plan)[0]
        assert opening_m is not None
        widths_m = manipulator.hand.closed_gap_m + 2 * opening_m
        assert 0.02 + 2 * MIN_FINGER_CLEARANCE_M <= widths_m < 2 * (0.0226 - 0.004)

    def test_a_post_beside_the_body_makes_the_pick_fail(
        self, manipulator: Manipulator, table: Body
    ) -> None:
        plan = planned(manipulator, table, cube(), post(0.0, 0.0145))
        assert plan.failure is not None
        assert plan.failure.stage in {"pick: close", "pick: descend"}
        assert "post" in plan.failure.reason
        assert plan.failure.is_certain

    def test_fingers_open_only_as_far_as_a_fence_at_the_place_allows(
        self, manipulator: Manipulator, table: Body
    ) -> None:
        fence = box("fence", (0.1, 0.006, 0.06), 0.75, 0.034, Z_TABLE + 0.03)
        plan = planned(manipulator, table, cube(), fence)
        assert plan.is_valid, str(plan.failure)
        opening_m = openings(plan)[-1]
        assert opening_m is not None
        assert opening_m < manipulator.hand.stroke_m

    def test_fingers_must_not_be_inside_the_grasped_body(
        self, manipulator: Manipulator, table: Body
    ) -> None:
        """A stem with a crossbar above it, which the fingers would be inside of."""
        z = Z_TABLE
        for width_m in (0.030, 0.055):
            parts = (
                Part(Box((0.02, 0.02, 0.08)), at(0.0, 0.0, 0.04)),
                Part(Box((0.02, width_m, 0.02)), at(0.0, 0.0, 0.07)),
            )
            body = Body("cube", parts, at(0.7, 0.15, z), is_movable=True)
            task = PickAndPlace(
                "cube", at_height(0.7, 0.15, z + 0.02), at_height(0.75, 0, z + 0.02)
            )
            scene, start = Scene.of([table, body]), manipulator.arm.start
            plan = plan_pick_and_place(task, manipulator, scene, start)
            assert plan.failure is not None
            assert "cube" in plan.failure.reason

    def test_a_movable_neighbour_gives_way_to_opening_fingers(
        self, manipulator: Manipulator, table: Body
    ) -> None:
        fixed = post(0.015, 0.0226)
        movable = Body(fixed.name, fixed.parts, fixed.T_base_body, is_movable=True)
        assert openings(planned(manipulator, table, cube(), movable))[0] is not None
        alone = planned(manipulator, table, cube())
        assert openings(alone) == [None, None, None]
        assert all(step.proof is not None for step in alone)


def at_height(x: float, y: float, z: float) -> pin.SE3:
    return pose_from_quaternion((x, y, z), DOWN)


@pytest.mark.slow
def test_travelling_fingers_keep_a_margin(robot: Baxter, plain: RobotBody, table: Body) -> None:
    """For fingers of boxes, the opening shrinks by the additional margin."""
    manipulator = Manipulator.of(robot, "left", body=plain)
    wide, narrow = (
        openings(planned(manipulator, table, cube(), post(0.015, 0.030), margin_m=margin_m))[0]
        for margin_m in (0.001, 0.003)
    )
    assert wide is not None
    assert narrow is not None
    assert wide - narrow == pytest.approx(0.002, abs=2e-4)  # found in steps of 0.1 mm


@settings(max_examples=5)
@given(
    x=st.floats(-0.03, 0.03),
    y=st.floats(-0.05, 0.05),
    turn=st.floats(-1.5, 1.5),
    edge=st.floats(0.002, 0.03),
)
def test_no_sample_is_nearer_than_proven_and_reported_contacts_exist(
    manipulator: Manipulator, x: float, y: float, turn: float, edge: float
) -> None:
    hand, T = manipulator.hand, PICK
    R = pin.utils.rotate("z", turn)
    size = (edge, edge, 0.04)
    thing = Body("thing", (Part(Box(size), at(0, 0, 0)),), pin.SE3(R, T.act(np.array([x, y, 0.0]))))
    check = TravelCheck(manipulator, FingerTravel(Scene.of([thing]), 0.0, hand.stroke_m))
    result = check.at(manipulator.ik.solve(T).q, 0.0)
    assert result.is_clear or check.contact_above(T, 0.0) is not None
    part = thing.placed_parts[0]
    gaps = [
        gap_m(shape.at(T * at(0.0, sign * finger_m, 0.0) * shape.T_body_part), part)
        for finger_m in np.linspace(0.0, hand.stroke_m, SAMPLES)
        for sign, finger in zip((1.0, -1.0), hand.fingers, strict=True)
        for shape in finger
    ]
    if isinstance(result, ContinuousProof):
        assert result.proven_m <= min(gaps) + BODY_M
    else:
        assert min(gaps) <= hand.stroke_m / SAMPLES


@settings(max_examples=8)
@given(off=st.floats(-0.006, 0.006), gap=st.floats(-0.001, 0.01))
@example(off=0.00390625, gap=PROOF_M)  # a case that rounding decides
def test_a_pushed_body_hits_its_neighbour_exactly_when_it_is_near_enough(
    manipulator: Manipulator, off: float, gap: float
) -> None:
    """A cube beside the middle is pushed by one finger, towards a wall that stands further in."""
    body = cube(x=0.7, y=0.15 + off)
    assume(abs(off) > 1e-4)
    assume(abs(off) + gap > PRESSING_TOLERANCE_M)  # else it touches the rail from the start
    away = -float(np.sign(off))
    rail_y = 0.15 + off + away * (0.01 + abs(off) + gap + 0.001)
    rail = box("rail", (0.05, 0.002, 0.004), 0.7, rail_y, Z_TABLE + 0.002)
    grasp = manipulator.hand.close_on(PICK, body, manipulator.hand.stroke_m)
    assert isinstance(grasp, Grasp)
    scene, touch_m = Scene.of([body, rail]), grasp.finger_m + abs(grasp.push_m)
    pushing = closing_travel(scene, "cube", touch_m, grasp)[-1]
    contact = TravelCheck(manipulator, pushing).contact_above(PICK, 0.0)
    pair = set() if contact is None else {contact.nearest.first, contact.nearest.second}
    assert (pair == {"cube", "rail"}) == (gap < 0.0) or abs(gap) < PROOF_M + ROUNDING_M


def test_a_proof_of_fingers_counts_the_other_links(manipulator: Manipulator) -> None:
    """At the neutral configuration all are far."""
    hand = manipulator.hand
    travel = FingerTravel(Scene.of(), 0.0, hand.stroke_m)
    result = prove_travel(manipulator, (travel,), manipulator.arm.neutral)
    assert isinstance(result, ContinuousProof)
    assert result.nearest.distance_m > 0.05
