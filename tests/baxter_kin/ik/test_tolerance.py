from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import RequestError, UnknownNameError
from baxter_kin.ik.tolerance import FREE, Tolerance

ROUNDING = 1e-9

small = st.floats(-0.5, 0.5)


def deviated(T: pin.SE3, displacement: list[float], rotation: list[float]) -> pin.SE3:
    """A pose displaced along and rotated about the axes of another."""
    return T * pin.SE3(pin.exp3(np.array(rotation)), np.array(displacement))


@given(st.lists(small, min_size=6, max_size=6), st.lists(small, min_size=6, max_size=6))
def test_without_tolerance_the_excess_is_distance_and_angle(
    where: list[float], by: list[float]
) -> None:
    T = pin.exp6(np.array(where))
    distance, angle = Tolerance().excess(T, deviated(T, by[:3], by[3:]))
    assert distance == pytest.approx(np.linalg.norm(by[:3]), abs=ROUNDING)
    assert angle == pytest.approx(np.linalg.norm(by[3:]), abs=ROUNDING)


@given(st.lists(small, min_size=6, max_size=6), st.lists(small, min_size=6, max_size=6))
def test_what_is_inside_has_no_excess_and_what_is_outside_has_the_rest(
    where: list[float], by: list[float]
) -> None:
    T, bounds = pin.exp6(np.array(where)), 0.2
    tolerance = Tolerance((bounds,) * 3, (bounds,) * 3)
    excess = tolerance.excess(T, deviated(T, by[:3], by[3:]))
    outside = [np.linalg.norm(np.maximum(np.abs(part) - bounds, 0.0)) for part in (by[:3], by[3:])]
    assert excess == pytest.approx(outside, abs=ROUNDING)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@given(roll=st.floats(-10.0, 10.0), tilt=st.floats(0.0, 3.0), towards=st.floats(-4.0, 4.0))
def test_about_an_axis_only_its_tilt_counts(
    axis: str, roll: float, tilt: float, towards: float
) -> None:
    unit = np.eye(3)["xyz".index(axis)]
    aside = pin.exp3(towards * unit) @ np.roll(unit, 1)  # any direction across the axis
    R = pin.exp3(tilt * aside) @ pin.exp3(roll * unit)
    _, angle = Tolerance.about(axis).excess(pin.SE3.Identity(), pin.SE3(R, np.zeros(3)))
    assert angle == pytest.approx(tilt, abs=1e-7)


@given(st.lists(small, min_size=3, max_size=3), st.lists(small, min_size=3, max_size=3))
def test_position_only_ignores_the_orientation(by: list[float], rotation: list[float]) -> None:
    T = pin.exp6(np.arange(6) / 7.0)
    distance, angle = Tolerance.position_only(0.1).excess(T, deviated(T, by, rotation))
    outside = np.linalg.norm(np.maximum(np.abs(by) - 0.1, 0.0))
    assert distance == pytest.approx(outside, abs=ROUNDING)
    assert angle == 0.0


@pytest.mark.parametrize(
    ("position_m", "rotation_rad", "message"),
    [
        ((0.0, -0.1, 0.0), (0.0, 0.0, 0.0), "position_m needs numbers from 0 to inf"),
        ((0.0, math.nan, 0.0), (0.0, 0.0, 0.0), "position_m needs numbers from 0 to inf"),
        ((0.0, 0.0), (0.0, 0.0, 0.0), "position_m needs three numbers"),
        (0.1, (0.0, 0.0, 0.0), "position_m needs three numbers"),
        ("abc", (0.0, 0.0, 0.0), "position_m must be real numbers"),
        ((0.0, 0.0, 0.0), (FREE, FREE, 0.0), "leaves two axes free"),
        ((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), "beyond that say inf"),
    ],
)
def test_nonsense_is_refused_with_what_is_allowed(
    position_m: Any, rotation_rad: Any, message: str
) -> None:
    with pytest.raises(RequestError, match=message):
        Tolerance(position_m, rotation_rad)


def test_unknown_axis_names_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match="use one of: x, y, z"):
        Tolerance.about("w")


def test_equal_tolerances_are_equal_whatever_they_were_made_of() -> None:
    made_of_lists: Any = [0.0, 0.0, 0.1], np.zeros(3)
    assert Tolerance(*made_of_lists) == Tolerance((0.0, 0.0, 0.1))
    assert hash(Tolerance(*made_of_lists)) == hash(Tolerance((0.0, 0.0, 0.1)))
