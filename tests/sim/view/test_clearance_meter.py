from __future__ import annotations

import fcl
import numpy as np
import pinocchio as pin
import pytest
import trimesh
from trimesh.proximity import closest_point_naive

from baxter_kin import Baxter
from baxter_kin.validation import FloatArray
from planner import Body, Plan, make_block
from planner.clearance import Clearance
from planner.collision.robot.robot_body import RobotBody
from planner.collision.robot.robot_shapes import RobotShapes
from planner.scene.bodies import Box
from planner.scene.contact import PartContact
from sim.events import Event, EventKind
from sim.recording.recorded_motion import RecordedMove
from sim.recording.recording import Recording
from sim.view.clearance import TIE_M, ClearanceMeter, Hands, HandState
from tests.conftest import at

APART_M = 1e-9
"""The two points are so exactly as far apart as the distance says."""

REFERENCE_M = 2e-6
"""How far FCL's distances of triangles, and trimesh's, are from coal's."""


@pytest.fixture(scope="module")
def shapes(robot: Baxter) -> RobotShapes:
    return RobotShapes(robot)


@pytest.fixture(scope="module")
def bodies(table: Body, block: Body) -> dict[str, Body]:
    return {"table": table, "block": block}


@pytest.fixture(scope="module")
def meter(shapes: RobotShapes, bodies: dict[str, Body]) -> ClearanceMeter:
    return ClearanceMeter(shapes, bodies)


@pytest.fixture(scope="module")
def poses(bodies: dict[str, Body]) -> dict[str, pin.SE3]:
    return {name: body.T_base_body for name, body in bodies.items()}


NOTHING_INTENDED = HandState(supports=frozenset())


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


def nearest(
    meter: ClearanceMeter,
    q: FloatArray,
    poses: dict[str, pin.SE3],
    left: HandState = NOTHING_INTENDED,
    moving: tuple[str, ...] = ("left",),
) -> Clearance:
    return nearest_and_points(meter, q, poses, left, moving)[0]


def nearest_and_points(
    meter: ClearanceMeter,
    q: FloatArray,
    poses: dict[str, pin.SE3],
    left: HandState = NOTHING_INTENDED,
    moving: tuple[str, ...] = ("left",),
) -> tuple[Clearance, FloatArray]:
    found = meter.at(q, poses, {"left": left, "right": NOTHING_INTENDED}, moving)
    assert found is not None
    return found


def test_points_are_as_far_apart_as_the_distance_and_on_the_links_skin(
    meter: ClearanceMeter, robot: Baxter, poses: dict[str, pin.SE3]
) -> None:
    body, positive = RobotBody.load(), 0
    for number, q in enumerate(configurations(robot, 40)):
        near, points = nearest_and_points(meter, q, poses)
        assert near.first.startswith(("left_", "l_gripper"))  # what moves comes first
        if near.distance_m <= 0.0:
            continue
        positive += 1
        apart = np.linalg.norm(points[1] - points[0])
        assert apart == pytest.approx(near.distance_m, abs=APART_M)
        for name, point in zip((near.first, near.second), points, strict=True):
            if name in body.links and number < 12:
                skin = surface_of(name, robot, q)
                _, off, _ = closest_point_naive(skin, point[None])  # type: ignore[no-untyped-call]
                assert off[0] == pytest.approx(body.links[name].margin_m, abs=REFERENCE_M)
    assert positive > 10


@pytest.mark.slow
def test_no_link_is_nearer_to_a_body_by_other_code(
    meter: ClearanceMeter,
    shapes: RobotShapes,
    executed: Recording,
    bodies: dict[str, Body],
    poses: dict[str, pin.SE3],
) -> None:
    body, robot = RobotBody.load(), shapes.robot
    arm = robot.arm("left")
    links = {shapes.links[i] for i in shapes.of_arm(arm) & shapes.wholes}
    others = [box for each in bodies.values() for box in boxes_of(each)]
    compared = 0
    for q in [*executed.q[270::180], *configurations(robot, 1)]:
        near = nearest(meter, q, poses)
        least = min(
            distance_m(object_of(surface_of(link, robot, q)), box) - body.links[link].margin_m
            for link in links
            for box in others
        )
        if least > 0.0:
            assert near.distance_m <= least + REFERENCE_M
        if near.distance_m > 0.0 and near.second in ("table", "block"):
            compared += 1
            assert near.distance_m == pytest.approx(least, abs=REFERENCE_M)
    assert compared > 1


def test_bodies_that_are_not_there_do_not_count(meter: ClearanceMeter, robot: Baxter) -> None:
    for q in configurations(robot, 5):
        near = nearest(meter, q, {"unknown": pin.SE3.Identity()})
        assert {near.first, near.second}.isdisjoint({"table", "block"})


@pytest.mark.parametrize(
    "hand",
    [HandState(None, "block", frozenset()), HandState(), HandState("block", None, frozenset())],
    ids=["is to grasp it", "unknown", "holds it"],
)
def test_a_hand_that_may_touch_a_body_does_not_count_against_it(
    meter: ClearanceMeter, robot: Baxter, hand: HandState
) -> None:
    q, arm = np.array(robot.configuration()), robot.arm("left")
    q[list(robot.indices(arm.joint_names))] = arm.start
    tip = arm.T_base_tip(arm.start)
    inside = {"block": at(*tip.translation)}
    touching = nearest(meter, q, inside)
    assert touching.distance_m <= 0.0
    if hand.touchable is not None:  # an intended contact counts where it presses too deep
        assert nearest(meter, q, inside, hand).distance_m < 0.0
    assert "block" in (touching.first, touching.second)
    above = {"block": at(*(tip.translation + np.array([0.0, 0.0, -0.06])))}
    assert "block" in nearest(meter, q, above).second
    near = nearest(meter, q, above, hand)
    assert "block" not in (near.first, near.second)
    assert near.distance_m > 0.0


@pytest.mark.parametrize(
    ("supports", "counts"),
    [
        (frozenset(), True),
        (frozenset([PartContact(0, "table", 7)]), True),
        (frozenset(["table"]), False),
        (frozenset([PartContact(0, "table", 0)]), False),
        (None, False),
    ],
)
def test_a_held_body_counts_against_others_unless_it_may_touch_them(
    meter: ClearanceMeter,
    robot: Baxter,
    poses: dict[str, pin.SE3],
    supports: frozenset[PartContact | str] | None,
    counts: bool,
) -> None:
    near = nearest(
        meter, np.array(robot.configuration()), poses, HandState("block", None, supports)
    )
    assert ((near.first, near.second) == ("block", "table")) is counts


def test_a_pair_of_the_moving_arm_is_preferred_to_one_that_stands(
    shapes: RobotShapes, robot: Baxter
) -> None:
    """A box 20 mm beside the left hand, which stands, while the right arm moves."""
    q = np.array(robot.configuration())
    tip = robot.arm("left").T_base_tip(robot.arm("left").neutral).translation
    meter = ClearanceMeter(shapes, {"box": make_block("box", at(*tip), edge_m=0.02)})
    beside = {"box": at(tip[0], tip[1] + 0.12, tip[2])}
    both = nearest(meter, q, beside, moving=("left", "right"))
    assert "box" in (both.first, both.second)
    right = nearest(meter, q, beside, moving=("right",))
    assert right.first.startswith(("right_", "r_gripper"))
    assert right.distance_m >= both.distance_m
    one, other = (nearest(meter, q, beside, moving=(side,)) for side in ("left", "right"))
    assert both.distance_m == pytest.approx(min(one.distance_m, other.distance_m), abs=1e-9)


def test_bodies_may_be_elsewhere_each_time(meter: ClearanceMeter, robot: Baxter) -> None:
    q, arm = np.array(robot.configuration()), robot.arm("left")
    tip = arm.T_base_tip(arm.neutral).translation
    distances = [
        nearest(meter, q, {"block": at(tip[0], tip[1], tip[2] - below_m)}).distance_m
        for below_m in (0.06, 0.05, 0.06)
    ]
    assert distances[0] == distances[2]
    assert distances[0] - distances[1] == pytest.approx(0.01, abs=5e-3)


@pytest.mark.parametrize(("nearer_m", "names_hand"), [(0.5 * TIE_M, True), (2.0 * TIE_M, False)])
def test_of_equally_near_pairs_that_of_the_moving_hand_is_reported(
    shapes: RobotShapes, robot: Baxter, nearer_m: float, names_hand: bool
) -> None:
    """One box over the forearm, and one before the fingers that is a little farther away."""
    q, arm = np.array(robot.configuration()), robot.arm("left")
    q[list(robot.indices(arm.joint_names))] = arm.start
    elbow, tip = _elbow_and_tip(robot, q)
    boxes = {name: make_block(name, at(0, 0, 0), edge_m=0.02) for name in ("one", "other")}
    meter = ClearanceMeter(shapes, boxes)

    def poses(first_m: float, second_m: float) -> dict[str, pin.SE3]:
        up, down = np.array([0.0, 0.0, first_m]), np.array([0.0, 0.0, -second_m])
        return {"one": at(*(elbow + up)), "other": at(*(tip + down))}

    def away_m(name: str, height_m: float) -> float:
        near = nearest(meter, q, {name: poses(height_m, height_m)[name]})
        assert name in (near.first, near.second)
        return near.distance_m

    def height_m(name: str, wanted_m: float) -> float:
        low, high = 0.02, 0.3
        while high - low > 1e-9:
            middle = (low + high) / 2
            low, high = (middle, high) if away_m(name, middle) < wanted_m else (low, middle)
        return high

    heights = height_m("one", 0.015), height_m("other", 0.015 + nearer_m)
    near = nearest(meter, q, poses(*heights))
    assert ("other" in (near.first, near.second)) is names_hand


def _elbow_and_tip(robot: Baxter, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    elbow = data.oMi[robot.model.getJointId("left_e1")].translation
    return elbow, data.oMf[robot.model.getFrameId(robot.arm("left").tip_frame)].translation


def event(kind: EventKind, body: Body) -> Event:
    return Event(0.0, kind, "", "left", body=body)


def recorded(plan: Plan, number: int) -> RecordedMove:
    move = plan.moves[number]
    return RecordedMove(0.0, move.label, move.trajectory, contacts=move.contacts)


def test_moves_and_events_say_what_a_hand_may_touch(plan: Plan, block: Body) -> None:
    """Approach, descend, grasp, retract, release, and a move that states nothing."""
    hands = Hands({})
    states = [hands.now["left"]]
    for step in (
        recorded(plan, 0),
        recorded(plan, 1),
        event(EventKind.GRASPED, block),
        recorded(plan, 2),
        event(EventKind.RELEASED, block),
        RecordedMove(0.0, "older", plan.moves[1].trajectory),
    ):
        if isinstance(step, Event):
            hands.on_event(step)
        else:
            hands.on_move(step)
        states.append(hands.now["left"])
    (support,) = states[4].supports or [""]
    assert isinstance(support, PartContact)
    assert support.other == "table"
    assert states == [
        HandState(),
        HandState(None, None, frozenset()),
        HandState(None, "block", frozenset()),
        HandState("block"),
        HandState("block", None, frozenset([support])),
        HandState(None, "block", frozenset()),
        HandState(),
    ]
    assert hands.now["right"] == HandState()
