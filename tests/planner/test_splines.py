"""Uniform cubic B-splines as motions."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm
from planner import plan_joint_move
from planner.splines import Sketch, trajectory_of

ROUNDING = 1e-9


def sketch(seed: int, intervals: int) -> Sketch:
    rng = np.random.default_rng(seed)
    q, v_ends = rng.normal(size=(intervals + 1, 7)), rng.normal(size=(2, 7))
    return Sketch(q, v_ends, float(rng.uniform(0.1, 10.0)))


@given(st.integers(0, 2**32 - 1), st.integers(4, 30))
def test_a_spline_passes_its_sketch(left: Arm, seed: int, intervals: int) -> None:
    drawn = sketch(seed, intervals)
    motion = trajectory_of(drawn.controls, drawn.duration_s, left.limits)
    assert len(motion.knots_s) == intervals + 1
    np.testing.assert_allclose(motion.q, drawn.q, atol=ROUNDING)
    np.testing.assert_allclose(motion.v[[0, -1]], drawn.v_ends, atol=ROUNDING)


@given(st.integers(0, 2**32 - 1), st.integers(4, 30))
def test_motion_stays_within_the_hull_of_its_controls(left: Arm, seed: int, intervals: int) -> None:
    drawn = sketch(seed, intervals)
    controls, step_s = drawn.controls, drawn.duration_s / intervals
    low, high = trajectory_of(controls, drawn.duration_s, left.limits).position_extrema()
    assert (low >= controls.min(axis=0) - ROUNDING).all()
    assert (high <= controls.max(axis=0) + ROUNDING).all()
    peaks = trajectory_of(controls, drawn.duration_s, left.limits).peak_ratios()
    for order, limit, peak in zip(
        (1, 2, 3), (left.limits.v_max, left.limits.a_max, left.limits.j_max), peaks, strict=True
    ):
        bound = np.abs(np.diff(controls, order, axis=0)) / step_s**order / limit
        assert peak <= bound.max() * (1.0 + ROUNDING)


def test_a_planned_motion_is_sketched_closely(left: Arm) -> None:
    planned = plan_joint_move(left.neutral, left.neutral + 0.5, left.limits)
    drawn = Sketch.of(planned, 64)
    motion = trajectory_of(drawn.controls, drawn.duration_s, left.limits)
    times = np.linspace(0.0, planned.duration, 500)
    np.testing.assert_allclose(motion.sample(times).q, planned.sample(times).q, atol=1e-5)
