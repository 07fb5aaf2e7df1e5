"""Valid values: what a parameter may be given, by its name and its annotation."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin

from fuzzing.stage import BODY, Stage
from fuzzing.targets import Target
from planner import make_block

Make = Callable[[Stage], Any]


def _constant(value: Any) -> Make:
    return lambda _: value


def _of(kind: str) -> Make:
    return lambda stage: stage[kind]


def _seven(stage: Stage) -> Any:
    return np.array(stage["q"])


def _full(stage: Stage) -> Any:
    return np.array(stage["Baxter"].configuration())


def _two(stage: Stage) -> Any:
    """The configuration of the left arm, twice."""
    return np.tile(_seven(stage), (2, 1))


BY_PARAMETER: MappingProxyType[str, Make] = MappingProxyType(
    {
        "Arm.side": _constant("left"),
        "Baxter.indices.names": _constant(("left_s0",)),
        "Certificate.__getitem__.name": _constant("limit"),
        "certify.motion": lambda stage: stage["PolynomialMotion"],
        "PolynomialMotion.of_coefficients.coefficients": lambda stage: (
            stage["PolynomialMotion"].derivatives
        ),
        "PolynomialMotion.of_coefficients.knots_s": _constant((0.0, 1.0)),
        "PolynomialMotion.through.times_s": _constant((0.0, 1.0)),
        "PolynomialMotion.through.q": _two,
        "PolynomialMotion.through.v": _two,
        "PolynomialMotion.through.a": _two,
        "PolynomialMotion.waypoints.q": _two,
        "ClearanceChecker.clearance.q": _full,
        "ClearanceChecker.configuration.q": _full,
        "Manipulator.q_others": _full,
        "Manipulator.of.q_others": _full,
        "Manipulator.configurations.qs": lambda stage: _seven(stage)[None],
        "Snapshot.q": _full,
        "prove_clear.q": _full,
        "load_object.kind": _constant("table"),
        "costs.q": lambda stage: _seven(stage)[None],
        "about.axis": _constant("z"),
        "pose_from_quaternion.quat_xyzw": _constant((0.0, 0.0, 0.0, 1.0)),
        "JointLimits.names": lambda stage: stage["JointLimits"].names,
        "joint_names": lambda stage: stage["Arm"].joint_names,
        "Mesh.vertices": lambda stage: stage["Mesh"].vertices,
        "Mesh.triangles": lambda stage: stage["Mesh"].triangles,
        "CollisionContext.with_margin.ends": _seven,
        "CollisionContext.obstacles.resting": lambda stage: _seven(stage)[None],
        "pose_from_quaternion.position_m": _constant((0.7, 0.0, 0.1)),
        "Box.size_m": _constant((0.1, 0.2, 0.3)),
        "Tolerance.position_m": _constant((0.0, 0.01, 0.0)),
        "Tolerance.rotation_rad": _constant((0.0, 0.01, 0.0)),
        "Certificate.subject": _constant(None),
        "Scene.of.bodies": lambda stage: list(stage["Scene"]),
        "Part.rgba": _constant((1.0, 0.0, 0.0, 1.0)),
        "Baxter.load.urdf": lambda stage: stage["RobotDescription"].text,
        "hands": lambda stage: {"right": stage["ElectricGripper"]},
        "ElectricGripper.fingers": _constant("wide"),
        "ElectricGripper.tips": _constant("half_round"),
        "ElectricGripper.slot": _constant(3),
        "ElectricGripper.of.text": _constant("narrow-3"),
        "Tool.shapes": lambda stage: stage["Tool"].shapes,
        "Tool.T_hand_tip": lambda stage: stage["Tool"].T_hand_tip,
        "Plan.robot": lambda stage: stage["Plan"].robot,
        "tool_of.body": lambda _: make_block("probe", pin.SE3.Identity()),
        "tool_of.T_hand_tip": lambda stage: stage["Tool"].T_hand_tip,
        "CollisionContext.q_others": lambda stage: stage["Baxter"].configuration(),
        "RobotShapes.index": _constant(0),
        "make_block.colour": _constant("red"),
        "make_block.edge_m": _constant(0.05),
        "plan_free_move.is_clear": _constant(lambda _: True),
        "plan_free_move.timeout_s": _constant(0.2),
        "ClosedLoop.plan": lambda stage: lambda *_: stage["Plan"],
        "ClosedLoop.retries": _constant(0),
        "Simulation.wait.duration_s": _constant(0.05),
        "Simulation.tick_s": _constant(0.01),
        "solve_batch.progress": _constant(lambda _: None),
        "solutions.starts": _constant(4),
        "sample_solutions.turns": _constant(8),
        "step_rad": _constant(0.1),
        "speed_ratio": _constant(0.5),
        "T_base_tips": lambda stage: [stage["SE3"]] * 2,
        "seeds": lambda stage: [_seven(stage), None],
        "candidates": lambda stage: [_seven(stage)],
        "task": _of("PickAndPlace"),
        "of_task.task": _of("Task"),
        "starts": lambda stage: {stage["SeedType"]: 3},
        "tolerance": _constant(0.01),
        "solve.tolerance": _of("Tolerance"),
        "solve_batch.tolerance": _of("Tolerance"),
        "solve_stream.tolerance": _of("Tolerance"),
        "objective": _of("FarthestFromLimits"),
        "Program.objective": lambda stage: stage["Program"].objective,
        "Program.q": lambda stage: stage["Program"].q,
        "Program.parameters": lambda stage: stage["Program"].parameters,
        "Program.pose_error": lambda stage: stage["Program"].pose_error,
        "knots_s": _constant([0.0]),
        "Trajectory.q": lambda stage: _seven(stage)[None],
        "Trajectory.v": lambda _: np.zeros((1, 7)),
        "Trajectory.a": lambda _: np.zeros((1, 7)),
        "Trajectory.j": lambda _: np.zeros((0, 7)),
        "joints": lambda stage: dict(stage["State"].joints),
        "Arm.configuration.joints": _seven,
        "links": lambda stage: stage["RobotBody"].links,
        "skipped_pairs": lambda stage: stage["RobotBody"].skipped_pairs,
        "bodies": lambda stage: dict(stage["Scene"].bodies),
        "arms": lambda stage: stage["Baxter"].arms,
        "observers": lambda stage: [stage["Observer"]],
        "grippers": lambda stage: stage["Snapshot"].grippers,
        "T_base_bodies": lambda stage: stage["Snapshot"].T_base_bodies,
        "path": lambda stage: stage.file("some.file"),
        "file": lambda stage: stage.file("some.file"),
        "source": _of("TruePoses"),
        "space": _of("CollisionContext"),
        "shape": _of("Box"),
        "steps": lambda stage: stage["Plan"].steps,
        "Certificate.steps": _constant(1),
        "straight": _constant(()),
        "limits": _of("JointLimits"),
        "Certificate.limits": _constant("no limits"),
        "mode": _of("SeedMode"),
        "ik": _of("IKService"),
        "Move.ik": _of("IKResult"),
        "PlanFailure.ik": _of("IKResult"),
        "rng": _of("Generator"),
        "step": _of("Move"),
        "detail": _of("Rest"),
    }
)
"""By the parameter's name, where need be with that of the target; the longest that fits counts."""

TAKEN_FROM = MappingProxyType(
    {
        "baxter_kin.ik.SelfMotion": "SelfMotion",
        "planner.Hand": "Hand",
        "planner.MotionCertificate": "MotionCertificate",
        "planner.PolynomialMotion": "PolynomialMotion",
        "sim.recording.ArmMotion": "ArmMotion",
        "sim.Recording": "Recording",
        "sim.recording.Commands": "Commands",
        "baxter_kin.JointLimits": "JointLimits",
    }
)
"""Constructors whose arguments are what an object of the class has."""

BY_PATTERN: tuple[tuple[str, Make], ...] = (
    (r"^(side|limb)$", _constant("left")),
    (r"^T_", _of("SE3")),
    (r"^T$", _of("SE3")),
    (r"^(q|q_\w+|seed|current)$", _seven),
    (r"^(v|a)_(start|goal)$", lambda _: np.zeros(7)),
    (r"^(name|body|touchable|wanted)$", _constant(BODY)),
    (r"^(direction|axis_base)", _constant((0.0, 1.0, 0.0))),
    (r"^(times_s|t|s)$", _constant(0.0)),
    (r"_(m|s|rad)$", _constant(0.01)),
)

BY_ANNOTATION: tuple[tuple[str, Make], ...] = (
    (r"^(tuple|Sequence|Iterable|Collection)\b", _constant(())),
    (r"\bbool\b", _constant(False)),
    (r"\bint\b", _constant(1)),
    (r"\bfloat\b", _constant(0.1)),
    (r"^bytes$", _constant(b"\0\0\0\0")),
    (r"\bstr\b", _constant("a text")),
    (r"\bMapping\b", lambda _: {}),
    (r"\bFloatArray\b|\bArrayLike\b", _seven),
    (r"\bobject\b", _constant(None)),
    (r"\bSE3\b", lambda _: pin.SE3.Identity()),
)


def valid_value(target: Target, parameter: inspect.Parameter, stage: Stage) -> Any:
    """A value that the parameter allows."""
    if target.name in TAKEN_FROM:
        return getattr(stage[TAKEN_FROM[target.name]], parameter.name)
    full = f"{target.name}.{parameter.name}"
    fitting = [key for key in BY_PARAMETER if full.endswith(f".{key}")]
    annotation = str(parameter.annotation)
    classes = [word for word in re.findall(r"\w+", annotation) if word in stage]
    if classes and not any("." in key for key in fitting) and parameter.name not in BY_PARAMETER:
        value = stage[classes[0]]
        return (value,) if annotation.startswith(("tuple", "Sequence", "Iterable")) else value
    if fitting:
        return BY_PARAMETER[max(fitting, key=len)](stage)
    for pattern, make in BY_PATTERN:
        if re.search(pattern, parameter.name):
            return make(stage)
    for pattern, make in BY_ANNOTATION:
        if re.search(pattern, annotation):
            return make(stage)
    raise LookupError(f"no valid value is known for {full}: {annotation}")
