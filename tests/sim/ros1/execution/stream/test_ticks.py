"""Ticks: a grid without bursts, and plan time that never jumps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.ros1.execution.stream.ticks import PlanTime, Schedule

TICK_S = 0.01
DELAYS_S = st.lists(st.floats(0.0, 0.3), min_size=1, max_size=60)
ROUNDING_S = 1e-9


def driven(delays_s: list[float], begin_s: float = 100.0) -> tuple[list[float], list[float]]:
    """When ticks come that are each late by so much, and how far plan time has come at each."""
    schedule, clock = Schedule(begin_s, TICK_S), PlanTime(begin_s, TICK_S)
    came, passed = [], []
    now_s = begin_s
    for delay_s in delays_s:
        now_s = max(now_s, schedule.due_s) + delay_s
        schedule.came(now_s)
        came.append(now_s)
        passed.append(clock.advance(now_s))
    return came, passed


@given(DELAYS_S)
def test_plan_time_neither_jumps_nor_overtakes_the_clock(delays_s: list[float]) -> None:
    came, passed = driven(delays_s)
    steps = np.diff([0.0, *passed])
    gone = np.diff([100.0, *came])
    assert (steps >= 0.0).all()
    assert (steps <= np.minimum(gone, 2 * TICK_S) + ROUNDING_S).all()


@given(DELAYS_S)
def test_a_late_tick_is_not_made_up_by_a_burst(delays_s: list[float]) -> None:
    schedule, now_s = Schedule(0.0, TICK_S), 0.0
    slots = []
    for delay_s in delays_s:
        slots.append(round(schedule.due_s / TICK_S))
        assert schedule.due_s == pytest.approx(slots[-1] * TICK_S)
        now_s = max(now_s, schedule.due_s) + delay_s
        assert schedule.came(now_s) == pytest.approx(now_s - slots[-1] * TICK_S)
        assert schedule.due_s > now_s - ROUNDING_S  # the next one is not due already
    assert len(set(slots)) == len(slots)


def test_plan_time_is_the_clock_where_nothing_is_late() -> None:
    _, passed = driven([0.0] * 101)
    assert passed[-1] == pytest.approx(1.0)


def test_a_tick_of_more_than_20_ms_late_lets_plan_time_stand_still() -> None:
    _, passed = driven([0.0, 0.13])
    assert passed == pytest.approx([0.0, TICK_S])


def test_a_tick_of_15_ms_late_is_caught_up_with_by_two_ticks_at_most() -> None:
    _, passed = driven([0.0, 0.015])
    assert passed == pytest.approx([0.0, 2 * TICK_S])
