from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.errors import RequestError, UnknownNameError
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


angles = st.floats(-np.pi, np.pi)
bounds = st.floats(0.0, np.pi / 2)


def leaning(axis: str, lean: float, towards: float, roll: float = 0.0) -> pin.SE3:
    """A frame rolled about an axis that then leans, by an angle, in a direction."""
    unit = np.eye(3)["xyz".index(axis)]
    across = pin.exp3(towards * unit) @ np.roll(unit, 1)
    return pin.SE3(pin.exp3(lean * across) @ pin.exp3(roll * unit), np.zeros(3))


def excess_rad(tolerance: Tolerance, reached: pin.SE3) -> float:
    return tolerance.excess(pin.SE3.Identity(), reached)[1]


axes = pytest.mark.parametrize("axis", ["x", "y", "z"])


@axes
@given(tilt=bounds, lean=st.floats(0.0, 3.0), towards=angles, roll=angles)
def test_outside_a_cone_the_excess_is_the_rest_of_the_lean(
    axis: str, tilt: float, lean: float, towards: float, roll: float
) -> None:
    reached = leaning(axis, lean, towards, roll)
    cosine = reached.rotation["xyz".index(axis), "xyz".index(axis)]
    excess = excess_rad(Tolerance.about(axis, tilt_rad=tilt), reached)
    assert excess == pytest.approx(max(np.arccos(min(cosine, 1.0)) - tilt, 0.0), abs=1e-7)


@axes
@given(tilts=st.tuples(bounds, bounds), lean=st.floats(0.0, 3.0), towards=angles)
def test_a_wider_cone_allows_all_that_a_narrower_one_does(
    axis: str, tilts: tuple[float, float], lean: float, towards: float
) -> None:
    narrow, wide = (Tolerance.about(axis, tilt_rad=tilt) for tilt in sorted(tilts))
    reached = leaning(axis, lean, towards)
    assert excess_rad(wide, reached) <= excess_rad(narrow, reached)


@axes
@given(tilt=bounds, lean=st.floats(0.0, 3.0), directions=st.tuples(angles, angles), roll=angles)
def test_a_cone_does_not_mind_the_direction_of_the_lean(
    axis: str, tilt: float, lean: float, directions: tuple[float, float], roll: float
) -> None:
    tolerance = Tolerance.about(axis, tilt_rad=tilt)
    one, other = (excess_rad(tolerance, leaning(axis, lean, d, roll)) for d in directions)
    assert one == pytest.approx(other, abs=1e-7)


@axes
@given(tilt=bounds, lean=st.floats(0.0, 3.0), towards=angles, roll=angles)
def test_a_box_contains_the_cone_of_its_half_width(
    axis: str, tilt: float, lean: float, towards: float, roll: float
) -> None:
    cone, box = Tolerance.about(axis, tilt_rad=tilt), Tolerance.tilt_box(axis, tilt_rad=tilt)
    reached = leaning(axis, lean, towards, roll)
    assert excess_rad(box, reached) <= excess_rad(cone, reached) + ROUNDING


def test_about_is_a_cone_that_ends_at_five_degrees_where_the_box_goes_on_to_seven() -> None:
    five = np.radians(5.0)
    corner = pin.SE3(pin.exp3(np.array([five, five, 0.0])), np.zeros(3))
    cone, box = Tolerance.about("z", tilt_rad=five), Tolerance.tilt_box("z", tilt_rad=five)
    assert np.degrees(excess_rad(cone, corner)) == pytest.approx(5 * np.sqrt(2) - 5, abs=1e-9)
    assert excess_rad(box, corner) == pytest.approx(0.0, abs=ROUNDING)


@given(widths=st.tuples(bounds, bounds, bounds), roll=angles)
def test_nothing_within_a_tolerance_turns_more_than_it_says(
    widths: tuple[float, float, float], roll: float
) -> None:
    """At the corners, where rotation or lean is greatest."""
    assert Tolerance(rotation_rad=widths).most_turned_rad == pytest.approx(np.linalg.norm(widths))
    box = Tolerance.tilt_box("z", tilt_rad=widths[:2])
    corner = pin.exp3(np.array([widths[0], widths[1], 0.0])) @ pin.exp3(np.array([0.0, 0.0, roll]))
    reached = pin.SE3(corner, np.zeros(3))
    assert excess_rad(box, reached) == pytest.approx(0.0, abs=ROUNDING)
    lean = excess_rad(Tolerance.about("z"), reached)
    assert lean == pytest.approx(box.most_turned_rad, abs=1e-7)
    assert Tolerance.about("x", tilt_rad=widths[0]).most_turned_rad == widths[0]
    assert Tolerance.position_only().most_turned_rad == np.pi


@axes
def test_a_cone_of_no_width_is_any_rotation_about_the_axis(axis: str) -> None:
    rotation: Any = [FREE if name == axis else 0.0 for name in "xyz"]
    assert Tolerance.about(axis, tilt_rad=0.0) == Tolerance.about(axis)
    assert Tolerance.about(axis) == Tolerance.tilt_box(axis, tilt_rad=0.0)
    assert Tolerance.about(axis) == Tolerance(rotation_rad=rotation)


def test_a_box_may_have_two_widths() -> None:
    box = Tolerance.tilt_box("y", tilt_rad=(0.1, 0.2))
    assert box == Tolerance(rotation_rad=(0.1, FREE, 0.2))
    assert box != Tolerance.about("y", tilt_rad=0.1)


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


@pytest.mark.parametrize(
    ("tilt_rad", "rotation_rad", "message"),
    [
        (-0.1, (0.0, 0.0, FREE), "goes from 0 to a quarter turn"),
        (1.6, (0.0, 0.0, FREE), "beyond that ask for a position only"),
        (FREE, (0.0, 0.0, FREE), "tilt_rad must be a finite number"),
        ("5 deg", (0.0, 0.0, FREE), "tilt_rad must be a number"),
        (0.1, (0.0, 0.0, 0.0), "a cone needs one axis free"),
        (0.1, (FREE, FREE, FREE), "a cone needs one axis free"),
        (0.1, (0.1, 0.1, FREE), "a box bounds those instead"),
    ],
)
def test_a_cone_that_contradicts_the_other_bounds_is_refused(
    tilt_rad: Any, rotation_rad: Any, message: str
) -> None:
    with pytest.raises(RequestError, match=message):
        Tolerance(rotation_rad=rotation_rad, tilt_rad=tilt_rad)


def test_a_box_has_one_width_or_two() -> None:
    with pytest.raises(RequestError, match="one for each of the two other axes"):
        Tolerance.tilt_box("z", tilt_rad=(0.1, 0.2, 0.3))


@pytest.mark.parametrize("make", [Tolerance.about, Tolerance.tilt_box])
def test_unknown_axis_names_the_known_ones(make: Any) -> None:
    with pytest.raises(UnknownNameError, match="use one of: x, y, z"):
        make("w", tilt_rad=0.1)


def test_equal_tolerances_are_equal_whatever_they_were_made_of() -> None:
    made_of_lists: Any = [0.0, 0.0, 0.1], np.zeros(3)
    assert Tolerance(*made_of_lists) == Tolerance((0.0, 0.0, 0.1))
    assert hash(Tolerance(*made_of_lists)) == hash(Tolerance((0.0, 0.0, 0.1)))


@pytest.mark.parametrize("tilt_rad", ["a", None, math.nan, math.inf, [0.1], True, -0.1], ids=str)
def test_a_tilt_that_is_no_angle_is_refused(tilt_rad: Any) -> None:
    with pytest.raises(RequestError, match=r"tilt_rad|rotation_rad"):
        Tolerance.about("z", tilt_rad=tilt_rad)


@pytest.mark.parametrize("axis", [np.zeros(3), 5, None, ["z"], "xyz"], ids=str)
def test_an_axis_that_is_none_is_refused(axis: Any) -> None:
    with pytest.raises(UnknownNameError, match="unknown axis"):
        Tolerance.about(axis)


@pytest.mark.parametrize("position_m", [[1, 2], "0.1", None, [[1.0]], np.ones(4), True], ids=str)
def test_a_position_tolerance_is_one_or_three_numbers(position_m: Any) -> None:
    with pytest.raises(RequestError, match="position_m"):
        Tolerance.position_only(position_m)


@pytest.mark.parametrize("pose", [5, None, np.eye(4)], ids=str)
def test_the_excess_is_of_poses(pose: Any) -> None:
    with pytest.raises(RequestError, match="pose must be of class SE3"):
        Tolerance().excess(pose, pin.SE3.Identity())


@pytest.mark.parametrize("bounds", [{"rotation_rad": (5.0, 5.0, 5.0)}, {"tilt_rad": 5.0}])
def test_bounds_in_degrees_are_asked_about(bounds: dict[str, Any]) -> None:
    with pytest.raises(RequestError, match=r"are these degrees\? .* 5 deg is 0.08727 rad"):
        Tolerance(**bounds)
