"""Stage: one valid object of every class.

What never changes is made once in a process. What moves, or is written to, is made anew for each
block of calls, so that a block always goes the same way.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import planner as p
import planner.collision
import planner.grasping
import planner.trajectory
import planner.verification
import sim as s
import sim.perception
import sim.recording
import sim.world
from baxter_kin import (
    Arm,
    Baxter,
    ElectricGripper,
    Frame,
    IKFailure,
    IKService,
    NamedFrame,
    SeedMode,
    SeedType,
    StampedPose,
    Tool,
    ik,
)
from baxter_kin.description import RobotDescription
from baxter_kin.ik.tolerance import Task
from planner.verification import Relation
from sim.ros1.definitions import message_type
from sim.ros1_messages import MessageType
from sim.samples import Sample

TABLE_Z_M = -0.155

BODY = "block"


class Stage:
    """Valid objects, by the name of their class: `stage["Scene"]`."""

    def __init__(self, folder: Path) -> None:
        """An empty stage.

        Args:
            folder: where files are written.
        """
        self._folder = folder
        self._moving: dict[str, Any] = {}
        self._viewer: s.Viewer | None = None

    def reset(self) -> None:
        """Forget what may have changed."""
        self._moving.clear()

    def __getitem__(self, kind: str) -> Any:
        if hasattr(_Lasting, kind):
            return getattr(self._known, kind)
        if kind == "Viewer":
            return self._open_viewer()
        if kind not in self._moving:
            self._moving[kind] = _MOVING[kind](self)
        return self._moving[kind]

    def __contains__(self, kind: object) -> bool:
        return isinstance(kind, str) and (
            kind == "Viewer" or kind in _MOVING or hasattr(_Lasting, kind)
        )

    def file(self, name: str) -> Path:
        """A file that may be written."""
        return self._folder / name

    def _open_viewer(self) -> s.Viewer:
        """The viewer; another one where a call has closed it."""
        if self._viewer is None or "closed" in repr(self._viewer):
            self._viewer = s.Viewer(self["Baxter"])
        return self._viewer

    @cached_property
    def _known(self) -> _Lasting:
        return _Lasting()


class _Lasting:
    """What never changes; a property for each class, which has its name."""

    @cached_property
    def Baxter(self) -> Baxter:
        return Baxter.load()

    @cached_property
    def Arm(self) -> Arm:
        return self.Baxter.arm("left")

    @cached_property
    def Model(self) -> pin.Model:
        return self.Baxter.model

    @cached_property
    def RobotDescription(self) -> RobotDescription:
        return self.Baxter.description

    @cached_property
    def ElectricGripper(self) -> ElectricGripper:
        return ElectricGripper(slot=3)

    @cached_property
    def Tool(self) -> Tool:
        T_hand_tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.1]))
        return p.tool_of(p.make_block("probe", pin.SE3.Identity()), T_hand_tip)

    @cached_property
    def IKService(self) -> IKService:
        return IKService(self.Arm)

    @cached_property
    def IKResult(self) -> Any:
        return self.IKService.solve(self.SE3)

    @cached_property
    def IKFailure(self) -> IKFailure:
        return IKFailure("no way")

    @cached_property
    def SE3(self) -> pin.SE3:
        return self.Arm.T_base_tip(self.q)

    @cached_property
    def NamedFrame(self) -> NamedFrame:
        return NamedFrame("map", self.SE3)

    @cached_property
    def StampedPose(self) -> StampedPose:
        return StampedPose(self.SE3, Frame.WORLD)

    @cached_property
    def Frame(self) -> Frame:
        return Frame.BASE

    @cached_property
    def SeedMode(self) -> SeedMode:
        return SeedMode.AUTO

    @cached_property
    def SeedType(self) -> SeedType:
        return SeedType.USER

    @cached_property
    def Backend(self) -> ik.Backend:
        return ik.Backend.AUTO

    @cached_property
    def Scope(self) -> ik.Scope:
        return ik.Scope.ALL

    @cached_property
    def JointLimits(self) -> Any:
        return self.Arm.limits

    @cached_property
    def q(self) -> Any:
        return self.Arm.neutral

    @cached_property
    def FarthestFromLimits(self) -> ik.FarthestFromLimits:
        return ik.FarthestFromLimits()

    @cached_property
    def MostManipulable(self) -> ik.MostManipulable:
        return ik.MostManipulable()

    @cached_property
    def NearestTo(self) -> ik.NearestTo:
        return ik.NearestTo(self.q)

    @cached_property
    def Program(self) -> ik.Program:
        return ik.Program.of(self.Arm)

    @cached_property
    def Tolerance(self) -> ik.Tolerance:
        return ik.Tolerance.about("z")

    @cached_property
    def Task(self) -> Task:
        return Task.of(self.Arm, self.Tolerance)

    @cached_property
    def SelfMotion(self) -> ik.SelfMotion:
        return ik.trace_self_motion(self.Arm, self.q, step_rad=0.1)

    @cached_property
    def RobotBody(self) -> p.RobotBody:
        return p.RobotBody.load()

    @cached_property
    def RobotShapes(self) -> p.RobotShapes:
        return p.RobotShapes(self.Baxter)

    @cached_property
    def Manipulator(self) -> p.Manipulator:
        return p.Manipulator.of(self.Baxter, "left")

    @cached_property
    def Hand(self) -> p.Hand:
        return self.Manipulator.hand

    @cached_property
    def Box(self) -> p.Box:
        return p.Box((0.1, 0.1, 0.1))

    @cached_property
    def Cylinder(self) -> p.Cylinder:
        return p.Cylinder(0.1, 0.1)

    @cached_property
    def Sphere(self) -> p.Sphere:
        return p.Sphere(0.1)

    @cached_property
    def Mesh(self) -> p.Mesh:
        corners = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]
        return p.Mesh(np.array(corners), [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])

    @cached_property
    def Part(self) -> p.Part:
        return p.Part(self.Box, pin.SE3.Identity())

    @cached_property
    def Body(self) -> p.Body:
        T = pin.SE3(np.eye(3), np.array([0.7, 0.15, TABLE_Z_M + 0.02]))
        return p.make_block(BODY, T, edge_m=0.04)

    @cached_property
    def Scene(self) -> p.Scene:
        T = pin.SE3(np.eye(3), np.array([0.8, 0.0, TABLE_Z_M - 0.01]))
        table = p.Body("table", (p.Part(p.Box((0.6, 1.0, 0.02)), pin.SE3.Identity()),), T)
        return p.Scene.of([table, self.Body])

    @cached_property
    def Attachment(self) -> p.Attachment:
        return p.Attachment(BODY, "right_gripper", pin.SE3.Identity())

    @cached_property
    def State(self) -> p.State:
        return p.State.of(self.Manipulator, self.Scene)

    @cached_property
    def T_grasp(self) -> pin.SE3:
        return p.overhead_grasp(self.Hand, self.Body)

    @cached_property
    def Grasp(self) -> Any:
        return self.Hand.close_on(self.T_grasp, self.Body, self.Hand.stroke_m)

    @cached_property
    def Miss(self) -> p.grasping.Miss:
        return p.grasping.Miss(p.grasping.MissKind.NOTHING, "nothing there")

    @cached_property
    def MissKind(self) -> p.grasping.MissKind:
        return p.grasping.MissKind.NOTHING

    @cached_property
    def Trajectory(self) -> p.Trajectory:
        return p.plan_joint_move(self.q, self.q + 0.1, self.JointLimits)

    @cached_property
    def JointState(self) -> p.trajectory.JointState:
        return self.Trajectory.sample(0.1)

    @cached_property
    def PeakRatios(self) -> p.trajectory.PeakRatios:
        return self.Trajectory.peak_ratios()

    @cached_property
    def StraightLine(self) -> p.StraightLine:
        goal = pin.SE3(self.SE3.rotation, self.SE3.translation + 0.05 * np.eye(3)[2])
        return p.StraightLine(self.SE3, goal)

    @cached_property
    def Response(self) -> p.Response:
        return p.Response((0.35, 0.45), 0.001, 0.3)

    @cached_property
    def TrackingProof(self) -> p.TrackingProof:
        return p.TrackingProof(self.Response, (), 0.0, 0.04, 0.02, np.zeros(7), 0.3)

    @cached_property
    def MessageType(self) -> MessageType:
        return message_type("std_msgs/String")

    @cached_property
    def LineTolerance(self) -> p.LineTolerance:
        return p.LineTolerance()

    @cached_property
    def Clearance(self) -> p.collision.Clearance:
        return p.collision.Clearance(0.1, "left_hand", "table")

    @cached_property
    def ClearanceChecker(self) -> p.collision.ClearanceChecker:
        return p.collision.ClearanceChecker(self.RobotShapes, self.Arm, self.Scene)

    @cached_property
    def CollisionContext(self) -> p.CollisionContext:
        return self.Manipulator.context(self.Scene, finger_m=0.01)

    @cached_property
    def ContinuousProof(self) -> p.collision.ContinuousProof:
        return p.collision.ContinuousProof(0.1, self.Clearance, 0.0, 1, 1)

    @cached_property
    def ContinuousContact(self) -> p.collision.ContinuousContact:
        return p.collision.ContinuousContact(self.Clearance, 0.0, 1.0, 1, 1)

    @cached_property
    def Claim(self) -> p.Claim:
        return p.Claim("upright", {"angle_rad": 0.1})

    @cached_property
    def Grip(self) -> p.Grip:
        return p.Grip("open", p.GripperAction.OPEN)

    @cached_property
    def GripperAction(self) -> p.GripperAction:
        return p.GripperAction.OPEN

    @cached_property
    def Move(self) -> p.Move:
        return p.Move("move", self.Trajectory)

    @cached_property
    def Plan(self) -> p.Plan:
        return p.Plan(self.State, (self.Move, self.Grip))

    @cached_property
    def PlanFailure(self) -> p.PlanFailure:
        return p.PlanFailure("pick", "no way")

    @cached_property
    def PickAndPlace(self) -> p.PickAndPlace:
        return p.PickAndPlace(BODY, self.T_grasp, self.T_grasp)

    @cached_property
    def Relation(self) -> Relation:
        return Relation.AT_MOST

    @cached_property
    def Check(self) -> p.verification.Check:
        return p.verification.Check("limit", 0.5, Relation.AT_MOST, 1.0, "", "move")

    @cached_property
    def Certificate(self) -> p.Certificate:
        return p.verify(self.Plan)

    @cached_property
    def PolynomialMotion(self) -> p.PolynomialMotion:
        q = self.State.q(self.Arm.joint_names)
        return p.PolynomialMotion.through((0.0, 1.0), [q, q + 0.01])

    @cached_property
    def MotionCertificate(self) -> p.MotionCertificate:
        return p.certify(self.PolynomialMotion, "left", self.State)

    @cached_property
    def Recording(self) -> s.Recording:
        recorder = s.Recorder(self.Baxter)
        world = s.World(self.Baxter)
        simulation = s.Simulation(world, [recorder])
        recorder.remember(self.Scene)
        for body in self.Scene:
            simulation.spawn(body)
        simulation.execute(self.Plan)
        return recorder.recording()

    @cached_property
    def NotedRecording(self) -> s.recording.NotedRecording:
        return s.recording.NotedRecording(self.Recording, ())

    @cached_property
    def Commands(self) -> s.recording.Commands:
        q = self.Recording.motion("left").q
        return s.recording.Commands(self.Recording.times_s, q, q)

    @cached_property
    def Sample(self) -> Sample:
        q, still = np.array(self.Arm.neutral), np.zeros(7)
        flags = {"is_enabled": True, "is_stopped": False, "has_error": False}
        return Sample(0.0, "left", q, q, q, still, 0.0, 0.0, **flags)

    @cached_property
    def RecordedMove(self) -> s.recording.RecordedMove:
        return s.recording.RecordedMove(0.0, "move", self.Trajectory)

    @cached_property
    def Replay(self) -> s.Replay:
        return s.Replay(self.Recording, self.Baxter)

    @cached_property
    def ArmMotion(self) -> s.recording.ArmMotion:
        return self.Recording.motion("left")

    @cached_property
    def Snapshot(self) -> s.Snapshot:
        seen: list[s.Snapshot] = []

        class Eye(s.Observer):
            def on_snapshot(self, snapshot: s.Snapshot) -> None:
                seen.append(snapshot)

        s.play_back(self.Recording, Eye())
        return seen[-1]

    @cached_property
    def Event(self) -> s.Event:
        return s.Event(0.0, s.EventKind.MOVE_STARTED, "move", "left", self.Move)

    @cached_property
    def EventKind(self) -> s.EventKind:
        return s.EventKind.ENABLED

    @cached_property
    def GripperState(self) -> s.world.GripperState:
        return s.world.GripperState(100.0, is_gripping=False, has_missed=False)

    @cached_property
    def Push(self) -> s.world.Push:
        return s.world.Push(BODY, "left", "left finger", 0.02, 0.01, np.eye(3)[1], self.SE3)

    @cached_property
    def Closing(self) -> s.Closing:
        return s.Closing(0.0, miss=self.Miss)

    @cached_property
    def Contact(self) -> p.Contact:
        return p.Contact.of_supports(BODY, frozenset({"table"}))[0]

    @cached_property
    def Rest(self) -> s.world.Rest:
        return s.world.Rest(self.Body.T_base_body, ("table",), 0.0)

    @cached_property
    def Dwell(self) -> s.Dwell:
        return s.Dwell()

    @cached_property
    def Outcome(self) -> s.Outcome:
        return s.Outcome(None, 1.0)

    @cached_property
    def TaskResult(self) -> s.TaskResult:
        return s.TaskResult(f"carry {BODY}", BODY, "left", 1.0, 0.1, 0.0, "verified", True)

    @cached_property
    def Noise(self) -> s.Noise:
        return s.Noise(0.001)

    @cached_property
    def Sighting(self) -> s.perception.Sighting:
        return s.perception.Sighting(self.Body, 0.0)

    @cached_property
    def Transfer(self) -> s.Transfer:
        goal = self.Body.T_base_body
        return s.Transfer(BODY, goal.inverse() * self.T_grasp, goal)

    @cached_property
    def Attempt(self) -> s.perception.Attempt:
        return s.perception.Attempt(None, None, "not seen")

    @cached_property
    def LoopResult(self) -> s.perception.LoopResult:
        return s.perception.LoopResult((self.Attempt,), "not seen")


def _world(stage: Stage) -> s.World:
    world = s.World(stage["Baxter"])
    for body in stage["Scene"]:
        world.spawn(body)
    return world


def _closed_loop(stage: Stage) -> s.ClosedLoop:
    return s.ClosedLoop(stage["Simulation"], stage["Manipulator"], stage["TruePoses"], retries=0)


def _noisy(stage: Stage) -> s.NoisyPoses:
    return s.NoisyPoses(stage["TruePoses"], stage["Noise"], stage["Generator"])


_MOVING: dict[str, Callable[[Stage], Any]] = {
    "Generator": lambda _: np.random.default_rng(0),
    "World": _world,
    "Simulation": lambda stage: s.Simulation(stage["World"]),
    "Gripper": lambda stage: s.world.Gripper(stage["World"], "left"),
    "Observer": lambda _: s.Observer(),
    "Recorder": lambda stage: s.Recorder(stage["Baxter"]),
    "PlanCsvFile": lambda stage: s.recording.PlanCsvFile(stage.file("csv")),
    "TruePoses": lambda stage: s.TruePoses(stage["World"]),
    "NoisyPoses": _noisy,
    "ClosedLoop": _closed_loop,
    "Workbench": lambda stage: s.Workbench(stage["Baxter"]),
    "TipTarget": lambda stage: s.TipTarget(stage["Viewer"], stage["Baxter"], "left"),
}
"""What moves or is written to."""
