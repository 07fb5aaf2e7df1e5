"""Distances between shapes, and what counts as inside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter
from planner import Body, Part, RobotShapes, Scene
from planner.collision import ClearanceChecker
from planner.collision.distances import Distances, Enclosure
from planner.scene.bodies import Attachment
from planner.scene.contact import PRESSING_TOLERANCE_M, surface
from tests.bodies import CORNERS, SIDES
from tests.conftest import at
from tests.planner.collision.conftest import ORIGIN, ball, full
from tests.planner.conftest import mesh_of

CUBE_M, BALL_M = 0.05, 0.02
"""Half of an edge, a radius."""

PADDING_M = 0.003

GJK_M = 1e-6
"""Where coal's iterations end, with its own tolerances."""

seeds = st.integers(0, 2**32 - 1)
heights_m = st.floats(1e-4, 0.5)


def test_shapes_whose_depth_coal_does_not_find_count_as_inside_each_other(
    robot: Baxter, left: Arm, shapes: RobotShapes
) -> None:
    tip = left.T_base_tip(left.neutral)
    sail = mesh_of([[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.0, 0.1, 0.0]], [[0, 1, 2]])
    held = Attachment("ball", "left_gripper", ORIGIN)
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


@given(seeds)
def test_a_cube_winds_about_the_points_inside_it_and_no_others(seed: int) -> None:
    cube = Enclosure(CORNERS, np.array(SIDES))
    for point in np.random.default_rng(seed).uniform(-1.5, 1.5, (20, 3)):
        assert cube.winds_about(point) is bool(np.abs(point).max() < 1.0)


def test_nothing_is_inside_of_what_encloses_nothing() -> None:
    assert not Enclosure.none().winds_about(np.zeros(3))


def measured(
    shapes: Sequence[coal.CollisionGeometry],
    enclosures: Sequence[Enclosure | None],
    *,
    padding_m: float = 0.0,
    pieces: Mapping[int, Sequence[int]] | None = None,
) -> Distances:
    """Of the first two of some shapes; pieces count no pairs of their own."""
    geometry = pin.GeometryModel()
    for number, shape in enumerate(shapes):
        geometry.addGeometryObject(pin.GeometryObject(str(number), 0, ORIGIN, shape))
    return Distances(geometry, enclosures, pieces or {}, [(0, 1)], [padding_m])


def placed(found: Distances, *poses: pin.SE3) -> Distances:
    found.place(np.array([T.homogeneous for T in poses]))
    return found


@given(seeds, st.floats(0.0, 0.01))
def test_balls_are_as_far_apart_as_their_middles_less_both_radii_and_the_padding(
    seed: int, padding_m: float
) -> None:
    """Or as deep inside each other."""
    rng = np.random.default_rng(seed)
    radii, away = rng.uniform(0.02, 0.2, 2), rng.uniform(-0.3, 0.3, 3)
    balls = [coal.Sphere(radius) for radius in radii.tolist()]
    found = placed(measured(balls, [None, None], padding_m=padding_m), ORIGIN, at(*away))
    expected = np.linalg.norm(away) - radii.sum() - padding_m
    assert found.measure(0) == pytest.approx(expected, abs=GJK_M)


@given(seeds)
def test_the_nearest_points_of_balls_are_on_the_line_of_their_middles(seed: int) -> None:
    rng = np.random.default_rng(seed)
    radii, away = rng.uniform(0.02, 0.1, 2), rng.uniform(-0.3, 0.3, 3)
    apart = float(np.linalg.norm(away))
    assume(apart > radii.sum() + GJK_M)
    balls = [coal.Sphere(radius) for radius in radii.tolist()]
    found = placed(measured(balls, [None, None], padding_m=PADDING_M), ORIGIN, at(*away))
    points = found.points(0, found.measure(0))
    along = away / apart
    wanted = [radii[0] * along, away - radii[1] * along]
    assert points == pytest.approx(np.array(wanted), abs=GJK_M)


def test_shapes_inside_each_other_touch_at_one_point() -> None:
    balls = [coal.Sphere(0.05), coal.Sphere(0.05)]
    found = placed(measured(balls, [None, None]), ORIGIN, at(0.06, 0.0, 0.0))
    first, second = found.points(0, found.measure(0))
    assert np.array_equal(first, second)
    assert first == pytest.approx([0.03, 0.0, 0.0], abs=0.03)


def cube_of_triangles(half_m: float) -> coal.CollisionGeometry:
    return surface(half_m * CORNERS, np.array(SIDES))


@given(st.lists(heights_m, min_size=1, max_size=6), heights_m)
def test_a_distance_to_triangles_is_exact_below_what_is_asked_for_and_no_less_beyond(
    heights: list[float], within_m: float
) -> None:
    """However far apart the two were before."""
    shapes = [cube_of_triangles(CUBE_M), coal.Sphere(BALL_M)]
    pair = measured(shapes, [Enclosure.none(), None], padding_m=PADDING_M)
    for height_m in heights:
        placed(pair, ORIGIN, at(0.01, 0.01, CUBE_M + BALL_M + PADDING_M + height_m))
        found = pair.measure(0, within_m)
        if height_m < within_m:
            assert found == pytest.approx(height_m, abs=GJK_M)
        else:
            assert found >= within_m - GJK_M


@given(st.lists(heights_m, min_size=1, max_size=6), heights_m)
def test_where_a_bound_will_do_it_is_between_what_is_asked_for_and_the_distance(
    heights: list[float], exact_below_m: float
) -> None:
    pair = measured([cube_of_triangles(CUBE_M), coal.Sphere(BALL_M)], [Enclosure.none(), None])
    for height_m in heights:
        placed(pair, ORIGIN, at(0.01, 0.01, CUBE_M + BALL_M + height_m))
        found = pair.measure(0, exact_below_m=exact_below_m)
        assert found <= height_m + GJK_M
        assert found >= min(exact_below_m, height_m) - GJK_M


@pytest.mark.parametrize("depth_m", [0.001, 0.015])
def test_how_deep_something_is_in_triangles_is_known_of_the_pieces_around_them(
    depth_m: float,
) -> None:
    shapes = [cube_of_triangles(CUBE_M), coal.Sphere(BALL_M), coal.Box(*[2 * CUBE_M] * 3)]
    pair = measured(shapes, [Enclosure.none(), None, None], pieces={0: [2]})
    placed(pair, ORIGIN, at(0.01, 0.01, CUBE_M + BALL_M - depth_m), ORIGIN)
    assert pair.measure(0) == pytest.approx(-depth_m, abs=GJK_M)


@pytest.mark.parametrize(("x_m", "is_inside"), [(0.0, True), (0.08, True), (0.2, False)])
def test_a_ball_that_touches_no_triangle_may_be_inside_of_them(x_m: float, is_inside: bool) -> None:
    """Of a plank, wherever it is turned to."""
    corners = CORNERS * [0.11, 0.03, 0.03]
    shapes = [surface(corners, np.array(SIDES)), coal.Sphere(BALL_M)]
    pair = measured(shapes, [Enclosure(corners, np.array(SIDES)), None])
    T = pin.SE3(pin.exp3(np.array([0.3, -0.7, 0.9])), np.array([0.4, -0.1, 0.2]))
    assert placed(pair, T, T * at(x_m, 0.0, 0.0)).is_within(0) is is_inside
