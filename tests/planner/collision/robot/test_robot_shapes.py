"""The shapes of a robot: whole links and their pieces, margins and padding."""

from __future__ import annotations

from collections import Counter
from itertools import product

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter
from planner import (
    RobotShapes,
    Scene,
)
from planner.collision import ClearanceChecker
from planner.collision.robot.robot_body import RobotBody
from planner.collision.robot.robot_shapes import LinkShape, link_shapes
from planner.errors import SceneError
from planner.scene.coal_shapes import has_depth
from tests.planner.collision.conftest import ball
from tests.planner.conftest import distance

SAME_M = 1e-5
"""Difference of two of coal's methods with its default tolerances."""

seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def body() -> RobotBody:
    return RobotBody.load()


def test_links_without_a_mesh_have_the_shapes_of_the_urdf(
    shapes: RobotShapes,
) -> None:
    assert {"left_hand_link", "right_hand_link"} <= set(shapes.links)
    assert not any("collision_head" in link or "visual" in link for link in shapes.links)


def test_every_link_is_checked_once_against_the_robot_and_once_against_bodies(
    shapes: RobotShapes,
) -> None:
    for link in set(shapes.links):
        of_link = {i for i, name in enumerate(shapes.links) if name == link}
        assert len(of_link & shapes.wholes) >= 1
        assert of_link & shapes.details
    assert shapes.wholes | shapes.details == set(range(len(shapes.links)))


def test_the_hand_moves_with_the_last_joint(shapes: RobotShapes, arm: Arm) -> None:
    hand, fingers, pads = shapes.of_hand(arm), shapes.of_fingers(arm), shapes.of_pads(arm)
    assert hand < shapes.of_arm(arm)
    assert set(fingers[0]) | set(fingers[1]) < hand
    assert pads < set(fingers[0]) | set(fingers[1])
    assert not shapes.of_palm(arm) & pads
    assert f"{arm.side}_wrist" in {shapes.links[i] for i in shapes.of_palm(arm)}


def test_a_ball_inside_a_link_is_found_though_it_touches_no_triangle(
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
    inside = Scene.of([ball("ball", x, y, z, 0.003)])
    found = ClearanceChecker(shapes, left, inside).clearance(q)
    assert found.distance_m < 0.0
    assert found.second == "ball"


def test_padding_is_subtracted_from_all_distances_except_those_of_contacts(
    robot: Baxter, left: Arm, body: RobotBody
) -> None:
    both = [RobotShapes(robot, given) for given in (body, body.padded(0.004))]
    q = np.array(robot.configuration(left.joints(left.neutral)))
    tip = left.T_base_tip(left.neutral).translation
    beside = Scene.of([ball("ball", tip[0], tip[1], tip[2] - 0.05, 0.01)])
    for scene, links in ((beside, 1), (Scene.of([]), 2)):
        bare, thick = (ClearanceChecker(given, left, scene).clearance(q) for given in both)
        assert thick.distance_m == pytest.approx(bare.distance_m - links * 0.004, abs=1e-5)


def test_a_palm_has_its_mesh_margin_but_no_padding_against_a_grasped_body(
    robot: Baxter, left: Arm, body: RobotBody
) -> None:
    q = np.array(robot.configuration(left.joints(left.neutral)))
    tip = left.T_base_tip(left.neutral).translation
    scene = Scene.of([ball("ball", tip[0], tip[1], tip[2] - 0.05, 0.01)])
    distances = {}
    for padding_m, touchable in product((0.0, 0.004), (None, "ball")):
        shapes = RobotShapes(robot, body.padded(padding_m))
        checker = ClearanceChecker(shapes, left, scene, touchable=touchable)
        names = [checker.checked.clearance_of(pair, 0.0) for pair in range(len(checker.pairs))]
        wanted = {"left_gripper_base_link", "ball"}
        palm = [{near.first, near.second} == wanted for near in names].index(True)
        [distances[padding_m, touchable]] = checker.distances_m(q, [palm])
    bare_m = distances[0.0, None]
    assert distances[0.0, "ball"] == distances[0.004, "ball"] == bare_m
    assert distances[0.004, None] == pytest.approx(bare_m - 0.004)


@pytest.mark.parametrize("padding_m", [-1e-3, np.nan, np.inf])
def test_refuses_an_invalid_padding(body: RobotBody, padding_m: float) -> None:
    with pytest.raises(SceneError, match="padding_m"):
        body.padded(padding_m)


def test_refuses_a_body_of_another_class(robot: Baxter) -> None:
    with pytest.raises(SceneError, match="body"):
        RobotShapes(robot, "fat")  # type: ignore[arg-type]


@settings(max_examples=40)
@given(seed=seeds)
def test_contacts_agree_with_distances(robot: Baxter, seed: int) -> None:
    shapes, rng = RobotShapes(robot), np.random.default_rng(seed)
    surfaces = [shape.surface for shape in shapes.made if shape.surface is not None]
    surface = surfaces[rng.integers(len(surfaces))]
    link = surface.for_distances
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
            tree = surface.for_contacts
            found = coal.collide(tree, coal.Transform3s(), other, placed, request, result)
            assert bool(found) == (distance_m <= margin_m)


@pytest.fixture(scope="module")
def names(body: RobotBody) -> frozenset[str]:
    """All links except those that may replace others."""
    return frozenset(name for name in body.links if ":" not in name)


@pytest.fixture(scope="module")
def made(body: RobotBody, names: frozenset[str]) -> tuple[LinkShape, ...]:
    return link_shapes(body, names)


def test_shapes_are_those_of_the_given_links(body: RobotBody, made: tuple[LinkShape, ...]) -> None:
    few = frozenset({"torso", "left_wrist"})
    assert {shape.link for shape in link_shapes(body, few)} == few
    assert not link_shapes(body, frozenset())
    alone = link_shapes(body, few)
    assert len(alone) == sum(shape.link in few for shape in made)


def test_each_link_has_one_whole_shape_and_all_its_pieces_or_the_whole_as_details(
    body: RobotBody, made: tuple[LinkShape, ...]
) -> None:
    wholes = Counter(shape.link for shape in made if shape.is_whole)
    details = Counter(shape.link for shape in made if shape.is_detail)
    assert set(wholes.values()) == {1}
    for name, count in details.items():
        link = body.links[name]
        assert count == (len(link.pieces) if link.is_in_pieces else 1)


def test_pieces_and_simple_shapes_have_a_depth_and_surfaces_an_enclosure(
    made: tuple[LinkShape, ...],
) -> None:
    assert {shape.enclosure is None for shape in made} == {True, False}
    for shape in made:
        assert has_depth(shape.geometry) is (shape.enclosure is None)


def test_links_of_one_mesh_share_their_geometry(made: tuple[LinkShape, ...]) -> None:
    geometry = {shape.link: shape.geometry for shape in made if shape.is_whole}
    assert geometry["left_wrist"] is geometry["right_wrist"]
    assert geometry["left_wrist"] is not geometry["torso"]


def test_shapes_of_one_body_are_made_once(
    body: RobotBody, names: frozenset[str], made: tuple[LinkShape, ...]
) -> None:
    assert link_shapes(body, frozenset(names)) is made


def test_padding_thickens_all_shapes_and_moves_none(
    body: RobotBody, names: frozenset[str], made: tuple[LinkShape, ...]
) -> None:
    thick = link_shapes(body.padded(0.004), names)
    for one, other in zip(made, thick, strict=True):
        assert (one.link, one.overshoot_m) == (other.link, other.overshoot_m)
        assert other.padding_m == one.padding_m + 0.004


def test_surfaces_for_contacts_and_for_distances_are_of_the_same_triangles(
    made: tuple[LinkShape, ...],
) -> None:
    for shape in made:
        assert (shape.surface is None) is has_depth(shape.geometry)
        if shape.surface is not None:
            fast, slow = shape.surface.for_contacts, shape.surface.for_distances
            assert shape.geometry is fast
            assert fast.num_tris == slow.num_tris
            np.testing.assert_allclose(fast.vertices(), slow.vertices(), rtol=0.0, atol=1e-12)
