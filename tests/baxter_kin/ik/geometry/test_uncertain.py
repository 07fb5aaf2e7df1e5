from __future__ import annotations

import math

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from baxter_kin.ik.geometry.uncertain import UncertainAngle, UncertainVector
from baxter_kin.validation import FloatArray

ROUNDING = 1e-9

ARC_SINE = 1e-6
"""What an arc sine or cosine near 1 loses: half the digits."""

angles = st.floats(-20.0, 20.0)
slacks = st.floats(0.0, 4.0)


def one(*numbers: float) -> tuple[FloatArray, ...]:
    """Each number as an array of one."""
    return tuple(np.array([number]) for number in numbers)


def turn(angle: float) -> float:
    """The same angle but for whole turns, in [-pi, pi]."""
    return math.remainder(angle, 2.0 * math.pi)


@given(angles, slacks, angles, st.floats(0.0, math.pi), st.floats(-1.0, 1.0))
def test_an_angle_within_the_slack_of_a_range_is_never_excluded(
    middle: float, slack: float, range_middle: float, half: float, share: float
) -> None:
    inside = UncertainAngle(*one(range_middle + share * half + share * slack, slack))
    assert inside.is_within(range_middle, half + ROUNDING)[0]
    given_angle = UncertainAngle(*one(middle, slack))
    is_near = abs(turn(middle - range_middle)) <= half + slack
    assume(abs(abs(turn(middle - range_middle)) - half - slack) > ROUNDING)
    assert given_angle.is_within(range_middle, half)[0] == is_near


shares = st.floats(-1.0, 1.0)
known = st.tuples(angles, slacks)


@given(known, known, shares, shares)
def test_a_difference_holds_the_differences_of_all_that_may_be(
    a: tuple[float, float], b: tuple[float, float], share_a: float, share_b: float
) -> None:
    difference = UncertainAngle(*one(*a)).less(UncertainAngle(*one(*b)))
    found = (a[0] + share_a * a[1]) - (b[0] + share_b * b[1])
    assert abs(found - difference.middle[0]) <= difference.slack[0] + ROUNDING


coordinates = st.floats(-2.0, 2.0)
vectors = st.tuples(coordinates, coordinates, st.floats(5e-6, 1.0))
"""Components and slack; the margins of the sweeps are 5e-6."""


def moved(vector: tuple[float, float, float], share: float, towards: float) -> tuple[float, float]:
    """Its components when its end is off by a share of the slack."""
    x, y, slack = vector
    return x + share * slack * math.cos(towards), y + share * slack * math.sin(towards)


@given(vectors, shares, angles)
def test_every_vector_within_the_slack_has_an_angle_within_its_slack(
    vector: tuple[float, float, float], share: float, towards: float
) -> None:
    angle = UncertainVector(*one(*vector)).angle
    x, y = moved(vector, share, towards)
    assume(math.hypot(x, y) > ROUNDING)
    off = abs(turn(math.atan2(y, x) - angle.middle[0]))
    assert off <= angle.slack[0] + ARC_SINE


@given(vectors, shares, angles, angles, st.floats(0.0, 0.5))
def test_every_direction_with_a_component_in_the_range_is_within_the_angle(
    vector: tuple[float, float, float], share: float, towards: float, direction: float, width: float
) -> None:
    x, y = moved(vector, share, towards)
    assume(math.hypot(*vector[:2]) > vector[2] + 1e-3)
    component = x * math.cos(direction) + y * math.sin(direction)
    limits = one(component - width, component + 0.5 * width)
    found, is_possible = UncertainVector(*one(*vector)).arc_cosine(*limits)
    between = abs(turn(direction - math.atan2(y, x)))
    assert is_possible[0]
    assert abs(between - found.middle[0]) <= found.slack[0] + ARC_SINE


def test_a_component_longer_than_the_vector_is_impossible() -> None:
    vector = UncertainVector(*one(3.0, 4.0, 0.1))
    assert vector.length[0] == 5.0
    assert not vector.arc_cosine(*one(5.2, 6.0))[1][0]
    assert not vector.arc_cosine(*one(-6.0, -5.2))[1][0]
    assert vector.arc_cosine(*one(5.05, 6.0))[1][0]


def test_the_slack_of_an_angle_is_that_of_the_tangent_to_where_the_end_may_be() -> None:
    assert UncertainVector(*one(0.0, 2.0, 1.0)).angle.slack[0] == math.asin(0.5)


def test_a_vector_that_may_be_zero_may_have_any_angle() -> None:
    assert UncertainVector(*one(0.1, 0.0, 0.1)).angle.slack[0] == math.pi


def test_a_part_has_what_was_chosen() -> None:
    both = UncertainAngle(np.array([1.0, 2.0]), np.array([0.1, 0.2])).part(np.array([False, True]))
    assert (both.middle.tolist(), both.slack.tolist()) == ([2.0], [0.2])


def test_a_vector_known_to_be_zero_may_have_any_angle_too() -> None:
    zero = np.zeros(1)
    assert UncertainVector(zero, zero, zero).angle.slack[0] == math.pi
