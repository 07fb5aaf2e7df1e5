"""Samples stand a step of travel apart, however slow the motion is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings

from planner import Manipulator, plan_joint_move
from planner.trajectory import CONTINUITY_TOLERANCE
from planner.verification.motion.cubics import Cubics
from planner.verification.motion.sampled_path import sampled_path
from tests.planner.verification.conftest import configurations, inside


@given(first=configurations(), second=configurations(), rate=configurations())
@settings(max_examples=20)
def test_samples_stand_a_step_of_travel_apart(
    manipulator: Manipulator, first: Any, second: Any, rate: Any
) -> None:
    start, goal = inside(manipulator, 0.8 * first), inside(manipulator, 0.8 * second)
    way = plan_joint_move(start, goal, manipulator.limits, v_start=0.1 * rate)
    reach, step = np.linspace(1.0, 0.1, 7), 0.01
    path = sampled_path(Cubics(way), reach, step, 10_000)
    dense = way.sample(np.linspace(0.0, way.duration, 20_000)).q
    travelled = float((np.abs(np.diff(dense, axis=0)) @ reach).sum())
    assert float((path.turned @ reach).max()) <= step + 1e-9
    assert (path.turned @ reach).sum() == pytest.approx(travelled, rel=1e-4, abs=1e-7)
    assert len(path.times_s) <= 3 + travelled / step
    assert path.q[[0, -1]] == pytest.approx(
        np.array([way.q_start, way.q_goal]), abs=CONTINUITY_TOLERANCE
    )
