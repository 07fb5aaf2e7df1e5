"""Closing: what the fingers push on their way, and where they end."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from baxter_kin import Baxter
from planner import Body, Manipulator, make_block
from planner.collision.robot.robot_body import RobotBody
from planner.grasping import Grasp, MissKind
from sim import Closing, World
from sim.world import Gripper
from tests.bodies import grasp_of
from tests.conftest import at, overhead

CONTACT_M = 1e-6
"""Both pads are on a body within this, measured by other code to 1e-9 m."""

REST_M = 1e-7
RIGID = 1e-12
TABLE_Z_M = -0.155
PAD_Z_M = -0.015
"""Middle of the pads, seen from the tip."""

LEVEL_PICK = pin.SE3(np.diag([1.0, -1.0, -1.0]), np.array([0.70, 0.15, -0.129]))
"""Straight down, the closing axis along -y of base."""


@pytest.fixture(scope="module")
def q_level(manipulator: Manipulator) -> np.ndarray:
    """The left arm over the table, its hand straight down."""
    answer = manipulator.ik.solve(LEVEL_PICK)
    assert answer.is_valid
    return answer.q


@pytest.fixture(scope="module", params=["plain fingers", "Rethink's"])
def shared(
    request: pytest.FixtureRequest,
    robot: Baxter,
    table: Body,
    q_level: np.ndarray,
    plain: RobotBody,
) -> World:
    """The left hand around nothing, on the table; each example removes what it adds."""
    world = World(robot, plain if request.param == "plain fingers" else None)
    world.move_arm("left", q_level)
    world.spawn(table)
    return world


@pytest.fixture
def world(robot: Baxter, table: Body, q_level: np.ndarray, plain: RobotBody) -> World:
    world = World(robot, plain)
    world.move_arm("left", q_level)
    world.spawn(table)
    return world


def standing(name: str, y: float = 0.15, *, yaw: float = 0.0, edge: object = 0.045) -> Body:
    """A block on the table, below the hand."""
    block = make_block(name, at(0.0, 0.0, 0.0), edge_m=edge)  # type: ignore[arg-type]
    z = TABLE_Z_M + block.extent_m((0, 0, 1))[1]
    return block.at(pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, yaw), np.array([0.70, y, z])))


def fixed(name: str, y: float, *, width: float = 0.004, x: float = 0.70, z: float = -0.13) -> Body:
    """Something that does not give way."""
    return make_block(name, at(x, y, z), edge_m=(0.01, width, 0.02), is_movable=False)


def in_the_hand(world: World, name: str, y: float, *, edge: object, movable: bool = True) -> None:
    """A block between the pads in the air, its centre so far along y of the tip."""
    block = make_block(name, at(0, 0, 0), edge_m=edge, is_movable=movable)  # type: ignore[arg-type]
    world.spawn(block)
    world.place_body(name, world.T_base_tip("left") * at(0.0, y, PAD_Z_M))


def close(world: World, wanted: str | None = None) -> Closing:
    gripper = Gripper(world, "left")
    closing = gripper.closing(wanted)
    gripper.finish(closing)
    return closing


def gaps_m(world: World, name: str) -> list[float]:
    """Distance of each finger's pad to a block, by Pinocchio's kinematics and coal."""
    model, shapes = world.robot.model, world.shapes.model
    data, placed = model.createData(), shapes.createData()
    pin.updateGeometryPlacements(model, data, shapes, placed, world.q)
    body = world.body(name)
    box = coal.Box(*body.parts[0].shape.size_m)  # type: ignore[union-attr]
    T = body.T_base_body * body.parts[0].T_body_part
    gaps: dict[str, float] = {}
    for index in world.shapes.of_pads(world.robot.arm("left")):
        pad, at_pad = shapes.geometryObjects[index].geometry, placed.oMg[index]
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        request.gjk_tolerance = 1e-9
        poses = [coal.Transform3s(P.rotation, P.translation) for P in (at_pad, T)]
        gap = coal.distance(pad, poses[0], box, poses[1], request, result)
        link = world.shapes.links[index]
        gaps[link] = min(gap, gaps.get(link, gap))
    return list(gaps.values())


OFF_M = 0.0034
"""A block of 5 cm that is so far off the middle, and turned by up to 0.15 rad, is between the open
pads; at 3.5 mm and 0.15 rad a corner is more than 0.5 mm inside one."""


class TestHolding:
    """An off-centre and askew block, on the table."""

    @pytest.mark.slow
    @example(OFF_M, -0.15)
    @example(-OFF_M, 0.15)
    @example(0.0035, 0.140625)  # a finger presses into it by 0.1 mm from the start
    @settings(max_examples=25)
    @given(st.floats(-OFF_M, OFF_M), st.floats(-0.15, 0.15))
    def test_it_slides_along_the_closing_axis_until_both_pads_touch_as_the_hand_predicts(
        self, shared: World, offset: float, yaw: float
    ) -> None:
        hand = shared.hands["left"]
        shared.set_fingers("left", hand.stroke_m)
        shared.spawn(standing("b", 0.15 + offset, yaw=yaw))
        try:
            T_base_tip, body = shared.T_base_tip("left"), shared.body("b")
            predicted = grasp_of(hand, T_base_tip, body, hand.stroke_m)
            closing = close(shared)
            assert closing.body == "b"
            assert gaps_m(shared, "b") == pytest.approx([0.0, 0.0], abs=CONTACT_M)
            before, after = body.T_base_body, shared.body("b").T_base_body
            assert closing.grasp is not None
            moved = T_base_tip.rotation.T @ (after.translation - before.translation)
            assert moved == pytest.approx([0.0, closing.grasp.push_m, 0.0], abs=1e-9)
            assert after.rotation == pytest.approx(before.rotation, abs=1e-9)
            assert after.translation[2] == pytest.approx(before.translation[2], abs=REST_M)
            assert predicted is not None
            assert closing.finger_m == predicted.finger_m
            held = shared.holding("left")
            assert held is not None
            assert (held.T_link_body.homogeneous == predicted.T_tip_body.homogeneous).all()
            assert closing.pushes[0].distance_m == pytest.approx(abs(predicted.push_m), abs=RIGID)
        finally:
            shared.delete("b")

    @pytest.mark.parametrize("yaw", [-0.15, 0.15])
    def test_a_block_with_a_corner_in_a_pad_is_not_grasped(self, shared: World, yaw: float) -> None:
        shared.set_fingers("left", shared.hands["left"].stroke_m)
        shared.spawn(standing("b", 0.15 + 0.0038, yaw=yaw))
        try:
            assert close(shared).body is None
        finally:
            shared.delete("b")

    def test_the_block_moves_with_the_finger_from_the_moment_of_touch(self, world: World) -> None:
        world.spawn(standing("b", 0.153))  # y of the tip points along -y of base
        before = world.q.tolist(), world.body("b").T_base_body
        gripper = Gripper(world, "left")
        closing = gripper.closing()
        assert (world.q.tolist(), world.body("b").T_base_body) == before
        (push,) = closing.pushes
        assert (push.body, push.finger, push.by) == ("b", "right", "right finger")
        assert push.distance_m == pytest.approx(0.003, abs=CONTACT_M)
        for finger_m in np.linspace(world.finger_m("left"), closing.finger_m, 9):
            gripper.close_to(closing, float(finger_m))
            moved = 0.153 - world.body("b").T_base_body.translation[1]
            assert moved == pytest.approx(max(0.0, push.begin_m - finger_m), abs=REST_M)
            if finger_m < push.begin_m:
                assert min(gaps_m(world, "b")) == pytest.approx(0.0, abs=CONTACT_M)

    def test_what_stands_on_a_pushed_block_goes_along(self, world: World) -> None:
        world.spawn(standing("b", 0.153))
        world.spawn(make_block("top", at(0.70, 0.153, 0.1), edge_m=0.02))
        before = world.body("top").centre_base
        closing = close(world)
        assert closing.body == "b"
        assert {push.body: push.is_riding for push in closing.pushes} == {"b": False, "top": True}
        assert world.body("top").centre_base - before == pytest.approx(
            [0, -0.003, 0], abs=CONTACT_M
        )
        assert world.supports["top"] == ("b",)

    def test_a_hand_that_is_not_quite_level_slides_the_block_along_the_table(
        self,
        robot: Baxter,
        table: Body,
        manipulator: Manipulator,
        block: Body,
        plain: RobotBody,
    ) -> None:
        world = World(robot, plain)
        world.move_arm("left", manipulator.ik.solve(overhead(0.70, 0.15, -0.129)).q)
        world.spawn(table)
        world.spawn(block)
        closing = close(world)
        assert closing.body == "block"
        grasp = closing.grasp
        assert isinstance(grasp, Grasp)
        raised = world.body("block").extent_m((0, 0, 1))[0] - TABLE_Z_M
        slope = world.T_base_tip("left").rotation[2, 1]
        assert raised == pytest.approx(slope * grasp.push_m, abs=REST_M)
        assert abs(raised) < 5e-5


class TestNeighbours:
    """What a pushed block meets."""

    def test_another_block_is_pushed_along(self, world: World) -> None:
        world.spawn(standing("b", 0.153))
        world.spawn(make_block("next", at(0.70, 0.12, -0.15), edge_m=(0.01, 0.018, 0.01)))
        closing = close(world)
        assert closing.body == "b"
        pushes = {push.body: push for push in closing.pushes}
        assert pushes["next"].by == "b"
        # it was 1.5 mm away from a block that is pushed by 3 mm
        assert pushes["next"].distance_m == pytest.approx(0.0015, abs=CONTACT_M)
        assert world.body("next").centre_base[1] == pytest.approx(0.1185, abs=CONTACT_M)

    def test_a_wall_behind_the_block_stops_the_fingers(self, world: World) -> None:
        world.spawn(standing("b", 0.153))
        world.spawn(fixed("wall", 0.1275, z=-0.15))  # its near side is 1 mm from the block
        closing = close(world)
        assert closing.miss is not None
        assert closing.miss.kind is MissKind.BLOCKED
        assert str(closing.miss) == "b met wall, which does not give way"
        assert closing.pushes[0].distance_m == pytest.approx(0.001, abs=CONTACT_M)
        assert world.body("b").extent_m((0, 1, 0))[0] == pytest.approx(0.1295, abs=CONTACT_M)

    def test_two_blocks_between_the_fingers_are_a_miss_that_names_both(self, world: World) -> None:
        for name, y in (("red", 0.137), ("blue", 0.163)):
            world.spawn(standing(name, y, edge=(0.04, 0.02, 0.04)))
        closing = close(world)
        assert closing.miss is not None
        assert closing.miss.kind is MissKind.CROWDED
        assert "red" in str(closing.miss)
        assert "blue" in str(closing.miss)
        gap = world.body("blue").extent_m((0, 1, 0))[0] - world.body("red").extent_m((0, 1, 0))[1]
        assert gap == pytest.approx(0.0, abs=CONTACT_M)

    @pytest.mark.parametrize("y", [0.0, 0.003])
    def test_what_the_other_hand_holds_does_not_give_way(self, world: World, y: float) -> None:
        in_the_hand(world, "b", y, edge=0.03)
        before = world.body("b").T_base_body
        world.attach("right", "b", world.T_base_tip("right").inverse() * before)
        closing = close(world)
        after = world.body("b").T_base_body
        np.testing.assert_allclose(after.homogeneous, before.homogeneous, atol=1e-12)
        if y == 0.0:
            assert closing.body == "b"
            assert len(world.held) == 2
            return
        assert closing.miss is not None
        assert closing.miss.kind is MissKind.BLOCKED


class TestImmovable:
    """Fingers do not pass through what does not give way."""

    @pytest.mark.parametrize("y", [-0.015, 0.0, 0.012])
    def test_they_stop_at_a_post(self, world: World, y: float) -> None:
        in_the_hand(world, "post", y, edge=(0.01, 0.02, 0.02), movable=False)
        closing = close(world)
        assert closing.miss is not None
        assert closing.miss.kind is MissKind.BLOCKED
        assert closing.finger_m == pytest.approx(abs(y) + 0.01 - 0.008, abs=CONTACT_M)
        assert min(gaps_m(world, "post")) == pytest.approx(0.0, abs=CONTACT_M)

    def test_a_finger_that_is_inside_something_does_not_move(self, world: World) -> None:
        in_the_hand(world, "post", 0.02, edge=0.03, movable=False)
        begin = world.finger_m("left")
        assert close(world).finger_m == begin

    def test_fingers_slide_over_a_table_that_they_touch(self, world: World) -> None:
        tip = world.T_base_tip("left").translation[2]
        plate = make_block(
            "plate", at(0.70, 0.15, tip - 0.005 - 0.01), edge_m=(0.3, 0.3, 0.02), is_movable=False
        )
        world.spawn(plate)
        closing = close(world)
        assert closing.finger_m == 0.0
        assert closing.miss is not None
        assert closing.miss.kind is MissKind.NOTHING


class TestMisses:
    """Why nothing is held."""

    def test_the_wanted_body_is_the_subject_of_a_miss(self, world: World) -> None:
        world.spawn(standing("b", -0.1))
        miss = close(world, "b").miss
        assert miss is not None
        assert (miss.kind, miss.body) == (MissKind.NOTHING, "b")
        assert "250 mm to the side of the tip" in str(miss)

    def test_too_low_is_a_miss_with_its_number_and_the_fingers_stop_on_it(
        self, world: World
    ) -> None:
        in_the_hand(world, "b", 0.0, edge=0.04)
        world.place_body("b", world.T_base_tip("left") * at(0.0, 0.0, 0.0035 - 0.001 + 0.02))
        closing = close(world)
        assert closing.miss is not None
        assert closing.miss.kind is MissKind.EDGE
        assert closing.miss.amount_m == pytest.approx(0.001, abs=CONTACT_M)
        assert closing.finger_m == pytest.approx((0.04 - 0.016) / 2, abs=CONTACT_M)
        assert world.holding("left") is None

    def test_too_wide_names_both_widths_and_nothing_moves(self, world: World) -> None:
        in_the_hand(world, "b", 0.0, edge=0.06)
        begin = world.finger_m("left")
        closing = close(world)
        assert closing.miss is not None
        assert closing.miss.kind is MissKind.TOO_WIDE
        assert "60.0 mm across the hand, whose finger pads are 57.7 mm apart" in str(closing.miss)
        assert closing.finger_m == begin
        assert closing.pushes == ()

    def test_what_only_the_fingers_touch_above_their_pads_is_not_held(self, world: World) -> None:
        in_the_hand(world, "b", 0.0, edge=0.03)
        world.place_body("b", world.T_base_tip("left") * at(0.0, 0.0, -0.06))
        closing = close(world)
        assert closing.miss is not None
        assert str(closing.miss) == "the fingers touch b outside of their pads"
        assert closing.finger_m == pytest.approx((0.03 - 0.018) / 2, abs=CONTACT_M)


@pytest.mark.parametrize("below_m", [0.0, 0.002])
def test_a_plate_on_a_stand_is_grasped_from_above_and_below(
    robot: Baxter, manipulator: Manipulator, below_m: float
) -> None:
    """A level hand; where it is too low, the upper finger would push the plate into its stand."""
    world, z = World(robot), 0.055
    world.spawn(make_block("stand", at(0.6, 0.0, 0.0), edge_m=(0.2, 0.2, 0.09), is_movable=False))
    world.spawn(make_block("plate", at(0.6, 0.0, z), edge_m=(0.2, 0.5, 0.02)))
    R = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    answer = manipulator.ik.solve(pin.SE3(R, np.array([0.6, 0.22, z - below_m])))
    assert answer.is_valid
    world.move_arm("left", answer.q)
    closing = Gripper(world, "left").closing("plate")
    if below_m == 0.0:
        assert closing.grasp is not None, closing.miss
        assert closing.grasp.width_m == pytest.approx(0.02, abs=2e-3)
        assert all(push.distance_m < CONTACT_M for push in closing.pushes)
    else:
        assert closing.miss is not None
        assert closing.miss.kind is MissKind.BLOCKED
