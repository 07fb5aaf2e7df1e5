"""Rows of limits and continuity, against the motions that the splines are."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin import Arm
from baxter_kin.frames import raised
from baxter_kin.validation import FloatArray
from planner import StraightLine
from planner.motion.program.phases import MotionTask, Phase
from planner.motion.program.sparse import Rows
from planner.motion.program.spline_rows import spline_rows
from planner.motion.program.unknowns import Numbers, Unknowns, numbers_of
from planner.splines import trajectory_of

ROUNDING = 1e-9

WHOLE = (Phase(9, rests=True, at_goal=True),)
IN_TWO = (Phase(5), Phase(4, rests=True, at_goal=True))

seeds = st.integers(0, 2**32 - 1)


def random_controls(seed: int) -> FloatArray:
    """Of nine intervals from rest to rest, shape (12, 7)."""
    controls = np.random.default_rng(seed).normal(size=(12, 7))
    controls[:3], controls[-3:] = controls[0], controls[-1]
    return controls


@cache
def made(phases: tuple[Phase, ...]) -> tuple[Unknowns, Rows, ca.Function]:
    """The rows and how they are computed."""
    unknowns, numbers = Unknowns.of(phases, 7), Numbers(phases, 7)
    symbols = ca.MX.sym("x", unknowns.count)
    rows = spline_rows(phases, unknowns, symbols, numbers)
    return unknowns, rows, ca.Function("value", [symbols, numbers.all], [rows.g])


def rows_at(
    phases: tuple[Phase, ...],
    controls: list[FloatArray],
    durations_s: list[float],
    arm: Arm,
    q_start: FloatArray | None = None,
) -> tuple[Rows, FloatArray]:
    """The rows, and their values where the unknowns are those of some splines."""
    unknowns, rows, value = made(phases)
    x = np.zeros(unknowns.count + 14)
    for where, these in zip(unknowns.controls, controls, strict=True):
        x[where] = these
    x[unknowns.durations] = durations_s
    start = controls[0][0] if q_start is None else q_start
    T = arm.T_base_tip(arm.neutral)
    lines = tuple(StraightLine(T, raised(T, 0.1)) for phase in phases if phase.line is not None)
    heights_m = (0.0,) * sum(phase.keeps_height for phase in phases)
    task = MotionTask(start, lines, heights_m=heights_m, q_goal=controls[-1][-1])
    return rows, value(x[: unknowns.count], numbers_of(task, arm, arm.limits)).full().ravel()


@given(seeds, st.floats(0.1, 10.0))
def test_the_greatest_share_of_a_limit_is_that_of_the_motion(
    left: Arm, seed: int, duration_s: float
) -> None:
    """Of velocity at least that, as controls are around it; exact for the other two."""
    controls = random_controls(seed)
    _, shares = rows_at(WHOLE, [controls], [duration_s], left)
    peaks = trajectory_of(controls, duration_s, left.limits).peak_ratios()
    velocity, rest = np.split(np.abs(shares), [7 * 7])
    acceleration, jerk = np.split(rest, [8 * 7])
    assert len(jerk) == 9 * 7
    assert velocity.max() >= peaks.velocity * (1.0 - ROUNDING)
    assert acceleration.max() == pytest.approx(peaks.acceleration, rel=ROUNDING)
    assert jerk.max() == pytest.approx(peaks.jerk, rel=ROUNDING)


@given(seeds)
def test_a_spline_that_is_cut_in_two_goes_on_where_it_was_cut(left: Arm, seed: int) -> None:
    controls = random_controls(seed)
    rows, found = rows_at(IN_TWO, [controls[:8], controls[5:]], [5.0, 4.0], left)
    is_joint = (rows.low == 0.0) & (rows.high == 0.0)
    assert is_joint.sum() == 3 * 7
    np.testing.assert_allclose(found[is_joint], 0.0, atol=ROUNDING)
    assert set(rows.high[~is_joint]) == {1.0}
    assert set(rows.low[~is_joint]) == {-1.0}


@given(seeds)
def test_jumps_at_a_cut_are_those_of_position_velocity_and_acceleration(
    left: Arm, seed: int
) -> None:
    one, other = random_controls(seed), random_controls(seed + 1)
    durations_s, parts = [5.0, 2.0], [one[:8], other[5:]]
    rows, found = rows_at(IN_TWO, parts, durations_s, left)
    before, after = (
        trajectory_of(part, duration_s, left.limits)
        for part, duration_s in zip(parts, durations_s, strict=True)
    )
    jumps = [getattr(before, name)[-1] - getattr(after, name)[0] for name in "qva"]
    np.testing.assert_allclose(found[rows.high == 0.0], np.ravel(jumps), atol=ROUNDING)


def test_where_the_arm_begins_at_speed_it_begins_at_its_start(left: Arm) -> None:
    phases = (Phase(9, 0, enters=True, rests=True, at_goal=True),)
    controls = np.random.default_rng(0).normal(size=(12, 7))
    controls[-3:] = controls[-1]
    first = trajectory_of(controls, 1.0, left.limits).q[0]
    for q_start, gap in ((first, 0.0), (first - 0.5, 0.5)):
        rows, found = rows_at(phases, [controls], [1.0], left, q_start)
        np.testing.assert_allclose(found[rows.high == 0.0], np.full(7, gap), atol=ROUNDING)
