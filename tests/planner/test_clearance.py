"""Clearances and the results of proofs, and their texts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.clearance import SHOWN_M, ContinuousContact, checked_margin_m, least
from planner.collision import Clearance
from planner.errors import MotionError, SceneError


def test_the_least_clearance_is_the_smallest_or_none() -> None:
    far, near = Clearance(0.2, "a", "b"), Clearance(-0.1, "c", "d")
    assert least([far, near, far]) is near
    assert least([]) is None


@pytest.mark.parametrize(
    ("distance_m", "needed_m", "text"),
    [
        (0.0123, 0.0, "arm is 12.3 mm from wall"),
        (0.01, 0.02, "arm is 10.0 mm from wall, and 20.0 mm are required"),
        (0.01, -0.001, "arm is 10.0 mm from wall"),
        (-0.0123, 0.02, "arm is 12.3 mm inside wall"),
        (0.9 * SHOWN_M, 0.0, "arm touches wall"),
        (-0.9 * SHOWN_M, 0.0, "arm touches wall"),
        (1.1 * SHOWN_M, 0.0, "arm is 0.1 mm from wall"),
    ],
)
def test_a_distance_is_shown_in_millimetres_with_the_margin_where_the_two_are_apart(
    distance_m: float, needed_m: float, text: str
) -> None:
    assert Clearance(distance_m, "arm", "wall").too_near(needed_m) == text


def contact(
    distance_m: float, needed_m: float, time_s: float | None = 1.0, duration_s: float = 4.0
) -> ContinuousContact:
    near = Clearance(distance_m, "arm", "wall", time_s)
    return ContinuousContact(near, needed_m, duration_s, intervals=1, evaluations=1)


@pytest.mark.parametrize(
    ("distance_m", "needed_m", "text"),
    [
        (-0.002, 0.0, "arm would be 2.0 mm inside wall at 1.000 s (25 % of the motion)"),
        (0.0, 0.0, "arm would touch wall at 1.000 s (25 % of the motion)"),
        (0.003, 0.01, "arm would be 3.0 mm from wall at 1.000 s (25 % of the motion); 10.0 mm "),
        (0.0101, 0.01, "arm is not proven to keep 10 mm from wall: 10.100 mm apart at 1.000 s"),
    ],
)
def test_a_contact_states_a_distance_or_what_is_not_proven(
    distance_m: float, needed_m: float, text: str
) -> None:
    assert str(contact(distance_m, needed_m)).startswith(text)


@given(st.floats(-0.1, 0.1), st.floats(-0.001, 0.1))
def test_a_contact_is_found_where_at_most_the_required_distance_is_left(
    distance_m: float, needed_m: float
) -> None:
    assert contact(distance_m, needed_m).is_found is (distance_m <= needed_m)


def test_a_contact_of_a_motion_without_duration_is_at_its_start() -> None:
    assert contact(0.0, 0.0, None, 0.0).fraction == contact(0.0, 0.0, None).fraction == 0.0
    assert contact(0.0, 0.0, 3.0).fraction == 0.75


@pytest.mark.parametrize("margin_m", [np.nan, np.inf, None, "1 cm", True, -1e-9])
def test_refuses_an_invalid_margin(margin_m: Any) -> None:
    with pytest.raises(MotionError, match="margin"):
        checked_margin_m(margin_m)
    assert checked_margin_m(0.0) == 0.0


@pytest.mark.parametrize("needed_m", [None, "1 cm"])
def test_refuses_an_invalid_distance(needed_m: Any) -> None:
    with pytest.raises(SceneError, match="needed_m"):
        Clearance(0.01, "arm", "wall").too_near(needed_m)
