"""Solids: covers and balls contain their shapes, and nothing reaches farther than is said."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
import pytest

from baxter_kin.description import RobotDescription
from planner import Body, Box, Part, Sphere
from planner.scene.contact import surface
from planner.verification.body.robot_body import SolidBody, robot_body
from planner.verification.body.solid import (
    ACCURACY_M,
    Solid,
    distance_request,
    separation,
    solids_of,
)
from tests.bodies import CORNERS, SIDES
from tests.conftest import at

FILES = RobotDescription.installed()


@pytest.fixture(scope="module")
def body() -> SolidBody:
    return robot_body(FILES)


def test_covers_and_balls_contain_their_shapes(body: SolidBody) -> None:
    for solid in body.solids:
        if solid.is_surface:
            vertices = np.array(solid.shape.vertices())
            corners = np.array(solid.cover.points())
            sides = np.random.default_rng(1).normal(size=(200, 3))
            beyond = (vertices @ sides.T).max(axis=0) - (corners @ sides.T).max(axis=0)
            assert beyond.max() < 1e-12
            away = np.linalg.norm(vertices - solid.centre, axis=1)
            assert away.max() <= solid.radius_m + 1e-12


def test_the_parts_of_a_body_sit_where_the_body_has_them() -> None:
    parts = (Part(Box((0.1, 0.2, 0.3)), at(0.0, 0.0, 0.1)), Part(Sphere(0.02), at(0.1, 0.0, 0.0)))
    T_joint_body = pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.3])), np.array([0.4, 0.5, 0.6]))
    found = solids_of(Body("thing", parts, at(9.0, 9.0, 9.0)), 3, T_joint_body)
    assert [(solid.name, solid.joint) for solid in found] == [("thing", 3)] * 2
    for solid, part in zip(found, parts, strict=True):
        assert solid.T_joint_shape == T_joint_body * part.T_body_part


def test_no_point_is_farther_from_its_joint_than_is_said(body: SolidBody) -> None:
    for solid in body.solids:
        if solid.is_surface:
            corners = np.array(solid.shape.vertices())
            T = solid.T_joint_shape
            away = np.linalg.norm(corners @ T.rotation.T + T.translation, axis=1)
            assert away.max() <= solid.farthest_m() + 1e-12


def test_covers_are_no_farther_apart_than_what_they_cover(body: SolidBody) -> None:
    rng = np.random.default_rng(4)
    surfaces = [solid for solid in body.solids if solid.is_surface]
    request, result = distance_request(), coal.DistanceResult()
    for _ in range(20):
        first, second = (surfaces[i] for i in rng.choice(len(surfaces), 2, replace=False))
        apart = coal.Transform3s(pin.exp3(rng.normal(size=3)), rng.uniform(-0.5, 0.5, 3))
        found = []
        for of_covers in (True, False):
            result.clear()
            measure = separation(first, second, of_covers=of_covers)
            found.append(measure(coal.Transform3s(), apart, request, result))
        assert found[0] <= found[1] + ACCURACY_M


def test_a_convex_shape_and_a_flat_one_are_their_own_covers() -> None:
    plate = surface(CORNERS * [0.0, 1.0, 1.0], np.array(SIDES[:2]))
    for shape in (coal.Box(1.0, 2.0, 3.0), plate):
        solid = Solid.of("thing", 0, at(0.0, 0.0, 0.0), shape)
        assert solid.cover is solid.shape


def test_triangles_are_a_surface_and_a_box_is_none() -> None:
    shell = surface(CORNERS, np.array(SIDES))
    found = [Solid.of("thing", 0, at(0, 0, 0), s).is_surface for s in (shell, coal.Box(1, 1, 1))]
    assert found == [True, False]
