"""Support surfaces: meshes with walls, steps and holes, and supports that are not quite level.

What a body stands on is compared with brute force: heights below points of its underside, and the
hull of those that touch.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.frames import pose_from_quaternion
from baxter_kin.validation import FloatArray
from planner import Body, Box, Cylinder, Mesh, Part, Sphere, load_object, make_block
from planner.scene.bodies import Shape
from planner.scene.faces import FLOOR_Z_M, SLICE_M
from planner.scene.support import MAX_TILT_RAD, Landing, settle
from tests.conftest import at

REST_M = 1e-6
FLAT = Box((0.8, 0.8, 0.02))
STEP_M = 1e-3
"""Distance between points of an underside."""

ORIGIN = at(0.0, 0.0, 0.0)
seeds = st.integers(0, 2**32 - 1)


def sheet(*corners: tuple[float, float, float]) -> FloatArray:
    """Two triangles between four corners, shape (2, 3, 3)."""
    a, b, c, d = np.array(corners)
    return np.array([[a, b, c], [a, c, d]])


def level(x0: float, x1: float, y0: float, y1: float, z: float) -> FloatArray:
    return sheet((x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z))


def wall(start: tuple[float, float], end: tuple[float, float], z0: float, z1: float) -> FloatArray:
    return sheet((*start, z0), (*end, z0), (*end, z1), (*start, z1))


def walls(x: float, y: float, z0: float, z1: float) -> list[FloatArray]:
    corners = [(-x, -y), (x, -y), (x, y), (-x, y)]
    return [wall(corners[k - 1], corners[k], z0, z1) for k in range(4)]


def box(
    xs: tuple[float, float], ys: tuple[float, float], zs: tuple[float, float]
) -> list[FloatArray]:
    """The triangles of a cuboid."""
    (x0, x1), (y0, y1), (z0, z1) = xs, ys, zs
    middle = (x0 + x1) / 2, (y0 + y1) / 2
    shift = np.array([*middle, 0.0])
    sides = [part + shift for part in walls(x1 - middle[0], y1 - middle[1], z0, z1)]
    return [level(x0, x1, y0, y1, z0), level(x0, x1, y0, y1, z1), *sides]


def a_bin() -> list[FloatArray]:
    """A floor without thickness, and walls of 6 mm, thick enough for the points of an underside."""
    sides = [
        box((-0.126, -0.12), (-0.096, 0.096), (0.0, 0.05)),
        box((0.12, 0.126), (-0.096, 0.096), (0.0, 0.05)),
        box((-0.12, 0.12), (-0.096, -0.09), (0.0, 0.05)),
        box((-0.12, 0.12), (0.09, 0.096), (0.0, 0.05)),
    ]
    return [level(-0.12, 0.12, -0.09, 0.09, 0.0), *(sheet for side in sides for sheet in side)]


def a_tray() -> list[FloatArray]:
    """A plate with a rim of 15 mm, 8 mm high."""
    rims = [
        box((-0.15, 0.15), (-0.10, -0.085), (0.004, 0.012)),
        box((-0.15, 0.15), (0.085, 0.10), (0.004, 0.012)),
        box((-0.15, -0.135), (-0.085, 0.085), (0.004, 0.012)),
        box((0.135, 0.15), (-0.085, 0.085), (0.004, 0.012)),
    ]
    return [*box((-0.15, 0.15), (-0.10, 0.10), (0.0, 0.004)), *(s for rim in rims for s in rim)]


def stairs() -> list[FloatArray]:
    """Five steps, 50 mm deep and 30 mm high."""
    found = []
    for k in range(5):
        x, z = -0.125 + 0.05 * k, 0.03 * k
        found.append(level(x, x + 0.05, -0.1, 0.1, z))
        found.append(wall((x, -0.1), (x, 0.1), z - 0.03, z))
    return found


def a_room() -> list[FloatArray]:
    """Floor, ceiling and walls around everything, and a bench along a wall."""
    shell = [level(-1.0, 1.0, -1.0, 1.0, 0.0), level(-1.0, 1.0, -1.0, 1.0, 2.0)]
    return [*shell, *walls(1.0, 1.0, 0.0, 2.0), *box((-0.1, 0.05), (-0.2, 0.02), (0.0, 0.04))]


def a_grate() -> list[FloatArray]:
    """A plate with a hole of 40 x 40 mm in its middle."""
    outer, inner = 0.12, 0.02
    return [
        level(-outer, outer, -outer, -inner, 0.0),
        level(-outer, outer, inner, outer, 0.0),
        level(-outer, -inner, -inner, inner, 0.0),
        level(inner, outer, -inner, inner, 0.0),
    ]


PLACES: dict[str, Callable[[], list[FloatArray]]] = {
    "bin": a_bin,
    "tray": a_tray,
    "stairs": stairs,
    "room": a_room,
    "grate": a_grate,
}


def mesh(triangles: list[FloatArray]) -> Mesh:
    corners = np.concatenate(triangles)
    vertices, numbers = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return Mesh(vertices, numbers.reshape(-1, 3))


def placed(name: str, shape: Shape, T: pin.SE3 = ORIGIN) -> Body:
    return Body(name, (Part(shape, ORIGIN),), T)


def block(x: float, y: float, z: float, size: tuple[float, float, float], yaw: float) -> Body:
    T = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, yaw), np.array([x, y, z]))
    return make_block("block", T, edge_m=size)


# Brute force


@dataclass(frozen=True)
class Sampled:
    """What points of an underside find below them.

    Attributes:
        height_m: of the highest.
        inside_m: how far the centre is inside the hull of those that touch; negative outside.
    """

    height_m: float
    inside_m: float


def heights(triangles: FloatArray, points: FloatArray, top_m: float) -> FloatArray:
    """The highest triangle below a height, at points shape (n, 2); -inf where there is none."""
    found = np.full(len(points), -np.inf)
    for a, b, c in triangles:
        across = np.array([b[:2] - a[:2], c[:2] - a[:2]]).T
        if abs(np.linalg.det(across)) < 1e-12:
            continue
        shares = np.linalg.solve(across, (points - a[:2]).T)
        z = a[2] + shares.T @ [b[2] - a[2], c[2] - a[2]]
        is_over = (shares.min(axis=0) >= 0.0) & (shares.sum(axis=0) <= 1.0) & (z <= top_m)
        found = np.where(is_over, np.maximum(found, z), found)
    return found


def sampled(body: Body, triangles: FloatArray, grown_m: float) -> Sampled:
    """Points of the underside of a level box, grown on all sides."""
    shape = body.parts[0].shape
    assert isinstance(shape, Box)
    x, y, z = shape.size_m
    axes = [np.linspace(-e / 2 - grown_m, e / 2 + grown_m, round(e / STEP_M)) for e in (x, y)]
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    T = body.T_base_body
    points = grid @ T.rotation[:2, :2].T + T.translation[:2]
    found = heights(triangles, points, float(T.translation[2]) - z / 2)
    highest = float(found.max())
    hull = shapely.MultiPoint(points[found >= highest - SLICE_M]).convex_hull
    centre = shapely.Point(T.translation[:2])
    beside_m = hull.distance(centre)
    return Sampled(highest, hull.exterior.distance(centre) if not beside_m else -beside_m)


@pytest.mark.slow
@pytest.mark.parametrize("name", PLACES)
def test_a_block_is_carried_where_points_of_its_underside_meet_the_mesh(name: str) -> None:
    rng = np.random.default_rng(list(PLACES).index(name))
    sheets = PLACES[name]()
    below, triangles = placed(name, mesh(sheets)), np.concatenate(sheets)
    compared = 0
    for _ in range(30):
        size = tuple(rng.uniform(0.02, 0.08, 3).tolist())
        x, y = rng.uniform(-0.1, 0.1, 2)
        body = block(x, y, 0.3, size, float(rng.uniform(-3.0, 3.0)))
        narrow, wide = (sampled(body, triangles, grown_m) for grown_m in (-STEP_M, STEP_M))
        if not narrow.height_m == wide.height_m > -np.inf:
            continue  # an edge is too near to tell by points
        if narrow.inside_m * wide.inside_m <= 0.0 or abs(narrow.inside_m) < 2 * STEP_M:
            continue
        landing = settle(body, [below])
        bottom_m = landing.body.centre_base[2] - size[2] / 2
        is_level = landing.tilt_rad == 0.0
        assert landing.supports == (name,)
        if narrow.inside_m > 0.0:
            assert bottom_m == pytest.approx(narrow.height_m, abs=REST_M)
            assert is_level
            assert landing.overhang is None
        elif is_level:
            assert bottom_m == pytest.approx(narrow.height_m, abs=REST_M)
            assert landing.overhang is not None
        compared += 1
    assert compared >= 8


def corners_below(landing: Landing, edge_m: float) -> FloatArray:
    """Corners of the underside of a cube at rest, shape (4, 3)."""
    signs = np.array([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1]])
    T = landing.body.T_base_body
    found: FloatArray = edge_m / 2 * signs @ T.rotation.T + T.translation
    return found


BUMP = Mesh(
    np.array([[-0.4, -0.4, 0], [0.4, -0.4, 0], [0.4, 0.4, 0], [-0.4, 0.4, 0], [0.4, -0.1, 0.001]]),
    np.array([[0, 1, 2], [0, 2, 3], [2, 1, 4]]),
)
"""A square floor, and one triangle that rises by 1 mm at its far edge."""


def test_a_triangle_that_rises_far_away_does_not_carry_a_block() -> None:
    landing = settle(block(0.0, 0.0, 0.1, (0.05, 0.05, 0.05), 0.0), [placed("bin", BUMP)])
    assert landing.overhang is None
    assert landing.tilt_rad == 0.0
    assert landing.body.centre_base == pytest.approx([0.0, 0.0, 0.025], abs=REST_M)
    area = shapely.MultiPoint(landing.areas[0]).convex_hull.area
    assert area == pytest.approx(0.05**2, rel=1e-6)


def test_a_bin_as_one_mesh_supports_like_the_same_bin_of_boxes() -> None:
    thin = 0.004
    boxes = [
        ((0.24, 0.18, thin), (0.0, 0.0, -thin / 2)),
        ((thin, 0.18, 0.05), (-0.12, 0.0, 0.025)),
        ((thin, 0.18, 0.05), (0.12, 0.0, 0.025)),
        ((0.24, thin, 0.05), (0.0, -0.09, 0.025)),
        ((0.24, thin, 0.05), (0.0, 0.09, 0.025)),
    ]
    as_boxes = Body("bin", tuple(Part(Box(size), at(*where)) for size, where in boxes), ORIGIN)
    as_mesh = placed(
        "bin", mesh([level(-0.12, 0.12, -0.09, 0.09, 0.0), *walls(0.12, 0.09, 0.0, 0.05)])
    )
    for x in (-0.08, 0.0, 0.08):
        for y in (-0.05, 0.0, 0.05):
            body = block(x, y, 0.2, (0.05, 0.05, 0.05), 0.3)
            one, other = (settle(body, [each]) for each in (as_boxes, as_mesh))
            assert one.overhang is None
            assert other.overhang is None
            np.testing.assert_allclose(
                one.body.T_base_body.homogeneous, other.body.T_base_body.homogeneous, atol=REST_M
            )


def test_a_table_turned_by_a_thousandth_of_a_degree_carries_a_block_level_where_it_is() -> None:
    """A tilt of 17 um over a metre."""
    turned = pose_from_quaternion((1.0, 0.0, -0.93), (0.0001, 0.0, 0.1305, 0.9914), normalise=True)
    table = load_object("table", turned)
    for x in np.linspace(0.75, 1.3, 5):
        landing = settle(block(float(x), 0.1, -0.05, (0.05, 0.05, 0.05), 0.0), [table])
        assert landing.supports == ("table",)
        assert landing.overhang is None
        assert landing.tilt_rad == 0.0
        assert landing.body.centre_base[:2] == pytest.approx([x, 0.1], abs=1e-12)


@given(st.floats(0.05, 0.99), st.floats(-3.0, 3.0), st.sampled_from(["box", "mesh"]))
def test_a_block_lies_as_a_table_that_is_off_level_by_less_than_a_degree(
    tilt_deg: float, towards: float, kind: str
) -> None:
    axis = np.array([math.cos(towards), math.sin(towards), 0.0])
    T = pin.SE3(pin.exp3(math.radians(tilt_deg) * axis), np.zeros(3))
    top = placed("table", Box((0.8, 0.8, 0.02)) if kind == "box" else mesh(a_grate()), T)
    x = 0.0 if kind == "box" else 0.06
    landing = settle(block(x, 0.02, 0.1, (0.05, 0.05, 0.05), 0.4), [top])
    assert landing.overhang is None
    assert math.degrees(landing.tilt_rad) == pytest.approx(tilt_deg, abs=2e-3)
    assert landing.body.centre_base[:2] == pytest.approx([x, 0.02], abs=1e-9)
    thick = 0.01 if kind == "box" else 0.0
    for corner in corners_below(landing, 0.05):
        assert T.actInv(corner)[2] == pytest.approx(thick, abs=2e-6)


@pytest.mark.parametrize("shape", [Box((0.05, 0.05, 0.05)), Cylinder(0.02, 0.06)])
def test_nothing_stands_on_a_steeper_table_and_the_slope_is_reported(shape: Shape) -> None:
    T = pin.SE3(pin.exp3(np.array([0.0, math.radians(1.2), 0.0])), np.zeros(3))
    table = placed("table", FLAT, T)
    landing = settle(placed("body", shape, at(0.0, 0.0, 0.1)), [table])
    assert landing.overhang is not None
    assert math.degrees(landing.slope_rad) == pytest.approx(1.2, abs=1e-6)
    beyond = settle(placed("body", shape, at(0.41, 0.0, 0.1)), [placed("table", FLAT)])
    assert beyond.overhang is not None
    assert beyond.slope_rad == 0.0
    fallen = settle(block(0.0, 0.0, -2.0, (0.05, 0.05, 0.05), 0.0), [])
    assert fallen.body.centre_base[2] == pytest.approx(FLOOR_Z_M + 0.025, abs=REST_M)


@pytest.mark.parametrize("shape", [Sphere(0.03), Cylinder(0.02, 0.06)])
def test_round_bodies_stand_on_a_table_that_is_off_level_by_half_a_degree(shape: Shape) -> None:
    T = pin.SE3(pin.exp3(np.array([math.radians(0.3), math.radians(0.4), 0.0])), np.zeros(3))
    table = placed("table", FLAT, T)
    lying = pin.SE3(pin.rpy.rpyToMatrix(math.pi / 2, 0.0, 0.3), np.array([0.1, 0.0, 0.1]))
    for where in (at(0.1, 0.0, 0.1), lying):
        landing = settle(placed("body", shape, where), [table])
        assert landing.overhang is None


def test_a_plank_on_two_posts_of_unequal_height_lies_across_both() -> None:
    posts = [
        make_block("low", at(-0.08, 0.0, -0.001), edge_m=(0.02, 0.02, 0.04)),
        make_block("high", at(0.08, 0.0, 0.0), edge_m=(0.02, 0.02, 0.04)),
    ]
    landing = settle(block(0.0, 0.0, 0.1, (0.2, 0.03, 0.01), 0.0), posts)
    assert set(landing.supports) == {"low", "high"}
    assert landing.overhang is None
    assert landing.tilt_rad == pytest.approx(math.atan(0.001 / 0.16), rel=0.15)


@pytest.mark.slow
@given(seeds)
def test_on_uneven_ground_a_block_touches_around_its_centre_and_is_nowhere_inside(
    seed: int,
) -> None:
    """Triangles whose corners are up to 0.4 mm high or low, 40 mm apart."""
    rng = np.random.default_rng(seed)
    ticks = np.linspace(-0.2, 0.2, 11)
    vertices = np.stack([*np.meshgrid(ticks, ticks, indexing="ij"), np.zeros((11, 11))], axis=-1)
    vertices[..., 2] = rng.uniform(-4e-4, 4e-4, (11, 11))
    number = np.arange(121).reshape(11, 11)
    a, b, c, d = (
        n.ravel() for n in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    )
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    ground = Mesh(vertices.reshape(-1, 3), faces)
    x, y = rng.uniform(-0.1, 0.1, 2)
    body = block(x, y, 0.1, (0.09, 0.07, 0.05), float(rng.uniform(-3.0, 3.0)))
    landing = settle(body, [placed("ground", ground)])
    assert landing.overhang is None
    assert landing.tilt_rad <= MAX_TILT_RAD
    assert landing.body.centre_base[:2] == pytest.approx([x, y], abs=1e-9)
    grid = np.stack(np.meshgrid(np.linspace(-0.045, 0.045, 91), np.linspace(-0.035, 0.035, 71)), -1)
    under = np.column_stack([grid.reshape(-1, 2), np.full(91 * 71, -0.025)])
    T = landing.body.T_base_body
    points = under @ T.rotation.T + T.translation
    gaps = points[:, 2] - heights(ground.corners, points[:, :2], 1.0)
    assert gaps.min() > -2 * REST_M
