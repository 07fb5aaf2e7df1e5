"""plan_together: both arms pick and place at the same time.

Tasks of an arm are done in the given order. With several tasks, the arms begin their next ones
together: the one that is done first waits for the other. An arm that has no task left stands still.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

from baxter_kin.errors import UnknownNameError
from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import expect, expect_all, finite_scalar
from planner.clearance import ContinuousContact, checked_margin_m
from planner.collision.robot.robot_body import identity_of
from planner.completion import after, complete, state_of
from planner.errors import TaskError
from planner.grasping.finger_travel import FINGER_SPEED_M_S
from planner.manipulator import Manipulator
from planner.motion.joint_move import checked_start
from planner.motion.paths.straight_line import (
    DEFAULT_TOLERANCE,
    LineTolerance,
    checked_line_tolerance,
)
from planner.pick_place.task import PickAndPlace
from planner.plan import Plan
from planner.state import State
from planner.two_arms.arm_cycle import Requirements
from planner.two_arms.pair import PairSearch
from planner.two_arms.plan import TwoArmPlan

DEFAULT_GRIP_S = 0.5
"""Duration of a gripper action on the clock: the fingers' whole stroke takes 0.42 s."""

Tasks: TypeAlias = PickAndPlace | Sequence[PickAndPlace]
"""One task of an arm, or several in the order in which they are done."""


def plan_together(
    tasks: Mapping[str, PickAndPlace],
    manipulators: Mapping[str, Manipulator],
    state: State,
    *,
    margin_m: float = 0.0,
    grip_s: float = DEFAULT_GRIP_S,
    line_tolerance: LineTolerance = DEFAULT_TOLERANCE,
    may_withdraw: bool = True,
) -> TwoArmPlan:
    """Plan a pick and place of each arm, both at the same time.

    Both arms' motions are proven clear of each other at every instant of a common clock, together
    with the bodies that they hold, are about to pick or have placed. If no motion of both at once
    is found, they take turns, and `TwoArmPlan.in_turn` says why.

    Args:
        tasks: "left" and "right": the task of each arm; no body is in both.
        manipulators: "left" and "right": the arms, of the same robot.
        state: robot and bodies; both hands are empty.
        margin_m: distance that is proven to be kept from everything, as in `plan_pick_and_place`,
            and between the arms.
        grip_s: duration of a gripper action on the clock, at least the time that the fingers take
            for their whole stroke. An action that takes longer invalidates the proof.
        line_tolerance: maximum deviation of a tip from its straight lines.
        may_withdraw: whether an arm that is done may go on to neutral or to where it began, when
            it would be in the other's way.

    Returns:
        A plan; an invalid one that says why when there is none. It is invalid, too, where one arm's
        body would stand on a body that the other arm handles.

    Raises:
        TaskError: when an argument has the wrong type, an arm is missing, a body is in both tasks
            or cannot be moved, a hand is not empty, or `grip_s` is too short.
        SceneError: when a body is not in the scene.
        ConfigurationError: when an arm is outside its limits.
        MotionError: when the margin or the tolerance is invalid.
    """
    each = _of_both(tasks, PickAndPlace, "tasks")
    arms = _of_both(manipulators, Manipulator, "manipulators")
    expect(state, State, "state", TaskError)
    for side in LIMBS:
        _check_arm(side, arms[side], each[side], state)
    if each["left"].body == each["right"].body:
        raise TaskError(f"{each['left'].body!r} is in the tasks of both arms")
    if arms["left"].identity != arms["right"].identity:
        raise TaskError("both manipulators must be of the same robot")
    stroke_s = max(arm.hand.stroke_m for arm in arms.values()) / FINGER_SPEED_M_S
    finite_scalar(grip_s, "grip_s", TaskError, least=stroke_s)
    expect(may_withdraw, bool, "may_withdraw", TaskError)
    checked_line_tolerance(line_tolerance)
    requirements = Requirements(
        checked_margin_m(margin_m), grip_s, line_tolerance, may_withdraw
    )
    handled = {side: frozenset({each[side].body}) for side in LIMBS}
    return PairSearch(each, arms, state, handled, requirements).plan()


def _of_both(given, kind, what):
    expect(given, Mapping, what, TaskError)
    if set(given) != set(LIMBS):
        raise TaskError(f"{what} must be those of left and right, got {sorted(map(str, given))}")
    return {side: expect(given[side], kind, f"{what}[{side!r}]", TaskError) for side in LIMBS}


def _check_arm(side, manipulator, task, state):
    if manipulator.arm.side != side:
        raise TaskError(f"the manipulator for {side!r} is the {manipulator.arm.side} arm")
    if not state.scene[task.body].is_movable:
        raise TaskError(f"{task.body!r} is not movable, so it cannot be picked")
    held = state.holding(side)
    if held is not None:
        raise TaskError(f"the {side} hand holds {held.body!r}; it must be empty at first")
    checked_start(state.q(manipulator.arm.joint_names), manipulator.arm.limits, f"{side} q_start")
