"""A plan as the recording of its execution, in the world that it was made for."""

from __future__ import annotations

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.model import given_or_stock
from baxter_kin.validation import expect
from planner import Plan, RobotBody
from planner.state import State
from sim.errors import RecordingError
from sim.recording.recorder import Recorder
from sim.recording.recording import Recording
from sim.simulation import Simulation
from sim.world.world import World


def planned_recording(
    plan: Plan, robot: Baxter | None = None, *, body: RobotBody | None = None
) -> Recording:
    """What would be recorded if a plan were executed just as it says; nobody looks for contacts.

    Args:
        plan: a valid plan; the world it begins in is its own `start`.
        robot: the robot that it is for; the stock robot when not given.
        body: what that is taken to be; `RobotBody.load()` when not given.
    """
    expect(plan, Plan, "plan", RecordingError)
    if plan.failure is not None:
        raise RecordingError(f"an invalid plan has nothing to show: {plan.failure}")
    known = given_or_stock(robot, RecordingError)
    difference = "" if plan.robot is None else known.description.identity.difference(plan.robot)
    if difference:
        raise RecordingError(f"the plan is for another robot: {difference}; give that one")
    world, recorder = _initial_world(plan, known, body), Recorder(known)
    simulation = Simulation(world, [recorder], check_contacts=False)
    shown = evolve(plan, robot=None)  # its body may be another one than is shown
    simulation.execute(shown, unverified=True)
    simulation.finish()
    return recorder.recording()


def _initial_world(plan: Plan, robot: Baxter, body: RobotBody | None) -> World:
    """Robot and bodies where they are before the first step."""
    world = World(robot, body)
    _put_joints(world, plan.start)
    _put_bodies(world, plan.start)
    return world


def _put_joints(world: World, state: State) -> None:
    joints = state.joints
    for side, arm in world.robot.arms.items():
        if all(name in joints for name in arm.joint_names):
            world.move_arm(side, [joints[name] for name in arm.joint_names])
    for side, hand in world.hands.items():
        if hand.joint_names[0] in joints:
            world.set_fingers(side, joints[hand.joint_names[0]])
    if "head_pan" in joints:
        world.turn_head(joints["head_pan"])


def _put_bodies(world: World, state: State) -> None:
    """All of them exactly where they are said to be, whatever they would fall on."""
    for each in state.scene:
        world.spawn(each)
    for each in state.scene:
        world.slide(each.name, each.T_base_body)
    for each in state.scene:
        world.place_body(each.name, each.T_base_body)
    for held in state.attachments:
        world.attach(held.side, held.body, held.T_link_body)
