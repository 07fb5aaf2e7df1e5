"""Guesses of the joint program: which arm waits for the other, and when."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from planner import TwoArmPlan
from planner.motion.free_search import cheapest_way
from planner.motion.paths.straight_line import DEFAULT_TOLERANCE
from planner.splines import Sketch
from planner.two_arms.coordination import STEP_S, Coordination
from planner.two_arms.pair import PairSearch
from planner.two_arms.problem import Problem, Requirements
from planner.two_arms.program import Timed
from planner.two_arms.together import DEFAULT_GRIP_S
from tests.planner.two_arms.pairs import PairOfTasks

Costs = np.ndarray


def least_cost(costs: Costs, first: Costs, second: Costs) -> float:
    """The smallest cost of a way to the last place, by trying all ways."""

    @cache
    def cost_from(i: int, j: int) -> float:
        rest = [
            more + cost_from(i + a, j + b)
            for a, b, more in ((1, 1, 0.0), (0, 1, first[i]), (1, 0, second[j]))
            if i + a < costs.shape[0] and j + b < costs.shape[1]
        ]
        return float(costs[i, j]) + (min(rest) if rest else 0.0)

    return cost_from(0, 0)


sizes = st.tuples(st.integers(1, 6), st.integers(1, 6))


@given(data=st.data(), size=sizes)
def test_no_way_through_a_grid_is_cheaper(data: st.DataObject, size: tuple[int, int]) -> None:
    values = st.floats(0.0, 9.0)
    costs = data.draw(arrays(float, size, elements=values))
    first, second = (data.draw(arrays(float, n, elements=values)) for n in size)
    way = cheapest_way(costs, (first, second))
    assert way is not None
    steps = np.diff(way, axis=0)
    assert way[0].tolist() == [0, 0]
    assert (way[-1] + 1 == size).all()
    assert ((steps >= 0) & (steps <= 1)).all()
    assert steps.any(axis=1).all()
    staying = first[way[:-1, 0]] @ (steps[:, 0] == 0) + second[way[:-1, 1]] @ (steps[:, 1] == 0)
    cost = costs[tuple(way.T)].sum() + staying
    assert cost == pytest.approx(least_cost(costs, first, second))


def test_a_way_never_leads_where_there_is_none() -> None:
    costs = np.ones((3, 3))
    costs[1] = np.inf
    assert cheapest_way(costs) is None


@pytest.fixture(scope="module")
def coordination(crossing: PairOfTasks) -> Coordination:
    """The grid of two cycles whose ways cross."""
    handled = {side: frozenset({task.body}) for side, task in crossing.tasks.items()}
    requirements = Requirements(0.0, DEFAULT_GRIP_S, DEFAULT_TOLERANCE)
    problem = Problem(crossing.manipulators, crossing.state, handled, requirements)
    (variant,) = PairSearch(problem, crossing.tasks)._variants()
    return Coordination.of(variant.program, variant.own)


def blocked(coordination: Coordination, *blocks: tuple[slice, slice]) -> Coordination:
    """The same cycles; a metre is missing in some blocks of the grid, and nothing elsewhere."""
    missing_m = np.zeros_like(coordination.missing_m)
    for block in blocks:
        missing_m[block] = 1.0
    return replace(coordination, missing_m=missing_m)


def places(coordination: Coordination, timed: Sequence[Timed]) -> np.ndarray:
    """The steps of both cycles at which the arms are, at some times of the clock, shape (m, 2)."""
    program = coordination.program
    end_s = max(clock.end_s for clock in program.clocks(timed))
    times = np.arange(0.0, end_s, STEP_S / 3)
    found = []
    for clock, own, size in zip(
        program.clocks(timed),
        program.clocks(coordination.own),
        coordination.missing_m.shape,
        strict=True,
    ):
        steps_s = STEP_S * np.arange(size)
        apart = np.linalg.norm(clock.states(times)[0][:, None] - own.states(steps_s)[0], axis=2)
        apart[clock.at(times)[0][:, None] != own.at(steps_s)[0]] = np.inf  # of another phase
        assert apart.min(axis=1).max() < 0.2  # on its own way, between two steps
        found.append(apart.argmin(axis=1))
    return np.array(found).T


def test_without_anything_between_them_both_cycles_are_the_own_ones(
    coordination: Coordination,
) -> None:
    """The shorter one may wait for as long as the other takes longer."""
    guess = blocked(coordination).guess()
    clocks, own_clocks = map(coordination.program.clocks, (guess.timed, coordination.own))
    ends_s, own_s = ([clock.end_s for clock in each] for each in (clocks, own_clocks))
    assert max(ends_s) == pytest.approx(max(own_s), abs=STEP_S)
    for timed, own in zip(guess.timed, coordination.own, strict=True):
        for sketch, before in zip(timed.sketches, own.sketches, strict=True):
            assert sketch.duration_s == pytest.approx(before.duration_s)
            np.testing.assert_allclose(sketch.q, before.q, atol=1e-2)


@pytest.mark.parametrize("number", [0, 1])
def test_an_arm_waits_at_its_start_for_the_other_one(
    coordination: Coordination, number: int
) -> None:
    """It may move only when the other one is done."""
    block = [slice(None, -1), slice(None, -1)]
    block[number] = slice(10, None)
    guess = blocked(coordination, (block[0], block[1])).guess()
    own_s = coordination.program.clocks(coordination.own)[1 - number].end_s
    assert guess.timed[number].waits_s.sum() >= own_s - 1.5
    assert guess.timed[1 - number].waits_s.max() < 1e-9


@pytest.mark.parametrize("first", [20, 30, 40])
def test_a_guess_keeps_out_of_what_is_blocked(coordination: Coordination, first: int) -> None:
    guess = blocked(coordination, (slice(first, first + 12), slice(20, 36))).guess()
    i, j = places(coordination, guess.timed).T
    assert not ((i > first) & (i < first + 11) & (j > 20) & (j < 35)).any()


def test_delays_look_clear_and_the_shortest_is_the_first(coordination: Coordination) -> None:
    i, j = np.indices(coordination.missing_m.shape)
    meet = (abs(i - j) < 6) & (i > 15) & (j > 15) & (i < 40) & (j < 40)
    met = replace(coordination, missing_m=meet.astype(float))
    found = met.delayed()
    assert [guess.cost_s for guess in found] == sorted(guess.cost_s for guess in found)
    left, right = (timed.waits_s.sum() for timed in found[0].timed)
    assert max(left, right) == pytest.approx(6 * STEP_S)
    assert min(left, right) == 0.0


def test_motions_of_both_arms_take_little_longer_than_the_slower_one(
    crossing_plan: TwoArmPlan, coordination: Coordination
) -> None:
    own_s = max(clock.end_s for clock in coordination.program.clocks(coordination.own))
    assert own_s - 1e-2 < crossing_plan.duration_s < 1.4 * own_s


def test_a_sketch_between_two_has_controls_between_theirs() -> None:
    rng = np.random.default_rng(3)
    first, second = (
        Sketch(rng.normal(size=(6, 7)), rng.normal(size=(2, 7)), duration_s)
        for duration_s in (1.0, 2.5)
    )
    between = first.towards(second, 0.25)
    np.testing.assert_allclose(between.controls, 0.75 * first.controls + 0.25 * second.controls)
    assert between.duration_s == pytest.approx(1.375)
