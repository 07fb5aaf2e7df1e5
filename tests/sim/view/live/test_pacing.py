"""Simulated time passes as real time does, at the speed that was asked for, or not at all."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest

from sim.view.live import pacing as module
from sim.view.live.pacing import MAX_LATENESS_S, MIN_PAUSE_S, SPEEDS, Pacing

TICK_S = 0.01


class Clock:
    """Time that passes only when somebody sleeps or works."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.while_asleep: Callable[[], None] = lambda: None

    def perf_counter(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds
        self.while_asleep()


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(module, "time", clock)
    monkeypatch.setattr(Pacing, "_sleep", lambda _, seconds: clock.sleep(seconds))
    return clock


@pytest.fixture
def pacing() -> Pacing:
    return Pacing()


def pass_ticks(pacing: Pacing, first: int, last: int) -> None:
    for tick in range(first, last + 1):
        pacing.wait_for(tick * TICK_S)


def test_a_second_takes_a_second(pacing: Pacing, clock: Clock) -> None:
    begin = clock.now_s
    pass_ticks(pacing, 0, 100)
    assert clock.now_s - begin == pytest.approx(1.0)


@pytest.mark.parametrize("speed", [SPEEDS[0], 0.5, SPEEDS[1]])
def test_a_second_takes_longer_at_a_slower_speed(
    pacing: Pacing, clock: Clock, speed: float
) -> None:
    pacing.change_speed(speed)
    begin = clock.now_s
    pass_ticks(pacing, 0, 100)
    assert clock.now_s - begin == pytest.approx(1.0 / speed)


def test_a_new_speed_counts_from_the_last_snapshot_on(pacing: Pacing, clock: Clock) -> None:
    begin = clock.now_s
    pass_ticks(pacing, 0, 50)
    pacing.change_speed(0.1)
    pass_ticks(pacing, 51, 51)
    assert clock.now_s - begin == pytest.approx(0.5 + 10 * TICK_S)
    pacing.change_speed(1.0)
    pass_ticks(pacing, 52, 101)
    assert clock.now_s - begin == pytest.approx(0.5 + 10 * TICK_S + 0.5)


def test_a_new_speed_applies_to_a_snapshot_that_waits(pacing: Pacing, clock: Clock) -> None:
    pacing.wait_for(0.0)
    pacing.change_speed(0.1)
    clock.while_asleep = lambda: pacing.change_speed(4.0)
    begin = clock.now_s
    pacing.wait_for(1.0)
    assert clock.now_s - begin < 1.0


def test_what_is_late_is_caught_up_with(pacing: Pacing, clock: Clock) -> None:
    begin = clock.now_s
    for tick in range(101):
        pacing.wait_for(tick * TICK_S)
        clock.now_s += 0.5 * MAX_LATENESS_S if tick == 10 else 0.0
    assert clock.now_s - begin == pytest.approx(1.0)


def test_after_planning_nothing_rushes(pacing: Pacing, clock: Clock) -> None:
    pacing.wait_for(0.0)
    clock.now_s += 3 * MIN_PAUSE_S
    pacing.stand_still()
    pacing.wait_for(TICK_S)
    before = clock.now_s
    pacing.wait_for(2 * TICK_S)
    assert clock.now_s - before == pytest.approx(TICK_S)


def test_after_a_long_time_nothing_rushes(pacing: Pacing, clock: Clock) -> None:
    pacing.wait_for(0.0)
    clock.now_s += 2 * MAX_LATENESS_S
    pacing.wait_for(TICK_S)
    before = clock.now_s
    pacing.wait_for(2 * TICK_S)
    assert clock.now_s - before == pytest.approx(TICK_S)


def test_a_pause_lasts_until_it_is_ended_and_nothing_rushes_then(
    pacing: Pacing, clock: Clock
) -> None:
    pass_ticks(pacing, 0, 10)
    pacing.pause(True)
    begin = clock.now_s
    clock.while_asleep = lambda: pacing.pause(clock.now_s < begin + 60.0)
    pacing.wait_for(11 * TICK_S)
    ended = clock.now_s
    assert 60.0 <= ended - begin < 61.0
    pass_ticks(pacing, 12, 111)
    assert clock.now_s - ended == pytest.approx(1.0)


def test_a_simulation_that_begins_does_not_wait_for_its_first_snapshot(
    pacing: Pacing, clock: Clock
) -> None:
    pass_ticks(pacing, 0, 100)
    pacing.begin()
    before = clock.now_s
    pacing.wait_for(50.0)
    assert clock.now_s == before


def test_another_thread_ends_a_pause_at_once(pacing: Pacing) -> None:
    pacing.pause(True)
    waiting = threading.Thread(target=pacing.wait_for, args=(0.0,))
    waiting.start()
    assert waiting.is_alive()
    pacing.pause(False)
    waiting.join(60.0)
    assert not waiting.is_alive()
