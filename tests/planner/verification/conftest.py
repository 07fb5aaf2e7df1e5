"""A plan that is good, and ways to spoil it past every check of its classes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from baxter_kin import pose_from_quaternion
from baxter_kin.fields import evolve, field_names
from planner import (
    Attachment,
    Body,
    Box,
    Certificate,
    Manipulator,
    Move,
    Part,
    PickAndPlace,
    Plan,
    Scene,
    State,
    Trajectory,
    plan_joint_move,
    plan_pick_and_place,
    verify,
)
from tests.conftest import at
from tests.planner.conftest import without_statements

T = TypeVar("T")
DOWN = (0.0, 1.0, 0.0, 0.0)
PICK = pose_from_quaternion((0.70, 0.15, -0.129), DOWN)
PLACE = pose_from_quaternion((0.75, 0.0, -0.129), DOWN)

BLOCK = at(0.675, 0.125, -0.155)
"""The block of the README, whose origin is its minimum corner, on the table."""


def forged(value: T, **changes: Any) -> T:
    """A copy with other fields, past every check of its class."""
    copy = object.__new__(type(value))
    for name in field_names(value):
        object.__setattr__(copy, name, changes.get(name, getattr(value, name)))
    return copy


def spoiled(plan: Plan, label: str, **changes: Any) -> Plan:
    """The plan with another trajectory in one move, past every check."""
    steps = [
        forged(step, trajectory=forged(step.trajectory, **changes))
        if isinstance(step, Move) and step.label == label
        else step
        for step in plan
    ]
    return forged(plan, steps=tuple(steps))


def with_moves(plan: Plan, trajectories: dict[str, Trajectory]) -> Plan:
    """The plan with other trajectories in some moves."""
    steps = [
        evolve(step, trajectory=trajectories[step.label])
        if isinstance(step, Move) and step.label in trajectories
        else step
        for step in plan
    ]
    return evolve(plan, steps=tuple(steps))


def move_of(plan: Plan, label: str) -> Move:
    return next(move for move in plan.moves if move.label == label)


def failed(certificate: Certificate) -> set[str]:
    return {check.name for check in certificate.failures}


@pytest.fixture(scope="session")
def world(table: Body, block: Body) -> Scene:
    return Scene.of([table, block.at(BLOCK)])


@pytest.fixture(scope="session")
def plan(manipulator: Manipulator, world: Scene) -> Plan:
    task = PickAndPlace("block", PICK, PLACE)
    made = plan_pick_and_place(task, manipulator, world, manipulator.arm.neutral)
    assert made.is_valid, str(made.failure)
    return without_statements(evolve(made, start=State.of(manipulator, world)))


@pytest.fixture(scope="session")
def stopping(plan: Plan, manipulator: Manipulator) -> Plan:
    """The same waypoints by joint moves from rest to rest, so that any one can be exchanged."""
    steps = [
        evolve(
            step,
            trajectory=plan_joint_move(
                step.trajectory.q_start, step.trajectory.q_goal, manipulator.limits
            ),
            is_straight=False,
        )
        if isinstance(step, Move)
        else step
        for step in plan
    ]
    return evolve(plan, steps=tuple(steps))


@pytest.fixture(scope="session")
def certificate(plan: Plan) -> Certificate:
    return verify(plan)


@pytest.fixture(scope="session")
def tracked_certificate(tracked_plan: Plan) -> Certificate:
    return verify(tracked_plan)


def with_bodies(plan: Plan, change: Callable[[Scene], Scene]) -> Plan:
    state = evolve(plan.start, scene=change(plan.start.scene))
    return evolve(plan, start=state)


TABLE_M = -0.155
"""Height of the table's top in base."""


def standing_box(name: str, size: tuple[float, float, float], x: float, y: float, z: float) -> Body:
    """A box that stands at a height."""
    part = Part(Box(size), at(0.0, 0.0, size[2] / 2))
    return Body(name, (part,), at(x, y, z), is_movable=name == "block")


@pytest.fixture(scope="session")
def cube_scene(table: Body) -> Scene:
    """A cube of 2 cm on the table."""
    return Scene.of([table, standing_box("block", (0.02, 0.02, 0.02), 0.70, 0.15, TABLE_M)])


@pytest.fixture(scope="session")
def cube_plan(manipulator: Manipulator, cube_scene: Scene) -> Plan:
    """The cube taken and put 15 cm aside, nothing else around."""
    pick, place = (
        pose_from_quaternion((x, y, TABLE_M + 0.01), DOWN) for x, y in ((0.70, 0.15), (0.75, 0.0))
    )
    task = PickAndPlace("block", pick, place)
    made = plan_pick_and_place(task, manipulator, cube_scene, manipulator.arm.neutral)
    assert made.is_valid, str(made.failure)
    return without_statements(evolve(made, start=State.of(manipulator, cube_scene)))


@pytest.fixture(scope="session")
def cube_certificate(cube_plan: Plan) -> Certificate:
    return verify(cube_plan)


@pytest.fixture
def holding(cube_plan: Plan, manipulator: Manipulator) -> State:
    """The same world, and a stick in the right hand."""
    joints = dict(cube_plan.start.joints)
    for name, sign in (("l", 1.0), ("r", -1.0)):
        joints[f"r_gripper_{name}_finger_joint"] = sign * 0.002
    right = manipulator.robot.arm("right")
    tip = right.T_base_tip(np.array([joints[name] for name in right.joint_names]))
    hold = Attachment("stick", "right_gripper", pin.SE3.Identity())
    stick = Body("stick", (Part(Box((0.006, 0.006, 0.03)), at(0, 0, 0)),), tip, is_movable=True)
    return State(cube_plan.start.scene.with_body(stick), joints, (hold,))


def configurations() -> st.SearchStrategy[Any]:
    return hnp.arrays(np.float64, 7, elements=st.floats(-0.9, 0.9))


def inside(manipulator: Manipulator, share: Any) -> Any:
    """A configuration by its share of the range of each joint, -1..1."""
    low, high = manipulator.limits.q_min, manipulator.limits.q_max
    return (low + high) / 2 + share * (high - low) / 2
