"""The exercises of notebook 8: several tasks of an arm, a place for both hands, a tray."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from baxter_kin import pose_from_quaternion
from baxter_kin.frames import angle_between
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray
from lessons.answers import Mistake, exercise, instance, numbers, shown, stock_robot
from planner import (
    Manipulator,
    PairMove,
    PickAndPlace,
    TwoArmPlan,
    load_object,
    make_block,
    plan_together,
)
from planner.state import State
from sim import World

UPRIGHT, DOWN = (0.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0)
BLOCK_Z_M = -0.13
"""The centre of a block on the table."""

BLOCKS = {"red": (0.65, 0.20), "blue": (0.75, -0.20)}
"""Where they start in the second exercise, x and y in base, m."""

WANTED = {
    "left": {"red": (0.75, 0.40), "green": (0.58, 0.42)},
    "right": {"blue": (0.65, -0.40)},
}
"""Of the first exercise: where each arm brings its blocks, in order."""

RED_PLACE, BLUE_PLACE = (0.70, 0.12), (0.70, 0.02)
"""Of the second exercise: they block each other."""

WITHIN_M = 0.20
"""How far the blue block's place may be moved."""

TRAY_GOAL_BASE = (0.50, 0.0, 0.25)
TRAY_YAW_RAD = np.radians(15.0)
"""Of the third exercise."""

NEAR_M, NEAR_RAD = 1e-3, 1e-3
"""How far a body may be off its place."""


@exercise("set `answer` to the plan of both arms")
def check_list(answer: Any) -> str:
    """A plan in which one arm has two tasks, and the other one has one.

    Args:
        answer: a `TwoArmPlan`.
    """
    plan = instance(answer, TwoArmPlan, "plan_together")
    if plan.failure is not None:
        raise Mistake(f"this plan is refused: {plan.failure}")
    for side, wanted in WANTED.items():
        ends = _ends(plan, side)
        if list(ends) != list(wanted):
            names, asked = (" and then ".join(each) for each in (ends, wanted))
            raise Mistake(f"the {side} arm carries {names}, and it should carry {asked}")
        for name, place in wanted.items():
            if np.linalg.norm(ends[name][:2] - place) > NEAR_M:
                raise Mistake(f"{name} goes to {shown(ends[name])} m, not to {shown(place)}")
    return f"three blocks in {plan.duration_s:.1f} s"


@exercise("set `answer` to x and y in m, such as (0.7, -0.1)")
def check_place(answer: Any) -> str:
    """A place for the blue block at which both hands can be at once.

    Args:
        answer: x and y in base, m.
    """
    place = numbers(answer, 2, "x and y in m")
    off_m = float(np.linalg.norm(place - BLUE_PLACE))
    if off_m > WITHIN_M:
        raise Mistake(
            f"{shown(place)} is {1e3 * off_m:.0f} mm from {shown(BLUE_PLACE)}; at most "
            f"{1e3 * WITHIN_M:.0f} mm are allowed"
        )
    plan = _carried(place)
    if plan.failure is not None:
        raise Mistake(f"with {shown(place)} this plan is refused: {plan.failure}")
    if plan.in_turn:
        raise Mistake(f"with {shown(place)} the arms take turns: {plan.in_turn}")
    return f"with blue at {shown(place)} m both arms need {plan.duration_s:.1f} s"


@exercise("set `answer` to the move of the tray")
def check_tray(answer: Any) -> str:
    """The move of a tray in both hands to a turned pose.

    Args:
        answer: a `PairMove`.
    """
    move = instance(answer, PairMove, "plan_pair_move")
    goal = pin.SE3(np.array(move.T_base_bodies[-1]))
    if np.linalg.norm(goal.translation - TRAY_GOAL_BASE) > NEAR_M:
        raise Mistake(
            f"the tray ends at {shown(goal.translation)} m, and it should at "
            f"{shown(TRAY_GOAL_BASE)}"
        )
    turned = pin.utils.rotate("z", TRAY_YAW_RAD)
    if angle_between(goal.rotation, turned.T) < NEAR_RAD:
        raise Mistake("the tray is turned the other way; about z, a positive angle goes to y")
    if angle_between(goal.rotation, turned) > NEAR_RAD:
        raise Mistake("the tray is not turned by 15 degrees about the vertical")
    return (
        f"{move.duration_s:.2f} s, and the right hand at most "
        f"{1e6 * move.deviation.position_m:.0f} um off its place on the tray"
    )


def _ends(plan: TwoArmPlan, side: str) -> Mapping[str, FloatArray]:
    """Where an arm brings bodies: their centres, by name, m in base."""
    own, ends = plan.plans[side], {}
    arm = stock_robot().arm(side)
    q, picked = own.q_start, {}
    for step in own:
        if hasattr(step, "trajectory"):
            q = step.trajectory.q_goal
        elif step.body is not None and step.body not in picked:
            picked[step.body] = arm.T_base_tip(q)
        elif step.body is not None:
            moved = arm.T_base_tip(q) * picked[step.body].inverse()
            ends[step.body] = moved.act(own.start.scene[step.body].centre_base)
    return ends


def _carried(place: FloatArray) -> TwoArmPlan:
    """Both arms carry their blocks, blue to a place."""
    robot = stock_robot()
    world = World(robot)
    world.spawn(load_object("table", pose_from_quaternion((1.0, 0.0, -0.93), UPRIGHT)))
    for side, (name, xy) in zip(LIMBS, BLOCKS.items(), strict=True):
        world.move_arm(side, robot.arm(side).start)
        world.spawn(make_block(name, pose_from_quaternion((*xy, BLOCK_Z_M), UPRIGHT)))
    places = {"red": RED_PLACE, "blue": tuple(place)}
    tasks = {
        side: PickAndPlace(
            name,
            pose_from_quaternion((*BLOCKS[name], BLOCK_Z_M), DOWN),
            pose_from_quaternion((*places[name], BLOCK_Z_M), DOWN),
        )
        for side, name in zip(LIMBS, BLOCKS, strict=True)
    }
    arms = {side: Manipulator.of(robot, side) for side in LIMBS}
    state: State = world.state
    return plan_together(tasks, arms, state, may_withdraw=False)
