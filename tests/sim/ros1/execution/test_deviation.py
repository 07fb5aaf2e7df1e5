"""Deviation: of joints from their set-points, of the tip from its path."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Arm
from baxter_kin.validation import FloatArray
from planner import plan_joint_move
from sim.events import Sample
from sim.ros1.execution.execution import deviation_of

CHORD_M = 1e-4
"""Between two set-points the tip's way is taken to be straight."""


def sample(q_path: FloatArray, q_measured: FloatArray) -> Sample:
    still = np.zeros(7)
    flags = {"is_enabled": True, "is_stopped": False, "has_error": False}
    return Sample(0.0, "left", q_path, q_path, q_measured, still, 0.0, 0.0, **flags)


@settings(max_examples=15)
@given(late=st.floats(0.0, 40.0))
def test_an_arm_that_is_late_is_off_its_set_points_but_not_off_its_path(
    left: Arm, late: float
) -> None:
    way = plan_joint_move(left.neutral, left.start, left.limits)
    times = np.arange(0.0, min(1.2, way.duration), 0.01)
    path, measured = way.sample(times).q, way.sample(np.maximum(times - 0.01 * late, 0.0)).q
    joint_rad, tip_m = deviation_of(
        left, [sample(*each) for each in zip(path, measured, strict=True)]
    )
    assert joint_rad == pytest.approx(np.abs(path - measured).max())
    assert tip_m < CHORD_M


def test_a_tip_beside_its_path_is_off_by_how_far_it_is_beside(left: Arm) -> None:
    q = left.neutral
    turned = q + np.array([0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    moved = left.T_base_tip(turned).translation - left.T_base_tip(q).translation
    joint_rad, tip_m = deviation_of(left, [sample(q, q), sample(q, turned)])
    assert joint_rad == pytest.approx(0.02)
    assert tip_m == pytest.approx(float(np.linalg.norm(moved)))


def test_nothing_that_happened_is_no_deviation(left: Arm) -> None:
    assert deviation_of(left, []) == (0.0, 0.0)
