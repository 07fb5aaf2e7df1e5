"""Pick and place as stages, planned into one checked `Plan`.

```
pick    open - approach - descend - close - retract
place   approach - descend - open - retract
```

Approach and retract are `hover_m` above the pose, in the same orientation. Every waypoint gets one
IK result and one time-optimal move that stops there. Each move is proven free of collision at every
instant (`planner.swept`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin import IKResult
from baxter_kin.arrays import Vector, positive_scalar
from baxter_kin.errors import expect
from baxter_kin.frames import checked_pose
from planner.collision import ClearanceChecker, Held
from planner.contact import stands, touching
from planner.errors import MotionError, SceneError, TaskError
from planner.hand import Grasp
from planner.manipulator import Manipulator
from planner.plan import Grip, GripperAction, Move, Plan, PlanFailure, Step
from planner.scene import Body, Scene
from planner.situation import Situation
from planner.swept import prove_clear
from planner.swept_result import SweptContact, SweptProof
from planner.timing import plan_joint_move
from planner.trajectory import Trajectory

LONGEST_DROP_M = 0.01
"""From how high above its support a body may be let go."""


@dataclass(frozen=True, slots=True, eq=False)
class PickAndPlace:
    """One pick and one place.

    Attributes:
        body: name of the body to carry.
        T_base_pick: tip pose when the fingers close.
        T_base_place: tip pose when they open again.
        hover_m: height of the approach and retract poses above these, above zero.

    Raises:
        TaskError: when `body` is no name, or `hover_m` is not a number above zero.
        PoseError: when a pose is none.
    """

    body: str
    T_base_pick: pin.SE3
    T_base_place: pin.SE3
    hover_m: float = 0.15

    def __post_init__(self) -> None:
        """Check and copy."""
        expect(self.body, str, "name of the body", TaskError)
        positive_scalar(self.hover_m, "hover distance", TaskError)
        for name in ("T_base_pick", "T_base_place"):
            object.__setattr__(self, name, checked_pose(getattr(self, name)))


def plan_pick_and_place(
    task: PickAndPlace, manipulator: Manipulator, scene: Scene, q_start: ArrayLike
) -> Plan:
    """Every step from `q_start` until the arm has retracted from the placed body.

    Args:
        task: what goes where.
        manipulator: the arm and its hand.
        scene: all bodies, the one to carry among them.
        q_start: where the arm stands, shape (7,), rad.

    Returns:
        A plan; when a step has no solution, an invalid one that says which and why.

    Raises:
        SceneError: when the body is not in the scene.
        TaskError: when it cannot be moved.
        ConfigurationError: when `q_start` is malformed or outside the limits.
    """
    expect(task, PickAndPlace, "task", TaskError)
    expect(manipulator, Manipulator, "manipulator", TaskError)
    expect(scene, Scene, "scene", SceneError)
    body = scene[task.body]
    if not body.is_movable:
        raise TaskError(f"{body.name!r} is not movable, so it cannot be picked")
    now = manipulator.arm.limits.check(q_start, "q_start")
    return _drafted(manipulator, scene, now, lambda draft: _pick_and_place(draft, task, body))


def plan_start_move(
    manipulator: Manipulator,
    scene: Scene,
    q_now: ArrayLike,
    q_start: ArrayLike | None = None,
) -> Plan:
    """The way to where a task starts, then an open gripper.

    Args:
        manipulator: the arm and its hand, which is empty.
        scene: all bodies.
        q_now: where the arm stands, shape (7,), rad.
        q_start: where it shall stand; every joint at zero when not given.

    Returns:
        A plan; when the way collides, an invalid one that says with what.

    Raises:
        ConfigurationError: when a configuration is malformed or outside the limits.
    """
    expect(manipulator, Manipulator, "manipulator", TaskError)
    expect(scene, Scene, "scene", SceneError)
    goal = np.zeros(7) if q_start is None else q_start
    now = manipulator.arm.limits.check(q_now, "q_now")
    checked_goal = manipulator.arm.limits.check(goal, "q_start")

    def steps(draft: _Draft) -> None:
        draft.move_joints("move to start", checked_goal)
        draft.grip("open", GripperAction.OPEN)

    return _drafted(manipulator, scene, now, steps)


def _drafted(
    manipulator: Manipulator, scene: Scene, q_start: Vector, steps: Callable[[_Draft], None]
) -> Plan:
    """The plan of some steps, or of those before the first that has no solution."""
    draft, failure = _Draft(manipulator, scene, q_start), None
    try:
        steps(draft)
    except _NoSolutionError as stop:
        failure = stop.failure
    situation = Situation.of(manipulator, scene)
    return Plan(manipulator.arm.side, q_start, tuple(draft.steps), failure, situation)


def _pick_and_place(draft: _Draft, task: PickAndPlace, body: Body) -> None:
    above_pick, above_place = _above(task.T_base_pick, task), _above(task.T_base_place, task)
    draft.refuse_wide("pick: open", task.T_base_pick, body)
    draft.grip("pick: open", GripperAction.OPEN)
    draft.move("pick: approach", above_pick)
    draft.move("pick: descend", task.T_base_pick)
    draft.grasp("pick: close", task, body)
    draft.move("pick: retract", above_pick)
    draft.move("place: approach", above_place)
    draft.move("place: descend", task.T_base_place)
    draft.release("place: open", task.T_base_place)
    draft.move("place: retract", above_place)


def _above(T_base_tip: pin.SE3, task: PickAndPlace) -> pin.SE3:
    lift = np.array([0.0, 0.0, task.hover_m])
    return pin.SE3(T_base_tip.rotation, T_base_tip.translation + lift)


class _NoSolutionError(Exception):
    """Ends the drafting of a plan; becomes `Plan.failure`."""

    def __init__(self, stage: str, reason: str, ik: IKResult | None = None) -> None:
        self.failure = PlanFailure(stage, reason, ik)
        super().__init__(str(self.failure))


class _Draft:
    """A plan while it is being made: the steps so far, and the situation after them."""

    def __init__(self, manipulator: Manipulator, scene: Scene, q_start: Vector) -> None:
        self.steps: list[Step] = []
        self._manipulator = manipulator
        self._q = q_start
        self._scene = scene
        self._finger_m = manipulator.hand.stroke_m
        self._held: Held | None = None
        self._touchable: str | None = None
        self._checker: ClearanceChecker | None = None

    def refuse_wide(self, stage: str, T_base_tip: pin.SE3, body: Body) -> None:
        """Stop here when the hand cannot open wide enough for the body."""
        hand = self._manipulator.hand
        width = hand.width_across_m(T_base_tip, body)
        if width > hand.open_gap_m:
            raise _NoSolutionError(
                stage,
                f"{body.name} measures {1e3 * _least_width_m(body):.1f} mm, "
                f"{1e3 * width:.1f} mm across the hand as it lies, but the {hand.side} hand opens "
                f"only {1e3 * hand.open_gap_m:.1f} mm",
            )
        self._touchable = body.name

    def grip(self, label: str, action: GripperAction, body: str | None = None) -> None:
        """Add a gripper action."""
        self.steps.append(Grip(label, action, body))

    def move(self, label: str, T_base_tip: pin.SE3) -> None:
        """Add the move to a pose."""
        ik = self._manipulator.ik.solve(T_base_tip, current=self._q)
        if not ik.is_valid:
            raise _NoSolutionError(label, str(ik.failure), ik)
        self.move_joints(label, ik.q, T_base_tip, ik)

    def move_joints(
        self,
        label: str,
        q_goal: Vector,
        T_base_tip: pin.SE3 | None = None,
        ik: IKResult | None = None,
    ) -> None:
        """Add the move to a configuration, and what asked for it."""
        try:
            trajectory = plan_joint_move(self._q, q_goal, self._manipulator.limits)
        except MotionError as cause:
            raise _NoSolutionError(label, str(cause), ik) from cause
        proof = self._proven(label, trajectory)
        self.steps.append(Move(label, trajectory, T_base_tip, ik, proof.nearest, proof))
        self._q = q_goal

    def grasp(self, label: str, task: PickAndPlace, body: Body) -> None:
        """Add the closing of the fingers around the body."""
        T_base_tip, T_base_place = task.T_base_pick, task.T_base_place
        grasp = self._manipulator.hand.grasp(T_base_tip, body, self._finger_m)
        if grasp is None:
            raise _NoSolutionError(label, _miss(T_base_tip, body))
        self.grip(label, GripperAction.CLOSE, body.name)
        self._hold(body, grasp, T_base_place)

    def release(self, label: str, T_base_tip: pin.SE3) -> None:
        """Add the opening of the fingers, which leaves the body where it is."""
        if self._held is None:
            raise TaskError("nothing is held, so nothing can be released")
        body = self._held.body.at(T_base_tip * self._held.T_tip_body)
        if not stands(body, self._scene, LONGEST_DROP_M):
            raise _NoSolutionError(
                label,
                f"{body.name} would fall: nothing is within {1e3 * LONGEST_DROP_M:.0f} mm below it",
            )
        self.grip(label, GripperAction.OPEN, body.name)
        self._scene, self._touchable = self._scene.with_body(body), body.name
        self._held, self._checker = None, None
        self._finger_m = self._manipulator.hand.stroke_m

    def _hold(self, body: Body, grasp: Grasp, T_base_place: pin.SE3) -> None:
        self._scene, self._touchable = self._scene.without(body.name), None
        placed = body.at(T_base_place * grasp.T_tip_body)
        supports = touching(body, self._scene) | touching(placed, self._scene)
        self._held, self._checker = Held(body, grasp.T_tip_body, supports), None
        self._finger_m = grasp.finger_m

    def _proven(self, label: str, trajectory: Trajectory) -> SweptProof:
        checker = self._checker = self._checker or ClearanceChecker(
            self._manipulator.shapes,
            self._manipulator.arm,
            self._scene,
            touchable=self._touchable,
            held=self._held,
        )
        others = next(self._manipulator.configurations(trajectory.q[:1], self._finger_m))
        result = prove_clear(checker, trajectory, others)
        if isinstance(result, SweptContact):
            raise _NoSolutionError(label, str(result))
        return result


def _miss(T_base_tip: pin.SE3, body: Body) -> str:
    offset = T_base_tip.actInv(body.centre_base)
    across = 1e3 * float(np.hypot(offset[0], offset[1]))
    return (
        f"the fingers would close on nothing: {body.name} is {across:.0f} mm beside the tip and "
        f"{1e3 * offset[2]:.0f} mm ahead of it"
    )


def _least_width_m(body: Body) -> float:
    """The narrowest of the body's three extents along its own axes."""
    spans = [body.extent_m(axis) for axis in body.T_base_body.rotation.T]
    return min(high - low for low, high in spans)
