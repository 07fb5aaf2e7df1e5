"""What a motion program is asked for: phases, and the task that they are solved for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from baxter_kin.arrays import Vector
from planner.straight_line import StraightLine


class Phase(NamedTuple):
    """What the arm does between two moments.

    Attributes:
        intervals: of its spline.
        line: which of the lines the tip follows; None where it is free.
        ends: from which fraction of the line to which.
        rests: whether the arm rests at the end.
    """

    intervals: int
    line: int | None = None
    ends: tuple[float, float] = (0.0, 1.0)
    rests: bool = False


class LineTolerance(NamedTuple):
    """How far a tip may be off its line.

    Attributes:
        position_m: from the line.
        rotation_rad: from the orientation that belongs there.
    """

    position_m: float
    rotation_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class MotionTask:
    """What a program is solved for.

    Attributes:
        q_start: where the arm rests at first, shape (7,), rad.
        lines: those of the phases, by their numbers.
        tolerance: of the lines, at the knots: along and about each axis.
        heights_m: the least height of the tip in base, for each phase in which it is free.
    """

    q_start: Vector
    lines: tuple[StraightLine, ...]
    tolerance: LineTolerance
    heights_m: tuple[float, ...]
