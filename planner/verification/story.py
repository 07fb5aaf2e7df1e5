"""The world through a plan: what the hand holds when, how far it is open, and what stands where.

The gripper's actions cut a plan into runs of moves, in which nothing but the arm changes, and
travels of the fingers, in which nothing changes but them and what they push.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from baxter_kin.errors import quoted
from baxter_kin.validation import FloatArray
from planner.plan import Grip, GripperAction, Move, Plan
from planner.scene.attachment import Attachment
from planner.scene.bodies import Body, Scene
from planner.state import State
from planner.verification.fingers import ClosingFingers, Fingers, drop_m
from planner.verification.urdf_robot import UrdfRobot

MOST_DROP_M = 0.02
"""A body that falls farther is left where it was let go: a check of its own refuses that."""


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
        q_start: where the arm stands before them, shape (7,), rad.
        moves: in order; there may be none.
        scene: the bodies that stand still meanwhile.
        finger_m: how far the hand is open.
        carried: what it holds.
        released: name of the body that it let go right before.
        wanted: name of the body that it closes on right after.
        is_put_down: whether it lets the carried body go right after.
    """

    q_start: FloatArray
    moves: tuple[Move, ...]
    scene: Scene
    finger_m: float
    carried: Carried | None = None
    released: str | None = None
    wanted: str | None = None
    is_put_down: bool = False

    @property
    def q(self) -> FloatArray:
        """Where the arm stands after the moves, shape (7,), rad."""
        last: FloatArray = self.moves[-1].trajectory.q[-1] if self.moves else self.q_start
        return last


@dataclass(frozen=True, slots=True, eq=False)
class FingerMove:
    """The fingers close or open while the arm stands still.

    Attributes:
        grip: the gripper action.
        q_arm: where the arm stands, shape (7,), rad.
        scene: the bodies that stand still; the one between the fingers is not among them.
        between: the body that the fingers close on or let go, where it is at the beginning.
        begin_m: how far they are open then.
        touch_m: how far when the first one touches and begins to push.
        end_m: how far at the end.
        push_m: how far the body is pushed by then, along y of the tip.
    """

    grip: Grip
    q_arm: FloatArray
    scene: Scene
    between: Carried | None
    begin_m: float
    touch_m: float
    end_m: float
    push_m: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class GraspEvent:
    """The hand closes on a body: where both are, how far it is open, and how that ends."""

    number: int
    label: str
    T_base_tip: pin.SE3
    body: Body
    opening_m: float
    closing: ClosingFingers


@dataclass(frozen=True, slots=True, eq=False)
class ReleaseEvent:
    """The hand lets a body go: where it is, and the bodies around."""

    number: int
    label: str
    T_base_tip: pin.SE3
    body: Body
    scene: Scene


Stage: TypeAlias = Run | FingerMove


class Story:
    """A plan followed step by step.

    Attributes:
        stages: runs of moves and travels of fingers, in order.
        grasps: where the hand closes on a body.
        releases: where it lets one go.
        faults: gripper actions that contradict what the hand holds or what there is.
        scene: the bodies that stand by themselves at first.
        elsewhere: what the other hand holds, where that is.
        others_hold: the same, as attachments.
        apart_m: how far each body that a hand holds stands, in the scene, from where the hand is.
        runs: the run, as far as it goes before each step of the plan, and at the end.
        standing: where all joints are at first, as `UrdfRobot` orders them.
    """

    def __init__(self, plan: Plan, state: State, robot: UrdfRobot, fingers: Fingers):
        self.stages: list[Stage] = []
        self.grasps: list[GraspEvent] = []
        self.releases: list[ReleaseEvent] = []
        self.faults: list[str] = []
        self.elsewhere: list[Body] = []
        self.others_hold: list[Attachment] = []
        self.runs: list[Run] = []
        self.apart_m: dict[str, float] = {}
        self._robot, self._fingers = robot, fingers
        self.standing = robot.standing(state.joints)
        self._run = self._begin(plan.q_start, state)
        self.scene = self._run.scene
        if self._run.carried is not None:
            self._hold(self._run.carried)
        for self._number, step in enumerate(plan.steps):
            self.runs.append(self._run)
            if isinstance(step, Move):
                self._run = replace(self._run, moves=(*self._run.moves, step))
            else:
                self._grip(step)
        self.stages.append(self._run)
        self.runs.append(self._run)

    def _begin(self, q_start: FloatArray, state: State) -> Run:
        """What the hands hold is no part of the scene."""
        scene, carried = state.scene, None
        for holding in state.attachments:
            body = scene[holding.body]
            is_own = holding.side == self._robot.limb
            T_base_tip = (
                self._robot.T_base_tip(self.standing, q_start)
                if is_own
                else self._robot.T_base_other_tip(self.standing, holding.side)
            )
            placed = body.at(T_base_tip * holding.T_link_body)
            self.apart_m[body.name] = _apart_m(body.T_base_body, placed.T_base_body)
            scene = scene.without(body.name)
            if is_own:
                carried = Carried(body, holding.T_link_body)
            else:
                self.elsewhere.append(placed)
                self.others_hold.append(holding)
        return Run(q_start, (), scene, self._robot.opening(self.standing), carried)

    def _hold(self, carried: Carried) -> None:
        """What the hand holds from the start it holds as after closing on it."""
        run, grip = self._run, Grip("start", GripperAction.CLOSE, carried.body.name)
        at = (run.finger_m, run.finger_m, run.finger_m)
        self.stages.append(FingerMove(grip, run.q_start, run.scene, carried, *at))

    def _grip(self, grip: Grip) -> None:
        T_base_tip = self._robot.T_base_tip(self.standing, self._run.q)
        if grip.action is GripperAction.CLOSE:
            self._close(grip, T_base_tip)
        else:
            self._open(grip, T_base_tip)

    def _close(self, grip: Grip, T_base_tip: pin.SE3) -> None:
        run = self._run
        if run.carried is not None:
            self._fault(grip, f"the hand already holds {run.carried.body.name}")
        elif grip.body is None:
            self._travel(grip, run.scene, None, 0.0)
            self._next(run.scene, 0.0)
        elif grip.body not in run.scene.bodies or not run.scene.bodies[grip.body].is_movable:
            self._fault(grip, f"there is no movable body {quoted(grip.body)}")
        else:
            self._grasp(grip, T_base_tip, run.scene[grip.body])

    def _grasp(self, grip: Grip, T_base_tip: pin.SE3, body: Body) -> None:
        run, T_tip_body = self._run, T_base_tip.inverse() * body.T_base_body
        closing = self._fingers.closing(body, T_tip_body, run.finger_m)
        self.grasps.append(
            GraspEvent(self._number, grip.label, T_base_tip, body, run.finger_m, closing)
        )
        self._run, rest = replace(run, wanted=body.name), run.scene.without(body.name)
        self._travel(grip, rest, Carried(body, T_tip_body), closing.finger_m, closing)
        if closing.is_hold:
            self._next(rest, closing.finger_m, Carried(body, closing.T_tip_body))
        else:
            self._next(run.scene, closing.finger_m)

    def _open(self, grip: Grip, T_base_tip: pin.SE3) -> None:
        run, carried = self._run, self._run.carried
        name = None if carried is None else carried.body.name
        if grip.body != name:
            holds = "nothing" if name is None else name
            self._fault(grip, f"the hand holds {holds}, not {grip.body or 'nothing'}")
        end_m = self._opening(grip)
        self._travel(grip, run.scene, carried, end_m)
        if carried is None:
            self._next(run.scene, end_m)
            return
        body = carried.body.at(T_base_tip * carried.T_tip_body)
        self.releases.append(ReleaseEvent(self._number, grip.label, T_base_tip, body, run.scene))
        self.stages[-2] = replace(run, is_put_down=True)
        landed = self._landed(body, run.scene)
        self._next(run.scene.with_body(landed), end_m, released=body.name)

    def _landed(self, body: Body, scene: Scene) -> Body:
        """Where a body that is let go comes to rest: straight below, on the first that it meets."""
        falls = [drop_m(body, below, MOST_DROP_M) for below in (*scene, *self.elsewhere)]
        T = pin.SE3(body.T_base_body)
        fall_m = min(falls, default=math.inf)
        if math.isfinite(fall_m):
            T.translation = T.translation - np.array([0.0, 0.0, fall_m])
        return body.at(T)

    def _opening(self, grip: Grip) -> float:
        """How far an open goes; it must be within the stroke, and further than what is held."""
        if grip.opening_m is None:
            return self._robot.stroke_m
        asked, stroke = 1e3 * grip.opening_m, 1e3 * self._robot.stroke_m
        if grip.opening_m > self._robot.stroke_m:
            self._fault(grip, f"it opens to {asked:.3f} mm, its stroke is {stroke:.3f} mm")
        if self._run.carried is not None and grip.opening_m <= self._run.finger_m:
            now = 1e3 * self._run.finger_m
            self._fault(grip, f"at {asked:.3f} mm it lets nothing go, as it holds at {now:.3f} mm")
        return min(grip.opening_m, self._robot.stroke_m)

    def _travel(
        self,
        grip: Grip,
        scene: Scene,
        between: Carried | None,
        end_m: float,
        closing: ClosingFingers | None = None,
    ) -> None:
        """The run so far ends, and the fingers travel."""
        begin_m = self._run.finger_m
        touch_m, push_m = (end_m, 0.0) if closing is None else (closing.touch_m, closing.push_m)
        travel = FingerMove(grip, self._run.q, scene, between, begin_m, touch_m, end_m, push_m)
        self.stages += [self._run, travel]

    def _next(
        self,
        scene: Scene,
        finger_m: float,
        carried: Carried | None = None,
        released: str | None = None,
    ) -> None:
        """A new run begins where the arm stands."""
        self._run = Run(self._run.q, (), scene, finger_m, carried, released)

    def _fault(self, grip: Grip, reason: str) -> None:
        self.faults.append(f"{grip.label}: {reason}")


def _apart_m(first: pin.SE3, second: pin.SE3) -> float:
    """How far apart two poses put a body's origin, or the ends of its axes of a metre each."""
    ends = np.eye(4)
    ends[3] = 1.0
    apart: FloatArray = (first.homogeneous - second.homogeneous) @ ends
    return float(np.linalg.norm(apart, axis=0).max())
