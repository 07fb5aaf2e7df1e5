from __future__ import annotations

import fcl
import numpy as np
import pinocchio as pin
import pytest
import trimesh
from trimesh.proximity import closest_point_naive

from baxter_kin import Baxter
from baxter_kin.validation import FloatArray
from planner import Body, make_block
from planner.collision.robot.robot_body import RobotBody
from planner.collision.robot.robot_shapes import RobotShapes
from planner.scene.bodies import Box
from planner.scene.contact import Contact
from sim.recording.recording import Recording
from sim.view.telemetry.nearest import TIE_M, Nearest, NearestPairs
from sim.view.telemetry.stated_contacts import Contacts
from tests.conftest import at

APART_M = 1e-9
"""The two points are so exactly as far apart as the distance says."""

REFERENCE_M = 2e-6
"""How far FCL's distances of triangles, and trimesh's, are from coal's."""


@pytest.fixture(scope="module")
def shapes(robot: Baxter) -> RobotShapes:
    return RobotShapes(robot)


@pytest.fixture(scope="module")
def measured(shapes: RobotShapes, table: Body, block: Body) -> NearestPairs:
    return NearestPairs(shapes, ("left",), {"table": table, "block": block})


@pytest.fixture(scope="module")
def poses(table: Body, block: Body) -> dict[str, FloatArray]:
    return {body.name: body.T_base_body.homogeneous for body in (table, block)}


def configurations(robot: Baxter, count: int) -> list[FloatArray]:
    """The left arm in front of the robot, over the table or in it."""
    rng, arm = np.random.default_rng(3), robot.arm("left")
    where = list(robot.indices(arm.joint_names))
    found = []
    for _ in range(count):
        q = np.array(robot.configuration())
        q[where] = np.clip(arm.start + rng.normal(0.0, 0.35, 7), arm.limits.q_min, arm.limits.q_max)
        found.append(q)
    return found


def surface_of(link: str, robot: Baxter, q: FloatArray) -> trimesh.Trimesh:
    """The triangles of a link, placed by Pinocchio alone."""
    vertices, triangles = RobotBody.load().links[link].whole
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    T = data.oMf[robot.model.getFrameId(link, pin.FrameType.BODY)]
    placed = vertices @ T.rotation.T + T.translation
    return trimesh.Trimesh(placed, triangles, process=False)


def object_of(mesh: trimesh.Trimesh) -> fcl.CollisionObject:
    model = fcl.BVHModel()
    model.beginModel(len(mesh.vertices), len(mesh.faces))
    model.addSubModel(mesh.vertices, mesh.faces)
    model.endModel()
    return fcl.CollisionObject(model, fcl.Transform())


def boxes_of(body: Body) -> list[fcl.CollisionObject]:
    found = []
    for part in body.placed_parts:
        assert isinstance(part.shape, Box)
        T = part.T_body_part
        pose = fcl.Transform(T.rotation, T.translation)
        found.append(fcl.CollisionObject(fcl.Box(*part.shape.size_m), pose))
    return found


def distance_m(first: fcl.CollisionObject, second: fcl.CollisionObject) -> float:
    return float(fcl.distance(first, second, fcl.DistanceRequest(), fcl.DistanceResult()))


def nearest(pairs: NearestPairs, q: FloatArray, poses: dict[str, FloatArray]) -> Nearest:
    found = pairs.at(q, poses, Contacts())
    assert found is not None
    return found


def test_points_are_as_far_apart_as_it_says(
    measured: NearestPairs, robot: Baxter, poses: dict[str, FloatArray]
) -> None:
    positive = 0
    for q in configurations(robot, 40):
        near = nearest(measured, q, poses)
        if near.distance_m > 0.0:
            positive += 1
            apart = np.linalg.norm(near.points_base[1] - near.points_base[0])
            assert apart == pytest.approx(near.distance_m, abs=APART_M)
    assert positive > 10


def test_points_are_on_the_links_skin(
    measured: NearestPairs, robot: Baxter, poses: dict[str, FloatArray]
) -> None:
    body = RobotBody.load()
    for q in configurations(robot, 12):
        near = nearest(measured, q, poses)
        if near.distance_m <= 0.0:
            continue
        for name, point in zip((near.first, near.second), near.points_base, strict=True):
            if name in body.links:
                seen = surface_of(name, robot, q)
                _, off, _ = closest_point_naive(seen, point[None])  # type: ignore[no-untyped-call]
                assert off[0] == pytest.approx(body.links[name].margin_m, abs=REFERENCE_M)


def test_no_link_is_nearer_to_a_body_by_other_code(
    measured: NearestPairs, shapes: RobotShapes, executed: Recording, poses: dict[str, FloatArray]
) -> None:
    body, robot = RobotBody.load(), shapes.robot
    arm = robot.arm("left")
    links = {shapes.links[i] for i in shapes.of_arm(arm) & shapes.wholes}
    others = [box for each in measured.bodies.values() for box in boxes_of(each)]
    told = 0
    for q in [*executed.q[270::90], *configurations(robot, 2)]:
        near = nearest(measured, q, poses)
        least = min(
            distance_m(object_of(surface_of(link, robot, q)), box) - body.links[link].margin_m
            for link in links
            for box in others
        )
        if least > 0.0:
            assert near.distance_m <= least + REFERENCE_M
        if near.distance_m > 0.0 and near.second in ("table", "block"):
            told += 1
            assert near.distance_m == pytest.approx(least, abs=REFERENCE_M)
    assert told > 1


def test_what_moves_comes_first(
    measured: NearestPairs, robot: Baxter, poses: dict[str, FloatArray]
) -> None:
    for q in configurations(robot, 10):
        assert nearest(measured, q, poses).first.startswith(("left_", "l_gripper"))


def test_bodies_that_are_not_there_do_not_count(measured: NearestPairs, robot: Baxter) -> None:
    for q in configurations(robot, 5):
        near = nearest(measured, q, {"never told of": np.eye(4)})
        assert {near.first, near.second}.isdisjoint({"table", "block"})


def test_a_hand_that_may_touch_a_body_does_not_count_against_it(
    measured: NearestPairs, robot: Baxter, poses: dict[str, FloatArray], block: Body
) -> None:
    q = np.array(robot.configuration())
    arm = robot.arm("left")
    q[list(robot.indices(arm.joint_names))] = arm.start
    around = {"block": at(*arm.T_base_tip(arm.start).translation).homogeneous}
    touching = measured.at(q, around, Contacts())
    assert touching is not None
    assert touching.distance_m <= 0.0
    assert "block" in (touching.first, touching.second)
    for contacts in (
        Contacts(meant=frozenset(Contact.of_hand("left", "block", may_press=False))),
        Contacts(unknown=frozenset(["left"])),
        Contacts(held=frozenset([("left", "block")])),
    ):
        near = measured.at(q, around, contacts)
        assert near is not None
        assert near.distance_m > 0.0


def test_a_held_body_counts_against_others_unless_it_may_touch_them(
    measured: NearestPairs, robot: Baxter, poses: dict[str, FloatArray]
) -> None:
    q, held = np.array(robot.configuration()), frozenset([("left", "block")])
    near = measured.at(q, poses, Contacts(held))
    assert near is not None
    assert {near.first, near.second} == {"block", "table"}
    assert near.first == "block"
    other_part = Contact("block", "table", 0, 7)
    still = measured.at(q, poses, Contacts(held, frozenset([other_part])))
    assert still is not None
    assert {still.first, still.second} == {"block", "table"}
    for contacts in (
        Contacts(held, frozenset([Contact("block", "table")])),
        Contacts(held, frozenset([Contact("table", "block", 0, 0)])),
        Contacts(held, unknown=frozenset(["left"])),
    ):
        free = measured.at(q, poses, contacts)
        assert free is not None
        assert {free.first, free.second} != {"block", "table"}


def test_both_arms_count_when_both_move(shapes: RobotShapes, robot: Baxter) -> None:
    both, left, right = (
        NearestPairs(shapes, sides, {}) for sides in (("left", "right"), ("left",), ("right",))
    )
    for q in configurations(robot, 6):
        one, other, least = (nearest(pairs, q, {}) for pairs in (left, right, both))
        assert least.distance_m == pytest.approx(min(one.distance_m, other.distance_m), abs=1e-9)


def test_a_pair_of_the_moving_arm_is_preferred_to_one_that_stands(
    shapes: RobotShapes, robot: Baxter
) -> None:
    """A box 20 mm beside the left hand, which stands, while the right arm moves."""
    q = np.array(robot.configuration())
    tip = robot.arm("left").T_base_tip(robot.arm("left").neutral).translation
    box = make_block("box", at(*tip), edge_m=0.02)
    beside = {"box": at(tip[0], tip[1] + 0.12, tip[2]).homogeneous}
    pairs = NearestPairs(shapes, ("left", "right"), {"box": box})
    standing = pairs.at(q, beside, Contacts())
    assert standing is not None
    assert "box" in (standing.first, standing.second)
    moving = pairs.at(q, beside, Contacts(), ("right",))
    assert moving is not None
    assert moving.first.startswith(("right_", "r_gripper"))
    assert moving.distance_m >= standing.distance_m
    alone = NearestPairs(shapes, ("right",), {"box": box}).at(q, beside, Contacts())
    assert alone is not None
    assert moving.distance_m == pytest.approx(alone.distance_m, abs=1e-9)


@pytest.mark.parametrize(("nearer_m", "names_hand"), [(0.5 * TIE_M, True), (2.0 * TIE_M, False)])
def test_of_equally_near_pairs_that_of_the_moving_hand_is_reported(
    shapes: RobotShapes, robot: Baxter, nearer_m: float, names_hand: bool
) -> None:
    """One box over the forearm, and one before the fingers that is a little farther away."""
    q, arm = np.array(robot.configuration()), robot.arm("left")
    q[list(robot.indices(arm.joint_names))] = arm.start
    elbow, tip = _elbow_and_tip(robot, q)
    boxes = {name: make_block(name, at(0, 0, 0), edge_m=0.02) for name in ("one", "other")}
    pairs = NearestPairs(shapes, ("left",), boxes)

    def poses(first_m: float, second_m: float) -> dict[str, FloatArray]:
        up, down = np.array([0.0, 0.0, first_m]), np.array([0.0, 0.0, -second_m])
        return {"one": at(*(elbow + up)).homogeneous, "other": at(*(tip + down)).homogeneous}

    def away_m(name: str, height_m: float) -> float:
        placed = poses(height_m, height_m)
        near = pairs.at(q, {name: placed[name]}, Contacts())
        assert near is not None
        assert name in (near.first, near.second)
        return near.distance_m

    def height_m(name: str, wanted_m: float) -> float:
        low, high = 0.02, 0.3
        while high - low > 1e-9:
            middle = (low + high) / 2
            low, high = (middle, high) if away_m(name, middle) < wanted_m else (low, middle)
        return high

    heights = height_m("one", 0.015), height_m("other", 0.015 + nearer_m)
    near = pairs.at(q, poses(*heights), Contacts(), ("left",))
    assert near is not None
    assert ("other" in (near.first, near.second)) is names_hand


def _elbow_and_tip(robot: Baxter, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    elbow = data.oMi[robot.model.getJointId("left_e1")].translation
    return elbow, data.oMf[robot.model.getFrameId(robot.arm("left").tip_frame)].translation
