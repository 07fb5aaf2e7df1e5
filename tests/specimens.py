"""Objects of all public classes, as users get them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from enum import Enum
from typing import Any

import numpy as np
import pinocchio as pin

import baxter_kin.ik as inverse
import planner
import planner.collision
import planner.grasping
import sim
import sim.perception
import sim.recording
import sim.world
from baxter_kin import Baxter, ElectricGripper, IKService, NamedFrame, StampedPose
from baxter_kin.fields import field_names
from planner import Manipulator, Plan, RobotBody, Scene, load_object
from planner.clearance import ContinuousProof
from planner.two_arms.pair_moves.relative_pose import RelativeDeviation
from sim import Recorder, Simulation, World
from tests.conftest import at, overhead

FAR = at(3.0, 0.0, 0.0)
SCENE = Scene.of(
    [
        load_object("table", at(1.0, 0.0, -0.93)),
        load_object("block", at(0.6725, 0.1265, -0.155), is_movable=True),
    ]
)
PICK, PLACE = overhead(0.70, 0.15, -0.129), overhead(0.75, 0.0, -0.129)
TASK = planner.PickAndPlace("block", PICK, PLACE)


def curve(length_m: float) -> pin.SE3:
    """A straight line, as a curve."""
    return FAR * at(length_m, 0.0, 0.0)


PATHS = (
    planner.Polyline([curve(0.0), curve(0.1)]),
    planner.Arc(FAR, FAR.translation + np.eye(3)[0], np.eye(3)[2], 1.0),
    planner.Curve(curve, 0.1),
)
FOLLOWED = planner.FollowedPath(tuple(PATHS[0].pieces()), np.ones(1), speed_m_s=0.1)


def specimens_of(
    robot: Baxter, ik: IKService, manipulator: Manipulator, plan: Plan
) -> dict[str, object]:
    """Objects by what they are; `plan` is one of `TASK`."""
    arm, world = ik.arm, World(robot)
    recorder = Recorder(robot)
    simulation = Simulation(world, [recorder])
    for body in SCENE:
        simulation.spawn(body)
    outcome, recording = simulation.execute(plan), recorder.recording()
    space = manipulator.context(SCENE, finger_m=0.01)
    hand, eyes = manipulator.hand, sim.TruePoses(world)
    nearest = planner.collision.Clearance(-0.01, "left_hand", "table", 0.5)
    q = world.arm_q("left")
    motion = planner.PolynomialMotion.waypoints([q, q + 0.01], joint_names=arm.joint_names)
    gripper = sim.world.GripperState(0.0, False, False)
    miss = planner.grasping.Miss(planner.grasping.MissKind.NOTHING, "nothing is between the pads")
    push = sim.world.Push("block", "left", "pad", 0.01, 0.005, np.eye(3)[1], FAR)
    tracked = planner.Response((0.35, 0.45), 0.001, 0.3)
    joints = dict(zip(world.robot.joint_names, world.q, strict=True))
    return {
        "robot": robot,
        "service": ik,
        "tool": IKService(arm.with_tip(at(0.0, 0.0, 0.1))),
        "result": ik.solve(arm.T_base_tip(arm.neutral)),
        "no result": ik.solve(FAR),
        "poses": (StampedPose(FAR, NamedFrame("map", FAR)), inverse.Tolerance.about("z")),
        "self-motion": inverse.trace_self_motion(arm, arm.neutral),
        "objectives": (
            inverse.NearestTo(arm.neutral),
            inverse.FarthestFromLimits(),
            inverse.MostManipulable(),
        ),
        "plan": plan,
        "no plan": planner.plan_pick_and_place(
            planner.PickAndPlace("block", FAR, PLACE), manipulator, SCENE, arm.start
        ),
        "no plan of both arms": planner.TwoArmPlan(
            plan.start,
            {"left": plan, "right": Plan(plan.start, (), limb="right")},
            {"left": tuple(map(float, range(0, 10 * len(plan.steps), 10))), "right": ()},
            0.5,
            failure=planner.PlanFailure("place: descend", "both hands cannot be there at once"),
        ),
        "handover": planner.Handover("stick", PLACE, "right", where=(0.7, 0.0, 0.2)),
        "pair carry": planner.PairCarry("tray", {"left": FAR, "right": FAR}, PLACE),
        "pair move": planner.PairMove(
            "tray",
            planner.Trajectory.stay(q, arm.limits),
            np.eye(4)[None],
            RelativeDeviation(1e-5, 1e-4, 256),
            ContinuousProof(0.01, nearest, 0.0, 1, 1),
        ),
        "certificate": planner.verify(plan),
        "certificate of both": planner.TwoArmCertificate({}, 1.0, "it failed"),
        "another motion": (
            motion,
            planner.certify(motion, "left", planner.State(Scene({}), joints)),
        ),
        "body": (RobotBody.load(), RobotBody.load().padded(0.01)),
        "space": (space, space.with_margin(0.001)),
        "path": (
            *PATHS,
            planner.PathMove(planner.plan_joint_move(q, q + 0.1, arm.limits), FOLLOWED),
        ),
        "line": (
            planner.StraightLine(FAR, FAR * at(0.0, 0.0, 0.02)),
            planner.LineTolerance(),
            planner.Line("tool", 0.1),
            planner.Upright(),
        ),
        "simulation": simulation,
        "outcome": outcome,
        "bench": (
            sim.Workbench(robot),
            sim.TaskResult("carry a", "a", "", 0.0, 0.1, None, "no", False),
        ),
        "recording": (recording, recording.motion("left")),
        "snapshot": sim.Snapshot(
            0.0, world.q, {"block": FAR}, dict.fromkeys(("left", "right"), gripper), "waits"
        ),
        "page": sim.Replay(recording, robot),
        "tasks": (TASK, sim.Transfer("block", FAR, FAR)),
        "moves": (
            trajectory := planner.plan_joint_move(arm.neutral, arm.start, arm.limits),
            trajectory.peak_ratios(),
            planner.collision.ContinuousContact(nearest, 0.0, 1.0, 3, 7),
            trajectory.sample(0.1),
        ),
        "response": tracked,
        "tracking": planner.prove_tracking(
            plan, tracked, manipulator=manipulator, seek_speed=False
        ),
        "tracking of both": planner.TwoArmTrackingProof({}, (), (), 0.005, 0.02, None, "it failed"),
        "perception": (
            sim.ClosedLoop(simulation, manipulator, eyes),
            eyes.observe("block", simulation.time_s),
            sim.perception.LoopResult(
                (sim.perception.Attempt(None, None, "nothing was seen"),), "nothing was seen"
            ),
            sim.NoisyPoses(eyes, sim.Noise(), np.random.default_rng(0)),
        ),
        "fingers": (
            hand,
            planner.overhead_grasp(hand, simulation.world.body("block")),
            sim.Closing(0.01, miss=miss, pushes=(push,)),
            planner.Attachment("block", "left_gripper", FAR),
            sim.world.Contact(0.1, "left_hand", "block", False, 1e-3, True, 0.0),
            planner.Claim("upright", {"angle_rad": 0.1}),
        ),
        "notes": sim.recording.NotedRecording(recording, ("a line is cut off",)),
        "commands": sim.recording.Commands(np.arange(2.0), np.zeros((2, 7)), np.ones((2, 7))),
        "comparison": sim.recording.Comparison(
            arm.joint_names,
            *(np.arange(2.0), np.zeros((2, 7)), np.zeros(2), 2, 1),
        ),
        "recorded plan": sim.recording.RecordedPlan(plan, 0.01, 0.02, "left_s0", 1.5),
        "shapes": (planner.Sphere(0.1), planner.Cylinder(0.1, 0.2)),
        "hands": (
            ElectricGripper(slot=3),
            planner.tool_of(planner.make_block("probe", at(0.0, 0.0, 0.0)), at(0.0, 0.0, 0.1)),
        ),
    }


def parts_of(given: Any) -> Iterator[Any]:
    """An object, and those in its fields, in attributes that a copy keeps, and in collections."""
    seen: set[int] = set()
    waiting = [given]
    while waiting:
        each = waiting.pop()
        if id(each) in seen or isinstance(each, (str, bytes, float, int, Enum, type)):
            continue
        seen.add(id(each))
        yield each
        if isinstance(each, Mapping):
            waiting += each.values()
        elif isinstance(each, Iterable) and isinstance(each, (tuple, list)):
            waiting += each
        waiting += [getattr(each, name) for name in field_names(each)]
        waiting += getattr(each, "__dict__", {}).values()
