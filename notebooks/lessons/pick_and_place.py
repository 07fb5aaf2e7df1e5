"""The exercises of notebook 4: a grasp of a turned block, the faster arm, a camera's errors."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin

from baxter_kin import pose_from_quaternion
from baxter_kin.frames import T_world_base, checked_pose
from lessons.answers import Mistake, exercise, instance, shown, stock_robot
from planner import (
    Manipulator,
    PickAndPlace,
    Plan,
    Scene,
    load_object,
    make_block,
    plan_pick_and_place,
)
from sim.perception.pose_source import Noise

DOWN, UPRIGHT = (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
"""Orientations, x, y, z, w."""

TURNED_BASE, TURN_DEG = (0.70, 0.10, -0.13), 30.0
"""The centre of the turned block, m, and how far it is turned about the vertical."""

EDGE_M = 0.05
NEAR_M = 0.003
"""A grasp may be so far beside the block's centre."""

HIGH_M = 0.015
"""A grasp may be so far above or below it."""

ASKEW_DEG = 2.0
"""How far the hand may be from square to the block, and from straight down."""

FROM_BASE, TO_BASE = (0.70, 0.00, -0.13), (0.70, 0.20, -0.13)
"""Where the block of the second exercise goes, its centre, m."""

SLOWER = 0.03
"""How much longer than with the faster arm a plan may take."""

CAMERA = Noise(position_m=0.001, yaw_rad=float(np.radians(0.5)), dropout=0.1)
"""What is to be written down in the third exercise."""


@exercise("set `answer` to the pose of the tip when the fingers close, seen from base")
def check_grasp(answer: Any) -> str:
    """Where the tip grasps a block of 5 cm that is turned by 30 degrees, from above.

    Args:
        answer: an SE3, base to tip; any of the four ways round.
    """
    T = checked_pose(answer)
    off = T.translation - TURNED_BASE
    if T.rotation[2, 2] > np.cos(np.radians(90.0)):
        raise Mistake("the hand points up; its z axis has to point down, as DOWN has it")
    if np.degrees(np.arccos(min(1.0, -T.rotation[2, 2]))) > ASKEW_DEG:
        raise Mistake("the hand leans; its z axis has to point straight down")
    _refuse_position(T)
    if np.linalg.norm(off[:2]) > NEAR_M or abs(off[2]) > HIGH_M:
        raise Mistake(f"the tip is {1e3 * np.linalg.norm(off):.1f} mm from the block's centre")
    _refuse_turn(_square_deg(T.rotation, TURN_DEG), _square_deg(T.rotation, 0.0))
    return "the fingers close on two opposite faces of the block, at its centre"


@exercise("set `answer` to the plan of the faster arm")
def check_faster_arm(answer: Any) -> str:
    """The block from `FROM_BASE` to `TO_BASE`, by the arm that needs less time.

    Args:
        answer: a `Plan`.
    """
    plan = instance(answer, Plan, "plan_pick_and_place")
    if not plan.is_valid:
        raise Mistake(f"this plan is refused: {plan.failure}")
    _refuse_other_task(plan)
    times = {side: own.motion_time_s for side, own in _own_plans().items()}
    best = min(times, key=lambda side: times[side])
    if plan.motion_time_s > (1.0 + SLOWER) * times[best]:
        other = f"; the {best} arm needs {times[best]:.2f} s" if plan.limb != best else ""
        raise Mistake(f"the {plan.limb} arm needs {plan.motion_time_s:.2f} s{other}")
    told = " and ".join(f"{times[side]:.2f} s with the {side} arm" for side in times)
    return f"the {plan.limb} arm is faster: {told}"


@exercise("set `answer` to a Noise(...)")
def check_camera(answer: Any) -> str:
    """A camera: 1 mm along each axis, half a degree of turn, one look in ten sees nothing.

    Args:
        answer: a `Noise`.
    """
    noise = instance(answer, Noise, "Noise(position_m=...)")
    if np.isclose(noise.position_m, 1e3 * CAMERA.position_m):
        raise Mistake("position_m is in metres: a millimetre is 0.001")
    if np.isclose(noise.yaw_rad, np.degrees(CAMERA.yaw_rad)):
        raise Mistake("yaw_rad is in radians: half a degree is np.radians(0.5)")
    if np.isclose(noise.dropout, 1.0 - CAMERA.dropout):
        raise Mistake("dropout is the share of looks that see nothing: one in ten, not nine")
    if noise.latency_s > 0.0:
        raise Mistake("nothing was said of a delay; leave latency_s out")
    for name in ("position_m", "yaw_rad", "dropout"):
        if not np.isclose(getattr(noise, name), getattr(CAMERA, name), rtol=1e-2):
            raise Mistake(f"{name} should be {getattr(CAMERA, name):.4g}")
    return f"{noise.position_m} m, {noise.yaw_rad:.4f} rad, and {noise.dropout:.0%} of looks fail"


def _square_deg(R_base_tip: Any, turn_deg: float) -> float:
    """How far the fingers close from square to a block that is turned so far, degrees."""
    closing_deg = np.degrees(np.arctan2(R_base_tip[1, 1], R_base_tip[0, 1]))
    return float((closing_deg - turn_deg + 45.0) % 90.0 - 45.0)


def _refuse_position(T: pin.SE3) -> None:
    """Refuse typical mistakes in a position."""
    centre = np.array(TURNED_BASE)
    if np.allclose(T.translation, 1e3 * centre, atol=1.0):
        raise Mistake("the position is in millimetres; lengths are in metres")
    if np.allclose(T.translation, T_world_base().act(centre), atol=NEAR_M):
        raise Mistake("that is where world sees the block; the task wants poses in base")
    if np.allclose(T.translation, centre * (1.0, -1.0, 1.0), atol=NEAR_M):
        raise Mistake("that is on the robot's right; y points to its left")
    if np.allclose(T.translation, np.add(centre, (0.0, 0.0, EDGE_M / 2)), atol=NEAR_M):
        raise Mistake("the tip is on top of the block; the fingers close around its centre")


def _refuse_turn(off_deg: float, from_base_deg: float) -> None:
    """Refuse typical mistakes in the turn of the hand."""
    if abs(off_deg) <= ASKEW_DEG:
        return
    if abs(from_base_deg) <= ASKEW_DEG:
        raise Mistake("the block is turned and the hand is not, so it would close on the corners")
    if abs(from_base_deg + TURN_DEG) <= ASKEW_DEG:
        raise Mistake(
            "the hand is turned the other way round: the tip's z axis points down, so a turn about "
            "it is the opposite of one about base's"
        )
    meant = (np.degrees(TURN_DEG) + 45.0) % 90.0 - 45.0
    if min(abs(from_base_deg - meant), abs(from_base_deg + meant)) <= ASKEW_DEG:
        raise Mistake(f"the hand is turned by {TURN_DEG:g} radians; use np.radians({TURN_DEG:g})")
    raise Mistake(f"the hand is turned {abs(off_deg):.1f} degrees from square to the block")


def _refuse_other_task(plan: Plan) -> None:
    """Refuse a plan that does not bring the block from `FROM_BASE` to `TO_BASE`."""
    if "red" not in plan.start.scene.bodies:
        raise Mistake("the plan has no block named red; plan in the scene `fresh`")
    start = plan.start.scene["red"].centre_base
    if np.linalg.norm(start - FROM_BASE) > NEAR_M:
        raise Mistake(f"in this plan's scene the block is at {shown(start)} m; plan in `fresh`")
    places = [move.T_base_tip for move in plan.moves if move.label == "place: descend"]
    picks = [move.T_base_tip for move in plan.moves if move.label == "pick: descend"]
    if len(places) != 1 or len(picks) != 1 or places[0] is None or picks[0] is None:
        raise Mistake("asked for is one pick and one place")
    goal = places[0].act(picks[0].actInv(start))
    if np.linalg.norm(goal - TO_BASE) > NEAR_M:
        raise Mistake(
            f"in this plan the block goes to {shown(goal)} m in base, not to {shown(TO_BASE)}"
        )


@cache
def _own_plans() -> dict[str, Plan]:
    """The best that each arm can do."""
    table = load_object("table", pose_from_quaternion((1.0, 0.0, -0.93), UPRIGHT))
    block = make_block("red", pose_from_quaternion(FROM_BASE, UPRIGHT), edge_m=EDGE_M)
    pick, place = (pose_from_quaternion(each, DOWN) for each in (FROM_BASE, TO_BASE))
    task, scene, robot = PickAndPlace("red", pick, place), Scene.of([table, block]), stock_robot()
    return {
        side: plan_pick_and_place(task, Manipulator.of(robot, side), scene, robot.arm(side).neutral)
        for side in ("left", "right")
    }
