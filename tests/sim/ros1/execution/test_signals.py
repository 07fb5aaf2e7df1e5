"""Signals: the first ends an execution in order, the second at once."""

from __future__ import annotations

import os
import signal

import pytest

from sim.ros1.execution.signals import handled
from sim.ros1.execution.stops import StopCause


@pytest.mark.parametrize(
    ("number", "cause"), [(signal.SIGINT, StopCause.SIGINT), (signal.SIGTERM, StopCause.SIGTERM)]
)
def test_the_first_asks_for_a_stop_and_the_second_is_out_at_once(
    number: int, cause: StopCause
) -> None:
    asked: list[StopCause] = []
    with handled() as signals, signals.stopping(asked.append):
        os.kill(os.getpid(), number)
        assert asked == [cause]
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), number)
    assert asked == [cause]
    assert signals.came is cause


def test_without_an_execution_it_is_a_keyboard_interrupt() -> None:
    with handled() as signals, pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGTERM)
    assert signals.came is StopCause.SIGTERM


def test_the_former_handlers_come_back() -> None:
    before = signal.getsignal(signal.SIGINT)
    with handled():
        assert signal.getsignal(signal.SIGINT) is not before
    assert signal.getsignal(signal.SIGINT) is before
