"""Lines in the motion program: kept at knots, so that they are kept between them as well."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from baxter_kin.kinematics.arm import Arm
from planner.motion.straight_line import STRICT, LineTolerance, StraightLine
from planner.trajectory import Trajectory

INTERVAL_M, INTERVAL_RAD = 0.011, 0.05
"""How far the tip goes and turns in an interval of a line on average, at most, lest it leaves the
line in between."""

LOOKS, SHARE = 4, 0.9
"""How often the tip is looked at in an interval, and the share of a tolerance that it may be off
there, for what is between two looks."""

BETWEEN = np.array([0.55 * 1e-4, 0.65 * math.radians(0.02)])
"""What is left of a tolerance for what is between two knots, m and rad, but not more than these
shares of it."""

TINY = 1e-7
"""Tolerances at knots, m, are no less, and turns, rad, count as no less."""


def is_on_line(arm: Arm, line: StraightLine, motion: Trajectory, tolerance: LineTolerance) -> bool:
    """Whether the tip keeps to a line, looked at between the knots too."""
    looks = np.linspace(0.0, motion.duration, LOOKS * (len(motion.knots_s) - 1) + 1)
    off_m, off_rad = line.off(arm.T_base_tips(motion.sample(looks).q))
    is_near = (off_m <= SHARE * tolerance.position_m) & (off_rad <= SHARE * tolerance.rotation_rad)
    return bool(is_near.all())


def at_knots(tolerance: LineTolerance, lines: Sequence[StraightLine] = ()) -> tuple[float, float]:
    """How far the tip may be off lines at knots, along and about each axis, m and rad.

    Less where a tip that is ahead of its turn on the line would be turned by more.
    """
    most = SHARE * np.array([tolerance.position_m, tolerance.rotation_rad])
    between = np.minimum(BETWEEN, 0.65 * most / SHARE)
    position_m, rotation_rad = ((most - between) / math.sqrt(3.0)).tolist()
    for line in lines:
        position_m = min(position_m, rotation_rad * line.length_m / max(line.angle_rad, TINY))
    return max(position_m, TINY), rotation_rad


def intervals_on(line: StraightLine, tolerance: LineTolerance, fewest: int) -> int:
    """How many a line has, so many at least; in steps, so that there are few programs.

    What a spline leaves between knots goes with the fourth power of their distance.
    """
    needed = max(line.length_m / INTERVAL_M, line.angle_rad / INTERVAL_RAD, fewest)
    tighter = (
        STRICT.position_m / tolerance.position_m,
        STRICT.rotation_rad / tolerance.rotation_rad,
    )
    needed *= math.sqrt(math.sqrt(max(1.0, *tighter)))
    step = 2 if needed <= 20 else 10
    return step * math.ceil(needed / step)
