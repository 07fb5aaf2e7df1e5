"""Valid values for the parameters of everything public, and hostile ones, as strategies.

An object of a public class is built from valid values of its required fields. `LASTING` and
`CHANGING` construct objects whose parts must be consistent; `NAMED`, `PATTERNS` and `ANNOTATIONS`
give all other values, by the name of a parameter or by its annotation.
"""

from __future__ import annotations

import functools  # noqa: F401 - for `HOSTILE`
import inspect
import itertools  # noqa: F401 - the same
import re
from collections.abc import Callable, Mapping
from enum import Enum
from pathlib import Path  # noqa: F401 - the same
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin
from hypothesis import strategies as st

import planner as p
import sim as s
from baxter_kin import Baxter, ElectricGripper, IKService, ik
from baxter_kin.ik.tolerance import Task
from fuzzing.targets import CONSTRUCTIBLE, Target
from planner.clearance import Clearance, ContinuousProof
from planner.two_arms.pair_moves.relative_pose import RelativeDeviation
from planner.verification import Relation
from sim.events import Sample
from sim.ros1.definitions import message_type

Strategy = st.SearchStrategy[Any]

LONG = 100_000
"""Length of the strings that no message should repeat."""

FILLER = "x"
TABLE_Z_M = -0.155
BODY = "block"
HAND_Y_M = {"left": 0.2, "right": -0.2}


class Stranger:
    """A class unknown to the toolkit."""


HOSTILE = tuple(
    r"""
None
5
-1
0
0.5
nan
inf
-inf
1e308
1e-308
10**12
10**400
True
1j
""
"x"
"0.1"
"\ud800"
"a\0b"
FILLER * LONG
b"x"
FILLER.encode() * LONG
()
[]
{}
set()
{"a": 1}
{5: None}
[None]
["a", "b"]
[[1, 2], [3]]
functools.reduce(lambda inner, _: [inner], range(100), [])
[1.0] * 7
["1"] * 7
[10**400] * 7
(x for x in [1.0, 2.0])
itertools.count()
itertools.repeat(pin.SE3.Identity())
range(10**12)
np.zeros(0)
np.zeros(3)
np.zeros(7)
np.zeros((2, 7))
np.zeros((0, 7))
np.zeros((3, 3))
np.zeros((4, 4))
np.zeros(LONG)
np.full(7, nan)
np.full(7, inf)
np.full(7, 1e308)
np.ma.array(np.zeros(7), mask=[True] + [False] * 6)
np.array([None, "a", 1.0], dtype=object)
np.zeros(7, dtype=np.complex128)
np.ones(7, dtype=np.bool_)
np.array(["a"] * 7)
np.array(["2020-01-01"] * 7, dtype="datetime64[D]")
np.zeros(7, dtype=np.int8)
pin.SE3(np.eye(3), np.array([nan, 0.0, 0.0]))
pin.SE3(np.eye(3), np.array([1e308, 0.0, 0.0]))
pin.SE3(np.diag([-1.0, 1.0, 1.0]), np.zeros(3))
pin.SE3(np.zeros((3, 3)), np.zeros(3))
pin.SE3(np.eye(3) + np.diag([1.0, 0.0], k=1), np.zeros(3))
Stranger()
Stranger
lambda *_: None
Path()
""".strip().splitlines()
)
"""Python expressions; a report shows them as they are."""


def hostile(expression: str) -> Any:
    """The value of an expression in `HOSTILE`."""
    return eval(expression, {**globals(), "nan": np.nan, "inf": np.inf})


# Objects whose parts must be consistent


def _recording() -> s.Recording:
    recorder, world = s.Recorder(one("Baxter")), s.World(one("Baxter"))
    simulation = s.Simulation(world, [recorder])
    recorder.remember(one("Scene"))
    for body in one("Scene"):
        simulation.spawn(body)
    simulation.execute(one("Plan"))
    return recorder.recording()


def _snapshot() -> s.Snapshot:
    seen: list[s.Snapshot] = []

    class Eye(s.Observer):
        def on_snapshot(self, snapshot: s.Snapshot) -> None:
            seen.append(snapshot)

    s.play_back(one("Recording"), Eye())
    return seen[-1]


def _scene() -> p.Scene:
    T = pin.SE3(np.eye(3), np.array([0.8, 0.0, TABLE_Z_M - 0.01]))
    table = p.Body("table", (p.Part(p.Box((0.6, 1.0, 0.02)), pin.SE3.Identity()),), T)
    return p.Scene.of([table, one("Body")])


def _world() -> s.World:
    world = s.World(one("Baxter"))
    for body in one("Scene"):
        world.spawn(body)
    return world


def _pair_move() -> Any:
    near = Clearance(0.02, "left_hand", "table", 0.5)
    return p.PairMove(
        "tray",
        one("Trajectory"),
        np.eye(4)[None],
        RelativeDeviation(1e-5, 1e-4, 256),
        ContinuousProof(0.01, near, 0.0, 1, 1),
    )


def _body_tips() -> dict[str, pin.SE3]:
    return {side: pin.SE3(np.eye(3), np.array([0.0, y, 0.0])) for side, y in HAND_Y_M.items()}


def _sample() -> Sample:
    flags = {"is_enabled": True, "is_stopped": False, "has_error": False}
    return Sample(0.0, "left", *[np.array(one("q"))] * 3, np.zeros(7), 0.0, 0.0, **flags)


LASTING: Mapping[str, Callable[[], Any]] = MappingProxyType(
    {
        "Baxter": Baxter.load,
        "Arm": lambda: one("Baxter").arm("left"),
        "Model": lambda: one("Baxter").model,
        "RobotDescription": lambda: one("Baxter").description,
        "q": lambda: one("Arm").neutral,
        "SE3": lambda: one("Arm").T_base_tip(one("q")),
        "ElectricGripper": lambda: ElectricGripper(slot=3),
        "Tool": lambda: p.tool_of(
            p.make_block("probe", pin.SE3.Identity()),
            pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.1])),
        ),
        "IKService": lambda: IKService(one("Arm")),
        "IKResult": lambda: one("IKService").solve(one("SE3")),
        "JointLimits": lambda: one("Arm").limits,
        "Program": lambda: ik.Program.of(one("Arm")),
        "Tolerance": lambda: ik.Tolerance.about("z"),
        "Task": lambda: Task.of(one("Arm"), one("Tolerance")),
        "SelfMotion": lambda: ik.trace_self_motion(one("Arm"), one("q"), step_rad=0.1),
        "RobotBody": p.RobotBody.load,
        "RobotShapes": lambda: p.RobotShapes(one("Baxter")),
        "Manipulator": lambda: p.Manipulator.of(one("Baxter"), "left"),
        "Hand": lambda: one("Manipulator").hand,
        "Box": lambda: p.Box((0.1, 0.1, 0.1)),
        "Mesh": lambda: p.Mesh(
            np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]),
            [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        ),
        "Body": lambda: p.make_block(
            BODY, pin.SE3(np.eye(3), np.array([0.7, 0.15, TABLE_Z_M + 0.02])), edge_m=0.04
        ),
        "Scene": _scene,
        "Attachment": lambda: p.Attachment(BODY, "right_gripper", pin.SE3.Identity()),
        "State": lambda: p.State.of(one("Manipulator"), one("Scene")),
        "T_grasp": lambda: p.overhead_grasp(one("Hand"), one("Body")),
        "Grasp": lambda: one("Hand").close_on(one("T_grasp"), one("Body"), one("Hand").stroke_m),
        "Trajectory": lambda: p.plan_joint_move(one("q"), one("q") + 0.1, one("JointLimits")),
        "StraightLine": lambda: p.StraightLine(
            one("SE3"), pin.SE3(one("SE3").rotation, one("SE3").translation + 0.05 * np.eye(3)[2])
        ),
        "Polyline": lambda: p.Polyline([one("SE3"), one("StraightLine").T_base_goal]),
        "Arc": lambda: p.Arc(
            one("SE3"), one("SE3").translation + 0.05 * np.eye(3)[0], np.eye(3)[2], 0.5
        ),
        "Curve": lambda: p.Curve(one("StraightLine").at, 0.5),
        "Response": lambda: p.Response((0.35, 0.45), 0.001, 0.3),
        "TrackingProof": lambda: p.TrackingProof(
            one("Response"), (), 0.0, 0.04, 0.02, np.zeros(7), 0.3
        ),
        "TwoArmTrackingProof": lambda: p.TwoArmTrackingProof(
            {}, (), (), 0.005, 0.02, None, "none is found"
        ),
        "MessageType": lambda: message_type("std_msgs/String"),
        "CollisionContext": lambda: one("Manipulator").context(one("Scene"), finger_m=0.01),
        "Plan": lambda: p.Plan(
            one("State"),
            (p.Move("move", one("Trajectory")), p.Grip("open", p.GripperAction.OPEN)),
        ),
        "TwoArmPlan": lambda: p.TwoArmPlan(
            one("State"),
            _both_plans(),
            _both_begins(),
            0.5,
            failure=p.PlanFailure("place: descend", "both hands cannot be there at once"),
        ),
        "TwoArmCertificate": lambda: p.TwoArmCertificate({}, 1.0, "none is found"),
        "FollowedPath": lambda: p.FollowedPath(
            tuple(one("Polyline").pieces()), np.ones(1), speed_m_s=0.1
        ),
        "PairCarry": lambda: p.PairCarry(BODY, _body_tips(), one("SE3")),
        "Handover": lambda: p.Handover(BODY, one("Body").T_base_body),
        "PairMove": _pair_move,
        "PickAndPlace": lambda: p.PickAndPlace(BODY, one("T_grasp"), one("T_grasp")),
        "Transfer": lambda: s.Transfer(
            BODY,
            one("Body").T_base_body.inverse() * one("T_grasp"),
            one("Body").T_base_body,
        ),
        "Relation": lambda: Relation.AT_MOST,
        "Certificate": lambda: p.verify(one("Plan")),
        "PolynomialMotion": lambda: p.PolynomialMotion.through(
            (0.0, 1.0), [one("q"), one("q") + 0.01], joint_names=one("Arm").joint_names
        ),
        "MotionCertificate": lambda: p.certify(one("PolynomialMotion"), "left", one("State")),
        "Contact": lambda: p.Contact.of_supports(BODY, frozenset({"table"}))[0],
        "Recording": _recording,
        "Commands": lambda: s.recording.Commands(
            one("Recording").times_s, *[one("Recording").motion("left").q] * 2
        ),
        "Sample": _sample,
        "ArmMotion": lambda: one("Recording").motion("left"),
        "RecordedPlan": lambda: s.recording.RecordedPlan(one("Plan"), 0.01, 0.005, "left_s0", 0.1),
        "Comparison": lambda: s.recording.compare_run(one("Plan"), one("Recording")),
        "Snapshot": _snapshot,
    }
)
"""Immutable objects by the name of their class; made once per process."""

CHANGING: Mapping[str, Callable[[], Any]] = MappingProxyType(
    {
        "Generator": lambda: np.random.default_rng(0),
        "World": _world,
        "Simulation": lambda: s.Simulation(one("World")),
        "Workbench": lambda: s.Workbench(one("Baxter")),
        "PlanCsvFile": lambda: s.recording.PlanCsvFile("csv"),
        "ClosedLoop": lambda: s.ClosedLoop(
            one("Simulation"), one("Manipulator"), s.TruePoses(one("World")), retries=0
        ),
        "TipTarget": lambda: s.TipTarget(one("Viewer"), one("Baxter"), "left"),
    }
)
"""Mutable objects; made anew for each target, so that its calls are reproducible."""

_made: dict[str, Any] = {}


def one(kind: str) -> Any:
    """The object of that name in `LASTING` or `CHANGING`; a viewer that is open."""
    if kind == "Viewer":  # starting one takes long
        if "closed" in repr(_made.get(kind, "closed")):
            _made[kind] = s.Viewer(one("Baxter"))
    elif kind not in _made:
        _made[kind] = {**LASTING, **CHANGING}[kind]()
    return _made[kind]


def _both_plans() -> dict[str, p.Plan]:
    """The plans of both arms, that of the right one without steps."""
    return {"left": one("Plan"), "right": p.Plan(one("State"), (), limb="right")}


def _both_begins() -> dict[str, tuple[float, ...]]:
    """When the steps of these plans begin."""
    return {"left": (0.0, 100.0), "right": ()}


def forget() -> None:
    """Discard the mutable objects."""
    for kind in CHANGING:
        _made.pop(kind, None)


# Valid values


def _given(value: Any) -> Strategy:
    return st.just(value)


def _of(kind: str) -> Strategy:
    return st.deferred(lambda: objects(kind))


def _made_by(make: Callable[[], Any]) -> Strategy:
    return st.builds(make)


_seven = _made_by(lambda: np.array(one("q")))
_one_row = _made_by(lambda: np.array(one("q"))[None])
_two_rows = _made_by(lambda: np.tile(one("q"), (2, 1)))
_all_joints = _made_by(lambda: np.array(one("Baxter").configuration()))
_seconds = _given((0.0, 1.0))

NAMED: Mapping[str, Strategy] = MappingProxyType(
    {
        "indices.names": _given(("left_s0",)),
        "Certificate.__getitem__.name": _given("limit"),
        "certify.motion": _of("PolynomialMotion"),
        "of_coefficients.coefficients": _made_by(lambda: one("PolynomialMotion").derivatives),
        "of_coefficients.knots_s": _seconds,
        "through.times_s": _seconds,
        **{f"PolynomialMotion.through.{name}": _two_rows for name in "qva"},
        "PolynomialMotion.waypoints.q": _two_rows,
        "ClearanceChecker.clearance.q": _all_joints,
        "ClearanceChecker.configuration.q": _all_joints,
        "q_others": _all_joints,
        "configurations.qs": _one_row,
        "Snapshot.q": _all_joints,
        "prove_clear.q": _all_joints,
        "load_object.kind": _given("table"),
        "costs.q": _one_row,
        "about.axis": _given("z"),
        "pose_from_quaternion.quat_xyzw": _given((0.0, 0.0, 0.0, 1.0)),
        "pose_from_quaternion.position_m": _given((0.7, 0.0, 0.1)),
        "joint_names": _made_by(lambda: one("Arm").joint_names),
        "Commands.times_s": _made_by(lambda: one("Commands").times_s),
        "with_margin.ends": _seven,
        "obstacles.resting": _one_row,
        "Tolerance.position_m": _given((0.0, 0.01, 0.0)),
        "Tolerance.rotation_rad": _given((0.0, 0.01, 0.0)),
        "Scene.of.bodies": _made_by(lambda: list(one("Scene"))),
        "Part.rgba": _given((1.0, 0.0, 0.0, 1.0)),
        "Baxter.load.urdf": _made_by(lambda: one("RobotDescription").text),
        "hands": _made_by(lambda: {"right": one("ElectricGripper")}),
        "ElectricGripper.of.text": _given("narrow-3"),
        "tool_of.body": _made_by(lambda: p.make_block("probe", pin.SE3.Identity())),
        "tool_of.T_hand_tip": _made_by(lambda: one("Tool").T_hand_tip),
        "RobotShapes.index": _given(0),
        "make_block.colour": _given("red"),
        "make_block.edge_m": _given(0.05),
        "is_clear": _given(lambda _: True),
        "plan_free_move.timeout_s": _given(0.2),
        "ClosedLoop.plan": _made_by(lambda: lambda *_: one("Plan")),
        "retries": _given(0),
        "Simulation.wait.duration_s": _given(0.05),
        "tick_s": _given(0.01),
        "progress": _given(lambda _: None),
        "solutions.starts": _given(4),
        "sample_solutions.turns": _given(8),
        "step_rad": _given(0.1),
        "speed_ratio": _given(0.5),
        "motion_from.speed": _given("recorded"),
        "T_base_tips": _made_by(lambda: [one("SE3")] * 2),
        "seeds": _made_by(lambda: [np.array(one("q")), None]),
        "candidates": _made_by(lambda: [np.array(one("q"))]),
        "of_task.task": _of("Task"),
        "task": _of("PickAndPlace"),
        "TwoArmPlan.plans": _made_by(_both_plans),
        "TwoArmPlan.begins_s": _made_by(_both_begins),
        "steps_of.side": _given("left"),
        "motion_of.side": _given("left"),
        "Replay.recording": _of("Recording"),
        "compare": _given(None),
        "drawing": _of("Polyline"),
        "write_replay.recording": _of("Recording"),
        "part.joints": _given(slice(0, 3)),
        "strokes": _given(None),
        "side_by_side.each": _made_by(lambda: [one("JointLimits")]),
        "plan_pair_carry.task": _of("PairCarry"),
        "plan_handover.task": _of("Handover"),
        "plan_together.tasks": _made_by(
            lambda: {side: one("PickAndPlace") for side in ("left", "right")}
        ),
        "manipulators": _made_by(
            lambda: {"left": one("Manipulator"), "right": p.Manipulator.of(one("Baxter"), "right")}
        ),
        "T_body_tips": _made_by(_body_tips),
        "PairMove.deviation": _made_by(lambda: one("PairMove").deviation),
        "PairMove.proof": _made_by(lambda: one("PairMove").proof),
        "carry_together.left": _made_by(lambda: (BODY, (0.7, 0.2))),
        "carry_together.right": _made_by(lambda: (BODY, (0.7, -0.2))),
        "plan_retract.retreat": _given(()),
        **dict.fromkeys(
            ("approach", "retreat", "place_approach", "place_retreat"),
            _made_by(lambda: p.Line("tool", 0.05)),
        ),
        "direction": _given((0.0, 0.0, 1.0)),
        "TaskResult.task": _given("a task"),
        "starts": _made_by(lambda: {ik.SeedType.USER: 3}),
        "tolerance": _given(0.01),
        **{f"{name}.tolerance": _of("Tolerance") for name in ("solve", "solve_batch")},
        "solve_stream.tolerance": _of("Tolerance"),
        "objective": _of("FarthestFromLimits"),
        "knots_s": _given([0.0]),
        "Arm.configuration.joints": _seven,
        "observers": st.lists(_of("Observer"), max_size=1),
        "path": _given("some.file"),
        "file": _given("some.file"),
        "source": _of("TruePoses"),
        "space": _of("CollisionContext"),
        "shape": _of("Box"),
        "mode": _of("SeedMode"),
        "ik": _of("IKService"),
        "Move.ik": _of("IKResult"),
        "PlanFailure.ik": _of("IKResult"),
        "step": _of("Move"),
        "detail": _of("Rest"),
        "Rest.supports": _given(("table",)),
        "say": _given(lambda _: None),
        "ends": st.tuples(*[_of("CurveEnd")] * 2),
    }
)
"""By the parameter's name, qualified by its target where necessary; the longest match counts."""

PATTERNS: tuple[tuple[str, Strategy], ...] = (
    (r"^(side|limb|arm)$", _given("left")),
    (r"^T(_|$)", _of("SE3")),
    (r"^(q|q_\w+|seed|current)$", _seven),
    (r"^(v|a)_(start|goal)$", _given(np.zeros(7))),
    (r"^(name|body|touchable|wanted)$", _given(BODY)),
    (r"^(direction|axis_base)", _given((0.0, 1.0, 0.0))),
    (r"^(times_s|t|s)$", _given(0.0)),
    (r"_(m|s|rad)$", st.sampled_from((0.01, 0.03))),
)

ANNOTATIONS: tuple[tuple[str, Strategy], ...] = (
    (r"^(tuple|Sequence|Iterable|Collection)\b", _given(())),
    (r"\bbool\b", st.booleans()),
    (r"\bint\b", st.integers(1, 2)),
    (r"\bfloat\b", st.sampled_from((0.1, 0.2))),
    (r"^bytes$", _given(b"\0\0\0\0")),
    (r"\bstr\b", st.sampled_from(("a text", "another"))),
    (r"\bMapping\b", _given({})),
    (r"\bFloatArray\b|\bArrayLike\b", _seven),
    (r"\bobject\b", _given(None)),
    (r"\bPoseLike\b|\bSE3\b", _of("SE3")),
)


def objects(kind: str) -> Strategy:
    """Valid objects of a class, by its name."""
    if kind in {"Viewer", *LASTING, *CHANGING}:
        return st.builds(one, st.just(kind))
    cls = CONSTRUCTIBLE[kind]
    if issubclass(cls, Enum):
        return st.sampled_from(cls)
    parameters = inspect.signature(cls).parameters.values()
    needed = [each for each in parameters if each.default is each.empty]
    return st.builds(cls, **{each.name: valid(f".{kind}", each) for each in needed})


def valid(target: str, parameter: inspect.Parameter) -> Strategy:
    """Valid values of a parameter."""
    kind, annotation = target.rpartition(".")[2], str(parameter.annotation)
    if kind in LASTING and hasattr(one(kind), parameter.name):
        return st.builds(lambda: getattr(one(kind), parameter.name))
    full = f"{target}.{parameter.name}"
    fitting = [key for key in NAMED if full.endswith(f".{key}")]
    if fitting:
        return NAMED[max(fitting, key=len)]
    for word in re.findall(r"\w+", annotation):
        if word in LASTING or word in CHANGING or word in CONSTRUCTIBLE:
            is_many = annotation.startswith(("tuple", "Sequence", "Iterable"))
            return st.tuples(objects(word)) if is_many else objects(word)
    for pattern, found in PATTERNS:
        if re.search(pattern, parameter.name):
            return found
    for pattern, found in ANNOTATIONS:
        if re.search(pattern, annotation):
            return found
    raise LookupError(f"no valid value is known for {full}: {annotation}")


def receivers(target: Target) -> Strategy:
    """Objects on which a method or property is called."""
    return st.none() if target.owner is None else objects(target.owner.__name__)
