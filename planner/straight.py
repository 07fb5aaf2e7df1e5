"""Straight-line tip motion, timed to the joints' own limits.

A straight move is a `StraightPath`, the configurations along the line, and a `plan_path_move`, the
fastest motion along them. This module joins both; callers who want to pass a point of the line at
speed, or to time one path several times, use the two themselves.
"""

from __future__ import annotations

from numpy.typing import ArrayLike

from baxter_kin import Arm, JointLimits
from baxter_kin.arrays import finite_scalar
from baxter_kin.frames import PoseLike
from planner.errors import MotionError
from planner.path_timing import plan_path_move
from planner.straight_path import PathState, StraightPath, plan_straight_path
from planner.trajectory import Trajectory


def plan_straight_move(
    arm: Arm,
    q_start: ArrayLike,
    T_base_goal: PoseLike,
    limits: JointLimits,
    *,
    speed_start_m_s: float = 0.0,
    acceleration_start_m_s2: float = 0.0,
    speed_end_m_s: float = 0.0,
    acceleration_end_m_s2: float = 0.0,
) -> Trajectory:
    """The fastest motion that takes the tip along a straight line; from rest to rest by default.

    The tip's position stays on the line between its pose at `q_start` and `T_base_goal`, its
    orientation on the shortest rotation between both, at the same fraction of the way: within
    0.1 mm and 0.02 deg, in fact some micrometres. The joints move as little as the line asks of
    them, and no IK branch is jumped. Where the line is shorter than `straight_line.LEAST_LENGTH`
    (m and rad together), the motion has no duration.

    Args:
        arm: whose tip moves.
        q_start: where the arm stands, shape (7,), rad, inside the limits.
        T_base_goal: where the tip ends, seen from base; less than half a turn away.
        limits: of the arm's joints.
        speed_start_m_s: of the tip along the line, where the motion starts; not negative.
        acceleration_start_m_s2: of the tip along the line, there.
        speed_end_m_s: the same where it ends.
        acceleration_end_m_s2: the same.

    Raises:
        ConfigurationError: when `q_start` has another shape, is not finite or outside the limits.
        PoseError: when `T_base_goal` is no pose.
        StraightMoveError: when the line leaves the arm's reach, crosses a singularity, leads a
            joint to a limit, or turns by half a turn; with the fraction of it that is possible.
        MotionError: when the limits are of other joints, or the ends are too fast.
    """
    path = plan_straight_path(arm, q_start, T_base_goal, limits)
    start = _state(path, 0.0, "start", speed_start_m_s, acceleration_start_m_s2)
    end = _state(path, 1.0, "end", speed_end_m_s, acceleration_end_m_s2)
    return plan_path_move(path, limits, start=start, end=end)


def _state(
    path: StraightPath, s: float, which: str, speed: float, acceleration: float
) -> PathState:
    speed = finite_scalar(speed, f"speed_{which}_m_s", MotionError)
    acceleration = finite_scalar(acceleration, f"acceleration_{which}_m_s2", MotionError)
    if speed < 0.0:
        raise MotionError(f"speed_{which}_m_s must not be negative, got {speed:g}")
    if speed == 0.0 and acceleration == 0.0:
        return PathState(s)
    if path.length_m <= 0.0 or path.line.is_point:
        raise MotionError(
            f"the tip turns on the spot, so it has no speed along the line; speed_{which}_m_s and "
            f"acceleration_{which}_m_s2 must be zero (plan_path_move takes rates of the path)"
        )
    return PathState(s, speed / path.length_m, acceleration / path.length_m)
