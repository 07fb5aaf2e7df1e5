"""Straight lines for the tests of straight moves, and how far a motion is off its line."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
from hypothesis import assume

from baxter_kin import Arm, IKService, JointLimits, pose_from_quaternion
from baxter_kin.validation import FloatArray
from planner import LineTolerance, StraightLine, StraightMoveError, Trajectory, plan_straight_move
from planner.motion.paths.straight_line import DEFAULT_TOLERANCE

OVERHEAD_XYZW = (0.0, 1.0, 0.0, 0.0)
DESCENT_M = 0.15

STRAIGHT_M = 1e-4
STRAIGHT_RAD = math.radians(0.02)


def above(height_m: float, side: str = "left") -> pin.SE3:
    """A pose above the demo's first grasp, or its mirror image."""
    y = 0.15 if side == "left" else -0.15
    return pose_from_quaternion((0.70, y, -0.129 + height_m), OVERHEAD_XYZW)


@cache
def q_above(arm: Arm, height_m: float = DESCENT_M) -> FloatArray:
    """A configuration of the arm there."""
    return IKService(arm).solve(above(height_m, arm.side), current=arm.start).q


def random_move(
    arm: Arm, seed: int, *given: Any, **options: Any
) -> tuple[Trajectory, StraightLine]:
    """What `drawn_move` gives; refused ones are left out."""
    try:
        return drawn_move(arm, seed, *given, **options)
    except StraightMoveError:
        assume(False)
        raise


def drawn_move(
    arm: Arm,
    seed: int,
    limits: JointLimits | None = None,
    longest_m: float = 0.15,
    line_tolerance: LineTolerance = DEFAULT_TOLERANCE,
) -> tuple[Trajectory, StraightLine]:
    """A straight move from anywhere, in any direction, with a turn or without, and its line."""
    rng = np.random.default_rng(seed)
    allowed = arm.limits if limits is None else limits
    span = allowed.q_max - allowed.q_min
    q = rng.uniform(allowed.q_min + 0.2 * span, allowed.q_max - 0.2 * span)
    goal = random_goal(arm, q, rng, longest_m)
    motion = plan_straight_move(arm, q, goal, allowed, line_tolerance=line_tolerance)
    return motion, StraightLine(arm.T_base_tip(q), goal)


def random_goal(arm: Arm, q: FloatArray, rng: np.random.Generator, longest_m: float) -> pin.SE3:
    """A pose not farther than that from the one at q, turned by up to 0.5 rad in half the cases."""
    T = arm.T_base_tip(q)
    shift, turn = rng.normal(size=3), rng.normal(size=3)
    shift *= rng.uniform(0.0, longest_m) / np.linalg.norm(shift)
    turn *= rng.uniform(0.0, 0.5) * rng.integers(0, 2) / np.linalg.norm(turn)
    return pin.SE3(T.rotation @ pin.exp3(turn), T.translation + shift)


def farthest_off(
    motion: Trajectory, arm: Arm, start: pin.SE3, goal: pin.SE3, samples: int = 200
) -> tuple[float, float]:
    """Greatest distance from the line in m, and from the slerp at its nearest point in rad.

    For a turn on the spot, from the rotations between both. Written with quaternions and
    projections, unlike the planner's own twists.
    """
    way = goal.translation - start.translation
    first, last = pin.Quaternion(start.rotation), pin.Quaternion(goal.rotation)
    off_m, off_rad = [], []
    for q in motion.sample(np.linspace(0.0, motion.duration, samples)).q:
        T = arm.T_base_tip(q)
        if way.any():
            s = float(way @ (T.translation - start.translation) / (way @ way))
        else:
            s = first.angularDistance(pin.Quaternion(T.rotation)) / first.angularDistance(last)
        s = min(max(s, 0.0), 1.0)
        off_m.append(np.linalg.norm(T.translation - start.translation - s * way))
        there = first.slerp(s, last)
        off_rad.append(there.angularDistance(pin.Quaternion(T.rotation)))
    return float(max(off_m)), float(max(off_rad))
