"""The exercises of notebook 3: a slower joint move, a straight way down, the speed of the tip."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from baxter_kin import IKService, JointLimits, pose_from_quaternion
from baxter_kin.fields import evolve
from baxter_kin.frames import angle_between
from baxter_kin.validation import FloatArray
from lessons.answers import Mistake, exercise, instance, number, refuse, shown, stock_robot
from planner import Trajectory, plan_joint_move

DOWN = (0.0, 1.0, 0.0, 0.0)
"""Pointing straight down; x, y, z, w."""

START_BASE, GOAL_BASE = (0.60, 0.40, 0.10), (0.75, 0.00, -0.10)
"""Of the notebook's move, m."""

SLOW_DEG_S = 30.0
"""The velocity that no joint is to exceed."""

DEPTH_M = 0.10
"""How far the hand goes straight down."""

POSITION_M, ANGLE_RAD = 1e-3, 1e-2
"""How far a tip may be off its pose or its line."""

SHARE = 0.01
"""How much longer than needed a motion may take."""

READ_OFF = 4e-3
"""An answer may be rounded to so large a share of it."""


@exercise("set `answer` to the trajectory that plan_joint_move gives")
def check_slow(answer: Any) -> str:
    """The notebook's joint move, no joint faster than 30 degrees a second.

    Args:
        answer: a `Trajectory`.
    """
    move = instance(answer, Trajectory, "plan_joint_move")
    _refuse_other_ends(move, (START_BASE, GOAL_BASE), "from T_start to T_goal")
    limits = stock_robot().arm("left").limits
    fastest = float(np.abs(move.sample(np.linspace(0.0, move.duration, 2000)).v).max())
    if fastest > np.radians(SLOW_DEG_S) + 1e-6:
        hint = "" if fastest < np.radians(SLOW_DEG_S) + 0.5 else "; v_max is in rad/s, not degrees"
        raise Mistake(f"a joint turns at {np.degrees(fastest):.1f} degrees a second{hint}")
    peaks = move.peak_ratios(limits)
    if max(peaks) > 1.0 + 1e-6:
        raise Mistake("it is slow enough, but exceeds the arm's a_max or j_max: keep these")
    best = plan_joint_move(move.q_start, move.q_goal, _slow(limits))
    if move.duration > (1.0 + SHARE) * best.duration:
        raise Mistake(
            f"no joint is too fast, but it takes {move.duration:.3f} s, and {best.duration:.3f} s "
            "are enough: change nothing but v_max, and take each joint to its 30 degrees per second"
        )
    return f"{move.duration:.3f} s, and no joint turns faster than {np.degrees(fastest):.1f} deg/s"


@exercise("set `answer` to the trajectory that plan_straight_move gives")
def check_down(answer: Any) -> str:
    """From `T_start` 10 cm straight down, as seen from base.

    Args:
        answer: a `Trajectory` whose tip stays within a millimetre of the line.
    """
    line = instance(answer, Trajectory, "plan_straight_move")
    x, y, z = START_BASE
    ends = START_BASE, (x, y, z - DEPTH_M)
    _refuse_other_ends(line, ends, "from T_start to 10 cm below it")
    tips = _tips(line)
    across_m = float(np.linalg.norm(tips[:, :2] - (x, y), axis=1).max())
    if across_m > POSITION_M:
        raise Mistake(
            f"it ends where it should, but its tip leaves the line by {1e3 * across_m:.1f} mm: "
            "that is a joint move; plan_straight_move keeps to the line"
        )
    if max(line.peak_ratios(stock_robot().arm("left").limits)) > 1.0 + 1e-6:
        raise Mistake("it is straight, but exceeds the arm's limits; give it arm.limits")
    return f"10 cm down in {line.duration:.3f} s, at most {1e6 * across_m:.0f} micrometres off"


@exercise("set `answer` to a speed in m/s, such as 0.5")
def check_tip_speed(answer: Any) -> str:
    """The greatest speed of the tip during the notebook's joint move.

    Args:
        answer: m/s.
    """
    given = number(answer, "one speed in m/s")
    move, arm = _notebooks_move(), stock_robot().arm("left")
    state = move.sample(np.linspace(0.0, move.duration, 4000))
    twists = np.array([arm.jacobian(q) @ v for q, v in zip(state.q, state.v, strict=True)])
    speeds = np.linalg.norm(twists[:, :3], axis=1)
    wanted = float(speeds.max())
    if abs(given - wanted) < READ_OFF * wanted:
        when = float(np.linspace(0.0, move.duration, 4000)[speeds.argmax()])
        return f"the tip is fastest after {when:.2f} s, at {wanted:.3f} m/s"
    tips = _tips(move)
    way = float(np.linalg.norm(np.diff(tips, axis=0), axis=1).sum())
    refuse(
        given,
        {
            "that is in millimetres per second; asked for are metres per second": 1e3 * wanted,
            "that is the mean speed along the path; asked for is the greatest": way / move.duration,
            "that is the distance of start and goal over the time, a mean; asked for is the peak": (
                float(np.linalg.norm(tips[-1] - tips[0])) / move.duration
            ),
            "that is the norm of all six rows, metres mixed with radians; the first three are "
            "the linear velocity": float(np.linalg.norm(twists, axis=1).max()),
            "that is how fast the tip turns, in rad/s; the linear velocity comes first": float(
                np.linalg.norm(twists[:, 3:], axis=1).max()
            ),
            "that is a speed of joints, in rad/s; the Jacobian makes the tip's of it": float(
                np.abs(state.v).max()
            ),
            "that is the speed along one axis; take the norm of all three": float(
                np.abs(twists[:, :3]).max()
            ),
        },
        READ_OFF / 2.0,
    )
    raise Mistake("sample q and v along move, and take the norm of the first three rows of J @ v")


def _slow(limits: JointLimits) -> JointLimits:
    return evolve(limits, v_max=np.minimum(limits.v_max, np.radians(SLOW_DEG_S)))


@cache
def _notebooks_move() -> Trajectory:
    arm = stock_robot().arm("left")
    ik = IKService(arm)
    q_start = ik.solve(pose_from_quaternion(START_BASE, DOWN), current=arm.start).q
    q_goal = ik.solve(pose_from_quaternion(GOAL_BASE, DOWN), current=q_start).q
    return plan_joint_move(q_start, q_goal, arm.limits)


def _tips(trajectory: Trajectory) -> FloatArray:
    """Where the tip is at 1,000 instants, shape (1000, 3), m in base."""
    arm = stock_robot().arm("left")
    qs = trajectory.sample(np.linspace(0.0, trajectory.duration, 1000)).q
    return np.array([arm.T_base_tip(q).translation for q in qs])


def _refuse_other_ends(
    trajectory: Trajectory, ends_base: tuple[tuple[float, ...], ...], wanted: str
) -> None:
    """Refuse a trajectory that does not lead the left tip between the ends, pointing down."""
    arm, R_down = stock_robot().arm("left"), pose_from_quaternion(START_BASE, DOWN).rotation
    T_first, T_last = arm.T_base_tip(trajectory.q_start), arm.T_base_tip(trajectory.q_goal)
    for T, end, which in zip((T_first, T_last), ends_base, ("starts", "ends"), strict=True):
        off = T.translation - end
        if np.linalg.norm(off) > POSITION_M:
            rising = which == "ends" and np.allclose(
                off, (0.0, 0.0, 2.0 * DEPTH_M), atol=POSITION_M
            )
            hint = (
                "; in base, down is -z, and in the frame of a tip that points down it is +z"
                if rising
                else ""
            )
            raise Mistake(
                f"asked for is a move {wanted}, and this one {which} with the tip at "
                f"{shown(T.translation)} m in base{hint}"
            )
        if angle_between(T.rotation, R_down) > ANGLE_RAD:
            raise Mistake(
                f"this move {which} with the hand turned; keep the orientation of T_start"
            )
