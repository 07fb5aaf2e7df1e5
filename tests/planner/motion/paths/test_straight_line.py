"""Poses along a line: slerp, deviations, tolerances, and refused poses."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm
from baxter_kin.errors import PoseError
from baxter_kin.frames import checked_pose
from planner import (
    LineTolerance,
    StraightLine,
    StraightMoveError,
    plan_joint_move,
    plan_straight_move,
)
from planner.errors import MotionError
from planner.motion.paths.pieces import MAX_FRACTION, MIN_LENGTH
from planner.motion.paths.straight_line import (
    DEFAULT_TOLERANCE,
    HALF_TURN_MARGIN_RAD,
    MAX_INTERVAL_M,
    MAX_INTERVAL_RAD,
    MIN_KNOT_TOLERANCE,
    MIN_TOLERANCE_M,
    MIN_TOLERANCE_RAD,
    intervals_of,
    is_on_line,
    knot_tolerance,
)
from tests.planner.lines import above, q_above

ROUNDING = 1e-9

seeds = st.integers(0, 2**32 - 1)


def random_line(seed: int) -> StraightLine:
    rng = np.random.default_rng(seed)
    turn = rng.normal(size=3)
    turn *= rng.uniform(0.0, math.pi - 0.01) / np.linalg.norm(turn)
    start = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
    return StraightLine(
        start, pin.SE3(start.rotation @ pin.exp3(turn), start.translation + rng.normal(size=3))
    )


@given(seeds, st.floats(0.0, 1.0))
def test_positions_are_on_the_line_and_orientations_on_the_slerp(seed: int, s: float) -> None:
    line = random_line(seed)
    start, goal, T = line.T_base_start, line.T_base_goal, line.at(s)
    assert line.at(0.0).isApprox(start, ROUNDING)
    assert line.at(1.0).isApprox(goal, ROUNDING)
    assert np.linalg.norm(line.error(s, T)) < ROUNDING
    np.testing.assert_allclose(
        T.translation, (1.0 - s) * start.translation + s * goal.translation, atol=ROUNDING
    )
    slerp = pin.Quaternion(start.rotation).slerp(s, pin.Quaternion(goal.rotation))
    assert slerp.angularDistance(pin.Quaternion(T.rotation)) < 1e-7  # an arc cosine near zero


@given(seeds)
def test_the_twist_is_the_derivative_of_the_pose(seed: int) -> None:
    line, ds = random_line(seed), 1e-5
    change = line.error(0.5 + ds, line.at(0.5 - ds)) / (2.0 * ds)
    np.testing.assert_allclose(change, line.twist, atol=1e-6)


def test_length_and_angle_are_those_of_the_way() -> None:
    goal = pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.5])), np.array([0.0, 3.0, 4.0]))
    line = StraightLine(pin.SE3.Identity(), goal)
    assert line.length_m == pytest.approx(5.0)
    assert line.angle_rad == pytest.approx(0.5)


def test_a_line_shorter_than_the_least_is_a_point() -> None:
    short, long = (
        StraightLine(pin.SE3.Identity(), pin.SE3(np.eye(3), np.array([0.0, 0.0, length])))
        for length in (0.5 * MIN_LENGTH, 2.0 * MIN_LENGTH)
    )
    assert short.is_point
    assert not long.is_point


def test_a_little_less_than_half_a_turn_is_a_line() -> None:
    turn = math.pi - 2.0 * HALF_TURN_MARGIN_RAD
    goal = pin.SE3(pin.exp3(np.array([0.0, turn, 0.0])), np.zeros(3))
    assert StraightLine(pin.SE3.Identity(), goal).angle_rad == pytest.approx(turn, abs=1e-8)


def test_a_rotation_of_rounded_digits_is_made_orthonormal() -> None:
    R = np.eye(3) + 2e-7
    line = StraightLine(pin.SE3.Identity(), pin.SE3(R, np.ones(3)))
    goal = line.T_base_goal.rotation
    np.testing.assert_allclose(goal.T @ goal, np.eye(3), atol=1e-14)


@pytest.mark.parametrize("s", [math.nan, math.inf, 1e308, "0.5", None, np.zeros(2)], ids=str)
def test_refuses_an_invalid_fraction(s: Any) -> None:
    line = random_line(0)
    for ask in (line.at, lambda s: line.error(s, line.T_base_start)):
        with pytest.raises(MotionError, match="s "):
            ask(s)
    for far in (-MAX_FRACTION, MAX_FRACTION):
        checked_pose(line.at(far))


HALF_TURN = pin.SE3(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))


@pytest.mark.parametrize(
    ("goal", "error"),
    [
        (np.zeros((4, 4)), PoseError),
        (HALF_TURN, StraightMoveError),
        *((pin.SE3(np.eye(3), np.array([x, 0.0, 0.0])), MotionError) for x in (1001.0, 1e308)),
    ],
)
def test_refuses_invalid_ends_and_half_turns(goal: Any, error: type[Exception]) -> None:
    for ends in ((pin.SE3.Identity(), goal), (goal, pin.SE3.Identity())):
        with pytest.raises(error):
            StraightLine(*ends)


@pytest.mark.parametrize("bad", [0.0, 1e-9, -1.0, math.nan, math.inf, 1e3, "1 mm", None, True])
def test_refuses_invalid_tolerances(bad: Any) -> None:
    for arguments in ((bad,), (1e-3, bad)):
        with pytest.raises(MotionError):
            LineTolerance(*arguments)


@given(st.integers(0, 2**32 - 1))
def test_deviations_of_many_tips_are_those_from_the_nearest_pose(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, goal, *tips = (
        pin.SE3(pin.exp3(scale * rng.normal(size=3)), scale * rng.normal(size=3))
        for scale in (0.3, 0.3, 1e-6, 1e-3, 0.1, 1.0)
    )
    line = StraightLine(start, goal)
    off_m, off_rad = line.deviations(np.array([(start * tip).homogeneous for tip in tips]))
    for tip, metres, radians in zip(tips, off_m, off_rad, strict=True):
        there = line.at(line.nearest_fraction(start * tip))
        assert metres == pytest.approx(
            np.linalg.norm((start * tip).translation - there.translation), abs=1e-12
        )
        turn = pin.Quaternion(there.rotation.T @ (start * tip).rotation)  # well-conditioned at pi
        angle_rad = 2.0 * math.atan2(np.linalg.norm(turn.vec()), abs(turn.w))
        assert radians == pytest.approx(angle_rad, abs=1e-12)


MIN_INTERVALS = 4


tolerances = st.builds(
    LineTolerance, st.floats(MIN_TOLERANCE_M, 0.01), st.floats(MIN_TOLERANCE_RAD, 0.1)
)


def line(length_m: float, angle_rad: float = 0.0) -> StraightLine:
    goal = pin.SE3(pin.exp3(np.array([0.0, 0.0, angle_rad])), np.array([length_m, 0.0, 0.0]))
    return StraightLine(pin.SE3.Identity(), goal)


@given(tolerances)
def test_a_tip_that_is_off_along_all_axes_is_within_the_tolerance(
    tolerance: LineTolerance,
) -> None:
    position_m, rotation_rad = knot_tolerance(tolerance)
    assert 0.0 < math.sqrt(3.0) * position_m < tolerance.position_m
    assert 0.0 < math.sqrt(3.0) * rotation_rad < tolerance.rotation_rad


@given(tolerances, st.floats(1.0, 10.0))
def test_a_wider_tolerance_leaves_no_less_at_the_knots(
    tolerance: LineTolerance, wider: float
) -> None:
    loose = LineTolerance(wider * tolerance.position_m, wider * tolerance.rotation_rad)
    assert (np.array(knot_tolerance(loose)) >= knot_tolerance(tolerance)).all()


@given(tolerances, st.floats(0.01, 0.5), st.floats(0.1, 3.0))
def test_a_tip_ahead_on_its_line_is_not_turned_by_more_than_it_may_be(
    tolerance: LineTolerance, length_m: float, angle_rad: float
) -> None:
    position_m, rotation_rad = knot_tolerance(tolerance, [line(length_m, angle_rad)])
    ahead_rad = position_m / length_m * angle_rad
    assert ahead_rad <= rotation_rad * (1.0 + ROUNDING) or position_m == MIN_KNOT_TOLERANCE
    assert position_m <= knot_tolerance(tolerance)[0]


@given(tolerances, st.floats(0.0, 2.0), st.floats(0.0, 3.0))
def test_no_interval_of_a_line_is_longer_than_the_longest(
    tolerance: LineTolerance, length_m: float, angle_rad: float
) -> None:
    count = intervals_of(line(length_m, angle_rad), tolerance, MIN_INTERVALS)
    assert count >= MIN_INTERVALS
    assert length_m / count <= MAX_INTERVAL_M * (1.0 + ROUNDING)
    assert angle_rad / count <= MAX_INTERVAL_RAD * (1.0 + ROUNDING)


@given(tolerances, st.floats(1.0, 10.0), st.floats(0.0, 1.0))
def test_a_tighter_tolerance_has_no_fewer_intervals(
    tolerance: LineTolerance, wider: float, length_m: float
) -> None:
    loose = LineTolerance(wider * tolerance.position_m, wider * tolerance.rotation_rad)
    tight = intervals_of(line(length_m), tolerance, MIN_INTERVALS)
    assert tight >= intervals_of(line(length_m), loose, MIN_INTERVALS)


def test_lines_of_all_lengths_have_few_numbers_of_intervals() -> None:
    counts = {
        intervals_of(line(length_m), DEFAULT_TOLERANCE, MIN_INTERVALS)
        for length_m in np.linspace(0, 1, 500)
    }
    assert counts == {*range(4, 21, 2), *range(30, 101, 10)}


@pytest.mark.parametrize(("position_m", "is_wide"), [(0.001, False), (0.1, True)])
def test_how_far_off_it_may_be_is_for_the_tolerance_to_say(
    left: Arm, position_m: float, is_wide: bool
) -> None:
    q, goal = q_above(left), above(0.05)
    straight = plan_straight_move(left, q, goal, left.limits)
    bent = plan_joint_move(q, straight.q_goal, left.limits)
    way = StraightLine(left.T_base_tip(q), goal)
    assert is_on_line(left, way, straight, DEFAULT_TOLERANCE)
    assert not is_on_line(left, way, bent, DEFAULT_TOLERANCE)
    assert is_on_line(left, way, bent, LineTolerance(position_m, 0.5)) is is_wide
