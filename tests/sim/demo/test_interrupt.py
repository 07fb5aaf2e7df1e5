"""Ctrl-C is raised, put off or remembered, but never lost, and never left to others."""

from __future__ import annotations

import contextlib
import signal
import threading

import pytest

from sim.demo import Interrupt, interruptible


def press_ctrl_c() -> None:
    signal.raise_signal(signal.SIGINT)


def test_ctrl_c_interrupts_at_once() -> None:
    with interruptible() as interrupt:
        with pytest.raises(KeyboardInterrupt):
            press_ctrl_c()
        assert interrupt.is_requested


def test_while_it_is_deferred_work_goes_on_to_its_end() -> None:
    done: list[str] = []

    def work() -> None:
        with interrupt.deferred():
            press_ctrl_c()
            done.append("all")

    with interruptible() as interrupt, pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["all"]


def test_what_was_swallowed_is_raised_at_the_next_check() -> None:
    with interruptible() as interrupt:
        with contextlib.suppress(KeyboardInterrupt):  # as a compiled library may do
            press_ctrl_c()
        for _ in range(2):
            with pytest.raises(KeyboardInterrupt):
                interrupt.check()


def test_a_second_ctrl_c_does_not_disturb_the_cleaning_up() -> None:
    before = signal.getsignal(signal.SIGINT)
    with interruptible():
        assert signal.getsignal(signal.SIGINT) is not before
        with pytest.raises(KeyboardInterrupt):
            press_ctrl_c()
        press_ctrl_c()
    assert signal.getsignal(signal.SIGINT) is before


def test_deferring_ends_even_when_the_work_fails() -> None:
    with interruptible() as interrupt:
        with interrupt.deferred():
            interrupt.check()
        with pytest.raises(ZeroDivisionError), interrupt.deferred():
            raise ZeroDivisionError
        with pytest.raises(KeyboardInterrupt):
            press_ctrl_c()


def test_in_another_thread_signals_are_left_alone() -> None:
    before, found = signal.getsignal(signal.SIGINT), []

    def work() -> None:
        with interruptible() as interrupt:
            interrupt.check()
            found.append((interrupt, signal.getsignal(signal.SIGINT)))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    ((interrupt, during),) = found
    assert isinstance(interrupt, Interrupt)
    assert during is before
