"""The configurations along a line: on it everywhere, smooth, least in norm, exact derivatives."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Arm, ConfigurationError
from planner import MotionError, PathState, StraightPath, plan_path_move, plan_straight_path
from planner.straight_path import LINE_TOLERANCE
from tests.planner.lines import above, q_above, random_path

DS = 1e-4
"""Step of central differences; their error is its square times the third derivative."""

seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=6)


@pytest.fixture(scope="module")
def path(left: Arm) -> StraightPath:
    return plan_straight_path(left, q_above(left), above(0.0), left.limits)


@few
@given(seeds)
def test_the_tip_is_on_the_line_everywhere(arm: Arm, seed: int) -> None:
    path = random_path(arm, seed)
    for s in np.linspace(0.0, 1.0, 101):
        wanted, T = path.line.at(float(s)), arm.T_base_tip(path.at(s).q)
        assert np.abs(wanted.homogeneous - T.homogeneous).max() <= LINE_TOLERANCE


@few
@given(seeds, st.floats(2.0 * DS, 1.0 - 2.0 * DS))
def test_each_derivative_is_that_of_the_one_before(left: Arm, seed: int, s: float) -> None:
    path = random_path(left, seed)
    ahead, behind, here = path.at(s + DS), path.at(s - DS), path.at(s)
    for order in range(3):
        difference = (ahead[order] - behind[order]) / (2.0 * DS)
        scale = 1.0 + np.abs(here[order + 1]).max() + np.abs(here[3]).max()
        np.testing.assert_allclose(difference, here[order + 1], atol=1e-4 * scale)


@few
@given(seeds, st.floats(0.0, 1.0))
def test_the_tip_moves_with_the_twist_of_the_line(left: Arm, seed: int, s: float) -> None:
    path = random_path(left, seed)
    point = path.at(s)
    np.testing.assert_allclose(left.jacobian(point.q) @ point.dq, path.line.twist, atol=1e-6)


@few
@given(seeds, st.floats(0.0, 1.0))
def test_the_joints_move_no_more_than_they_must(left: Arm, seed: int, s: float) -> None:
    path = random_path(left, seed)
    point = path.at(s)
    idle = np.linalg.svd(left.jacobian(point.q))[2][6]
    assert abs(idle @ point.dq) <= 1e-5 * (1.0 + np.linalg.norm(point.dq))


@few
@given(seeds, st.floats(0.0, 1.0))
def test_the_way_back_goes_through_the_same_configurations(left: Arm, seed: int, s: float) -> None:
    path = random_path(left, seed)
    forth, back = path.at(s), path.reversed().at(1.0 - s)
    np.testing.assert_allclose(back.q, forth.q, atol=1e-12)
    np.testing.assert_allclose(back.dq, -forth.dq, atol=1e-9)
    assert path.reversed().line.at(1.0 - s).isApprox(path.line.at(s), 1e-9)


def test_planning_the_way_back_finds_the_same_configurations(left: Arm, path: StraightPath) -> None:
    back = plan_straight_path(left, path.at(1.0).q, path.line.T_base_start, left.limits)
    np.testing.assert_allclose(back.at(1.0).q, path.at(0.0).q, atol=1e-7)


def test_many_fractions_give_the_same_as_one_by_one(path: StraightPath) -> None:
    s = np.array([0.0, 0.3, 1.0])
    together = path.at(s)
    for i, fraction in enumerate(s):
        for many, one in zip(together, path.at(fraction), strict=True):
            np.testing.assert_allclose(many[i], one, atol=1e-12)


def test_it_knows_how_long_it_is(path: StraightPath) -> None:
    assert path.length_m == pytest.approx(0.15, abs=1e-5)


def test_a_point_is_a_path_without_length(left: Arm) -> None:
    q = q_above(left)
    path = plan_straight_path(left, q, left.T_base_tip(q), left.limits)
    np.testing.assert_array_equal(path.at(0.7).q, q)
    assert not path.at(0.7).dq.any()


def test_joint_rates_are_those_of_the_tip(left: Arm, path: StraightPath) -> None:
    state = path.joint_state(PathState(0.4, speed_per_s=1.2, acceleration_per_s2=-0.7))
    J = left.jacobian(state.q)
    np.testing.assert_allclose(J @ state.v, 1.2 * path.line.twist, atol=1e-9)
    dt = 1e-5
    dJ = left.jacobian(state.q + dt * state.v) - left.jacobian(state.q - dt * state.v)
    tip = J @ state.a + dJ / (2.0 * dt) @ state.v
    np.testing.assert_allclose(tip, -0.7 * path.line.twist, atol=1e-6)


def test_a_motion_begins_and_ends_exactly_in_the_states_asked_for(
    left: Arm, path: StraightPath
) -> None:
    start, end = PathState(0.2, 0.8, 0.3), PathState(0.9, 0.4, -0.2)
    motion = plan_path_move(path, left.limits, start=start, end=end)
    for i, state in ((0, start), (-1, end)):
        asked = path.joint_state(state)
        for got, wanted in zip((motion.q, motion.v, motion.a), asked, strict=True):
            np.testing.assert_array_equal(got[i], wanted)


@pytest.mark.parametrize("s", [-0.1, 1.1, math.nan, math.inf, "half", [[0.5]], None])
def test_refuses_fractions_that_are_none(path: StraightPath, s: Any) -> None:
    with pytest.raises(MotionError):
        path.at(s)


@pytest.mark.parametrize(
    "state",
    [(-0.1,), (1.1,), (math.nan,), ("start",), (0.5, -1.0), (0.5, math.inf), (0.5, 0.0, math.nan)],
)
def test_refuses_states_that_are_none(state: tuple[Any, ...]) -> None:
    with pytest.raises(MotionError):
        PathState(*state)


def test_refuses_a_state_of_another_kind(path: StraightPath) -> None:
    with pytest.raises(MotionError, match="PathState"):
        path.joint_state(0.5)  # type: ignore[arg-type]


@pytest.mark.parametrize("coefficients", [np.zeros((3, 6)), np.zeros(7), np.full((2, 7), np.nan)])
def test_refuses_coefficients_that_are_none(path: StraightPath, coefficients: Any) -> None:
    with pytest.raises(ConfigurationError):
        StraightPath(path.arm, path.line, coefficients)


def test_a_path_cannot_be_changed(path: StraightPath) -> None:
    with pytest.raises(ValueError, match="read-only"):
        path.coefficients[0] = 1.0
