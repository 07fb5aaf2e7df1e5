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
from planner.collision.obstacles import PAIRS, REACH_M, LinearBounds
from planner.motion.program.rows import Rows, SparseSum, clearance_rows, constant, spline_rows
from planner.motion.program.unknowns import MotionTask, Numbers, Phase, Unknowns, numbers_of
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
    lines = tuple(StraightLine(T, raised(T, 0.1)) for phase in phases if phase.piece is not None)
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


SUM_ROUNDING = 1e-12


def added(
    seed: int, shape: tuple[int, int], beyond: int = 0
) -> tuple[SparseSum, FloatArray, ca.DM]:
    """A sum of random parts, the same made densely, and the entries that both are made of."""
    rng, entries = np.random.default_rng(seed), np.random.default_rng(seed + 1).normal(size=12)
    found, dense = SparseSum(), np.zeros((shape[0] + beyond, shape[1] + beyond))
    for _ in range(3):
        rows = rng.integers(0, shape[0] + beyond, (4, 1))
        columns = rng.integers(0, shape[1] + beyond, (4, 2))
        numbers, weights = rng.integers(0, 12, (4, 2)), rng.normal(size=(4, 2))
        found.add(rows, columns, numbers, weights)
        np.add.at(dense, (np.broadcast_to(rows, (4, 2)), columns), weights * entries[numbers])
    return found, dense[: shape[0], : shape[1]], ca.DM(entries)


def evaluated(found: SparseSum, entries: ca.DM, shape: tuple[int, int], **options: bool) -> ca.DM:
    symbols = ca.MX.sym("entries", 12)
    matrix = found.matrix(symbols, shape, **options)
    return ca.Function("matrix", [symbols], [matrix])(entries)


@given(seeds, st.sampled_from([((4, 3), 0), ((3, 3), 2)]))
def test_entries_at_one_place_are_added_up_with_their_weights_and_others_left_out(
    seed: int, size: tuple[tuple[int, int], int]
) -> None:
    shape, beyond = size
    found, dense, entries = added(seed, shape, beyond)
    np.testing.assert_allclose(evaluated(found, entries, shape).full(), dense, atol=SUM_ROUNDING)
    upper = evaluated(found, entries, shape, is_upper=True)
    np.testing.assert_allclose(upper.full(), np.triu(dense), atol=SUM_ROUNDING)
    assert upper.sparsity().is_triu()


def test_places_without_entries_are_not_stored() -> None:
    found = SparseSum()
    found.add(np.array([0, 2]), np.array([1, 1]), np.array([3, 4]))
    matrix = found.matrix(ca.MX.sym("entries", 12), (3, 3))
    assert matrix.sparsity().get_triplet() == ([0, 2], [1, 1])


def test_a_weight_that_is_not_given_is_one() -> None:
    found, entries = SparseSum(), np.arange(12.0)
    found.add(np.array([0, 0]), np.array([0, 1]), np.array([5, 7]))
    assert evaluated(found, ca.DM(entries), (1, 2)).full().tolist() == [[5.0, 7.0]]


@given(seeds)
def test_constants_at_one_place_are_added_up(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, columns, weights = rng.integers(0, 4, 9), rng.integers(0, 3, 9), rng.normal(size=9)
    dense = np.zeros((4, 3))
    np.add.at(dense, (rows, columns), weights)
    found = constant(rows, columns, weights, (4, 3))
    np.testing.assert_allclose(found.full(), dense, atol=SUM_ROUNDING)


PHASES = (Phase(4), Phase(5, rests=True, at_goal=True))
INTERVALS = 9
JOINTS = 7


def random_bounds(rng: np.random.Generator) -> list[LinearBounds]:
    """Those of both phases; some bound nothing, as where nothing is near."""
    bounds = []
    for phase in PHASES:
        numbers = rng.normal(size=(phase.intervals, PAIRS, JOINTS + 1))
        numbers[rng.random((phase.intervals, PAIRS)) < 0.3] = [*np.zeros(JOINTS), REACH_M]
        bounds.append(LinearBounds(rng.normal(size=(phase.intervals, 4)), numbers))
    return bounds


def excesses(
    bounds: list[LinearBounds], known: FloatArray, shortfalls: FloatArray
) -> list[np.float64]:
    """What distances exceed what is needed by, bound by bound."""
    found, interval = [], 0
    for each, controls in zip(bounds, Unknowns.of(PHASES, JOINTS).controls, strict=True):
        for k, numbers in enumerate(each.coefficients):
            q = each.weights[k] @ known[controls[k : k + 4]]
            found += [n[:JOINTS] @ q + n[JOINTS] + shortfalls[interval] for n in numbers if n[0]]
            interval += 1
    return found


@given(st.integers(0, 2**32 - 1))
def test_each_row_is_a_linear_bound_in_the_point_that_the_weights_say_and_the_shortfall(
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    unknowns, bounds = Unknowns.of(PHASES, JOINTS), random_bounds(rng)
    x, q_ends, shortfalls = (rng.normal(size=n) for n in (unknowns.count, 2 * JOINTS, INTERVALS))
    rows = clearance_rows(unknowns, bounds, q_ends)
    found = (rows.matrix @ np.concatenate([x, shortfalls])).full().ravel() - rows.low
    expected = excesses(bounds, np.concatenate([x, q_ends]), shortfalls)
    np.testing.assert_allclose(found, expected, atol=SUM_ROUNDING)


def test_where_nothing_is_near_there_are_no_rows() -> None:
    unknowns = Unknowns.of(PHASES, JOINTS)
    nothing = np.zeros((INTERVALS, PAIRS, JOINTS + 1))
    nothing[:, :, JOINTS] = REACH_M
    bounds = [LinearBounds(np.zeros((INTERVALS, 4)), nothing)]
    rows = clearance_rows(unknowns, bounds, np.zeros(2 * JOINTS))
    assert rows.matrix.shape == (0, unknowns.count + INTERVALS)
    assert rows.shortfalls == INTERVALS
