"""Recorder: from snapshots and events to data, of simulations and of plans."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from baxter_kin import Baxter, quaternion_xyzw
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
from sim import EventKind, Recorder, Recording, Simulation, World, read_recording
from sim.errors import RecordingError
from sim.recording.recorder import planned_recording
from tests.conftest import overhead

JOINT_RAD = 1e-9


@pytest.fixture
def world(robot: Baxter, table: Body, block: Body) -> World:
    world = World(robot)
    world.spawn(table)
    world.spawn(block)
    return world


@pytest.fixture(scope="module")
def recording(robot: Baxter, manipulator: Manipulator, table: Body, block: Body) -> Recording:
    """The block there for 0.1 s, then gone for 0.1 s, then the start move."""
    world, recorder = World(robot), Recorder(robot)
    simulation = Simulation(world, [recorder])
    simulation.spawn(table)
    simulation.spawn(block)
    simulation.wait(0.1)
    simulation.delete("block")
    simulation.wait(0.1)
    simulation.execute(
        plan_start_move(manipulator, world.scene, world.arm_q("left"), manipulator.arm.start),
        "demo, ",
    )
    return recorder.recording()


def test_times_configurations_captions_and_events_are_those_of_the_simulation(
    recording: Recording, manipulator: Manipulator
) -> None:
    assert recording.times_s[:3].tolist() == [0.0, 0.01, 0.02]
    assert recording.duration_s == recording.times_s[-1] - recording.times_s[0]
    arm = manipulator.arm
    where = [recording.joint_names.index(name) for name in arm.joint_names]
    assert recording.q[0, where].tolist() == arm.neutral.tolist()
    assert [text for _, text in recording.captions] == ["", "demo, move to start"]
    assert recording.captions[1][0] == pytest.approx(0.21)
    assert [event.kind for event in recording.events] == [
        EventKind.SPAWNED,
        EventKind.SPAWNED,
        EventKind.DELETED,
        EventKind.MOVE_STARTED,
        EventKind.OPENED,
    ]
    assert set(recording.bodies) == {"table", "block"}


def test_a_body_has_poses_while_it_is_there_and_nan_while_it_is_not(
    recording: Recording, block: Body
) -> None:
    there = np.isfinite(recording.body_poses["block"])
    rows: NDArray[np.bool_] = np.any(there, axis=1)
    assert (there == np.stack([rows] * 7, axis=1)).all()
    assert rows.tolist() == (recording.times_s <= 0.1).tolist()
    assert np.isfinite(recording.body_poses["table"]).all()
    row = recording.body_poses["block"][0]
    assert row[:3] == pytest.approx(block.T_base_body.translation, abs=1e-7)
    assert row[3:] == pytest.approx(quaternion_xyzw(block.T_base_body), abs=1e-9)


def test_nothing_simulated_is_no_recording(robot: Baxter) -> None:
    recorder = Recorder(robot)
    assert not recorder.has_snapshots
    with pytest.raises(RecordingError, match="no snapshot"):
        recorder.recording()


def test_moves_are_kept_with_their_exact_motion(
    recording: Recording, manipulator: Manipulator
) -> None:
    (move,) = recording.moves
    assert move.limb == "left"
    assert move.label == "demo, move to start"
    assert move.start_s == pytest.approx(0.2)
    assert move.trajectory.q_goal.tolist() == manipulator.arm.start.tolist()
    assert move.end_s == pytest.approx(recording.times_s[-1], abs=0.01)


def test_moves_from_before_the_kept_snapshots_are_forgotten(
    robot: Baxter, world: World, manipulator: Manipulator
) -> None:
    recorder = Recorder(robot, keep=5)
    simulation = Simulation(world, [recorder])
    arm = manipulator.arm
    for goal in (arm.start, arm.neutral, arm.start):
        q = world.arm_q("left")
        simulation.execute(plan_start_move(manipulator, world.scene, q, goal))
    assert len(recorder.recording().moves) == 1
    simulation.wait(0.1)
    assert recorder.recording().moves == ()


def test_a_recording_does_not_change_when_the_simulation_goes_on(
    robot: Baxter, world: World
) -> None:
    recorder, short = Recorder(robot), Recorder(robot, keep=5)
    simulation = Simulation(world, [recorder, short])
    simulation.wait(0.1)
    before = recorder.recording()
    simulation.wait(0.1)
    assert len(before.times_s) == 11
    assert len(recorder.recording().times_s) == 21
    assert short.has_snapshots
    assert short.recording().times_s == pytest.approx([0.16, 0.17, 0.18, 0.19, 0.20])


def test_wrong_arguments_are_refused(robot: Baxter, tmp_path: Path) -> None:
    wrong: Any
    for wrong in (0, -1, 0.5, "all", np.nan, []):
        with pytest.raises(RecordingError, match="keep"):
            Recorder(robot, keep=wrong)
    recorder: Any = Recorder(robot)
    for wrong in (None, "robot", 5, {}):
        for options in ((), (tmp_path / "run.mcap",)):
            with pytest.raises(RecordingError, match="robot"):
                Recorder(wrong, *options)
        for method, what in (
            (recorder.remember, "scene"),
            (recorder.on_start, "state"),
            (recorder.on_snapshot, "snapshot"),
            (recorder.on_event, "event"),
            (recorder.on_sample, "sample"),
        ):
            with pytest.raises(RecordingError, match=f"{what} must be of class"):
                method(wrong)


def test_bodies_that_are_remembered_have_poses(robot: Baxter, table: Body, tmp_path: Path) -> None:
    world, path = World(robot), tmp_path / "run.mcap"
    with Recorder(robot, path) as recorder:
        simulation = Simulation(world, [recorder])
        world.spawn(table)  # without the simulation
        simulation.wait(0.02)
        recorder.remember(world.scene)
    for recording in (recorder.recording(), read_recording(path).recording):
        assert np.isfinite(recording.body_poses["table"][1:]).all()


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
    world = World(robot)
    before = world.q
    recording = planned_recording(plan, robot)
    assert np.array_equal(world.q, before)
    kinds = [event.kind for event in recording.events]
    assert kinds.count(EventKind.GRASPED) == kinds.count(EventKind.RELEASED) == 1
    begin = plan.start.scene["block"].T_base_body.translation
    track = recording.body_poses["block"]
    assert track[0, :3] == pytest.approx(begin)
    assert track[-1, :3] - begin == pytest.approx([0.05, -0.15, 0.0], abs=2e-3)
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


def test_an_invalid_plan_and_that_of_another_robot_are_refused(
    manipulator: Manipulator, table: Body, block: Body, plan: Plan
) -> None:
    far = PickAndPlace("block", overhead(0.70, 0.15, -0.129), overhead(3.0, 0.0, -0.129))
    scene = Scene.of([table, block])
    refused = plan_pick_and_place(far, manipulator, scene, manipulator.arm.start)
    assert refused.failure is not None
    with pytest.raises(RecordingError) as error:
        planned_recording(refused)
    assert str(refused.failure) in str(error.value)
    with pytest.raises(RecordingError, match="another robot"):
        planned_recording(plan, Baxter.load(hands={"right": None}))
