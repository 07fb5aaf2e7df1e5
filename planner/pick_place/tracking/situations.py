"""The situation of every move of a plan: what stands where, what is held, what may be touched.

A plan holds its steps and the world before them. What follows from these for each move is what
`planner.pick_place.phases` found when the plan was made, found once more from the plan alone:

- on the straight line right before the fingers close on a body, and on the one right after they let
  it go, the hand may come near it, and its pads touch it where they cannot but;
- what is held may touch what it stood on in the first move, and what it will stand on in the last.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pinocchio as pin

from planner.collision.context import CollisionContext
from planner.collision.continuous.proof import RESOLUTION_M
from planner.errors import TaskError
from planner.grasping.grasp import Miss
from planner.manipulator import Manipulator
from planner.plan import Grip, GripperAction, Move, Plan
from planner.scene.contact import gap_m, touching
from planner.scene.held import Held
from planner.scene.support import land, levelled
from planner.situation import Situation


def contexts_of(plan: Plan, manipulator: Manipulator) -> tuple[CollisionContext, ...]:
    """The situation of every move, in order.

    Args:
        plan: which says its situation.
        manipulator: the arm and its hand.

    Raises:
        TaskError: when the plan does not say it, or a gripper action contradicts it.
    """
    if plan.situation is None:
        raise TaskError("the plan does not say for which situation it was made; plan again")
    joints = manipulator.robot.configuration(dict(plan.situation.joints))
    return tuple(_Hand(plan, replace(manipulator, q_others=joints), plan.situation).contexts())


class _Hand:
    """What the hand does, step by step."""

    def __init__(self, plan: Plan, manipulator: Manipulator, situation: Situation) -> None:
        self._plan, self._manipulator = plan, manipulator
        self._scene, self._finger_m = situation.scene, manipulator.finger_m
        self._held = next((held for held in situation.held if held.side == plan.limb), None)
        self._stood = self._supports()
        self._released: str | None = None
        self._tip = manipulator.arm.T_base_tip(plan.q_start)

    def contexts(self) -> Iterator[CollisionContext]:
        """The situation of each move."""
        steps = self._plan.steps
        for number, step in enumerate(steps):
            after = steps[number + 1] if number + 1 < len(steps) else None
            if isinstance(step, Grip):
                self._act(step)
            else:
                yield self._context(step, after if isinstance(after, Grip) else None)
                self._tip = self._manipulator.arm.T_base_tip(step.trajectory.q_goal)
                self._stood, self._released = frozenset(), None

    def _context(self, move: Move, after: Grip | None) -> CollisionContext:
        goal = self._manipulator.arm.T_base_tip(move.trajectory.q_goal)
        if self._held is not None:
            supports = self._stood
            if after is not None and after.action is GripperAction.OPEN:
                placed = self._scene[self._held.body].at(goal * self._held.T_tip_body)
                supports |= touching(placed, self._scene.without(placed.name))
            return self._manipulator.context(
                self._scene, finger_m=self._finger_m, held=self._held, supports=supports
            )
        if move.is_straight and after is not None and after.action is GripperAction.CLOSE:
            return self._near(after.body, goal)
        return self._near(self._released if move.is_straight else None, self._tip)

    def _near(self, body: str | None, T_base_tip: pin.SE3) -> CollisionContext:
        """With a body that the open hand may come near, if there is one."""
        finger_m = self._finger_m
        if body is None:
            return self._manipulator.context(self._scene, finger_m=finger_m)
        pads = self._manipulator.hand.pads_at(T_base_tip, finger_m)
        parts = self._scene[body].placed_parts
        may_press = min(gap_m(pad, part) for pad in pads for part in parts) <= RESOLUTION_M
        return self._manipulator.context(
            self._scene, finger_m=finger_m, touchable=body, may_press=may_press
        )

    def _supports(self) -> frozenset[str]:
        """What the held body touches where it is."""
        if self._held is None:
            return frozenset()
        return touching(self._scene[self._held.body], self._scene)

    def _act(self, grip: Grip) -> None:
        if grip.action is GripperAction.OPEN:
            self._open(grip)
        elif grip.body is None:
            self._finger_m = 0.0
        else:
            self._close(grip.label, grip.body)

    def _close(self, label: str, name: str) -> None:
        body = self._scene[name]
        grasp = self._manipulator.hand.close_on(self._tip, body, self._finger_m)
        if self._held is not None or isinstance(grasp, Miss):
            reason = grasp if isinstance(grasp, Miss) else f"the hand holds {self._held}"
            raise TaskError(f"{label}: the fingers cannot close on {name}: {reason}")
        self._held = Held(self._plan.limb, name, grasp.T_tip_body)
        self._finger_m, self._stood = grasp.finger_m, self._supports()

    def _open(self, grip: Grip) -> None:
        stroke_m = self._manipulator.hand.stroke_m
        self._finger_m = stroke_m if grip.opening_m is None else min(grip.opening_m, stroke_m)
        if self._held is not None:
            body = self._scene[self._held.body].at(self._tip * self._held.T_tip_body)
            others = self._scene.without(body.name)
            self._scene = others.with_body(land(levelled(body), others).body)
            self._held, self._released = None, body.name
