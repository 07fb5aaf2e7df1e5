"""The exercises of notebook 2: one pose, two elbows for one pose, and the edge of the reach."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from baxter_kin import Arm, IKResult, IKService, pose_from_quaternion
from baxter_kin.frames import T_world_base, angle_between, read_with_w_first
from baxter_kin.validation import FloatArray
from lessons.answers import Mistake, exercise, joint_angles, number, shown, stock_robot

DOWN = (0.0, 1.0, 0.0, 0.0)
"""Pointing straight down; x, y, z, w."""

PLACE_BASE = (0.65, 0.30, 0.00)
POSE_BASE = (0.70, 0.15, -0.13)
"""Where the tip shall be in the first two exercises, m."""

EDGE_Y, EDGE_Z = 0.15, -0.13
EDGE_STEP_M = 0.01
"""To what the edge of the reach is asked for."""

LEAST_APART_M = 0.20
"""How far apart the elbows shall be."""

POSITION_M, ANGLE_RAD = 1e-4, 1e-3
"""How far a tip may be off its pose."""


@exercise("set `answer` to seven joint angles in rad, or to what ik.solve gives")
def check_place(answer: Any) -> str:
    """Joint angles that bring the left tip to `PLACE_BASE`, the hand pointing straight down.

    Args:
        answer: shape (7,), rad, or an `IKResult`; the hand may be turned about the vertical.
    """
    arm = stock_robot().arm("left")
    q = joint_angles(answer, arm)
    T = arm.T_base_tip(q)
    off_m = float(np.linalg.norm(T.translation - PLACE_BASE))
    tilt = _tilt(T)
    if off_m < POSITION_M and tilt < ANGLE_RAD:
        return f"the tip is {1e3 * off_m:.4f} mm off, and the hand points straight down"
    _refuse_place(q, T)
    if tilt >= ANGLE_RAD and off_m < POSITION_M:
        raise Mistake(f"the tip is there, but the hand leans by {np.degrees(tilt):.1f} degrees")
    raise Mistake(
        f"the tip is at {shown(T.translation)} m in base, {1e3 * off_m:.1f} mm off, and the hand "
        f"leans {np.degrees(tilt):.1f} degrees from down"
    )


@exercise("set `answer` to two solutions, as (q_one, q_other)")
def check_elbows(answer: Any) -> str:
    """Two solutions for the notebook's `pose` whose elbows are 20 cm apart or more.

    Args:
        answer: two of what `check_place` takes.
    """
    if isinstance(answer, IKResult) or not isinstance(answer, (Sequence, np.ndarray)):
        raise Mistake("asked for are two solutions, in a list or in parentheses: (q_one, q_other)")
    if not any(isinstance(each, (IKResult, Sequence, np.ndarray)) for each in answer):
        raise Mistake("this is one solution; asked for are two of them: (q_one, q_other)")
    if len(answer) != 2:
        raise Mistake(f"asked for are two solutions, and these are {len(answer)}")
    arm, wanted = stock_robot().arm("left"), pose_from_quaternion(POSE_BASE, DOWN)
    elbows = []
    for which, each in zip(("first", "second"), answer, strict=True):
        q = joint_angles(each, arm)
        T = arm.T_base_tip(q)
        off_m = float(np.linalg.norm(T.translation - wanted.translation))
        turn = angle_between(T.rotation, wanted.rotation)
        if off_m > POSITION_M or turn > ANGLE_RAD:
            raise Mistake(
                f"the {which} is not a solution: its tip is {1e3 * off_m:.1f} mm and "
                f"{np.degrees(turn):.1f} degrees off the pose"
            )
        elbows.append(_elbow(arm, q))
    apart_m = float(np.linalg.norm(elbows[1] - elbows[0]))
    if apart_m < 1e-6:
        raise Mistake("both have the elbow at one place; take distant points of the curve")
    if apart_m < LEAST_APART_M:
        raise Mistake(
            f"both are solutions, but the elbows are only {100 * apart_m:.1f} cm apart; take "
            "points of the curve that are farther from one another"
        )
    return f"one pose, and the elbow moves by {100 * apart_m:.0f} cm"


@exercise("set `answer` to the largest x in metres, such as 0.75")
def check_edge(answer: Any) -> str:
    """The largest x, to the centimetre, that the left hand reaches pointing down.

    Args:
        answer: m, in base, with y and z as `EDGE_Y` and `EDGE_Z`.
    """
    x = number(answer, "one x in metres")
    if x > 10.0:
        raise Mistake("that looks like millimetres or centimetres; lengths are in metres")
    ik = IKService(stock_robot().arm("left"))
    poses = (pose_from_quaternion((each, EDGE_Y, EDGE_Z), DOWN) for each in (x, x + EDGE_STEP_M))
    here, farther = map(ik.solve, poses)
    if here.failure is not None:
        beyond_mm = 1e3 * here.failure.beyond_reach_m
        how = f"proven, by {beyond_mm:.0f} mm" if beyond_mm > 0.0 else "no solution was found"
        raise Mistake(f"x = {x:.3f} m is out of reach ({how})")
    if farther.is_valid:
        raise Mistake(f"x = {x:.3f} m is within reach, and so is 1 cm more")
    return f"{x:.3f} m is within reach, and 1 cm more is not"


def _refuse_place(q: FloatArray, T: pin.SE3) -> None:
    """Refuse typical mistakes."""
    right = stock_robot().arm("right").T_base_tip(q)
    x, y, z = T.translation
    if np.linalg.norm(right.translation - PLACE_BASE) < POSITION_M:
        raise Mistake("these angles are the right arm's; the IKService needs robot.arm('left')")
    if _is_place(stock_robot().arm("left").T_base_tip(q[::-1]).translation):
        raise Mistake("the joints are in the wrong order; arm.joint_names begins with s0")
    if _is_place((x, -y, z)):
        raise Mistake("the tip is on the robot's right; y points to its left")
    if _is_place((y, x, z)):
        raise Mistake("x and y have changed places: x points forward, y to the robot's left")
    if _is_place(T_world_base().act(T.translation)):
        raise Mistake("the tip is there as seen from world; the place is given in base")
    meant = pin.SE3(read_with_w_first(T.rotation), T.translation)
    if _is_place(T.translation) and _tilt(T) > 1.0 and _tilt(meant) < ANGLE_RAD:
        raise Mistake("the hand points elsewhere: quaternions are x, y, z, w here, w last")
    if _is_place(T.translation) and _tilt(T) > np.pi - ANGLE_RAD:
        raise Mistake("the hand points straight up; half a turn about y points it down")


def _is_place(point_base: Any) -> bool:
    return bool(np.linalg.norm(np.subtract(point_base, PLACE_BASE)) < POSITION_M)


def _tilt(T_base_tip: pin.SE3) -> float:
    """The angle between the hand and straight down, rad."""
    down = -T_base_tip.rotation[2, 2]
    return float(np.arctan2(np.linalg.norm(T_base_tip.rotation[:2, 2]), down))


def _elbow(arm: Arm, q: FloatArray) -> FloatArray:
    """Where the elbow is in base, shape (3,), m."""
    data = arm.model.createData()
    pin.forwardKinematics(arm.model, data, q)
    return np.array(data.oMi[arm.model.getJointId(f"{arm.side}_e1")].translation)
