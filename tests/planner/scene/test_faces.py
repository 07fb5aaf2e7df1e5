"""Where shapes touch, and whether a point is above that."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.validation import FloatArray
from planner import Box, Cylinder, Part, Sphere
from planner.scene.bodies import Shape
from planner.scene.faces import bottom_area, offset_from_hull, touched_area

ROUNDING_M = 1e-9
RIM_M = 3e-4
"""Error of the polygon of a rim of 3 cm."""


def part(shape: Shape, x: float = 0.0, y: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> Part:
    T = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, yaw), np.array([x, y, z]))
    return Part(shape, T)


def cube(x: float, y: float, z: float, edge: float = 0.1, yaw: float = 0.0) -> Part:
    return part(Box((edge, edge, edge)), x, y, z, yaw)


def ranges(area: FloatArray) -> list[tuple[float, float]]:
    return [(float(area[:, k].min()), float(area[:, k].max())) for k in (0, 1)]


@given(st.floats(-0.09, 0.09), st.floats(-0.09, 0.09))
def test_cubes_touch_in_the_overlap_of_their_faces(x: float, y: float) -> None:
    area = touched_area(cube(x, y, 0.1), cube(0.0, 0.0, 0.0))
    expected = [(max(c, 0.0) - 0.05, min(c, 0.0) + 0.05) for c in (x, y)]
    for found, wanted in zip(ranges(area), expected, strict=True):
        assert found == pytest.approx(wanted, abs=2e-6)


@given(st.floats(-3.0, 3.0))
def test_a_turned_cube_on_a_large_one_touches_with_its_whole_face(yaw: float) -> None:
    area = touched_area(cube(0.0, 0.0, 0.55, yaw=yaw), cube(0.0, 0.0, 0.0, edge=1.0))
    reach = 0.05 * (abs(math.cos(yaw)) + abs(math.sin(yaw)))
    for low, high in ranges(area):
        assert (low, high) == pytest.approx((-reach, reach), abs=ROUNDING_M)


def test_a_standing_cylinder_touches_with_its_rim() -> None:
    area = touched_area(part(Cylinder(0.03, 0.1), 0.01, 0.02, 0.1), cube(0.0, 0.0, 0.0))
    assert ranges(area)[0] == pytest.approx((-0.02, 0.04), abs=RIM_M)


def test_a_lying_cylinder_touches_along_a_line() -> None:
    T = pin.SE3(pin.rpy.rpyToMatrix(0.0, math.pi / 2, 0.0), np.array([0.0, 0.0, 0.08]))
    area = touched_area(Part(Cylinder(0.03, 0.06), T), cube(0.0, 0.0, 0.0))
    (x_low, x_high), (y_low, y_high) = ranges(area)
    assert (x_low, x_high) == pytest.approx((-0.03, 0.03), abs=RIM_M)
    assert (y_low, y_high) == pytest.approx((0.0, 0.0), abs=RIM_M)


def test_a_ball_touches_in_a_point() -> None:
    area = touched_area(part(Sphere(0.03), 0.01, 0.02, 0.08), cube(0.0, 0.0, 0.0))
    assert area == pytest.approx(np.array([[0.01, 0.02]]), abs=1e-6)


def test_only_the_lowest_parts_touch_the_floor() -> None:
    area = bottom_area([cube(0.0, 0.0, 0.05), cube(0.5, 0.0, 0.2)])
    assert ranges(area)[0] == pytest.approx((-0.05, 0.05), abs=ROUNDING_M)


SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


@pytest.mark.parametrize("point", [(0.5, 0.5), (0.0, 0.0), (1.0, 0.3), (1.0 + 5e-7, 0.3)])
def test_a_point_in_or_on_an_area_is_above_it(point: tuple[float, float]) -> None:
    assert offset_from_hull(np.array(point), [SQUARE]) is None


@pytest.mark.parametrize(
    ("point", "way"), [((1.3, 0.5), (0.3, 0.0)), ((1.3, 1.4), (0.3, 0.4)), ((0.5, -2), (0.0, -2.0))]
)
def test_the_way_leads_from_the_nearest_point_of_the_area(
    point: tuple[float, float], way: tuple[float, float]
) -> None:
    assert offset_from_hull(np.array(point), [SQUARE]) == pytest.approx(
        np.array(way), abs=ROUNDING_M
    )


def test_between_two_areas_a_point_is_above_their_hull() -> None:
    assert offset_from_hull(np.array([2.0, 0.5]), [SQUARE, SQUARE + np.array([3.0, 0.0])]) is None


def test_a_point_on_a_line_is_above_it_and_one_beside_is_not() -> None:
    line = np.array([[0.0, 0.0], [1.0, 0.0]])
    assert offset_from_hull(np.array([0.4, 0.0]), [line]) is None
    assert offset_from_hull(np.array([0.4, 0.1]), [line]) == pytest.approx(
        np.array([0.0, 0.1]), abs=1e-9
    )


@given(st.floats(-3.1, 3.1), st.floats(-0.9, 0.9), st.floats(-0.9, 0.9))
def test_edges_that_meet_touch_along_their_whole_length_despite_rounding(
    yaw: float, x: float, y: float
) -> None:
    """A box whose lower edge lies on the upper edge of a wider one, turned together."""
    T = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, yaw), np.array([x, y, 0.0]))
    above, below = (
        Part(Box(size), T * pin.SE3(np.eye(3), np.array(place)))
        for size, place in (
            ((0.06, 0.04, 0.04), (0.0, 0.0, 0.04)),
            ((0.1, 0.06, 0.04), (0.08, 0.0, 0.0)),
        )
    )
    area = touched_area(above, below)
    ends = np.array([T.act(np.array([0.03, side, 0.0]))[:2] for side in (-0.02, 0.02)])
    for end in ends:
        assert np.linalg.norm(area - end, axis=1).min() < 5e-6
