"""Cubics: critical states hold every extreme, found by bisection."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings

from planner import Manipulator, Trajectory, plan_joint_move
from planner.trajectory import CONTINUITY_TOLERANCE
from planner.verification.motion.cubics import Cubics
from tests.planner.verification.conftest import configurations, inside


@given(first=configurations(), second=configurations(), rate=configurations())
@settings(max_examples=20)
def test_critical_states_hold_every_extreme(
    manipulator: Manipulator, first: Any, second: Any, rate: Any
) -> None:
    start, goal = inside(manipulator, 0.8 * first), inside(manipulator, 0.8 * second)
    way = plan_joint_move(start, goal, manipulator.limits, v_start=0.1 * rate)
    states = Cubics(way).critical_states()
    for sampled, critical in zip(
        way.sample(np.linspace(0.0, way.duration, 2000)),
        (states.q, states.v, states.a),
        strict=True,
    ):
        assert (critical.max(axis=0) >= sampled.max(axis=0) - CONTINUITY_TOLERANCE).all()
        assert (critical.min(axis=0) <= sampled.min(axis=0) + CONTINUITY_TOLERANCE).all()


@given(first=configurations(), second=configurations(), rate=configurations())
@settings(max_examples=20)
def test_extrema_by_bisection_are_those_by_formula(
    manipulator: Manipulator, first: Any, second: Any, rate: Any
) -> None:
    start, goal = inside(manipulator, 0.8 * first), inside(manipulator, 0.8 * second)
    way = plan_joint_move(start, goal, manipulator.limits, v_start=0.1 * rate)
    states = Cubics(way).critical_states()
    lowest, highest = way.position_extrema()
    # a joint that turns at its goal does so just before or after it, by rounding
    assert states.q.min(axis=0) == pytest.approx(lowest, abs=CONTINUITY_TOLERANCE)
    assert states.q.max(axis=0) == pytest.approx(highest, abs=CONTINUITY_TOLERANCE)
    fastest = (np.abs(states.v) / manipulator.limits.v_max).max(initial=0.0)
    assert fastest == pytest.approx(way.peak_ratios().velocity, abs=CONTINUITY_TOLERANCE)


def test_a_turn_between_knots_is_found(manipulator: Manipulator) -> None:
    # q = t - t^2 + t^3 / 5 over 2 s turns at 5/3 -+ sqrt(10)/3: one of both lies inside
    def state(t: float) -> list[float]:
        return [t - t**2 + t**3 / 5, 1 - 2 * t + 0.6 * t**2, -2 + 1.2 * t]

    q, v, a = (np.outer(x, np.ones(7)) for x in np.array([state(0.0), state(2.0)]).T)
    way = Trajectory(manipulator.limits, np.array([0.0, 2.0]), q, v, a, np.full((1, 7), 1.2))
    turn = 5 / 3 - math.sqrt(10) / 3
    states = Cubics(way).critical_states()
    assert states.q.max() == pytest.approx(state(turn)[0], abs=1e-15)
    assert np.isclose(Cubics(way).turning_times(), turn, atol=1e-12).any()
    assert states.v.min() == pytest.approx(state(5 / 3)[1], abs=1e-15)
