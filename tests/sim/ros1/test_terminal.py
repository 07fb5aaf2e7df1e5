"""Signals of the commands: the first one requests a stop, the second is raised."""

from __future__ import annotations

import os
import signal

import pytest

from sim.ros1.terminal import Signals


@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)], ids=["SIGINT", "SIGTERM"]
)
def test_the_first_requests_a_stop_and_the_second_is_raised(number: int, status: int) -> None:
    requested: list[str] = []
    with Signals().installed() as signals, signals.stopping(requested.append):
        os.kill(os.getpid(), number)
        assert requested == [signal.Signals(number).name]
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), number)
    assert len(requested) == 1
    assert signals.status() == status


def test_all_after_the_first_can_be_ignored() -> None:
    requested: list[str] = []
    with Signals(ignores_more=True).installed() as signals:
        with signals.stopping(requested.append):
            for number in (signal.SIGTERM, signal.SIGINT):
                os.kill(os.getpid(), number)
        os.kill(os.getpid(), signal.SIGINT)
    assert requested == ["SIGTERM"]


def test_outside_of_stopping_it_is_a_keyboard_interrupt_and_the_former_handlers_come_back() -> None:
    before = signal.getsignal(signal.SIGINT)
    with Signals().installed() as signals:
        assert signal.getsignal(signal.SIGINT) is not before
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGTERM)
    assert signals.received is signal.SIGTERM
    assert signal.getsignal(signal.SIGINT) is before
