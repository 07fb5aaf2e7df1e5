"""Clock: ticks at whole multiples, ends anywhere."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.clock import Clock

TIME_S = 1e-9
"""Sums of some durations below 10 s."""


def passed(clock: Clock, *durations_s: float) -> list[float]:
    """The times that were shown while time passed in pieces."""
    shown: list[float] = []
    for duration_s in durations_s:
        clock.advance(duration_s, lambda _: None, lambda: shown.append(clock.time_s))
    return shown


@given(st.lists(st.floats(0.0, 1.0), max_size=8), st.floats(0.001, 0.5))
def test_every_tick_comes_once_at_its_multiple(pieces: list[float], tick_s: float) -> None:
    clock = Clock(tick_s)
    shown = passed(clock, *pieces)
    assert shown == [number * tick_s for number in range(len(shown))]
    assert clock.time_s == pytest.approx(sum(pieces), abs=TIME_S)


def test_the_world_is_brought_to_each_tick_before_it_is_shown_and_to_the_end() -> None:
    told: list[float | str] = []
    Clock(0.1).advance(0.25, told.append, lambda: told.append("shown"))
    assert told == [0.0, "shown", 0.1, "shown", 0.2, "shown", 0.25]


def test_the_ticks_to_come_are_those_that_will_be_shown() -> None:
    clock = Clock(0.1)
    passed(clock, 0.25)
    coming = clock.ticks_until(0.55).tolist()
    assert passed(clock, 0.3) == coming == pytest.approx([0.3, 0.4, 0.5], abs=TIME_S)


def test_it_knows_whether_it_stands_between_ticks() -> None:
    clock = Clock(0.1)
    passed(clock, 0.0)
    assert not clock.is_past_tick
    passed(clock, 0.05)
    assert clock.is_past_tick
