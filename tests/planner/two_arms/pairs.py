"""Pairs of tasks on the table, and an independent measurement of what both arms keep."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from baxter_kin import Baxter, pose_from_quaternion
from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from planner import (
    Body,
    Box,
    Grip,
    Handover,
    Manipulator,
    Move,
    Part,
    PickAndPlace,
    Plan,
    Scene,
    State,
    TwoArmPlan,
    load_object,
    plan_start_move,
)
from planner.collision.robot.robot_shapes import RobotShapes
from planner.completion import after, complete, state_of
from planner.two_arms.tracking.clocked_arm import alone
from tests.conftest import at

SIDES = "left", "right"
SIZE_M, TABLE_Z_M = 0.045, -0.155
DOWN = pose_from_quaternion((0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))
Spot = tuple[float, float, float]
"""x and y in base, m, and yaw, rad, of a block on the table."""


class PairOfTasks(NamedTuple):
    """One task of each arm, and robot and bodies before both."""

    tasks: dict[str, PickAndPlace]
    manipulators: dict[str, Manipulator]
    state: State

    @property
    def arguments(self) -> tuple[dict[str, PickAndPlace], dict[str, Manipulator], State]:
        """Those of `plan_together`."""
        return self.tasks, self.manipulators, self.state


def on_table(x: float, y: float, yaw: float = 0.0) -> pin.SE3:
    """The pose of a block on the table."""
    return pin.SE3(pin.utils.rotate("z", yaw), np.array([x, y, TABLE_Z_M + SIZE_M / 2]))


def block(name: str, spot: Spot) -> Body:
    """A block of 45 mm on the table."""
    part = Part(Box((SIZE_M,) * 3), pin.SE3.Identity())
    return Body(name, (part,), on_table(*spot), is_movable=True)


def carry(name: str, pick: Spot, place: Spot, hover_m: float = 0.15) -> PickAndPlace:
    """Carry a block with a vertical hand."""
    return PickAndPlace(name, on_table(*pick) * DOWN, on_table(*place) * DOWN, hover_m)


def pair(
    manipulators: Mapping[str, Manipulator], left: tuple[Spot, Spot], right: tuple[Spot, Spot]
) -> PairOfTasks:
    """Each arm carries its block from one spot to another, from where it starts in the demo."""
    ends = dict(zip(SIDES, (left, right), strict=True))
    bodies = [block(side, pick) for side, (pick, _) in ends.items()]
    tasks = {side: carry(side, *spots) for side, spots in ends.items()}
    scene = Scene.of([load_object("table", at(1.0, 0.0, -0.93)), *bodies])
    return PairOfTasks(tasks, dict(manipulators), started(manipulators, scene))


def one_move_each(
    plan: TwoArmPlan,
    manipulators: Mapping[str, Manipulator],
    turns: Mapping[str, tuple[float, float]],
) -> TwoArmPlan:
    """A move of each arm at the same time, without bodies that move; its proof is another plan's.

    Args:
        plan: where the arms start, and what stands around them.
        manipulators: of both arms.
        turns: of the first joint of each arm from there, at the start and at the goal, rad.
    """
    joints = dict(plan.start.joints)
    ends = {
        side: [plan.plans[side].q_start + turn * np.eye(7)[0] for turn in turns[side]]
        for side in SIDES
    }
    for side in SIDES:
        joints |= manipulators[side].arm.joints(ends[side][0])
    scene = Scene.of(body for body in plan.start.scene if not body.is_movable)
    there = evolve(plan, start=State(scene, joints))
    plans = {}
    for side in SIDES:
        manipulator = alone(there, side, manipulators[side])
        way = plan_start_move(manipulator, scene, *ends[side])
        assert way.failure is None, way.failure
        step = evolve(way.moves[0], label="go", state=None, contacts=())
        bare = Plan(there.start, (step,), robot=manipulator.identity)
        plans[side] = complete(bare, manipulator=manipulator)
    return evolve(there, plans=plans, begins_s=dict.fromkeys(SIDES, (0.0,)))


class HandoverCase(NamedTuple):
    """The arguments of `plan_handover`."""

    task: Handover
    manipulators: dict[str, Manipulator]
    state: State


def handover_of_stick(
    manipulators: Mapping[str, Manipulator], size_m: tuple[float, float, float] = (0.12, 0.04, 0.04)
) -> HandoverCase:
    """A stick that lies on the left side of a bench, and is to stand on the right side."""
    bench = Body(
        "bench", (Part(Box((0.9, 2.0, 0.06)), pin.SE3.Identity()),), at(0.95, 0.0, TABLE_Z_M - 0.03)
    )
    lies = pin.SE3(pin.utils.rotate("z", -1.6), np.array([0.65, 0.35, TABLE_Z_M + size_m[2] / 2]))
    up = pin.utils.rotate("y", -np.pi / 2)
    stands = pin.SE3(up, np.array([0.6, -0.65, TABLE_Z_M + size_m[0] / 2]))
    stick = Body("stick", (Part(Box(size_m), pin.SE3.Identity()),), lies, is_movable=True)
    state = started(manipulators, Scene.of([bench, stick]))
    return HandoverCase(Handover("stick", stands), dict(manipulators), state)


def started(manipulators: Mapping[str, Manipulator], scene: Scene) -> State:
    """Both arms where they start in the demo, the hands open."""
    robot, q = manipulators["left"].robot, manipulators["left"].q_others
    joints = dict(zip(robot.joint_names, q.tolist(), strict=True))
    for manipulator in manipulators.values():
        joints |= manipulator.arm.joints(manipulator.arm.start)
    return State(scene, joints)


class Measured:
    """Both arms of a plan at single times, placed by Pinocchio, and tested by coal pair by pair.

    Nothing of the planner's is used but the steps of both plans, the states that they say, and the
    shapes of links and bodies. While fingers travel, they and the body that they push may be
    anywhere between the ends of the step.
    """

    def __init__(self, plan: TwoArmPlan, robot: Baxter, manipulators: Mapping[str, Manipulator]):
        self._plan, self._model, self._manipulators = plan, robot.model, manipulators
        self._data = robot.model.createData()
        self._robot = robot
        shapes = RobotShapes(robot)
        self._made, self._geometry = shapes.made, list(shapes.model.geometryObjects)
        self._links = {
            side: sorted(shapes.of_arm(robot.arm(side)) & shapes.wholes) for side in SIDES
        }

    def are_within(self, time_s: float, share: float, within_m: float) -> bool:
        """Whether a shape of one arm is within a distance of one of the other at a time.

        Args:
            time_s: on the common clock.
            share: of the fingers' travel that has passed, if a hand grips.
            within_m: the distance.
        """
        full = np.array(self._robot.configuration(dict(self._plan.start.joints)))
        bodies: dict[str, list[Body]] = {}
        for side in SIDES:
            joints, bodies[side] = self._at(side, time_s, share)
            full[list(self._robot.indices(tuple(joints)))] = list(joints.values())
        pin.forwardKinematics(self._model, self._data, full)
        placed = {side: list(self._shapes(side, bodies[side])) for side in SIDES}
        return any(
            _near(one, other, within_m)
            for one, other in product(placed["left"], placed["right"])
            if one.is_link or other.is_link
        )

    def _at(self, side: str, time_s: float, share: float) -> tuple[dict[str, float], list[Body]]:
        """Joints of an arm and its fingers, and the bodies that it handles."""
        manipulator = self._manipulators[side]
        arm, hand = manipulator.arm, manipulator.hand
        timed = self._plan.steps_of(side)
        begun = [each for each in timed if each.begin_s <= time_s] or [timed[0]]
        begin_s, end_s, _, step = begun[-1]
        begin = state_of(step)
        end = after(step, begin, manipulator)
        names = [each.step.body for each in timed if isinstance(each.step, Grip) and each.step.body]
        finger = hand.joint_names[0]
        if isinstance(step, Move):
            done_s = min(max(time_s - begin_s, 0.0), step.trajectory.duration)
            joints = arm.joints(step.trajectory.sample(done_s).q)
            now = begin.moved(self._robot, joints)
            opening_m, bodies = begin.joints[finger], [now.scene[name] for name in set(names)]
        else:
            share = share if time_s < end_s else 1.0
            joints = {name: begin.joints[name] for name in arm.joint_names}
            opening_m = (1 - share) * begin.joints[finger] + share * end.joints[finger]
            bodies = []
            for name in set(names):
                T, T_end = (each.scene[name].T_base_body for each in (begin, end))
                bodies.append(begin.scene[name].at(pin.SE3.Interpolate(T, T_end, share)))
        return joints | hand.finger_joints(opening_m), bodies

    def _shapes(self, side: str, bodies: list[Body]) -> Iterator[_Placed]:
        for number in self._links[side]:
            shape = self._geometry[number]
            T = self._data.oMi[shape.parentJoint] * shape.placement
            yield _Placed.at(shape.geometry, T, is_link=True)
        for body in bodies:
            yield _Placed.at(coal.Box(*(SIZE_M,) * 3), body.T_base_body, is_link=False)


class _Placed(NamedTuple):
    """A shape at a pose.

    Attributes:
        low: lower corner of an axis-aligned box around it, in base, m.
        high: its upper corner.
        is_link: whether it is a link, not a body.
    """

    shape: coal.CollisionGeometry
    T: coal.Transform3s
    low: FloatArray
    high: FloatArray
    is_link: bool

    @classmethod
    def at(cls, shape: coal.CollisionGeometry, T: pin.SE3, *, is_link: bool) -> _Placed:
        shape.computeLocalAABB()
        low, high = np.array(shape.aabb_local.min_), np.array(shape.aabb_local.max_)
        middle, reach = T.act((low + high) / 2), np.abs(T.rotation) @ ((high - low) / 2)
        pose = coal.Transform3s(T.rotation, T.translation)
        return cls(shape, pose, middle - reach, middle + reach, is_link)


def _near(one: _Placed, other: _Placed, within_m: float) -> bool:
    if np.maximum(one.low - other.high, other.low - one.high).max() > within_m:
        return False
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    request.security_margin = within_m
    return bool(coal.collide(one.shape, one.T, other.shape, other.T, request, result))
