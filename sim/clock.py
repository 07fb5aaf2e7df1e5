"""Clock: exact time, and the ticks in it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from baxter_kin.validation import FloatArray, positive_scalar
from sim.errors import SimulationError

DEFAULT_TICK_S = 0.01
"""100 Hz, the rate of the original's commands and of its recorder."""

SHORTEST_TICK_S = 1e-6
"""Shorter ticks only fill memory."""


class Clock:
    """Time that ends anywhere, and ticks at whole multiples of their length.

    Attributes:
        time_s: time since the start.
    """

    def __init__(self, tick_s: float) -> None:
        """At time zero.

        Raises:
            SimulationError: when the tick is not a number or shorter than `SHORTEST_TICK_S`.
        """
        self._tick_s = positive_scalar(tick_s, "tick_s", SimulationError)
        if self._tick_s < SHORTEST_TICK_S:
            raise SimulationError(
                f"tick_s must be at least {SHORTEST_TICK_S:g} s, got {self._tick_s:g}"
            )
        self.time_s = 0.0
        self._next_tick = 0

    @property
    def is_past_tick(self) -> bool:
        """Whether time has passed since the last tick."""
        return self.time_s > (self._next_tick - 1) * self._tick_s

    def ticks_until(self, end_s: float) -> FloatArray:
        """The times of the ticks from now until then, shape (n,), s."""
        return self._tick_s * np.array(self._numbers(end_s), dtype=np.float64)

    def advance(
        self, duration_s: float, update: Callable[[float], None], show: Callable[[], None]
    ) -> None:
        """Let time pass and end exactly at the end.

        Args:
            duration_s: how long.
            update: brings the world to a time since the beginning; called at each tick and at the
                end.
            show: called at each tick after that.
        """
        begin_s = self.time_s
        for tick in self._numbers(begin_s + duration_s):
            self.time_s = tick * self._tick_s
            self._next_tick = tick + 1
            update(self.time_s - begin_s)
            show()
        update(duration_s)
        self.time_s = begin_s + duration_s

    def _numbers(self, end_s: float) -> range:
        return range(self._next_tick, math.floor(end_s / self._tick_s) + 1)
