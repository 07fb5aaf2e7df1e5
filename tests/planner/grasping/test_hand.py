"""Hands and what they grasp: numbers of the real hands, laws of hands with boxes as fingers."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import linprog

from baxter_kin import Baxter
from baxter_kin.errors import ConfigurationError, PoseError, UnknownNameError
from baxter_kin.validation import FloatArray
from planner import Body, Box, Cylinder, Hand, Manipulator, Part, RobotShapes
from planner.certificate.body import Body as Clusters
from planner.certificate.body import LinkShape
from planner.collision.robot.robot_body import RobotBody
from planner.errors import SceneError
from planner.grasping import Grasp
from planner.grasping.grasp import extent
from planner.scene.bodies import Shape, Sphere
from planner.scene.mesh import Mesh, cuboid
from tests.bodies import grasp_of
from tests.conftest import at, overhead
from tests.planner.conftest import hands_of, hull

GAP_TOLERANCE_M = 5e-6
"""The gaps are given in mm with two decimals."""

SEED_TOLERANCE_MM = 2e-2
"""Distances at the demo's pick are known in mm with two decimals; doubled for rounding."""

CONTACT_TOLERANCE_M = 1e-7
"""Contacts of boxes, cylinders and balls are found to 1e-8, and two of them add up."""

HOLLOW_M = 9e-4
"""Depth of the middle of a real pad behind its foremost points."""

ORIGIN = at(0.0, 0.0, 0.0)
PAD_Z_M = -0.015
"""Middle of the pads, seen from the tip."""

PICK = overhead(0.70, 0.15, -0.129)


@pytest.fixture(scope="module")
def real_hands(drawn: Baxter) -> dict[str, Hand]:
    """Hands with paddles on the left and half-round tips on the right."""
    return hands_of(drawn)


@pytest.fixture(scope="module")
def real_hand(real_hands: dict[str, Hand]) -> Hand:
    """The left hand."""
    return real_hands["left"]


@pytest.fixture(scope="module")
def hands(drawn: Baxter, plain: RobotBody) -> dict[str, Hand]:
    return hands_of(drawn, plain)


@pytest.fixture(scope="module")
def hand(hands: dict[str, Hand]) -> Hand:
    """The left hand, whose pads are boxes."""
    return hands["left"]


def thing(shape: Shape, x: float = 0.0, y: float = 0.0, z: float = PAD_Z_M) -> Body:
    """A body somewhere between the pads of a hand whose tip is at the origin of base."""
    return Body("thing", (Part(shape, ORIGIN),), at(x, y, z), is_movable=True)


def cube(edge: float) -> Box:
    return Box((edge, edge, edge))


def grasped(hand: Hand, body: Body, finger_m: float | None = None) -> Grasp:
    grasp = grasp_of(hand, ORIGIN, body, hand.stroke_m if finger_m is None else finger_m)
    assert grasp is not None
    return grasp


def placed_points(each: LinkShape) -> FloatArray:
    """The outermost points of a link's mesh in the frame of the link, homogeneous, shape (4, n)."""
    R, p = each.T_link_shape.R.centred()[0], each.T_link_shape.p.centred()[0]
    points = each.shape.points_of(0) @ R.T + p
    return np.column_stack([points, np.ones(len(points))]).T


@pytest.mark.parametrize(
    ("side", "closed_mm", "open_mm"), [("left", 15.298, 56.964), ("right", 11.028, 52.694)]
)
def test_the_gap_between_the_pads_is_that_of_the_meshes(
    drawn: Baxter, real_hands: dict[str, Hand], side: str, closed_mm: float, open_mm: float
) -> None:
    data = drawn.model.createData()
    pin.framesForwardKinematics(drawn.model, data, drawn.configuration())
    T_tip_base = data.oMf[drawn.model.getFrameId(drawn.arm(side).tip_frame)].inverse()
    pads = {each.link: each for each in Clusters(drawn.description.text).shapes}
    left, right = (
        (
            (T_tip_base * data.oMf[drawn.model.getFrameId(name, pin.FrameType.BODY)]).homogeneous
            @ placed_points(pads[name])
        )[1]
        for name in (f"{side[0]}_gripper_{finger}_finger_tip" for finger in "lr")
    )
    gap, hand = min(left) - max(right), real_hands[side]
    assert hand.closed_gap_m == pytest.approx(gap, abs=GAP_TOLERANCE_M)
    assert hand.closed_gap_m == pytest.approx(1e-3 * closed_mm, abs=GAP_TOLERANCE_M)
    assert hand.open_gap_m == pytest.approx(1e-3 * open_mm, abs=GAP_TOLERANCE_M)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("finger_m", [0.0, 0.01, 0.020833])
def test_the_gap_agrees_with_pinocchio_for_the_finger_joints(
    drawn: Baxter, plain: RobotBody, hands: dict[str, Hand], side: str, finger_m: float
) -> None:
    hand, of_robot = hands[side], RobotShapes(drawn, plain)
    first, second = sorted(of_robot.of_pads(drawn.arm(side)))
    shapes = of_robot.model
    shapes.removeAllCollisionPairs()
    shapes.addCollisionPair(pin.CollisionPair(first, second))
    data, geometry = drawn.model.createData(), shapes.createData()
    q = drawn.configuration(hand.finger_joints(finger_m))
    pin.computeDistances(drawn.model, data, shapes, geometry, q)
    gap = geometry.distanceResults[0].min_distance
    assert gap == pytest.approx(hand.closed_gap_m + 2 * finger_m, abs=1e-6)  # GJK's tolerance


def test_the_second_finger_mirrors_the_first_along_the_stroke_of_the_urdf(hand: Hand) -> None:
    assert hand.stroke_m == pytest.approx(0.020833, abs=1e-9)
    percents = [hand.percent(share * hand.stroke_m) for share in (0.0, 0.5, 1.0)]
    assert percents == pytest.approx([0.0, 50.0, 100.0], abs=1e-9)
    assert hand.finger_joints(0.01) == {
        "l_gripper_l_finger_joint": 0.01,
        "l_gripper_r_finger_joint": -0.01,
    }


@given(st.floats(0.018, 0.057))
def test_a_cube_between_the_pads_is_held_by_its_edge(hand: Hand, edge: float) -> None:
    grasp = grasped(hand, thing(cube(edge)))
    assert grasp.width_m == pytest.approx(edge, abs=CONTACT_TOLERANCE_M)
    assert grasp.finger_m == pytest.approx((edge - hand.closed_gap_m) / 2, abs=CONTACT_TOLERANCE_M)


@given(st.floats(0.01, 0.028))
def test_a_ball_and_a_rod_are_held_by_their_diameter(hand: Hand, radius: float) -> None:
    for shape in (Sphere(radius), Cylinder(radius, 0.1)):
        grasp = grasped(hand, thing(shape))
        assert grasp.width_m == pytest.approx(2 * radius, abs=CONTACT_TOLERANCE_M)


@given(st.floats(-0.0035, 0.0035))
def test_closing_pushes_a_body_into_the_middle(hand: Hand, offset: float) -> None:
    grasp = grasped(hand, thing(cube(0.05), 0.0, offset))
    assert grasp.push_m == pytest.approx(-offset, abs=CONTACT_TOLERANCE_M)
    assert grasp.T_tip_body.translation == pytest.approx([0.0, 0.0, PAD_Z_M], abs=1e-7)


@given(st.floats(-0.003, 0.003), st.floats(-0.01, 0.01), st.floats(-0.2, 0.2), st.floats(-0.1, 0.1))
def test_a_grasped_body_is_centred_and_grasping_again_changes_nothing(
    hand: Hand, y: float, x: float, yaw: float, roll: float
) -> None:
    R = pin.rpy.rpyToMatrix(roll, 0.0, yaw)
    body = thing(cube(0.045)).at(pin.SE3(R, np.array([x, y, PAD_Z_M])))
    first = grasp_of(hand, ORIGIN, body, hand.stroke_m)
    assume(first is not None)
    assert first is not None
    held, before = first.T_tip_body, body.T_base_body  # neither turned nor lifted
    np.testing.assert_allclose(held.rotation, before.rotation, atol=1e-12)
    np.testing.assert_allclose(held.translation[[0, 2]], before.translation[[0, 2]], atol=1e-12)
    again = grasped(hand, body.at(first.T_tip_body))
    assert again.push_m == pytest.approx(0.0, abs=CONTACT_TOLERANCE_M)
    assert again.width_m == pytest.approx(first.width_m, abs=CONTACT_TOLERANCE_M)


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_a_grasp_does_not_depend_on_where_the_hand_and_its_fingers_are(
    hand: Hand, x: float, y: float, yaw: float, pitch: float
) -> None:
    T = pin.SE3(pin.rpy.rpyToMatrix(0.0, pitch, yaw), np.array([x, y, 0.3]))
    body = thing(cube(0.04), 0.001, 0.002)
    here = grasped(hand, body)
    for place, finger_m in ((T, hand.stroke_m), (ORIGIN, 0.0145)):
        other = grasp_of(hand, place, body.at(place * body.T_base_body), finger_m)
        assert other is not None
        for name in ("width_m", "finger_m", "push_m"):
            expected = pytest.approx(getattr(here, name), abs=CONTACT_TOLERANCE_M)
            assert getattr(other, name) == expected


def beside_mm(hand: Hand, body: Body) -> list[float]:
    """Distances of the pads from a body at the demo's pick, on either side."""
    grasp = grasp_of(hand, PICK, body, hand.stroke_m)
    assert grasp is not None
    both = hand.open_gap_m - grasp.width_m
    return sorted(1e3 * gap for gap in (both / 2 + grasp.push_m, both / 2 - grasp.push_m))


def test_the_demos_pick_leaves_less_beside_the_block_by_the_meshes_than_by_the_urdf(
    hand: Hand, real_hand: Hand, block: Body
) -> None:
    assert beside_mm(hand, block) == pytest.approx([0.89, 4.20], abs=SEED_TOLERANCE_MM)
    assert beside_mm(real_hand, block) == pytest.approx([0.63, 3.89], abs=SEED_TOLERANCE_MM)
    grasp = grasp_of(real_hand, PICK, block, real_hand.stroke_m)
    assert grasp is not None  # of a block that lies askew
    across = real_hand.width_across_m(PICK, block)
    assert 0.017351 < grasp.finger_m < (across - real_hand.closed_gap_m) / 2


@pytest.mark.parametrize(("of", "finger_m"), [("hand", 0.0170), ("real_hand", 0.017351)])
def test_a_block_that_lies_straight_closes_the_fingers_to_where_its_faces_are(
    request: pytest.FixtureRequest, of: str, finger_m: float
) -> None:
    found = grasped(request.getfixturevalue(of), thing(cube(0.05))).finger_m
    assert found == pytest.approx(finger_m, abs=GAP_TOLERANCE_M)


def test_the_lowest_finger_point_of_the_demos_pick_is_222_mm_above_the_table(
    manipulator: Manipulator, table: Body
) -> None:
    hand = manipulator.hand
    lows = [
        Body("part", (part,), PICK * at(0.0, sign * hand.stroke_m, 0.0)).extent_m((0, 0, 1))[0]
        for finger, sign in zip(hand.fingers, (1.0, -1.0), strict=True)
        for part in finger
    ]
    above = min(lows) - table.extent_m((0, 0, 1))[1]
    assert above == pytest.approx(22.2e-3, abs=0.05e-3)


def test_the_real_hands_hold_bodies_slightly_narrower_than_their_gaps(
    real_hands: dict[str, Hand],
) -> None:
    for hand in real_hands.values():
        for edge, fits in ((hand.open_gap_m - 1e-4, True), (hand.open_gap_m + 1e-4, False)):
            grasp = grasp_of(hand, ORIGIN, thing(cube(edge)), hand.stroke_m)
            assert (grasp is not None) == fits


@pytest.mark.parametrize(
    ("side", "edge", "is_held"),
    [
        *(("left", 0.0576, True), ("left", 0.0577, False), ("left", 0.0155, False)),
        *(("right", 0.048, True), ("right", 0.05, False), ("right", 0.006, False)),
    ],
)
def test_bodies_wider_than_the_open_or_thinner_than_the_closed_hand_are_missed(
    hands: dict[str, Hand], side: str, edge: float, is_held: bool
) -> None:
    hand = hands[side]
    assert (grasp_of(hand, ORIGIN, thing(cube(edge)), hand.stroke_m) is not None) is is_held


@pytest.mark.parametrize(
    ("edge", "x", "y", "z"),
    [
        *((0.04, 0.06, 0.0, 0.0), (0.04, -0.06, 0.0, 0.0), (0.04, 0.0, 0.0, 0.06)),
        *((0.04, 0.0, 0.0, -0.09), (0.04, 0.0, 0.2, 0.0)),
        (0.05, 0.0, 0.010, 0.0),  # reaches into a pad before the fingers close
        (0.02, 0.0, 0.045, 0.0),  # only one pad can touch it
    ],
)
def test_a_body_beside_the_pads_is_missed(
    hand: Hand, edge: float, x: float, y: float, z: float
) -> None:
    assert grasp_of(hand, ORIGIN, thing(cube(edge), x, y, z), hand.stroke_m) is None
    assert grasp_of(hand, ORIGIN, thing(cube(edge)), 0.002) is None  # wider than the present gap
    assert hand.width_across_m(ORIGIN, thing(cube(0.06), x=0.2)) == 0.0


def test_a_body_pressed_lightly_by_one_pad_is_still_centred(hand: Hand) -> None:
    offset = 0.0288335 - 0.025 + 0.0003  # where the open pad is, and as deep as a contact may be
    grasp = grasped(hand, thing(cube(0.05), 0.0, offset))
    assert grasp.width_m == pytest.approx(0.05, abs=CONTACT_TOLERANCE_M)
    assert grasp.push_m == pytest.approx(-offset, abs=CONTACT_TOLERANCE_M)


def test_of_several_parts_the_outermost_touch_the_pads(hand: Hand) -> None:
    parts = (Part(cube(0.01), at(0.0, 0.02, 0.0)), Part(cube(0.01), at(0.0, -0.01, 0.0)))
    body = Body("pair", parts, at(0.0, 0.0, PAD_Z_M), is_movable=True)
    grasp = grasped(hand, body)
    assert grasp.width_m == pytest.approx(0.04, abs=CONTACT_TOLERANCE_M)
    assert grasp.push_m == pytest.approx(-0.005, abs=CONTACT_TOLERANCE_M)


def pads_rectangle(hand: Hand) -> list[tuple[float, float]]:
    """The intervals that both pads cover along x and z of the tip."""
    spans = [[extent(part, axis) for pad in hand.pads for part in pad] for axis in (0, 2)]
    return [(min(low for low, _ in each), max(high for _, high in each)) for each in spans]


SHAPES = [
    Box((0.03, 0.02, 0.05)),
    Cylinder(0.015, 0.06),
    hull(np.random.default_rng(3).uniform(-0.03, 0.03, (12, 3))),
]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_the_width_of_a_shape_is_that_of_its_hull_between_the_pads(
    real_hand: Hand, shape: Shape
) -> None:
    """The peer is a linear program, in which round shapes are polytopes of 720 corners a rim."""
    rng = np.random.default_rng(11)
    x, z = pads_rectangle(real_hand)
    for _ in range(8):
        place = rng.uniform(-0.02, 0.02, 3) + np.array([0.0, 0.0, PAD_Z_M])
        T = pin.SE3(pin.exp3(rng.standard_normal(3)), place)
        body = Body("thing", (Part(shape, ORIGIN),), T, is_movable=True)
        points = corners_of(shape) @ T.rotation.T + place
        low, high = (_reach_m(sign, points, x, z) for sign in (-1.0, 1.0))
        assert real_hand.width_across_m(ORIGIN, body) == pytest.approx(high + low, abs=1e-6)


def corners_of(shape: Shape) -> FloatArray:
    if isinstance(shape, Box):
        return np.array(list(product((-0.5, 0.5), repeat=3))) * shape.size_m
    if isinstance(shape, Cylinder):
        turns = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
        ring = shape.radius_m * np.stack([np.cos(turns), np.sin(turns), 0.0 * turns], axis=1)
        up = np.array([0.0, 0.0, shape.length_m / 2.0])
        return np.concatenate([ring - up, ring + up])
    assert isinstance(shape, Mesh)
    return shape.vertices


def _reach_m(
    sign: float, points: FloatArray, x: tuple[float, float], z: tuple[float, float]
) -> float:
    """Extent of the hull of points along y, or -y, where x and z are in intervals."""
    inside = np.array([points[:, 0], -points[:, 0], points[:, 2], -points[:, 2]])
    bounds = np.array([x[1], -x[0], z[1], -z[0]])
    found = linprog(-sign * points[:, 1], inside, bounds, np.ones((1, len(points))), [1.0])
    return float(-found.fun)


@given(y=st.floats(-0.01, 0.01), x=st.floats(0.0, 0.045), radius=st.floats(0.005, 0.03))
def test_the_width_of_a_ball_is_that_of_its_disc_at_the_edge_of_the_pads(
    real_hand: Hand, x: float, y: float, radius: float
) -> None:
    (_, x_max), _ = pads_rectangle(real_hand)
    beside = max(x - x_max, 0.0)
    assume(abs(beside - radius) > 1e-4)
    expected = 2.0 * np.sqrt(radius**2 - beside**2) if beside < radius else 0.0
    width = real_hand.width_across_m(ORIGIN, thing(Sphere(radius), x, y))
    assert width == pytest.approx(expected, abs=1e-6)


def mug(handle_m: float) -> Body:
    """A cup with a handle of that thickness, seen from the tip: the pads are around the handle."""
    cup = Part(Cylinder(0.04, 0.09), at(-0.064, 0.0, 0.0))
    handle = Part(Box((0.06, handle_m, 0.05)), at(-0.014, 0.0, 0.0))
    return Body("mug", (cup, handle), at(0.0, 0.0, PAD_Z_M), is_movable=True)


def test_a_mug_is_as_wide_as_the_handle_that_the_pads_are_around(real_hand: Hand) -> None:
    assert real_hand.width_across_m(ORIGIN, mug(0.018)) == pytest.approx(0.018)
    assert grasped(real_hand, mug(0.018)).width_m == pytest.approx(0.018, abs=HOLLOW_M)
    thin = real_hand.close_on(ORIGIN, mug(0.010), real_hand.stroke_m)
    assert str(thin) == (
        "mug measures 10.0 mm across the hand, whose closed finger pads are 15.3 mm apart"
    )
    turned = real_hand.close_on(at(-0.064, 0.0, 0.0), mug(0.018), real_hand.stroke_m)
    assert "mug measures 80.0 mm across the hand" in str(turned)


def test_a_bin_is_as_wide_as_the_wall_that_the_pads_are_around(real_hand: Hand) -> None:
    """As boxes and as one mesh; the wall on the other side is farther than the hand opens."""
    near = Box((0.2, 0.02, 0.1))
    walls = (Part(near, at(0.0, 0.0, 0.0)), Part(near, at(0.0, 0.1, 0.0)))
    wall = cuboid(near.size_m)
    vertices = np.concatenate([wall.vertices, wall.vertices + np.array([0.0, 0.1, 0.0])])
    one = Mesh(vertices, np.concatenate([wall.triangles, wall.triangles + 8]))
    for parts in (walls, (Part(one, ORIGIN),)):
        body = Body("bin", parts, at(0.0, 0.0, PAD_Z_M - 0.03), is_movable=True)
        assert real_hand.width_across_m(ORIGIN, body) == pytest.approx(0.02)
        assert grasped(real_hand, body).width_m == pytest.approx(0.02, abs=HOLLOW_M)


def test_a_pad_inside_a_body_holds_nothing(hand: Hand) -> None:
    """A wall behind the open pad, and a slat between the pads, of one body."""
    slat, wall = Part(cube(0.03), ORIGIN), Part(Box((0.05, 0.03, 0.05)), at(0.0, 0.046, 0.0))
    body = Body("both", (slat, wall), at(0.0, 0.0, PAD_Z_M), is_movable=True)
    assert grasp_of(hand, ORIGIN, body, hand.stroke_m) is None


@pytest.mark.parametrize("finger_m", [-1e-6, 0.0209, np.nan, np.inf, None, "open", [0.01], True])
def test_refuses_an_invalid_finger_position(hand: Hand, finger_m: Any) -> None:
    body = thing(cube(0.04))
    for use in (
        hand.finger_joints,
        hand.percent,
        lambda x: hand.close_on(ORIGIN, body, x),
        lambda x: hand.pads_at(ORIGIN, x),
        lambda x: hand.fingers_at(ORIGIN, x),
        lambda x: hand.room_m(ORIGIN, x, body),
    ):
        with pytest.raises(ConfigurationError, match="finger position"):
            use(finger_m)
    with pytest.raises(ConfigurationError, match="; give metres, not millimetres or per cent"):
        hand.percent(15.0)


@pytest.mark.parametrize(
    ("T_base_tip", "body", "error"),
    [
        *((pose, thing(cube(0.04)), PoseError) for pose in (None, "here", np.eye(3))),
        (np.full((4, 4), np.nan), thing(cube(0.04)), PoseError),
        *((ORIGIN, body, SceneError) for body in (None, "block", cube(0.04))),
    ],
)
def test_refuses_an_invalid_pose_or_body(
    hand: Hand, T_base_tip: Any, body: Any, error: type[Exception]
) -> None:
    for use in (
        lambda: hand.close_on(T_base_tip, body, 0.02),
        lambda: hand.width_across_m(T_base_tip, body),
        lambda: hand.room_m(T_base_tip, 0.02, body),
    ):
        with pytest.raises(error):
            use()


@pytest.mark.parametrize("side", ["middle", None, [], 3])
def test_refuses_to_find_fingers_on_an_invalid_side(robot: Baxter, side: Any) -> None:
    assert Hand.is_on(robot, "left")
    with pytest.raises(UnknownNameError):
        Hand.is_on(robot, side)
    nothing: Any = None
    with pytest.raises(SceneError):
        Hand.is_on(nothing, "left")
