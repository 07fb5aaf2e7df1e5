"""Approach: the straight line down to a tip pose and up again, passed at speed at its upper end.

A hover point is not stopped at: a joint move ends there with the velocity and acceleration that the
line then goes on with, `v = q' ds/dt` and `a = q'' (ds/dt)^2`. How fast is a choice: slow makes the
line take longer, fast makes the joint move do so. A few speeds are tried. Up is down run backwards.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from baxter_kin import JointLimits
from baxter_kin.arrays import Vector
from baxter_kin.copying import FrozenMapping
from planner.errors import MotionError
from planner.manipulator import Manipulator
from planner.path_timing import plan_path_move
from planner.rest_time import rest_to_rest_s
from planner.straight_path import PathState, StraightPath, plan_straight_path
from planner.timing import plan_joint_move
from planner.trajectory import JointState, Trajectory

SLOW, MEDIUM, FAST = 1.7, 2.3, 2.9
"""Speeds at the upper end, times the fraction of the line a second that a motion from rest to rest
covers on average. The best is at about 2.9 for 5 cm, at 1.5 to 2 for 15 cm, so two are tried, and
the third where these are too fast; all three would save 0.03 % of a cycle."""

SHORT_M = 0.10
"""Lines up to this are passed fast, longer ones slowly."""

SHORTEST_S = 1e-6
"""Lines that take less are passed as if they took so long."""


@dataclass(frozen=True, slots=True, eq=False)
class Approach:
    """The line between a tip pose and the point above it, in one family of configurations.

    Attributes:
        path: from above to the pose.
        descents: motions that end at the pose at rest, by the speed that they begin with, in
            fractions of the line per second; from rest alone where all others are too fast.
    """

    path: StraightPath
    descents: Mapping[float, Trajectory]

    @classmethod
    def of(cls, manipulator: Manipulator, q_target: Vector, T_base_above: pin.SE3) -> Approach:
        """The line from above to where the tip is at a configuration.

        Raises:
            StraightMoveError: when the line leaves the arm's reach or limits on the way up.
        """
        limits = manipulator.limits
        path = plan_straight_path(manipulator.arm, q_target, T_base_above, limits).reversed()
        way = path.at(1.0).q - path.at(0.0).q
        mean = 1.0 / max(float(rest_to_rest_s(way, limits)), SHORTEST_S)
        is_short = path.length_m <= SHORT_M
        descents: dict[float, Trajectory] = {}
        for shares in ((MEDIUM, FAST), (SLOW,)) if is_short else ((SLOW, MEDIUM), (FAST,)):
            planned = {mean * share: _descent(path, limits, mean * share) for share in shares}
            descents |= {speed: found for speed, found in planned.items() if found is not None}
            if descents:
                break
        else:
            descents[0.0] = plan_path_move(path, limits)
        return cls(path, FrozenMapping(descents))

    @property
    def q_above(self) -> Vector:
        """The configuration at the upper end, shape (7,), rad."""
        return self.path.at(0.0).q

    @property
    def q_target(self) -> Vector:
        """The configuration at the pose, shape (7,), rad."""
        return self.path.at(1.0).q

    def state_above(self, speed: float, *, rising: bool = False) -> JointState:
        """The joints' motion at the upper end, down or up the line."""
        q, v, a = self.path.joint_state(PathState(0.0, speed))
        return JointState(q, -v if rising else v, a)


def _descent(path: StraightPath, limits: JointLimits, speed: float) -> Trajectory | None:
    """None when it is too fast to stop in time."""
    try:
        return plan_path_move(path, limits, start=PathState(0.0, speed))
    except MotionError:
        return None


def plan_entry(
    q_start: Vector, approach: Approach, limits: JointLimits
) -> tuple[Trajectory, Trajectory]:
    """The fastest way from rest to an approach and down it: to its upper end, and the descent.

    Raises:
        MotionError: when there is none within the limits.
    """
    rest = JointState(q_start, np.zeros(7), np.zeros(7))
    found = [
        (joined, descent)
        for speed, descent in approach.descents.items()
        if (joined := _joined(rest, approach.state_above(speed), limits)) is not None
    ]
    if not found:
        raise MotionError("no motion to the approach keeps the limits at any speed that was tried")
    return min(found, key=_duration)


def plan_transfer(
    origin: Approach, goal: Approach, limits: JointLimits
) -> tuple[Trajectory, Trajectory, Trajectory]:
    """The fastest way from one pose to another: up, across, down; it stops at neither upper end.

    Raises:
        MotionError: when there is none within the limits.
    """
    found = []
    for rising, up in origin.descents.items():
        leaving = origin.state_above(rising, rising=True)
        for sinking, down in goal.descents.items():
            across = _joined(leaving, goal.state_above(sinking), limits)
            if across is not None:
                found.append((up.reversed(), across, down))
    if not found:
        raise MotionError(
            "no motion between the approaches keeps the limits at any speed that was tried"
        )
    return min(found, key=_duration)


def _joined(start: JointState, goal: JointState, limits: JointLimits) -> Trajectory | None:
    try:
        return plan_joint_move(
            start.q, goal.q, limits, v_start=start.v, a_start=start.a, v_goal=goal.v, a_goal=goal.a
        )
    except MotionError:
        return None


def _duration(parts: tuple[Trajectory, ...]) -> float:
    return sum(part.duration for part in parts)
