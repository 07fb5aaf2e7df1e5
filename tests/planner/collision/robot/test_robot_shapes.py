"""The robot's body as shapes: what contains what, and what was believed of smaller ones."""

from __future__ import annotations

from itertools import product

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter, pose_from_quaternion
from planner import (
    Body,
    Box,
    Manipulator,
    Part,
    PickAndPlace,
    RobotShapes,
    Scene,
    plan_pick_and_place,
    verify,
)
from planner.collision import ClearanceChecker
from planner.collision.robot.robot_body import RobotBody
from planner.errors import SceneError
from planner.scene.bodies import Sphere
from tests.conftest import at
from tests.planner.conftest import distance

DOWN = (0.0, 1.0, 0.0, 0.0)
PICK = pose_from_quaternion((0.70, 0.15, -0.129), DOWN)
PLACE = pose_from_quaternion((0.75, 0.0, -0.129), DOWN)


SAME_M = 1e-5
"""Distances by two ways of coal, with its own tolerances."""

seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def body() -> RobotBody:
    return RobotBody.load()


@pytest.fixture(scope="module")
def shapes(robot: Baxter, body: RobotBody) -> RobotShapes:
    return RobotShapes(robot, body)


def ball(radius_m: float, x: float, y: float, z: float) -> Body:
    return Body("ball", (Part(Sphere(radius_m), at(0, 0, 0)),), at(x, y, z))


def test_the_elbow_was_believed_to_pass_a_cube_that_it_goes_into(
    robot: Baxter, body: RobotBody, manipulator: Manipulator, scene: Scene
) -> None:
    """18.8 mm of clearance were proven, of shapes up to 91 mm smaller than the robot."""
    cube = Body("cube", (Part(Box((0.02, 0.02, 0.02)), at(0, 0, 0)),), at(0.482, 0.271, 0.345))
    task, start = PickAndPlace("block", PICK, PLACE), manipulator.arm.neutral
    believed = plan_pick_and_place(task, manipulator, scene, start)
    real = Manipulator.of(robot, "left", body=body)
    checker = ClearanceChecker(real.shapes, real.arm, Scene.of([cube]))
    qs = (
        q
        for move in believed.moves
        for q in real.configurations(
            move.trajectory.sample(np.linspace(0.0, move.trajectory.duration, 100)).q, 0.01
        )
    )
    found = min((checker.clearance(q) for q in qs), key=lambda near: near.distance_m)
    assert found.distance_m < 0.0
    assert "elbow" in found.first
    around = plan_pick_and_place(task, real, scene.with_body(cube), start)
    if around.is_valid:
        assert around.proven_clearance_m is not None
        assert around.proven_clearance_m > 0.0
        assert around.motion_time_s > believed.motion_time_s


def test_links_without_a_mesh_are_the_urdfs_shapes_and_placeholders_are_none(
    shapes: RobotShapes,
) -> None:
    assert {"left_hand_link", "right_hand_link"} <= set(shapes.links)
    assert not any("collision_head" in link or "visual" in link for link in shapes.links)


def test_every_link_counts_once_against_the_robot_and_once_against_bodies(
    shapes: RobotShapes,
) -> None:
    for link in set(shapes.links):
        of_link = {i for i, name in enumerate(shapes.links) if name == link}
        assert len(of_link & shapes.wholes) >= 1
        assert of_link & shapes.details
    assert shapes.wholes | shapes.details == set(range(len(shapes.links)))


def test_what_moves_with_the_last_joint_is_the_hand(shapes: RobotShapes, arm: Arm) -> None:
    hand, fingers, pads = shapes.of_hand(arm), shapes.of_fingers(arm), shapes.of_pads(arm)
    assert hand < shapes.of_arm(arm)
    assert set(fingers[0]) | set(fingers[1]) < hand
    assert pads < set(fingers[0]) | set(fingers[1])
    assert not shapes.of_palm(arm) & pads
    assert f"{arm.side}_wrist" in {shapes.links[i] for i in shapes.of_palm(arm)}


def test_a_ball_wholly_inside_a_link_is_inside_though_it_touches_no_triangle(
    robot: Baxter, left: Arm, shapes: RobotShapes
) -> None:
    q = np.array(robot.configuration(left.joints(left.neutral)))
    number = shapes.links.index("left_lower_elbow")
    enclosure, shape = shapes.made[number].enclosure, shapes.model.geometryObjects[number]
    assert enclosure is not None
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    middle = (enclosure.vertices.max(axis=0) + enclosure.vertices.min(axis=0)) / 2
    x, y, z = (data.oMi[shape.parentJoint] * shape.placement).act(middle)
    inside = Scene.of([ball(0.003, x, y, z)])
    found = ClearanceChecker(shapes, left, inside).clearance(q)
    assert found.distance_m < 0.0
    assert found.second == "ball"


def test_a_padding_is_taken_from_every_distance_but_those_of_contacts(
    robot: Baxter, left: Arm, body: RobotBody
) -> None:
    both = [RobotShapes(robot, given) for given in (body, body.padded(0.004))]
    q = np.array(robot.configuration(left.joints(left.neutral)))
    tip = left.T_base_tip(left.neutral).translation
    beside = Scene.of([ball(0.01, tip[0], tip[1], tip[2] - 0.05)])
    for scene, links in ((beside, 1), (Scene.of([]), 2)):
        bare, thick = (ClearanceChecker(given, left, scene).clearance(q) for given in both)
        assert thick.distance_m == pytest.approx(bare.distance_m - links * 0.004, abs=1e-5)


def test_a_palm_counts_the_margin_of_its_mesh_but_no_padding_against_what_is_grasped(
    robot: Baxter, left: Arm, body: RobotBody
) -> None:
    q = np.array(robot.configuration(left.joints(left.neutral)))
    tip = left.T_base_tip(left.neutral).translation
    scene = Scene.of([ball(0.01, tip[0], tip[1], tip[2] - 0.05)])
    distances = {}
    for padding_m, touchable in product((0.0, 0.004), (None, "ball")):
        shapes = RobotShapes(robot, body.padded(padding_m))
        checker = ClearanceChecker(shapes, left, scene, touchable=touchable)
        names = [checker.checked.between(pair, 0.0) for pair in range(len(checker.pairs))]
        wanted = {"left_gripper_base_link", "ball"}
        palm = [{near.first, near.second} == wanted for near in names].index(True)
        [distances[padding_m, touchable]] = checker.distances_m(q, [palm])
    bare_m = distances[0.0, None]
    assert distances[0.0, "ball"] == distances[0.004, "ball"] == bare_m
    assert distances[0.004, None] == pytest.approx(bare_m - 0.004)


@pytest.mark.parametrize("padding_m", [-1e-3, np.nan, np.inf])
def test_a_padding_that_is_none_is_refused(body: RobotBody, padding_m: float) -> None:
    with pytest.raises(SceneError, match="padding_m"):
        body.padded(padding_m)


def test_a_body_of_another_kind_is_refused(robot: Baxter) -> None:
    with pytest.raises(SceneError, match="body"):
        RobotShapes(robot, "fat")  # type: ignore[arg-type]


def test_verify_accepts_what_a_plan_with_the_body_states(
    robot: Baxter, body: RobotBody, scene: Scene
) -> None:
    """It measures on the original meshes, by other code."""
    real = Manipulator.of(robot, "left", body=body)
    plan = plan_pick_and_place(PickAndPlace("block", PICK, PLACE), real, scene, real.arm.neutral)
    assert plan.proven_clearance_m is not None
    assert plan.proven_clearance_m > 0.02
    assert verify(plan).is_valid


@settings(max_examples=100)
@given(seed=seeds)
def test_contacts_are_found_where_distances_say_so(robot: Baxter, seed: int) -> None:
    shapes, rng = RobotShapes(robot), np.random.default_rng(seed)
    number = int(rng.choice(sorted(shapes.for_contacts)))
    link = shapes.model.geometryObjects[number].geometry
    others = [
        coal.Box(*rng.uniform(0.002, 0.2, size=3)),
        coal.Cylinder(0.03, 0.1),
        coal.Sphere(0.02),
    ]
    other = others[rng.integers(len(others))]
    vertex = np.array(link.vertex(int(rng.integers(link.num_vertices))))
    quat = rng.normal(size=4)
    away = rng.normal(size=3) * rng.choice([0.01, 0.03, 0.1])
    T = pin.SE3(pin.Quaternion(quat / np.linalg.norm(quat)).matrix(), vertex + away)
    distance_m = distance(link, pin.SE3.Identity(), other, T)
    for margin_m in (0.0, 0.5 * distance_m, distance_m - SAME_M, distance_m + SAME_M, 0.05):
        if margin_m >= 0.0 and abs(margin_m - distance_m) > 0.5 * SAME_M:
            request, result = coal.CollisionRequest(), coal.CollisionResult()
            request.security_margin = margin_m
            placed = coal.Transform3s(T.rotation, T.translation)
            surface = shapes.for_contacts[number]
            found = coal.collide(surface, coal.Transform3s(), other, placed, request, result)
            assert bool(found) == (distance_m <= margin_m)
