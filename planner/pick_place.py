"""Pick and place as stages, planned into one checked `Plan`.

```
pick    open - approach - descend - close - retract
place   approach - descend - open - retract
```

Approach and retract are `hover_m` above the pose, in the same orientation. Every waypoint gets one
IK result and one time-optimal move that stops there. Each move is checked for collision at samples
no farther apart than `SAMPLE_S`; what happens between samples is not proven.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from baxter_kin import Arm, Baxter, IKResult, IKService, JointLimits
from baxter_kin.arrays import Vector, finite_array, float_array, positive_scalar
from baxter_kin.errors import ConfigurationError
from baxter_kin.frames import checked_pose
from planner.collision import Clearance, ClearanceChecker, Held, RobotShapes, least
from planner.contact import touching
from planner.errors import SceneError, TaskError, expect
from planner.hand import Grasp, Hand
from planner.plan import Grip, GripperAction, Move, Plan, PlanFailure, Step
from planner.scene import Body, Scene
from planner.timing import plan_joint_move
from planner.trajectory import Trajectory

SAMPLE_S = 0.025
"""Longest time between two collision checks of a move."""


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


@dataclass(frozen=True, slots=True, eq=False)
class Manipulator:
    """What planning for one arm needs to know.

    Attributes:
        robot: the whole robot.
        arm: the arm that moves.
        ik: its inverse kinematics.
        hand: its fingers.
        shapes: the robot's collision shapes.
        limits: what its moves may use; the arm's own when made by `of`.
        q_others: a full configuration, shape (19,), that says where all other joints stand.
    """

    robot: Baxter
    arm: Arm
    ik: IKService
    hand: Hand
    shapes: RobotShapes
    limits: JointLimits
    q_others: Vector = field(repr=False)

    def __post_init__(self) -> None:
        """Check and copy."""
        joints = (len(self.robot.joint_names),)
        q_others = finite_array(self.q_others, joints, "q_others", ConfigurationError)
        object.__setattr__(self, "q_others", q_others)

    @classmethod
    def of(
        cls, robot: Baxter, limb: str, *, speed_ratio: float = 1.0, q_others: Vector | None = None
    ) -> Manipulator:
        """Everything for one limb, its velocity limits scaled by `speed_ratio` in (0, 1].

        Raises:
            UnknownNameError: when `limb` is neither "left" nor "right".
            LimitsError: when the ratio is outside (0, 1].
            ConfigurationError: when `q_others` has another shape or is not finite.
        """
        expect(robot, Baxter, "robot", TaskError)
        arm, shapes = robot.arm(limb), RobotShapes(robot)
        return cls(
            robot=robot,
            arm=arm,
            ik=IKService(arm),
            hand=Hand.of(robot, arm, shapes),
            shapes=shapes,
            limits=arm.limits.scaled(speed_ratio),
            q_others=robot.configuration() if q_others is None else q_others,
        )

    def configurations(self, qs: ArrayLike, finger_m: float) -> Iterator[Vector]:
        """Full configurations, shape (19,), for arm configurations, shape (m, 7).

        Raises:
            ConfigurationError: when `qs` has another shape, something is not finite, or the fingers
                are outside their stroke.
        """
        count = float_array(qs, "qs", ConfigurationError).size // 7
        fingers = self.hand.finger_joints(finger_m)
        full = np.array(self.q_others)
        full[list(self.robot.indices(tuple(fingers)))] = list(fingers.values())
        where = list(self.robot.indices(self.arm.joint_names))
        for q in finite_array(qs, (count, 7), "qs", ConfigurationError):
            full[where] = q
            yield full.copy()


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
    q_start = manipulator.arm.limits.check(q_start, "q_start")
    draft = _Draft(manipulator, scene, q_start)
    try:
        _pick_and_place(draft, task, body)
    except _NoSolutionError as stop:
        return Plan(manipulator.arm.side, q_start, tuple(draft.steps), stop.failure)
    return Plan(manipulator.arm.side, q_start, tuple(draft.steps))


def plan_start_move(
    manipulator: Manipulator, q_now: ArrayLike, q_start: ArrayLike | None = None
) -> Plan:
    """The way to where a task starts, then an open gripper.

    Args:
        manipulator: the arm and its hand.
        q_now: where the arm stands, shape (7,), rad.
        q_start: where it shall stand; every joint at zero when not given.

    Raises:
        ConfigurationError: when a configuration is malformed or outside the limits.
    """
    expect(manipulator, Manipulator, "manipulator", TaskError)
    goal = np.zeros(7) if q_start is None else q_start
    trajectory = plan_joint_move(q_now, goal, manipulator.limits)
    steps = (Move("move to start", trajectory), Grip("open", GripperAction.OPEN))
    return Plan(manipulator.arm.side, trajectory.q_start, steps)


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
        trajectory = plan_joint_move(self._q, ik.q, self._manipulator.limits)
        clearance = self._checked(label, trajectory)
        self.steps.append(Move(label, trajectory, T_base_tip, ik, clearance))
        self._q = ik.q

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

    def _checked(self, label: str, trajectory: Trajectory) -> Clearance | None:
        checker = self._checker = self._checker or ClearanceChecker(
            self._manipulator.shapes,
            self._manipulator.arm,
            self._scene,
            touchable=self._touchable,
            held=self._held,
        )
        times = np.linspace(0.0, trajectory.duration, 1 + int(trajectory.duration / SAMPLE_S) + 1)
        configurations = self._manipulator.configurations(
            trajectory.sample(times).q, self._finger_m
        )
        found = least(checker.clearance(q) for q in configurations)
        if found is not None and found.distance_m <= 0.0:
            depth = -1e3 * found.distance_m
            raise _NoSolutionError(
                label, f"{found.first} would be {depth:.1f} mm inside {found.second}"
            )
        return found


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
