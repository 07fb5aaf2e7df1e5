"""The world through a plan: what the hand holds when, how far it is open, and what stands where.

The gripper's actions cut a plan into runs of moves; within a run nothing but the arm changes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import pinocchio as pin

from planner.plan import Grip, GripperAction, Move, Plan
from planner.scene import Body, Scene
from planner.situation import Situation
from planner.verification.fingers import Closing, Fingers
from planner.verification.urdf_robot import UrdfRobot


@dataclass(frozen=True, slots=True, eq=False)
class Carried:
    """A body in the hand.

    Attributes:
        body: what is held, where it stood before.
        T_tip_body: where it is seen from the tip.
    """

    body: Body
    T_tip_body: pin.SE3


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """Moves between two gripper actions.

    Attributes:
        moves: in order; there may be none.
        scene: the bodies that stand still meanwhile.
        finger_m: how far the hand is open.
        carried: what it holds.
        released: name of the body that it let go right before.
        wanted: name of the body that it closes on right after.
        is_put_down: whether it lets the carried body go right after.
    """

    moves: tuple[Move, ...]
    scene: Scene
    finger_m: float
    carried: Carried | None = None
    released: str | None = None
    wanted: str | None = None
    is_put_down: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class GraspEvent:
    """The hand closes on a body: where both are, how far it is open, and how that ends."""

    label: str
    T_base_tip: pin.SE3
    body: Body
    opening_m: float
    closing: Closing


@dataclass(frozen=True, slots=True, eq=False)
class ReleaseEvent:
    """The hand lets a body go: where it is, and the bodies around."""

    label: str
    T_base_tip: pin.SE3
    body: Body
    scene: Scene


class Story:
    """A plan followed step by step.

    Attributes:
        runs: moves between gripper actions.
        grasps: where the hand closes on a body.
        releases: where it lets one go.
        faults: gripper actions that contradict what the hand holds or what there is.
    """

    def __init__(self, plan: Plan, situation: Situation, robot: UrdfRobot, fingers: Fingers):
        """Follow the plan to its end."""
        self.runs: list[Run] = []
        self.grasps: list[GraspEvent] = []
        self.releases: list[ReleaseEvent] = []
        self.faults: list[str] = []
        self._robot, self._fingers = robot, fingers
        self._standing = robot.standing(situation.joints)
        self._q = plan.q_start
        self._run = Run((), situation.scene, robot.opening(self._standing))
        for step in plan.steps:
            if isinstance(step, Move):
                self._run = replace(self._run, moves=(*self._run.moves, step))
                self._q = step.trajectory.q[-1]
            else:
                self._grip(step)
        self.runs.append(self._run)

    def _grip(self, grip: Grip) -> None:
        T_base_tip = self._robot.T_base_tip(self._standing, self._q)
        if grip.action is GripperAction.CLOSE:
            self._close(grip, T_base_tip)
        else:
            self._open(grip, T_base_tip)

    def _close(self, grip: Grip, T_base_tip: pin.SE3) -> None:
        scene, carried = self._run.scene, self._run.carried
        if carried is not None:
            self._fault(grip, f"the hand already holds {carried.body.name}")
        elif grip.body is None:
            self._next(Run((), scene, 0.0))
        elif grip.body not in scene.bodies or not scene.bodies[grip.body].is_movable:
            self._fault(grip, f"there is no movable body {grip.body!r}")
        else:
            self._grasp(grip.label, T_base_tip, scene[grip.body])

    def _grasp(self, label: str, T_base_tip: pin.SE3, body: Body) -> None:
        T_tip_body = T_base_tip.inverse() * body.T_base_body
        closing = self._fingers.closing(body, T_tip_body, self._run.finger_m)
        self.grasps.append(GraspEvent(label, T_base_tip, body, self._run.finger_m, closing))
        scene, self._run = self._run.scene, replace(self._run, wanted=body.name)
        if not closing.is_hold:
            self._next(Run((), scene, closing.finger_m))
            return
        carried = Carried(body, closing.T_tip_body)
        self._next(Run((), scene.without(body.name), closing.finger_m, carried))

    def _open(self, grip: Grip, T_base_tip: pin.SE3) -> None:
        scene, carried, stroke = self._run.scene, self._run.carried, self._robot.stroke_m
        name = None if carried is None else carried.body.name
        if grip.body != name:
            holds = "nothing" if name is None else name
            self._fault(grip, f"the hand holds {holds}, not {grip.body or 'nothing'}")
        if carried is None:
            self._next(Run((), scene, stroke))
            return
        body = carried.body.at(T_base_tip * carried.T_tip_body)
        self.releases.append(ReleaseEvent(grip.label, T_base_tip, body, scene))
        self._run = replace(self._run, is_put_down=True)
        self._next(Run((), scene.with_body(body), stroke, released=body.name))

    def _next(self, run: Run) -> None:
        self.runs.append(self._run)
        self._run = run

    def _fault(self, grip: Grip, reason: str) -> None:
        self.faults.append(f"{grip.label}: {reason}")
