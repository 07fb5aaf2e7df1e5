"""Virtual time: it passes only while an executor sleeps, and then the robot ticks.

Whatever the load of the computer, tests see the same set-points at the same times.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from sim.ros1.execution import channel, execution, link
from sim.ros1.execution.readiness import robot

TICK_S = 0.01


class VirtualTime:
    """In place of the module `time`.

    Attributes:
        now_s: the time.
        on_tick: called at every tick.
    """

    def __init__(self) -> None:
        self.now_s = self._due_s = 1000.0
        self.on_tick: list[Callable[[], object]] = []

    def monotonic(self) -> float:
        return self.now_s

    def time(self) -> float:
        return self.now_s

    def sleep(self, duration_s: float) -> None:
        end_s = self.now_s + duration_s
        while self._due_s <= end_s:
            self.now_s = max(self.now_s, self._due_s)
            self._due_s += TICK_S
            for tick in list(self.on_tick):
                tick()
        self.now_s = max(self.now_s, end_s)  # what is called may take a while


@contextmanager
def virtual_time() -> Iterator[VirtualTime]:
    """Let executors live in virtual time inside the block."""
    clock = VirtualTime()
    with pytest.MonkeyPatch.context() as patch:
        for module in (channel, execution, link, robot):
            assert module.time is time
            patch.setattr(module, "time", clock)
        yield clock
