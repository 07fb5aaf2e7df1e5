"""Ticks: when set-points are sent, and how far plan time has come by then.

The schedule is a grid on the monotonic clock. A tick that comes late is not made up by a burst: the
next one is the next of the grid that has not passed. Plan time follows the clock, but by two ticks
at most from one set-point to the next, and where a tick is later than `LATEST_S`, by one: it stood
still meanwhile. So a machine that was busy makes the arm late, and never jump.
"""

from __future__ import annotations

import math

from baxter_kin.validation import positive_scalar
from planner.motion.response import TICK_S
from sim.errors import SimulationError

LATEST_S = 0.02
"""A tick later than this lets plan time stand still."""

LONGEST_STEP_TICKS = 2.0


class Schedule:
    """A grid of ticks, from a time on.

    Attributes:
        lateness_s: how late the last tick was.
    """

    def __init__(self, now_s: float, tick_s: float = TICK_S) -> None:
        """The first tick is now."""
        self._tick_s = positive_scalar(tick_s, "tick_s", SimulationError)
        self._begin_s, self._due_s = now_s, now_s
        self.lateness_s = 0.0

    @property
    def due_s(self) -> float:
        """When the next tick is due, on the clock."""
        return self._due_s

    def came(self, now_s: float) -> float:
        """The next tick has come, early by rounding at most; returns how late."""
        self.lateness_s = max(0.0, now_s - self._due_s)
        number = math.floor((max(now_s, self._due_s) - self._begin_s) / self._tick_s + 1e-9) + 1
        self._due_s = self._begin_s + number * self._tick_s
        return self.lateness_s


class PlanTime:
    """How far plan time has come, in time as it passes for the arm.

    Attributes:
        passed_s: so far; times the speed that is plan time.
    """

    def __init__(self, now_s: float, tick_s: float = TICK_S) -> None:
        """At zero."""
        self._tick_s, self._last_s, self.passed_s = tick_s, now_s, 0.0

    def advance(self, now_s: float) -> float:
        """Go on to the tick that has come; returns how far plan time has come by then."""
        gone_s = max(0.0, now_s - self._last_s)
        self._last_s = max(now_s, self._last_s)
        if gone_s > self._tick_s + LATEST_S:
            gone_s = self._tick_s
        self.passed_s += min(gone_s, LONGEST_STEP_TICKS * self._tick_s)
        return self.passed_s
