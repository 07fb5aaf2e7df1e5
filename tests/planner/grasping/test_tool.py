"""Tools on the flange: their distances, their motions, and plans of the other arm around them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter, IKService, Tool
from planner import (
    Body,
    Box,
    CollisionContext,
    Cylinder,
    Manipulator,
    Part,
    PickAndPlace,
    RobotShapes,
    Scene,
    Sphere,
    Trajectory,
    load_object,
    make_block,
    plan_free_move,
    plan_pick_and_place,
    prove_clear,
    tool_of,
    verify,
)
from planner.certificate.body import Body as Clusters
from planner.collision import ClearanceChecker
from planner.errors import SceneError
from planner.scene.mesh import Mesh
from tests.conftest import at, overhead

RADIUS_M = 0.012
"""Radius of the ball at the end of the probe; its centre is 0.17 m from the hand."""

PROBE = Body(
    "probe",
    (
        Part(Box((0.06, 0.06, 0.02)), at(0.0, 0.0, 0.01)),
        Part(Cylinder(0.01, 0.15), at(0.0, 0.0, 0.095)),
        Part(Sphere(RADIUS_M), at(0.0, 0.0, 0.17)),
    ),
    at(0.0, 0.0, 0.0),
)

DOWN = np.diag([1.0, -1.0, -1.0])


def down(x: float, y: float, z: float) -> pin.SE3:
    return pin.SE3(DOWN, np.array([x, y, z]))


@pytest.fixture(scope="module")
def robot() -> Baxter:
    """A robot with a probe on the left hand; its tip is the centre of the ball at its end."""
    return Baxter.load(hands={"left": tool_of(PROBE, at(0.0, 0.0, 0.17))})


def nearest_m(robot: Baxter, q: np.ndarray[tuple[int], np.dtype[np.float64]], body: Body) -> float:
    """The smallest distance of the arm from a body."""
    arm = robot.arm("left")
    checker = ClearanceChecker(RobotShapes(robot), arm, Scene.of([body]))
    full = robot.configuration(arm.joints(q))
    pairs = [checker.checked.clearance_of(pair, 0.0) for pair in range(len(checker.checked.pairs))]
    to_body = [n for n, pair in enumerate(pairs) if body.name in (pair.first, pair.second)]
    return float(min(checker.distances_m(full, to_body, 1.0)))


@pytest.mark.parametrize("gap_m", [0.003, 0.05])
def test_the_distance_below_its_end_is_that_of_its_ball(robot: Baxter, gap_m: float) -> None:
    tip = down(0.7, 0.2, 0.1)
    q = IKService(robot.arm("left")).solve(tip).q
    plate_m = 0.02
    plate = make_block(
        "plate",
        at(0.7, 0.2, 0.1 - RADIUS_M - gap_m - plate_m / 2),
        edge_m=(0.2, 0.2, plate_m),
        is_movable=False,
    )
    share = 0.023  # of the radius, by which the polyhedron around a ball is larger
    found = nearest_m(robot, q, plate)
    assert gap_m - share * RADIUS_M <= found <= gap_m + 1e-6


def test_every_part_of_it_counts(robot: Baxter) -> None:
    """A ball near the middle of its shaft: 0.01 m, its radius, and the gap apart from its axis."""
    tip = down(0.7, 0.2, 0.1)
    q = IKService(robot.arm("left")).solve(tip).q
    gap_m, ball_m = 0.01, 0.01
    ball = Body(
        "ball",
        (Part(Sphere(ball_m), at(0.0, 0.0, 0.0)),),
        at(0.7, 0.2 + 0.01 + gap_m + ball_m, 0.1 + 0.075),
    )
    assert gap_m - 2e-5 <= nearest_m(robot, q, ball) <= gap_m + 1e-6


def test_a_free_move_goes_around_a_wall(robot: Baxter) -> None:
    arm, q_others = robot.arm("left"), robot.configuration()
    ik = IKService(arm)
    q_start, q_goal = (ik.solve(down(0.7, y, 0.0)).q for y in (0.2, -0.1))
    wall = make_block("wall", at(0.7, 0.05, 0.0), edge_m=(0.3, 0.02, 0.12), is_movable=False)
    checker = ClearanceChecker(RobotShapes(robot), arm, Scene.of([wall]))
    space = CollisionContext(checker, q_others)

    def is_clear(motion: Trajectory) -> bool:
        return prove_clear(checker, motion, q_others).is_clear

    move = plan_free_move(q_start, q_goal, arm.limits, space, is_clear)
    assert len(move.j) > 30  # no straight line
    lengths = [
        nearest_m(robot, move.sample(t)[0], wall) for t in np.linspace(0.0, move.duration, 8)
    ]
    assert min(lengths) > 0.0


def test_a_manipulator_refuses_an_arm_without_fingers(robot: Baxter) -> None:
    with pytest.raises(SceneError, match=r"the left hand of this robot has no fingers: .* mount"):
        Manipulator.of(robot, "left")


@pytest.mark.slow
def test_the_other_arm_keeps_clear_of_it_and_verification_counts_it() -> None:
    """A long rod on the left hand reaches over the place where the right hand picks."""
    rod = Body("rod", (Part(Box((0.02, 0.02, 0.3)), at(0.0, 0.0, 0.15)),), at(0.0, 0.0, 0.0))
    robot = Baxter.load(hands={"left": tool_of(rod, at(0.0, 0.0, 0.3))})
    table = load_object("table", at(1.0, 0.0, -0.93))
    block = make_block("block", at(0.70, -0.15, -0.13))
    scene = Scene.of([table, block])
    right = Manipulator.of(robot, "right")
    start = right.arm.start
    task = PickAndPlace("block", overhead(0.70, -0.15, -0.129), overhead(0.75, -0.05, -0.129))
    plan = plan_pick_and_place(task, right, scene, start)
    assert plan.is_valid, plan.failure
    certificate = verify(plan, description=robot.description)
    assert certificate.is_valid, certificate.verdict
    assert "left_tool_0_link" in {s.link for s in Clusters(robot.description.text).shapes}
    tip = down(0.70, -0.10, 0.0)
    stands = IKService(robot.arm("left")).solve(tip)
    assert stands.is_valid
    q_others = robot.configuration(robot.arm("left").joints(stands.q))
    blocked = Manipulator.of(robot, "right", q_others=q_others)
    refused = plan_pick_and_place(task, blocked, scene, start)
    assert not refused.is_valid
    assert "tool" in str(refused.failure)


def test_refuses_a_tool_of_meshes() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) * 0.1
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    body = Body("wedge", (Part(Mesh(corners, faces), at(0, 0, 0)),), at(0, 0, 0))
    with pytest.raises(SceneError, match="the tool 'wedge' has a mesh"):
        tool_of(body, at(0, 0, 0.1))
    with pytest.raises(SceneError, match="must be of class Body"):
        tool_of("probe", at(0, 0, 0.1))  # type: ignore[arg-type]
    assert isinstance(tool_of(PROBE, at(0, 0, 0.1)), Tool)
