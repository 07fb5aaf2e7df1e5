"""What a motion program is asked for: phases, and the task that they are solved for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from baxter_kin.validation import FloatArray
from planner.motion.straight_line import StraightLine


class Phase(NamedTuple):
    """What the arm does between two moments.

    Attributes:
        intervals: of its spline.
        line: which of the lines the tip follows; None where it is free.
        ends: from which fraction of the line to which.
        rests: whether the arm rests at the end.
        at_goal: whether it rests there at the configuration that is given; its height on the way
            does not matter then.
        enters: whether the tip has a speed along its line at the start, which is given; for the
            first phase.
        leaves: the same at the end; for the last phase.
    """

    intervals: int
    line: int | None = None
    ends: tuple[float, float] = (0.0, 1.0)
    rests: bool = False
    at_goal: bool = False
    enters: bool = False
    leaves: bool = False

    @property
    def keeps_height(self) -> bool:
        """Whether its tip stays above a height."""
        return self.line is None and not self.at_goal


@dataclass(frozen=True, slots=True, eq=False)
class MotionTask:
    """What a program is solved for.

    Attributes:
        q_start: where the arm is at first, shape (7,), rad.
        lines: those of the phases, by their numbers.
        tolerance: of the lines, at the knots, along and about each axis, m and rad.
        heights_m: the least height of the tip in base, for each phase that keeps one.
        q_goal: where the arm rests at last, if that is given, shape (7,), rad.
        rates: of the fraction of the line, by time, where it is entered and left at speed: first
            and second derivative there, then here.
    """

    q_start: FloatArray
    lines: tuple[StraightLine, ...] = ()
    tolerance: tuple[float, float] = (1.0, 1.0)
    heights_m: tuple[float, ...] = ()
    q_goal: FloatArray | None = None
    rates: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
