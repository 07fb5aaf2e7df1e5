"""plan_together: both arms pick and place at the same time.

Tasks of an arm are done in the given order. With several tasks, the arms begin their next ones
together: the one that is done first waits for the other. An arm that has no task left stands still.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import expect, expect_all, finite_scalar
from planner.clearance import checked_margin_m
from planner.errors import TaskError
from planner.grasping.finger_travel import FINGER_SPEED_M_S
from planner.manipulator import Manipulator, both_of, of_each_arm
from planner.motion.joint_move import checked_start
from planner.motion.paths.straight_line import (
    DEFAULT_TOLERANCE,
    LineTolerance,
    checked_line_tolerance,
)
from planner.pick_place.plan_builder import NoSolutionError
from planner.pick_place.task import PickAndPlace
from planner.state import State
from planner.two_arms.pair import PairSearch
from planner.two_arms.plan import TwoArmPlan
from planner.two_arms.problem import Problem, Requirements, StepSequence

DEFAULT_GRIP_S = 0.5
"""Duration of a gripper action on the clock: the fingers' whole stroke takes 0.42 s."""

Tasks: TypeAlias = PickAndPlace | Sequence[PickAndPlace]
"""One task of an arm, or several in the order in which they are done."""


def plan_together(
    tasks: Mapping[str, Tasks],
    manipulators: Mapping[str, Manipulator],
    state: State,
    *,
    margin_m: float = 0.0,
    grip_s: float = DEFAULT_GRIP_S,
    line_tolerance: LineTolerance = DEFAULT_TOLERANCE,
    may_withdraw: bool = True,
) -> TwoArmPlan:
    """Plan picks and places of both arms at the same time.

    Both arms' motions are proven clear of each other at every instant of a common clock, together
    with the bodies that they hold, are about to pick or have placed. If no motion of both at once
    is found, they take turns, and `TwoArmPlan.in_turn` says why.

    Args:
        tasks: "left" and "right": the task of each arm, or several, done in the given order. No
            body is in tasks of both.
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
        TaskError: when an argument has the wrong type, an arm is missing, a body is in tasks of
            both or cannot be moved, a hand is not empty, or `grip_s` is too short.
        SceneError: when a body is not in the scene.
        ConfigurationError: when an arm is outside its limits.
        MotionError: when the margin or the tolerance is invalid.
    """
    each = {side: _several(given, side) for side, given in of_each_arm(tasks, "tasks").items()}
    handled = {side: frozenset(task.body for task in each[side]) for side in LIMBS}
    for name in sorted(handled["left"] & handled["right"]):
        raise TaskError(f"{name!r} is in the tasks of both arms")
    problem = checked_problem(
        handled,
        manipulators,
        state,
        margin_m=margin_m,
        grip_s=grip_s,
        line_tolerance=line_tolerance,
        may_withdraw=may_withdraw,
    )
    if all(len(given) == 1 for given in each.values()):
        return PairSearch(problem, {side: given[0] for side, given in each.items()}).plan()
    return _in_rounds(problem, each)


def checked_problem(
    handled: Mapping[str, frozenset[str]],
    manipulators: Mapping[str, Manipulator],
    state: State,
    *,
    margin_m: float,
    grip_s: float,
    line_tolerance: LineTolerance,
    may_withdraw: bool,
) -> Problem:
    """Check arguments of `plan_together`, raise its errors, and build the problem from them.

    `handled` contains the names of the bodies that each arm handles.
    """
    arms = dict(zip(LIMBS, both_of(manipulators), strict=True))
    expect(state, State, "state", TaskError)
    for side in LIMBS:
        _check_arm(side, arms[side], handled[side], state)
    if arms["left"].identity != arms["right"].identity:
        raise TaskError("both manipulators must be of the same robot")
    expect(may_withdraw, bool, "may_withdraw", TaskError)
    requirements = Requirements(
        checked_margin_m(margin_m),
        _checked_grip_s(grip_s, arms),
        checked_line_tolerance(line_tolerance),
        may_withdraw,
    )
    return Problem(arms, state, handled, requirements)


def _checked_grip_s(grip_s: float, manipulators: Mapping[str, Manipulator]) -> float:
    """The duration of a gripper action, refused where fingers take longer for their stroke."""
    stroke_s = max(arm.hand.stroke_m for arm in manipulators.values()) / FINGER_SPEED_M_S
    return float(finite_scalar(grip_s, "grip_s", TaskError, least=stroke_s))


def _in_rounds(problem: Problem, tasks: Mapping[str, Sequence[PickAndPlace]]) -> TwoArmPlan:
    """The plan of several tasks; both arms begin their next ones together."""
    sequence, reasons = StepSequence(problem), []
    try:
        for number in range(max(map(len, tasks.values()))):
            left = {side: given[number] for side, given in tasks.items() if number < len(given)}
            if len(left) < len(LIMBS):
                for side, task in left.items():
                    sequence.add_cycle(side, task)
                continue
            plan = PairSearch(sequence.problem, left).plan()
            if plan.failure is not None:
                raise NoSolutionError(plan.failure)
            reasons += [f"round {number + 1}: {plan.in_turn}"] if plan.in_turn else []
            sequence.add_plan(plan)
        return sequence.planned("; ".join(reasons))
    except NoSolutionError as stop:
        return problem.failed(stop.failure)


def _several(given: Any, side: str) -> tuple[PickAndPlace, ...]:
    """One task or several as a tuple."""
    if isinstance(given, PickAndPlace):
        return (given,)
    found = expect_all(given, PickAndPlace, f"tasks[{side!r}]", TaskError)
    if not found:
        raise TaskError(f"the {side} arm has no task; plan for the other one alone")
    return found


def _check_arm(side: str, manipulator: Manipulator, handled: frozenset[str], state: State) -> None:
    for name in sorted(handled):
        if not state.scene[name].is_movable:
            raise TaskError(f"{name!r} is not movable, so it cannot be picked")
    held = state.holding(side)
    if held is not None:
        raise TaskError(f"the {side} hand holds {held.body!r}; it must be empty at first")
    q = state.q(manipulator.arm.joint_names)
    checked_start(q, manipulator.arm.limits, f"the {side} arm's start", clip_start=False)
