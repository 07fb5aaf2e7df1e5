from __future__ import annotations

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from planner import (
    Body,
    Manipulator,
    PickAndPlace,
    Plan,
    Scene,
    plan_pick_and_place,
    plan_start_move,
)
from planner.scene.bodies import Attachment
from sim import World
from sim.errors import RecordingError
from sim.events import EventKind
from sim.recording.planned_recording import planned_recording
from tests.conftest import overhead

JOINT_RAD = 1e-9


@pytest.fixture(scope="module")
def plan(manipulator: Manipulator, table: Body, block: Body) -> Plan:
    task = PickAndPlace("block", overhead(0.70, 0.15, -0.129), overhead(0.75, 0.0, -0.129))
    return plan_pick_and_place(task, manipulator, Scene.of([table, block]), manipulator.arm.start)


def test_a_plan_of_moves_goes_from_start_to_goal(manipulator: Manipulator, table: Body) -> None:
    arm = manipulator.arm
    plan = plan_start_move(manipulator, Scene.of([table]), arm.neutral, arm.start)
    recording = planned_recording(plan)
    index = [recording.joint_names.index(name) for name in arm.joint_names]
    assert np.abs(recording.q[0, index] - plan.q_start).max() < JOINT_RAD
    assert np.abs(recording.q[-1, index] - arm.start).max() < JOINT_RAD
    assert recording.duration_s == pytest.approx(plan.motion_time_s)
    assert list(recording.bodies) == ["table"]


def test_the_block_is_grasped_carried_and_let_go_where_planned(plan: Plan, robot: Baxter) -> None:
    recording = planned_recording(plan, robot)
    kinds = [event.kind for event in recording.events]
    assert kinds.count(EventKind.GRASPED) == kinds.count(EventKind.RELEASED) == 1
    begin = plan.start.scene["block"].T_base_body.translation
    track = recording.body_poses["block"]
    assert track[0, :3] == pytest.approx(begin)
    assert track[-1, :3] - begin == pytest.approx([0.05, -0.15, 0.0], abs=2e-3)


def test_everything_begins_exactly_where_the_plan_has_it(plan: Plan, robot: Baxter) -> None:
    recording = planned_recording(plan, robot)
    own = robot.arm("left").joint_names
    for name, value in plan.start.joints.items():
        if name not in own and "finger" not in name:
            assert recording.q[0, recording.joint_names.index(name)] == pytest.approx(value)
    table = plan.start.scene["table"].T_base_body.translation
    assert recording.body_poses["table"][0, :3] == pytest.approx(table)


def test_what_is_held_first_is_in_the_hand(plan: Plan, robot: Baxter, block: Body) -> None:
    arm, state = robot.arm("left"), plan.start
    T_base_tip = arm.T_base_tip(plan.q_start)
    in_hand = Attachment("block", "left_gripper", overhead(0.0, 0.0, 0.0))
    scene = state.scene.without("block").with_body(block.at(T_base_tip * in_hand.T_link_body))
    laden = evolve(
        plan,
        steps=plan.steps[:1] if not hasattr(plan.steps[0], "action") else plan.moves[:1],
        start=evolve(state, scene=scene, attachments=(in_hand,)),
    )
    recording = planned_recording(laden, robot)
    T_goal = arm.T_base_tip(plan.moves[0].trajectory.q_goal) * in_hand.T_link_body
    assert recording.body_poses["block"][-1, :3] == pytest.approx(T_goal.translation)


def test_an_invalid_plan_is_refused_with_its_failure(
    manipulator: Manipulator, table: Body, block: Body
) -> None:
    far = PickAndPlace("block", overhead(0.70, 0.15, -0.129), overhead(3.0, 0.0, -0.129))
    scene = Scene.of([table, block])
    refused = plan_pick_and_place(far, manipulator, scene, manipulator.arm.start)
    assert refused.failure is not None
    with pytest.raises(RecordingError) as error:
        planned_recording(refused)
    assert str(refused.failure) in str(error.value)


def test_the_plan_of_another_robot_is_refused(plan: Plan) -> None:
    other = Baxter.load(hands={"right": None})
    with pytest.raises(RecordingError, match="for another robot"):
        planned_recording(plan, other)


def test_the_world_of_a_simulation_stays_as_it_is(plan: Plan, robot: Baxter) -> None:
    world = World(robot)
    before = world.q
    planned_recording(plan, robot)
    assert np.array_equal(world.q, before)
