"""The loop's thread: calls in order, moments, sockets, and faults that end nothing."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator

import pytest

from sim.ros1.transport.network.counts import Tally
from sim.ros1.transport.network.loop import FEW_TIMERS, READ, Loop
from tests.sim.ros1.processes import until


@pytest.fixture
def tally() -> Tally:
    return Tally()


@pytest.fixture
def loop(tally: Tally) -> Iterator[Loop]:
    loop = Loop("test", tally)
    yield loop
    loop.close()


def test_calls_are_made_in_order_in_its_thread(loop: Loop) -> None:
    made: list[tuple[int, bool]] = []
    for number in range(100):
        loop.call(lambda number=number: made.append((number, loop.is_here)))  # type: ignore[misc]
    until(lambda: len(made) == 100)
    assert made == [(number, True) for number in range(100)]
    assert not loop.is_here


def test_a_loop_that_has_ended_refuses_calls(loop: Loop) -> None:
    made: list[int] = []
    assert loop.call(lambda: made.append(1))
    loop.close()
    assert made == [1]
    assert not loop.call(lambda: made.append(2))


def test_moments_come_in_their_order_and_not_before(loop: Loop) -> None:
    came: list[tuple[str, float]] = []
    began_s = time.monotonic()
    loop.later(0.04, lambda: came.append(("second", time.monotonic())))
    loop.later(0.02, lambda: came.append(("first", time.monotonic())))
    until(lambda: len(came) == 2)
    assert [name for name, _ in came] == ["first", "second"]
    assert came[0][1] >= began_s + 0.02
    assert came[1][1] >= began_s + 0.04


def test_a_timer_that_is_cancelled_is_not_called(loop: Loop) -> None:
    came: list[str] = []
    timer = loop.later(0.01, lambda: came.append("cancelled"))
    timer.cancel()
    loop.later(0.03, lambda: came.append("kept"))
    until(lambda: came)
    assert came == ["kept"]


def test_timers_that_are_cancelled_are_forgotten(loop: Loop) -> None:
    for _ in range(10 * FEW_TIMERS):
        loop.later(1000.0, lambda: None).cancel()
    done = threading.Event()
    loop.call(done.set)
    assert done.wait(20.0)
    assert len(loop._timers) <= FEW_TIMERS


def test_a_fault_is_counted_and_the_next_call_is_made(
    loop: Loop, tally: Tally, caplog: pytest.LogCaptureFixture
) -> None:
    came: list[int] = []

    def fail() -> None:
        raise ZeroDivisionError

    loop.call(fail)
    loop.call(lambda: came.append(1))
    until(lambda: came)
    assert tally.counts.faults == 1
    assert "ZeroDivisionError" in caplog.text


def test_a_socket_is_watched_until_it_is_forgotten(loop: Loop) -> None:
    ours, theirs = socket.socketpair()
    read: list[bytes] = []
    with ours, theirs:
        loop.call(lambda: loop.watch(ours, READ, lambda _: read.append(ours.recv(10))))
        theirs.send(b"a")
        until(lambda: read == [b"a"])
        loop.call(lambda: loop.forget(ours))
        loop.call(lambda: loop.forget(ours))
        done = threading.Event()
        loop.call(done.set)
        assert done.wait(20.0)
        theirs.send(b"b")
        assert ours.recv(10) == b"b"
    assert read == [b"a"]


def test_what_was_called_before_the_end_is_done(tally: Tally) -> None:
    made: list[int] = []
    loop = Loop("test", tally)
    for number in range(10):
        loop.call(lambda number=number: made.append(number))  # type: ignore[misc]
    loop.close()
    loop.close()
    assert made == list(range(10))
    assert repr(loop) == "Loop(test, ended)"
