"""Distances between shapes, depths, enclosures, and the covers that bound distances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from baxter_kin import Arm, Baxter
from baxter_kin.validation import FloatArray
from planner import Body, Part, RobotShapes, Scene
from planner.collision import ClearanceChecker
from planner.collision.distances import Covers, Distances, Enclosure, placed_points
from planner.scene.bodies import Attachment
from planner.scene.coal_shapes import hull, surface
from planner.scene.contact import PRESSING_TOLERANCE_M
from tests.bodies import CORNERS, SIDES
from tests.conftest import at
from tests.planner.collision.conftest import ORIGIN, ball, full
from tests.planner.conftest import distance, mesh_of

CUBE_M, BALL_M = 0.05, 0.02
"""Half of the cube's edge, and the ball's radius."""

PADDING_M = 0.003

GJK_M = 1e-6
"""Accuracy of coal's iterations with its default tolerance."""

seeds = st.integers(0, 2**32 - 1)
heights_m = st.floats(1e-4, 0.5)


def test_shapes_of_unknown_depth_count_as_inside_each_other(
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


@given(seeds)
def test_a_cube_winds_about_the_points_inside_it_and_no_others(seed: int) -> None:
    cube = Enclosure(CORNERS, np.array(SIDES))
    for point in np.random.default_rng(seed).uniform(-1.5, 1.5, (20, 3)):
        assert cube.winds_about(point) is bool(np.abs(point).max() < 1.0)


def test_nothing_is_inside_an_empty_enclosure() -> None:
    assert not Enclosure.none().winds_about(np.zeros(3))


def measured(
    shapes: Sequence[coal.CollisionGeometry],
    enclosures: Sequence[Enclosure | None],
    *,
    padding_m: float = 0.0,
    pieces: Mapping[int, Sequence[int]] | None = None,
) -> Distances:
    """Distances of the first two of some shapes; pieces are not in pairs of their own."""
    geometry = pin.GeometryModel()
    for number, shape in enumerate(shapes):
        geometry.addGeometryObject(pin.GeometryObject(str(number), 0, ORIGIN, shape))
    return Distances(geometry, enclosures, pieces or {}, [(0, 1)], [padding_m])


def placed(found: Distances, *poses: pin.SE3) -> Distances:
    found.place(np.array([T.homogeneous for T in poses]))
    return found


@given(seeds, st.floats(0.0, 0.01))
def test_the_distance_of_balls_is_that_of_their_centres_less_radii_and_padding(
    seed: int, padding_m: float
) -> None:
    """Or their depth."""
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
def test_a_distance_to_triangles_is_exact_within_the_given_range_and_a_bound_beyond(
    heights: list[float], within_m: float
) -> None:
    """Whatever their distance was before."""
    shapes = [cube_of_triangles(CUBE_M), coal.Sphere(BALL_M)]
    pair = measured(shapes, [Enclosure.none(), None], padding_m=PADDING_M)
    for height_m in heights:
        placed(pair, ORIGIN, at(0.01, 0.01, CUBE_M + BALL_M + PADDING_M + height_m))
        found = pair.measure(0, within_m)
        if height_m < within_m:
            assert found == pytest.approx(height_m, abs=GJK_M)
        else:
            assert found >= within_m - GJK_M


@pytest.mark.parametrize("depth_m", [0.001, 0.015])
def test_the_depth_in_triangles_is_that_in_the_pieces_around_them(
    depth_m: float,
) -> None:
    shapes = [cube_of_triangles(CUBE_M), coal.Sphere(BALL_M), coal.Box(*[2 * CUBE_M] * 3)]
    pair = measured(shapes, [Enclosure.none(), None, None], pieces={0: [2]})
    placed(pair, ORIGIN, at(0.01, 0.01, CUBE_M + BALL_M - depth_m), ORIGIN)
    assert pair.measure(0) == pytest.approx(-depth_m, abs=GJK_M)


@pytest.mark.parametrize(("x_m", "is_inside"), [(0.0, True), (0.08, True), (0.2, False)])
def test_a_ball_that_touches_no_triangle_may_be_inside(x_m: float, is_inside: bool) -> None:
    """Inside a plank at any orientation."""
    corners = CORNERS * [0.11, 0.03, 0.03]
    shapes = [surface(corners, np.array(SIDES)), coal.Sphere(BALL_M)]
    pair = measured(shapes, [Enclosure(corners, np.array(SIDES)), None])
    T = pin.SE3(pin.exp3(np.array([0.3, -0.7, 0.9])), np.array([0.4, -0.1, 0.2]))
    assert placed(pair, T, T * at(x_m, 0.0, 0.0)).is_within(0) is is_inside


ROUNDING_M = 1e-12

MESH = CORNERS * [0.2, 0.03, 0.05] + [0.1, 0.0, 0.3]
"""Corners of a plank beside its origin."""

SHAPES = {
    "box": coal.Box(0.3, 0.1, 0.02),
    "ball": coal.Sphere(0.07),
    "can": coal.Cylinder(0.05, 0.4),
    "coin": coal.Cylinder(0.2, 0.01),
    "mesh": surface(MESH, np.array(SIDES)),
}


BALL, CYLINDERS = {1}, {2, 3}
"""Their numbers; coal finds a ball in a coin 1 cm thick up to 25 cm deep, which is too much."""


def points_of(name: str) -> FloatArray:
    """Points of its surface, including the farthest from its centre, shape (n, 3)."""
    shape, angles = SHAPES[name], np.linspace(0.0, 2.0 * np.pi, 33)
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    if isinstance(shape, coal.Box):
        return np.asarray(CORNERS * shape.halfSide)
    if isinstance(shape, coal.Sphere):
        return np.concatenate([shape.radius * np.roll(ring, k, axis=1) for k in range(3)])
    if isinstance(shape, coal.Cylinder):
        ends = np.array([0.0, 0.0, shape.halfLength])
        return np.concatenate([shape.radius * ring + ends, shape.radius * ring - ends])
    return MESH


def beside_segment_m(points: FloatArray, ends: FloatArray) -> FloatArray:
    """Distances of points from a segment, shape (n,)."""
    way = ends[1] - ends[0]
    share = np.clip((points - ends[0]) @ way / max(way @ way, 1e-300), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - ends[0] - share[:, None] * way, axis=1))


@pytest.fixture(scope="module")
def covers() -> Covers:
    return Covers.of(list(SHAPES.values()))


@pytest.mark.parametrize("name", SHAPES)
def test_every_point_of_a_shape_is_inside_its_box_its_ball_and_its_capsule(
    covers: Covers, name: str
) -> None:
    points, i = points_of(name), list(SHAPES).index(name)
    assert (points >= covers.lowest[i] - ROUNDING_M).all()
    assert (points <= covers.highest[i] + ROUNDING_M).all()
    from_middle = np.linalg.norm(points - covers.centres[i], axis=1)
    assert from_middle.max() == pytest.approx(covers.ball_radii[i], abs=ROUNDING_M)
    assert beside_segment_m(points, covers.ends[i]).max() <= covers.radii[i] + ROUNDING_M


@given(seeds)
def test_gaps_are_lower_bounds_on_distances(covers: Covers, seed: int) -> None:
    rng, shapes = np.random.default_rng(seed), list(SHAPES.values())
    spread_m = rng.uniform(0.01, 0.5)
    poses = [pin.SE3(pin.exp3(rng.normal(size=3)), spread_m * rng.normal(size=3)) for _ in shapes]
    pairs = np.indices((len(shapes), len(shapes))).reshape(2, -1).T
    placed = np.array([[T.homogeneous for T in poses]])
    gaps = covers.gaps_m(placed, np.zeros(len(pairs), np.intp), pairs)
    for (i, k), gap in zip(pairs.tolist(), gaps.tolist(), strict=True):
        if i != k:
            apart = distance(hull(shapes[i]), poses[i], hull(shapes[k]), poses[k])
            assert gap <= apart + GJK_M or (apart < 0.0 and {i, k} & BALL and {i, k} & CYLINDERS)
    within = covers.gaps_m(placed, np.zeros(len(pairs), np.intp), pairs, 0.1)
    assert (within <= gaps).all()
    np.testing.assert_array_equal(within[within < 0.1], gaps[within < 0.1])


def test_the_gap_of_boxes_beside_each_other_is_their_distance() -> None:
    covers = Covers.of([coal.Box(0.2, 0.2, 2.0), coal.Box(2.0, 0.2, 0.2)])
    poses = np.array([np.eye(4), np.eye(4)])
    poses[0, :3, 3] = [0.3, 0.5, 0.0]
    [gap] = covers.gaps_m(poses[None], np.array([0]), np.array([[0, 1]]))
    assert gap == pytest.approx(0.3)


def test_the_gap_of_a_ball_beside_a_box_is_their_distance() -> None:
    covers = Covers.of([coal.Sphere(0.1), coal.Box(0.2, 0.2, 0.2)])
    poses = np.array([np.eye(4), np.eye(4)])
    poses[0, :3, 3] = [0.5, 0.5, 0.0]
    [gap] = covers.gaps_m(poses[None], np.array([0]), np.array([[0, 1]]))
    assert gap == pytest.approx(0.4 * np.sqrt(2.0) - 0.1)


def test_the_covers_of_added_shapes_come_last(covers: Covers) -> None:
    shapes = list(SHAPES.values())
    joined = Covers.of(shapes[:2]).with_those_of(shapes[2:])
    for one, other in zip(joined, covers, strict=True):
        np.testing.assert_array_equal(one, other)


@given(seeds)
def test_points_are_placed_as_each_pose_acts_on_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    poses = [
        [pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3)) for _ in range(3)]
        for _ in range(2)
    ]
    points = rng.normal(size=(3, 4, 3))
    found = placed_points(np.array([[T.homogeneous for T in row] for row in poses]), points)
    for m, n, k in np.ndindex(2, 3, 4):
        np.testing.assert_allclose(found[m, n, k], poses[m][n].act(points[n, k]), atol=ROUNDING_M)
