"""How deep shapes press: exact between convex ones, the least way out of a surface."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.scene.contact import surface
from planner.verification.body.pressing import DEEPEST_M, depth_m
from planner.verification.body.solid import ACCURACY_M, Solid
from tests.bodies import CORNERS, SIDES
from tests.conftest import at

HERE = at(0.0, 0.0, 0.0)
UPRIGHT = np.eye(3)

ROUNDED_M = DEEPEST_M / 2**12
"""What halving the longest way so often leaves, rounded up."""


def ball(radius_m: float) -> Solid:
    return Solid.of("ball", 0, HERE, coal.Sphere(radius_m))


def shell(half_m: float) -> Solid:
    """The surface of a cube."""
    return Solid.of("shell", 0, HERE, surface(half_m * CORNERS, np.array(SIDES)))


@given(st.floats(0.01, 0.1), st.floats(0.01, 0.1), st.floats(0.0, 0.3))
def test_balls_press_by_their_radii_less_the_distance(
    first_m: float, second_m: float, apart_m: float
) -> None:
    T = pin.SE3(np.eye(3), apart_m * np.array([0.6, 0.0, 0.8]))
    deep_m = depth_m(ball(first_m), HERE, ball(second_m), T, UPRIGHT)
    assert deep_m == pytest.approx(max(0.0, first_m + second_m - apart_m), abs=ACCURACY_M)


@pytest.mark.parametrize("side", [*np.eye(3), *-np.eye(3)], ids=str)
@pytest.mark.parametrize("pressed_m", [1e-4, 0.0041, 0.013])
def test_a_ball_is_pulled_out_of_a_surface_the_way_it_came(
    side: np.ndarray[tuple[int], np.dtype[np.float64]], pressed_m: float
) -> None:
    T = pin.SE3(np.eye(3), (0.1 + 0.02 - pressed_m) * side)
    deep_m = depth_m(ball(0.02), T, shell(0.1), HERE, UPRIGHT)
    assert pressed_m - ACCURACY_M <= deep_m <= pressed_m + ROUNDED_M


def test_the_way_out_is_along_the_axes_of_the_hand() -> None:
    R = pin.rpy.rpyToMatrix(0.0, 0.0, np.pi / 4)
    T = at(0.1 + 0.02 - 0.004, 0.0, 0.0)
    straight_m = depth_m(ball(0.02), T, shell(0.1), HERE, UPRIGHT)
    aslant_m = depth_m(ball(0.02), T, shell(0.1), HERE, R)
    assert aslant_m == pytest.approx(np.sqrt(2.0) * straight_m, abs=2 * ROUNDED_M)


def test_a_surface_that_is_not_met_is_not_pressed() -> None:
    assert depth_m(ball(0.02), at(0.0, 0.0, 0.121), shell(0.1), HERE, UPRIGHT) == 0.0


def test_what_is_stuck_deeper_than_the_deepest_counts_as_that_deep() -> None:
    rod = Solid.of("rod", 0, HERE, coal.Box(0.02, 0.02, 1.0))
    assert depth_m(rod, HERE, shell(0.2), HERE, UPRIGHT) == DEEPEST_M


def test_what_is_no_deeper_than_known_counts_as_known() -> None:
    T = at(0.1 + 0.02 - 0.004, 0.0, 0.0)
    assert depth_m(ball(0.02), T, shell(0.1), HERE, UPRIGHT, known_m=0.01) == 0.01
    deeper_m = depth_m(ball(0.02), T, shell(0.1), HERE, UPRIGHT, known_m=0.002)
    assert deeper_m == pytest.approx(0.004, abs=ROUNDED_M)
