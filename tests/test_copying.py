"""Pickle and copy: of everything public, with nothing lost, or with a refusal in words."""

from __future__ import annotations

import copy
import importlib
import pickle
import pickletools
import pkgutil
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from enum import Enum
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import baxter_kin
import baxter_kin.ik as inverse
import planner
import planner.collision
import planner.grasping
import sim
import sim.perception
import sim.recording
import sim.world
from baxter_kin import Arm, Baxter, BaxterError, ElectricGripper, IKService, NamedFrame, StampedPose
from baxter_kin.errors import CopyError, UnknownNameError
from baxter_kin.fields import FrozenMapping, field_names
from planner import (
    Manipulator,
    PickAndPlace,
    Plan,
    RobotBody,
    Scene,
    load_object,
    plan_pick_and_place,
    verify,
)
from sim import Recorder, Simulation, World
from sim.ros1.execution.readiness import Finding, Readiness
from sim.view.live.viewer import Viewer
from tests.conftest import at, overhead
from tests.front_doors import FRONT_DOORS

COPIES: dict[str, Callable[[Any], Any]] = {
    "pickle": lambda each: pickle.loads(pickle.dumps(each)),
    "deepcopy": copy.deepcopy,
    "copy": copy.copy,
}
FAR = at(3.0, 0.0, 0.0)
SCENE = Scene.of(
    [
        load_object("table", at(1.0, 0.0, -0.93)),
        load_object("block", at(0.6725, 0.1265, -0.155), is_movable=True),
    ]
)
TASK = PickAndPlace("block", overhead(0.70, 0.15, -0.129), overhead(0.75, 0.0, -0.129))

TAKEN: dict[str, tuple[Any, ...]] = {
    "UnknownNameError": ("limb", "middle", ("left", "right")),
    "FileError": ("read", "a.json", "it is empty"),
    "StraightMoveError": (0.5, "the arm ends"),
    "StageError": ("pick: approach", "it is too far"),
    "NotReadyError": (Readiness((Finding("state", False, "it is stopped"),), None),),
}
"""What makes errors that take more than a sentence."""


@pytest.fixture(scope="module")
def plan(manipulator: Manipulator) -> Plan:
    return plan_pick_and_place(TASK, manipulator, SCENE, manipulator.arm.neutral)


@pytest.fixture(scope="module")
def everything(
    robot: Baxter, ik: IKService, manipulator: Manipulator, plan: Plan
) -> dict[str, object]:
    """Objects of all kinds, as users get them."""
    arm, world = ik.arm, World(robot)
    recorder = Recorder(robot)
    simulation = Simulation(world, [recorder])
    for body in SCENE:
        simulation.spawn(body)
    outcome = simulation.execute(plan)
    space = manipulator.context(SCENE, finger_m=0.01)
    refused = PickAndPlace("block", FAR, overhead(0.75, 0.0, -0.129))
    return {
        "robot": robot,
        "service": ik,
        "tool": IKService(arm.with_tip(at(0.0, 0.0, 0.1))),
        "result": ik.solve(arm.T_base_tip(arm.neutral)),
        "no result": ik.solve(FAR),
        "poses": (StampedPose(FAR, NamedFrame("map", FAR)), inverse.Tolerance.about("z")),
        "self-motion": inverse.trace_self_motion(arm, arm.neutral),
        "plan": plan,
        "no plan": plan_pick_and_place(refused, manipulator, SCENE, arm.start),
        "certificate": verify(plan),
        "motion of others": others(arm, world),
        "body": (RobotBody.load(), RobotBody.load().padded(0.01)),
        "space": (space, space.with_margin(0.001)),
        "line": (planner.StraightLine(FAR, FAR * at(0.0, 0.0, 0.02)), planner.LineTolerance()),
        "simulation": simulation,
        "outcome": outcome,
        "bench": (
            sim.Workbench(robot),
            sim.TaskResult("carry a", "a", "", 0.0, 0.1, None, "no", False),
        ),
        "recording": (recorder.recording(), recorder.recording().motion("left")),
        "snapshot": sim.Snapshot(0.0, world.q, {"block": FAR}, closed_grippers(), "waits"),
        "page": sim.Replay(recorder.recording(), robot),
        "tasks": (TASK, sim.Transfer("block", FAR, FAR)),
        "moves": moves(arm),
        "response": (tracked := planner.Response((0.35, 0.45), 0.001, 0.3)),
        "tracking": planner.prove_tracking(
            plan, tracked, manipulator=manipulator, seek_speed=False
        ),
        "looks": looks(simulation, manipulator),
        "fingers": fingers(manipulator.hand, simulation.world.body("block")),
        "notes": sim.recording.NotedRecording(recorder.recording(), ("a line is cut off",)),
        "commands": sim.recording.Commands(np.arange(2.0), np.zeros((2, 7)), np.ones((2, 7))),
        "shapes": (planner.Sphere(0.1), planner.Cylinder(0.1, 0.2)),
        "hands": (
            ElectricGripper(slot=3),
            planner.tool_of(planner.make_block("probe", at(0.0, 0.0, 0.0)), at(0.0, 0.0, 0.1)),
        ),
    }


def moves(arm: Arm) -> tuple[object, ...]:
    """A move, what is asked of it, and its like that is refused."""
    trajectory = planner.plan_joint_move(arm.neutral, arm.start, arm.limits)
    nearest = planner.collision.Clearance(-0.01, "left_hand", "table", 0.5)
    contact = planner.collision.ContinuousContact(nearest, 0.0, 1.0, 3, 7)
    return trajectory, trajectory.peak_ratios(), contact, trajectory.sample(0.1)


def others(arm: Arm, world: World) -> tuple[object, ...]:
    """A motion of something else's, and its certificate."""
    q = world.arm_q("left")
    motion = planner.PolynomialMotion.waypoints([q, q + 0.01], joint_names=arm.joint_names)
    state = planner.State(Scene({}), dict(zip(world.robot.joint_names, world.q, strict=True)))
    return motion, planner.certify(motion, "left", state)


def looks(simulation: Simulation, manipulator: Manipulator) -> tuple[object, ...]:
    """What looks where the block is, and what comes of it."""
    eyes = sim.TruePoses(simulation.world)
    loop = sim.ClosedLoop(simulation, manipulator, eyes)
    seen = eyes.observe("block", simulation.time_s)
    result = sim.perception.LoopResult(
        (sim.perception.Attempt(None, None, "nothing was seen"),), "nothing was seen"
    )
    noisy = sim.NoisyPoses(eyes, sim.Noise(), np.random.default_rng(0))
    return loop, seen, result, noisy


def closed_grippers() -> dict[str, sim.world.GripperState]:
    return dict.fromkeys(("left", "right"), sim.world.GripperState(0.0, False, False))


def fingers(hand: planner.Hand, body: planner.Body) -> tuple[object, ...]:
    """What happens between them."""
    miss = planner.grasping.Miss(
        planner.grasping.MissKind.NOTHING, "nothing is between the finger pads"
    )
    push = sim.world.Push("block", "left", "pad", 0.01, 0.005, np.eye(3)[1], FAR)
    holding = planner.Attachment("block", "left_gripper", FAR)
    contact = sim.world.Contact(0.1, "left_hand", "block", False, 1e-3, True, 0.0)
    closing = sim.Closing(0.01, miss=miss, pushes=(push,))
    claim = planner.Claim("upright", {"angle_rad": 0.1})
    return hand, planner.overhead_grasp(hand, body), closing, holding, contact, claim


def same(a: Any, b: Any) -> bool:
    """Whether two are alike: arrays, poses and dataclasses by value, others by their text."""
    if isinstance(a, np.ndarray):
        return bool(a.flags.writeable == b.flags.writeable and np.array_equal(a, b, equal_nan=True))
    if isinstance(a, pin.SE3):
        return bool(np.array_equal(a.homogeneous, b.homogeneous))
    if (names := field_names(a)) and not isinstance(a, planner.Certificate):
        return same([getattr(a, name) for name in names], [getattr(b, name) for name in names])
    if isinstance(a, (dict, FrozenMapping)):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, (tuple, list)):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, planner.Certificate):
        a, b = a.as_dict(), b.as_dict()  # but for the plan that it is of
    return type(a) is type(b) and (" object at 0x" in repr(a) or repr(a) == repr(b))


@pytest.mark.parametrize("way", COPIES)
def test_copies_are_alike(everything: dict[str, object], way: str) -> None:
    for name, each in everything.items():
        assert same(each, COPIES[way](each)), name


def test_what_is_copied_works(everything: dict[str, Any], left: Arm, plan: Plan) -> None:
    service, T = pickle.loads(pickle.dumps(everything["service"])), left.T_base_tip(left.neutral)
    assert service.solve(T).q.tolist() == everything["result"].q.tolist()
    space, guarded = pickle.loads(pickle.dumps(everything["space"]))
    assert space.is_free(left.neutral)
    assert guarded.is_free(left.neutral)
    assert verify(pickle.loads(pickle.dumps(plan))).is_valid
    tool = pickle.loads(pickle.dumps(everything["tool"])).arm
    assert np.allclose(tool.T_base_tip(left.neutral), T * at(0.0, 0.0, 0.1))


def test_the_body_that_comes_with_the_package_is_not_sent() -> None:
    assert len(pickle.dumps(RobotBody.load())) < 200
    assert pickle.loads(pickle.dumps(RobotBody.load())) is RobotBody.load()


def test_a_copy_of_a_certificate_is_of_no_plan(plan: Plan) -> None:
    certificate = verify(plan)
    assert certificate.is_of(plan)
    assert not pickle.loads(pickle.dumps(certificate)).is_of(plan)
    together = copy.deepcopy((plan, certificate))
    assert not together[1].is_of(together[0])


def test_every_public_class_was_copied_or_refuses(everything: dict[str, object]) -> None:
    copied = {name for each in everything.values() for name in classes_in(pickle.dumps(each))}
    public = {
        cls.__qualname__: cls
        for package in set(FRONT_DOORS) - {inverse}
        for cls in (getattr(package, name) for name in package.__all__)
        if isinstance(cls, type) and not issubclass(cls, (BaseException, Enum))
    }
    refusing = {"PlanCsvFile", "TipTarget", "Viewer"}
    abstract = {"Observer", "PoseSource"}
    missing = public.keys() - copied - refusing - abstract
    assert missing == set()


def classes_in(pickled: bytes) -> Iterator[str]:
    """The names of all classes that a pickle speaks of."""
    for opcode, argument, _ in pickletools.genops(pickled):
        if opcode.name in {"SHORT_BINUNICODE", "BINUNICODE"}:
            yield str(argument)


def test_what_holds_a_file_or_a_socket_says_that_it_cannot_be_copied(
    robot: Baxter, tmp_path: Path
) -> None:
    holders: dict[str, Any] = {
        "CsvFile": Recorder(robot, tmp_path / "a.csv"),
        "McapFile": Recorder(robot, tmp_path / "a.mcap"),
        "BagAtEnd": Recorder(robot, tmp_path / "a.bag"),
        "PlanCsvFile": sim.recording.PlanCsvFile(tmp_path / "b.csv"),
        "Viewer": Viewer(robot),
    }
    for name, holder in holders.items():
        for make in COPIES.values():
            with pytest.raises(CopyError, match=f"{name} holds an open file"):
                make(holder)
        holder.close()


def errors() -> list[type[BaxterError]]:
    for package in (baxter_kin, planner, sim):
        for module in pkgutil.iter_modules(package.__path__):
            if module.name == "errors":
                importlib.import_module(f"{package.__name__}.errors")
    found: list[type[BaxterError]] = [BaxterError]
    for each in found:
        found += each.__subclasses__()
    return found


@pytest.mark.parametrize("cls", errors())
def test_every_error_survives(cls: type[BaxterError]) -> None:
    error = cls(*TAKEN.get(cls.__name__, ("something is wrong",)))
    for make in COPIES.values():
        again = make(error)
        assert type(again) is cls
        assert str(again) == str(error)
        assert again.__dict__ == error.__dict__


def test_an_error_in_a_worker_reaches_the_one_who_asked() -> None:
    """It was believed to: `UnknownNameError` hung a pool for ever."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        error = pool.submit(ask_for_a_limb).exception(timeout=60.0)
    assert isinstance(error, UnknownNameError)
    assert error.allowed == ("left", "right")


def ask_for_a_limb() -> None:
    Baxter.load().arm("middle")
