"""Grasps from above: laws for any block, and certified plans with them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Baxter, ElectricGripper, quaternion_xyzw
from planner import (
    Body,
    Box,
    Cylinder,
    Hand,
    Manipulator,
    Part,
    PickAndPlace,
    Scene,
    make_block,
    overhead_grasp,
    plan_pick_and_place,
    verify,
)
from planner.errors import SceneError
from planner.grasping import Grasp, Miss, MissKind
from planner.grasping.grasp import extent
from planner.grasping.overhead import FINGER_CLEARANCE_M, LOWEST_SHARE, MESH_STEP_RAD
from planner.scene.contact import gap_m
from tests.bodies import with_plain_fingers
from tests.conftest import at
from tests.planner.conftest import hands_of, hull

ROUNDING_M = 1e-9
"""Rounding of sums of a few lengths of about a metre."""

CONTACT_TOLERANCE_M = 1e-6
"""Contacts of the right hand's round pads with tall boxes are found to 1e-7 m, and two add up."""

TABLE_Z_M = -0.155
ORIGIN = at(0.0, 0.0, 0.0)

graspable_m = st.floats(0.0165, 0.048)
"""Widths that both hands hold."""
heights_m = st.floats(0.006, 0.30)
yaws_rad = st.floats(-math.pi, math.pi)
lengths_m = st.floats(0.05, 0.20)
"""Sides that the right hand does not hold, and the left one at times."""
sides = st.sampled_from(["left", "right"])


@pytest.fixture(scope="module")
def hands() -> dict[str, Hand]:
    """A left hand with paddles and a right hand with half-round tips, both of boxes."""
    robot = Baxter.load(hands={"right": ElectricGripper(tips="half_round")})
    return hands_of(robot, with_plain_fingers(robot))


@pytest.fixture(scope="module")
def real_hands(robot: Baxter) -> dict[str, Hand]:
    return hands_of(robot)


def standing(x_m: float, y_m: float, height_m: float, yaw_rad: float = 0.0) -> Body:
    """A block with these edges on the table, turned about z."""
    R = pin.utils.rotate("z", yaw_rad)
    centre = np.array([0.70, 0.15, TABLE_Z_M + height_m / 2])
    return make_block("block", pin.SE3(R, centre), edge_m=(x_m, y_m, height_m))


def closed(hand: Hand, body: Body, **options: Any) -> Grasp | Miss:
    return hand.close_on(overhead_grasp(hand, body, **options), body, hand.stroke_m)


@given(side=sides, edges=st.tuples(lengths_m, graspable_m, heights_m), yaw=yaws_rad)
def test_any_block_that_fits_is_grasped_where_it_stands(
    hands: dict[str, Hand], side: str, edges: tuple[float, float, float], yaw: float
) -> None:
    grasp = closed(hands[side], standing(*edges, yaw))
    assert isinstance(grasp, Grasp)
    assert grasp.width_m == pytest.approx(edges[1], abs=CONTACT_TOLERANCE_M)
    assert abs(grasp.push_m) < CONTACT_TOLERANCE_M


@given(side=sides, width=graspable_m, height=heights_m, yaw=yaws_rad)
def test_fingers_stay_above_the_ground_and_the_palm_above_the_body(
    hands: dict[str, Hand], side: str, width: float, height: float, yaw: float
) -> None:
    hand = hands[side]
    tip_z = overhead_grasp(hand, standing(width, width, height, yaw)).translation[2]
    shapes = [part for finger in hand.fingers for part in finger]
    lowest = tip_z - max(extent(part, 2)[1] for part in shapes)
    palm = tip_z - max(extent(finger[-1], 2)[1] for finger in hand.fingers)
    clear_m = min(FINGER_CLEARANCE_M, LOWEST_SHARE * height)
    assert lowest >= TABLE_Z_M + clear_m - ROUNDING_M
    assert palm >= TABLE_Z_M + height + FINGER_CLEARANCE_M - ROUNDING_M


@given(x=graspable_m, y=graspable_m, yaw=yaws_rad, preferred=yaws_rad)
def test_tool_points_straight_down_and_closes_along_the_narrow_side(
    hands: dict[str, Hand], x: float, y: float, yaw: float, preferred: float
) -> None:
    body = standing(x, y, 0.05, yaw)
    T = overhead_grasp(hands["left"], body, yaw_rad=preferred)
    np.testing.assert_allclose(T.rotation[:, 2], [0.0, 0.0, -1.0], atol=1e-12)
    width = hands["left"].width_across_m(T, body)
    assert width == pytest.approx(min(x, y), abs=2e-6)


@given(edge=graspable_m, yaw=yaws_rad, preferred=yaws_rad)
def test_a_cube_is_grasped_within_45_degrees_of_the_preferred_yaw(
    hands: dict[str, Hand], edge: float, yaw: float, preferred: float
) -> None:
    T = overhead_grasp(hands["right"], standing(edge, edge, edge, yaw), yaw_rad=preferred)
    x, y, _ = T.rotation[:, 1]
    turned = math.remainder(math.atan2(-x, y) - preferred, math.tau)
    assert abs(turned) <= math.pi / 4 + 1e-4  # of sides as narrow within 1e-6 m


@given(preferred=yaws_rad)
def test_a_round_body_is_grasped_at_the_preferred_yaw(
    hands: dict[str, Hand], preferred: float
) -> None:
    tin = Body("tin", (Part(Cylinder(0.02, 0.06), ORIGIN),), at(0.7, 0.1, -0.125))
    T = overhead_grasp(hands["left"], tin, yaw_rad=preferred)
    c, s = math.cos(preferred), math.sin(preferred)
    np.testing.assert_allclose(T.rotation[:, 1], [-s, c, 0.0], atol=1e-12)


@given(yaw=yaws_rad)
def test_at_yaw_zero_its_quaternion_is_0_1_0_0(hands: dict[str, Hand], yaw: float) -> None:
    straight = overhead_grasp(hands["left"], standing(0.04, 0.04, 0.04))
    np.testing.assert_allclose(np.abs(quaternion_xyzw(straight)), [0, 1, 0, 0], atol=1e-12)
    turned = overhead_grasp(hands["left"], standing(0.06, 0.04, 0.04, yaw), yaw_rad=yaw)
    expected = pin.utils.rotate("z", yaw) @ straight.rotation
    np.testing.assert_allclose(turned.rotation, expected, atol=1e-12)


def test_the_narrow_side_may_be_too_thin(hands: dict[str, Hand]) -> None:
    """The left pads stay 16 mm apart, so it takes a slat of 10 mm by 40 mm lengthwise."""
    slat = standing(0.040, 0.010, 0.05)
    assert isinstance(closed(hands["left"], slat), Grasp)
    left, right = (hands[side].width_across_m for side in ("left", "right"))
    assert left(overhead_grasp(hands["left"], slat), slat) == pytest.approx(0.040)
    assert right(overhead_grasp(hands["right"], slat), slat) == pytest.approx(0.010)


@pytest.mark.parametrize(
    ("side", "edge_m", "kind"),
    [("right", 0.05, MissKind.TOO_WIDE), ("left", 0.01, MissKind.TOO_THIN)],
)
def test_a_body_that_fits_at_no_yaw_is_a_miss(
    hands: dict[str, Hand], side: str, edge_m: float, kind: MissKind
) -> None:
    miss = closed(hands[side], standing(edge_m, edge_m, 0.05))
    assert isinstance(miss, Miss)
    assert miss.kind is kind


def test_a_body_of_two_parts_is_grasped_across_both(hands: dict[str, Hand]) -> None:
    """An L of two bars: 40 mm across, 60 mm along, its middle beside both bars' middles."""
    bars = (
        Part(Box((0.06, 0.02, 0.04)), at(0.0, -0.01, 0.0)),
        Part(Box((0.02, 0.02, 0.04)), at(-0.02, 0.01, 0.0)),
    )
    body = Body("L", bars, at(0.70, 0.10, -0.135), is_movable=True)
    T = overhead_grasp(hands["left"], body)
    assert hands["left"].width_across_m(T, body) == pytest.approx(0.04)
    np.testing.assert_allclose(T.translation[:2], [0.70, 0.10], atol=ROUNDING_M)


@settings(max_examples=4)
@given(yaw=yaws_rad)
def test_a_mesh_is_grasped_along_its_narrow_side_within_a_degree(
    hands: dict[str, Hand], yaw: float
) -> None:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    slab = Part(hull(corners * [0.04, 0.02, 0.03]), ORIGIN)
    body = Body("slab", (slab,), pin.SE3(pin.utils.rotate("z", yaw), np.array([0.7, 0.1, 0.0])))
    T = overhead_grasp(hands["left"], body)
    narrow = pin.utils.rotate("z", yaw)[:, 1]
    assert abs(T.rotation[:, 1] @ narrow) >= math.cos(MESH_STEP_RAD)


def test_a_lying_cylinder_is_grasped_across(hands: dict[str, Hand]) -> None:
    lying = pin.SE3(pin.utils.rotate("z", 0.3) @ pin.utils.rotate("x", math.pi / 2), np.zeros(3))
    rod = Body("rod", (Part(Cylinder(0.01, 0.12), ORIGIN),), lying)
    assert hands["left"].width_across_m(overhead_grasp(hands["left"], rod), rod) == (
        pytest.approx(0.02)
    )


@pytest.mark.parametrize(
    "changes",
    [
        *({"yaw_rad": bad} for bad in (math.nan, "east")),
        *({"clear_m": bad} for bad in (0.0, -0.01)),
        *({"neighbours": bad} for bad in (None, 5, "block", ["block"])),
        *({"hand": None}, {"body": None}),
    ],
)
def test_refuses_invalid_arguments(hands: dict[str, Hand], changes: dict[str, Any]) -> None:
    arguments: dict[str, Any] = {"hand": hands["left"], "body": standing(0.04, 0.04, 0.04)}
    (name,) = changes
    with pytest.raises(SceneError, match=name):
        overhead_grasp(**{**arguments, **changes})


def test_more_clearance_lifts_the_tip(hands: dict[str, Hand]) -> None:
    body = standing(0.04, 0.04, 0.06)
    low, high = (overhead_grasp(hands["left"], body, clear_m=m) for m in (0.012, 0.018))
    assert high.translation[2] - low.translation[2] == pytest.approx(0.006)


@pytest.mark.parametrize("yaw", [0.0, 0.5])
def test_it_turns_where_a_neighbour_leaves_no_room_for_a_finger(
    real_hands: dict[str, Hand], yaw: float
) -> None:
    hand, body = real_hands["left"], standing(0.05, 0.04, 0.05, yaw)
    beside = body.at(body.T_base_body * at(0.0, 0.045, 0.0))
    neighbour = Body("beside", beside.parts, beside.T_base_body, is_movable=True)
    alone = overhead_grasp(hand, body, yaw_rad=yaw)
    between = overhead_grasp(hand, body, neighbours=Scene.of([body, neighbour]), yaw_rad=yaw)
    assert abs(alone.rotation[:, 1] @ body.T_base_body.rotation[:, 1]) == pytest.approx(1.0)
    assert abs(between.rotation[:, 1] @ body.T_base_body.rotation[:, 0]) == pytest.approx(1.0)
    for far_m in (0.04, 0.12):  # a finger that is open as far as it must be needs 2 cm
        away = neighbour.at(body.T_base_body * at(0.0, 0.04 + far_m, 0.0))
        np.testing.assert_allclose(
            overhead_grasp(hand, body, neighbours=[away], yaw_rad=yaw).homogeneous,
            alone.homogeneous,
        )


def test_a_round_body_is_grasped_beside_its_neighbours(real_hands: dict[str, Hand]) -> None:
    hand = real_hands["left"]
    tin = Body("tin", (Part(Cylinder(0.02, 0.06), ORIGIN),), at(0.7, 0.1, -0.125))
    others = [Body(f"{y:g}", tin.parts, at(0.7, 0.1 + y, -0.125)) for y in (-0.045, 0.045)]
    T = overhead_grasp(hand, tin, neighbours=others)
    fingers = list(hand.fingers_at(T, hand.stroke_m))
    assert min(gap_m(f, other.placed_parts[0]) for f in fingers for other in others) > 0.0


def test_enclosing_neighbours_are_ignored(
    real_hands: dict[str, Hand],
) -> None:
    body = standing(0.05, 0.04, 0.05)
    around = [
        Body(f"{x:g} {y:g}", body.parts, body.T_base_body * at(x, y, 0.0))
        for x, y in ((0.05, 0.0), (-0.05, 0.0), (0.0, 0.04), (0.0, -0.04))
    ]
    for hand in real_hands.values():
        T = overhead_grasp(hand, body, neighbours=around)
        np.testing.assert_array_equal(T.homogeneous, overhead_grasp(hand, body).homogeneous)


def mug(x_m: float, y_m: float, yaw: float = 0.0) -> Body:
    """A cup 10 cm wide, with a handle of 18 mm; both reach the same height."""
    parts = (
        Part(Cylinder(0.05, 0.09), at(0, 0, 0.045)),
        Part(Box((0.1, 0.018, 0.05)), at(0.09, 0, 0.065)),
    )
    place = pin.SE3(pin.utils.rotate("z", yaw), np.array([x_m, y_m, TABLE_Z_M]))
    return Body("mug", parts, place, is_movable=True)


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_a_mug_is_grasped_by_its_handle(real_hands: dict[str, Hand], yaw: float) -> None:
    body = mug(0.70, 0.15, yaw)
    grasp = closed(real_hands["left"], body)
    assert isinstance(grasp, Grasp)
    assert grasp.width_m == pytest.approx(0.018, abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("yaw", [0.4])
def test_a_plan_with_it_is_certified(
    robot: Baxter, manipulator: Manipulator, table: Body, yaw: float
) -> None:
    body = standing(0.06, 0.035, 0.04, yaw)
    pick = overhead_grasp(manipulator.hand, body)
    place = pin.SE3(pick.rotation, pick.translation + np.array([0.03, -0.12, 0.0]))
    task, scene = PickAndPlace("block", pick, place), Scene.of([table, body])
    certificate = verify(plan_pick_and_place(task, manipulator, scene, robot.arm("left").neutral))
    assert certificate.is_valid, certificate.verdict
