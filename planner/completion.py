"""Complete plans: the state at the beginning of each step, and its intended contacts.

A planner states both as it adds a step (`planner.pick_place.plan_builder`). For a plan that was
written by hand, or read from a file of version 3, they are derived here, from its start and its
steps alone:

- on the straight line just before the fingers close on a body, and on the one just after they
  release it, the hand may come near the body, and its pads may touch it where that is unavoidable;
- a held body may touch its previous support in the first move, and its next one in the last.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TypeGuard

import numpy as np

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.validation import expect
from planner.collision.context import CollisionContext
from planner.collision.distances import RESOLUTION_M
from planner.errors import TaskError
from planner.grasping.finger_travel import FINGER_SPEED_M_S, MIN_PUSH_M
from planner.grasping.grasp import Grasp, Miss
from planner.manipulator import Manipulator
from planner.motion.upright import max_tilt_rad
from planner.plan import Grip, GripperAction, Move, Plan, Step
from planner.scene.contact import Contact, part_contacts
from planner.scene.support import settle
from planner.state import State


def complete(
    plan: Plan, state: State | None = None, *, manipulator: Manipulator | None = None
) -> Plan:
    """A plan with the state and the contacts of every step.

    Args:
        plan: the plan to complete.
        state: robot and bodies before its first step; the plan's own when not given.
        manipulator: the arm that it is for; that of the stock robot when not given.

    Raises:
        TaskError: when an argument has the wrong type, the manipulator is the other arm, or a
            gripper action contradicts the state.
    """
    expect(plan, Plan, "plan", TaskError)
    start = plan.start if state is None else state
    arm = manipulator_for(plan, manipulator)
    started = evolve(plan, start=expect(start, State, "state", TaskError))
    return evolve(started, steps=tuple(_completed(started, arm)))


def manipulator_for(plan: Plan, manipulator: Manipulator | None) -> Manipulator:
    """The arm that a plan is for: the given one, or that of the stock robot."""
    arm = Manipulator.of(Baxter.load(), plan.limb) if manipulator is None else manipulator
    if expect(arm, Manipulator, "manipulator", TaskError).arm.side != plan.limb:
        raise TaskError(f"the plan is for the {plan.limb} arm, the manipulator is the other one")
    return arm


def tilt_of(plan: Plan, *, manipulator: Manipulator | None = None) -> float:
    """By how much a body leans on its way: the greatest angle from how it was first held, rad.

    The angle is that between the vertical and the axis of the body which was vertical at the start
    of the first move that carries it, at samples, 8 in each interval of a move. In a plan that
    grasps the body, that is how it was grasped. In a plan that begins with the body in the hand, it
    is how the body is held then, which may lean already. What a plan states of an upright axis is
    proven at every instant (`Upright`, `verify`).

    Args:
        plan: the plan.
        manipulator: the arm that it is for; that of the stock robot when not given.

    Raises:
        TaskError: as `complete`.
    """
    arm = manipulator_for(plan, manipulator)
    if any(step.state is None for step in plan):
        plan = complete(plan, manipulator=arm)
    tilt_rad, axes = 0.0, dict[str, tuple[float, ...]]()
    for move in plan.moves:
        held = state_of(move).holding(arm.arm.side)
        if held is None:
            axes.clear()
            continue
        T_base_tip = arm.arm.T_base_tip(move.trajectory.q_start)
        axis = axes.setdefault(held.body, tuple(T_base_tip.rotation[2].tolist()))
        tilt_rad = max(tilt_rad, max_tilt_rad(arm.arm, move.trajectory, axis))
    return tilt_rad


def move_contexts(plan: Plan, manipulator: Manipulator) -> tuple[CollisionContext, ...]:
    """The collision context of every move, as stated by its step; completes the plan if needed."""
    if any(step.state is None for step in plan):
        plan = complete(plan, manipulator=manipulator)
    return tuple(manipulator.at(state_of(move), move.contacts) for move in plan.moves)


def state_of(step: Step) -> State:
    """Robot and bodies at the beginning of a step of a complete plan."""
    if step.state is None:
        raise TaskError(f"{step.label}: the state is not known; complete the plan by complete()")
    return step.state


def after(step: Step, state: State, manipulator: Manipulator) -> State:
    """Robot and bodies at the end of a step that begins in a state."""
    robot, arm, hand = manipulator.robot, manipulator.arm, manipulator.hand
    if isinstance(step, Move):
        return state.moved(robot, arm.joints(step.trajectory.q_goal))
    held, T_base_tip = state.holding(arm.side), arm.T_base_tip(state.q(arm.joint_names))
    if step.action is GripperAction.OPEN:
        opening_m = hand.stroke_m if step.opening_m is None else step.opening_m
        opened = state.moved(robot, hand.finger_joints(min(opening_m, hand.stroke_m)))
        if held is None:
            return opened
        body = state.scene[held.body].at(T_base_tip * held.T_link_body)
        if step.receiver:
            return opened.released(body.name, body.T_base_body)
        landed = settle(body, list(state.scene.without(body.name))).body
        return opened.released(body.name, landed.T_base_body)
    if step.body is None:
        return state.moved(robot, hand.finger_joints(0.0))
    grasp = _grasp(step.label, step.body, state, manipulator)
    closed = state.held_by(arm.tip_frame, step.body, grasp.T_tip_body)
    return closed.moved(robot, hand.finger_joints(grasp.finger_m))


def during(contacts: Iterable[Contact], duration_s: float) -> tuple[Contact, ...]:
    """Contacts that last for a whole step."""
    return tuple(evolve(each, end_s=duration_s) for each in contacts)


def of_grip(grip: Grip, state: State, end: State, manipulator: Manipulator) -> tuple[Contact, ...]:
    """Contacts while the fingers act: of hand and body, and of a pushed body with its supports.

    Args:
        grip: the step.
        state: at its beginning.
        end: at its end.
        manipulator: the arm and its hand.
    """
    if grip.body is None:
        return ()
    arm, finger = manipulator.arm, manipulator.hand.joint_names[0]
    contacts = Contact.of_hand(arm.side, grip.body, may_press=True)
    body, ended = state.scene[grip.body], end.scene[grip.body]
    pushed_m = float(np.linalg.norm(ended.centre_base - body.centre_base))
    if grip.action is GripperAction.CLOSE and pushed_m > MIN_PUSH_M:
        contacts += Contact.of_supports(body.name, part_contacts(body, state.scene))
    way_m = abs(end.joints[finger] - state.joints[finger])
    return during(contacts, way_m / FINGER_SPEED_M_S)


def _completed(plan: Plan, manipulator: Manipulator) -> Iterator[Step]:
    state, side, steps = plan.start, manipulator.arm.side, plan.steps
    taken: State | None = state  # before the hand closed, until the first move after that
    released: str | None = None  # likewise, what it let go
    for step, following in zip(steps, (*steps[1:], None), strict=False):
        end, held = after(step, state, manipulator), state.holding(side)
        if isinstance(step, Grip):
            contacts = of_grip(step, state, end, manipulator)
            taken = state
            released = held.body if held and end.holding(side) is None else released
        else:
            if held is not None:
                is_put = isinstance(following, Grip) and following.action is GripperAction.OPEN
                touching = _of_held(held.body, [taken, end if is_put else None])
            elif step.is_straight and _is_close(following):
                touching = _of_hand(following.body, end, manipulator)
            else:
                touching = _of_hand(released if step.is_straight else None, state, manipulator)
            contacts = during(touching, step.trajectory.duration)
            taken = released = None
        yield evolve(step, state=state, contacts=contacts)
        state = end


def _is_close(step: Step | None) -> TypeGuard[Grip]:
    return isinstance(step, Grip) and step.action is GripperAction.CLOSE


def _of_held(name: str, states: Iterable[State | None]) -> tuple[Contact, ...]:
    """Contacts of a held body where it is picked up and where it is put down."""
    scenes = [state.scene for state in states if state is not None]
    return Contact.of_supports(name, set().union(*(part_contacts(s[name], s) for s in scenes)))


def _of_hand(name: str | None, state: State, manipulator: Manipulator) -> tuple[Contact, ...]:
    """Contacts of the open hand with a body that it grasps next, or has released."""
    if name is None:
        return ()
    arm, hand = manipulator.arm, manipulator.hand
    T_base_tip = arm.T_base_tip(state.q(arm.joint_names))
    room_m = hand.room_m(T_base_tip, state.joints[hand.joint_names[0]], state.scene[name])
    return Contact.of_hand(arm.side, name, may_press=room_m <= RESOLUTION_M)


def _grasp(label: str, name: str, state: State, manipulator: Manipulator) -> Grasp:
    arm, hand = manipulator.arm, manipulator.hand
    held, body = state.holding(arm.side), state.scene[name]
    if held is not None:
        raise TaskError(f"{label}: the fingers cannot close on {name}: the hand holds {held.body}")
    opening_m = state.joints[hand.joint_names[0]]
    grasp = hand.close_on(arm.T_base_tip(state.q(arm.joint_names)), body, opening_m)
    if isinstance(grasp, Miss):
        raise TaskError(f"{label}: the fingers cannot close on {name}: {grasp}")
    return grasp
