"""Distances between shapes, and what counts as inside."""

from __future__ import annotations

import pytest

from baxter_kin import Arm, Baxter
from planner import Body, ClearanceChecker, Part, RobotShapes, Scene
from planner.collision.distances import Enclosure
from planner.scene.contact import PRESSING_TOLERANCE_M
from planner.scene.held import Held
from tests.conftest import at
from tests.planner.collision.conftest import ORIGIN, ball, full
from tests.planner.conftest import mesh_of


def test_shapes_whose_depth_coal_does_not_find_count_as_inside_each_other(
    robot: Baxter, left: Arm, shapes: RobotShapes
) -> None:
    tip = left.T_base_tip(left.neutral)
    sail = mesh_of([[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.0, 0.1, 0.0]], [[0, 1, 2]])
    held = Held("left", "ball", ORIGIN)
    sail_body = Body("sail", (Part(sail, ORIGIN),), at(*tip.translation))
    scene = Scene.of([sail_body, ball("ball", 0, 0, 0)])
    checker = ClearanceChecker(shapes, left, scene, held=held, touchable="sail", supports=["sail"])
    found = checker.clearance(full(robot, left, left.neutral))
    assert -1.0 < found.distance_m < -PRESSING_TOLERANCE_M


@pytest.mark.parametrize("inside", [True, False])
def test_a_closed_surface_winds_about_what_it_encloses(shapes: RobotShapes, inside: bool) -> None:
    enclosure = next(
        enclosure
        for enclosure, link in ((made.enclosure, made.link) for made in shapes.made)
        if enclosure is not None and link == "left_wrist"
    )
    assert isinstance(enclosure, Enclosure)
    middle = (enclosure.vertices.max(axis=0) + enclosure.vertices.min(axis=0)) / 2
    point = middle if inside else enclosure.vertices.max(axis=0) + 0.001
    assert enclosure.winds_about(point) is inside
