"""What is asked at the knots of a line, so that it is kept between them as well."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm
from planner import LineTolerance, StraightLine, plan_joint_move, plan_straight_move
from planner.motion.line_knots import (
    INTERVAL_M,
    INTERVAL_RAD,
    TINY,
    at_knots,
    intervals_on,
    is_on_line,
)
from planner.motion.straight_line import LEAST_M, LEAST_RAD, STRICT
from tests.planner.lines import above, q_above

FEWEST = 4

ROUNDING = 1e-9

tolerances = st.builds(LineTolerance, st.floats(LEAST_M, 0.01), st.floats(LEAST_RAD, 0.1))


def line(length_m: float, angle_rad: float = 0.0) -> StraightLine:
    goal = pin.SE3(pin.exp3(np.array([0.0, 0.0, angle_rad])), np.array([length_m, 0.0, 0.0]))
    return StraightLine(pin.SE3.Identity(), goal)


@given(tolerances)
def test_a_tip_that_is_off_along_all_axes_is_within_the_tolerance(
    tolerance: LineTolerance,
) -> None:
    position_m, rotation_rad = at_knots(tolerance)
    assert 0.0 < math.sqrt(3.0) * position_m < tolerance.position_m
    assert 0.0 < math.sqrt(3.0) * rotation_rad < tolerance.rotation_rad


@given(tolerances, st.floats(1.0, 10.0))
def test_a_wider_tolerance_leaves_no_less_at_the_knots(
    tolerance: LineTolerance, wider: float
) -> None:
    loose = LineTolerance(wider * tolerance.position_m, wider * tolerance.rotation_rad)
    assert (np.array(at_knots(loose)) >= at_knots(tolerance)).all()


@given(tolerances, st.floats(0.01, 0.5), st.floats(0.1, 3.0))
def test_a_tip_ahead_on_its_line_is_not_turned_by_more_than_it_may_be(
    tolerance: LineTolerance, length_m: float, angle_rad: float
) -> None:
    position_m, rotation_rad = at_knots(tolerance, [line(length_m, angle_rad)])
    ahead_rad = position_m / length_m * angle_rad
    assert ahead_rad <= rotation_rad * (1.0 + ROUNDING) or position_m == TINY
    assert position_m <= at_knots(tolerance)[0]


@given(tolerances, st.floats(0.0, 2.0), st.floats(0.0, 3.0))
def test_no_interval_of_a_line_is_longer_than_the_longest(
    tolerance: LineTolerance, length_m: float, angle_rad: float
) -> None:
    count = intervals_on(line(length_m, angle_rad), tolerance, FEWEST)
    assert count >= FEWEST
    assert length_m / count <= INTERVAL_M * (1.0 + ROUNDING)
    assert angle_rad / count <= INTERVAL_RAD * (1.0 + ROUNDING)


@given(tolerances, st.floats(1.0, 10.0), st.floats(0.0, 1.0))
def test_a_tighter_tolerance_has_no_fewer_intervals(
    tolerance: LineTolerance, wider: float, length_m: float
) -> None:
    loose = LineTolerance(wider * tolerance.position_m, wider * tolerance.rotation_rad)
    tight = intervals_on(line(length_m), tolerance, FEWEST)
    assert tight >= intervals_on(line(length_m), loose, FEWEST)


def test_lines_of_all_lengths_have_few_numbers_of_intervals() -> None:
    counts = {intervals_on(line(length_m), STRICT, FEWEST) for length_m in np.linspace(0, 1, 500)}
    assert counts == {*range(4, 21, 2), *range(30, 101, 10)}


def test_a_straight_move_is_on_its_line_and_a_joint_move_is_not(left: Arm) -> None:
    q, goal = q_above(left), above(0.05)
    straight = plan_straight_move(left, q, goal, left.limits)
    bent = plan_joint_move(q, straight.q_goal, left.limits)
    way = StraightLine(left.T_base_tip(q), goal)
    assert is_on_line(left, way, straight, STRICT)
    assert not is_on_line(left, way, bent, STRICT)


@pytest.mark.parametrize(("position_m", "is_wide"), [(0.001, False), (0.1, True)])
def test_how_far_off_it_may_be_is_for_the_tolerance_to_say(
    left: Arm, position_m: float, is_wide: bool
) -> None:
    q, goal = q_above(left), above(0.05)
    end = plan_straight_move(left, q, goal, left.limits).q_goal
    bent = plan_joint_move(q, end, left.limits)
    way = StraightLine(left.T_base_tip(q), goal)
    assert is_on_line(left, way, bent, LineTolerance(position_m, 0.5)) is is_wide
