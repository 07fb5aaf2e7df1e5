"""Rows of clearance, against their bounds where the spline is."""

from __future__ import annotations

import casadi as ca
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from planner.collision.obstacles import JOINTS, PAIRS
from planner.motion.program.clearance_rows import clearance_rows
from planner.motion.program.phases import Phase
from planner.motion.program.unknowns import Numbers, Unknowns

ROUNDING = 1e-12

PHASES = (Phase(4), Phase(5, rests=True, at_goal=True))
INTERVALS = 9


@given(st.integers(0, 2**32 - 1))
def test_each_row_is_a_linear_bound_in_the_point_that_the_weights_say_and_the_shortfall(
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    unknowns, numbers = Unknowns.of(PHASES, keeps_clear=True), Numbers(PHASES, INTERVALS)
    x = ca.MX.sym("x", unknowns.count)
    rows = clearance_rows(PHASES, unknowns, x, numbers)
    assert rows is not None
    at, given_ = rng.normal(size=unknowns.count), rng.normal(size=numbers.all.shape[0])
    asked = [rows.g, numbers.q_ends, numbers.weights, numbers.clearances]
    values = ca.Function("values", [x, numbers.all], asked).call([at, given_])
    found, q_ends, weights, clearances = (each.full() for each in values)
    known = np.concatenate([at, q_ends.ravel()])
    expected, interval = [], 0
    for controls in unknowns.controls:
        for k in range(len(controls) - 3):
            q = weights[:, interval] @ known[controls[k : k + 4]]
            for bound in clearances.T[PAIRS * interval : PAIRS * (interval + 1)]:
                excess = bound[:JOINTS] @ q + bound[JOINTS]
                expected.append(excess + at[unknowns.shortfalls[interval]])
            interval += 1
    np.testing.assert_allclose(found.ravel(), expected, atol=ROUNDING)


def test_distances_may_exceed_what_is_needed_by_any_amount_but_not_fall_short() -> None:
    unknowns, numbers = Unknowns.of(PHASES, keeps_clear=True), Numbers(PHASES, INTERVALS)
    rows = clearance_rows(PHASES, unknowns, ca.MX.sym("x", unknowns.count), numbers)
    assert rows is not None
    assert len(rows.low) == len(rows.high) == INTERVALS * PAIRS
    assert not rows.low.any()
    assert np.isinf(rows.high).all()


def test_there_are_none_where_clearance_is_not_asked_for() -> None:
    unknowns = Unknowns.of(PHASES)
    assert clearance_rows(PHASES, unknowns, ca.MX.sym("x", unknowns.count), Numbers(PHASES)) is None
