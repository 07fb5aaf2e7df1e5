"""Rows of clearance, against their bounds where the spline is."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.validation import FloatArray
from planner.collision.obstacles import PAIRS, REACH_M, LinearBounds
from planner.motion.program.clearance_rows import clearance_rows
from planner.motion.program.phases import Phase
from planner.motion.program.unknowns import Unknowns

ROUNDING = 1e-12

PHASES = (Phase(4), Phase(5, rests=True, at_goal=True))
INTERVALS = 9
JOINTS = 7


def random_bounds(rng: np.random.Generator) -> list[LinearBounds]:
    """Those of both phases; some bound nothing, as where nothing is near."""
    bounds = []
    for phase in PHASES:
        numbers = rng.normal(size=(phase.intervals, PAIRS, JOINTS + 1))
        numbers[rng.random((phase.intervals, PAIRS)) < 0.3] = [*np.zeros(JOINTS), REACH_M]
        bounds.append(LinearBounds(rng.normal(size=(phase.intervals, 4)), numbers, 0.0))
    return bounds


def excesses(
    bounds: list[LinearBounds], known: FloatArray, shortfalls: FloatArray
) -> list[np.float64]:
    """What distances exceed what is needed by, bound by bound."""
    found, interval = [], 0
    for each, controls in zip(bounds, Unknowns.of(PHASES, JOINTS).controls, strict=True):
        for k, numbers in enumerate(each.numbers):
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
    np.testing.assert_allclose(found, expected, atol=ROUNDING)


def test_where_nothing_is_near_there_are_no_rows() -> None:
    unknowns = Unknowns.of(PHASES, JOINTS)
    nothing = np.zeros((INTERVALS, PAIRS, JOINTS + 1))
    nothing[:, :, JOINTS] = REACH_M
    bounds = [LinearBounds(np.zeros((INTERVALS, 4)), nothing, REACH_M)]
    rows = clearance_rows(unknowns, bounds, np.zeros(2 * JOINTS))
    assert rows.matrix.shape == (0, unknowns.count + INTERVALS)
    assert rows.shortfalls == INTERVALS
