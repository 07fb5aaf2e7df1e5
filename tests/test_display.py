"""What a notebook or a prompt shows of every public class: one short line with what matters."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterator
from enum import Enum
from pathlib import Path
from typing import Any

import attrs
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import find, given
from hypothesis import strategies as st

import planner
import planner.collision
import planner.trajectory
import planner.verification
import sim
import sim.perception
import sim.recording
import sim.world
from baxter_kin import Arm, Baxter, IKFailure, IKResult, IKService, JointLimits, SeedType, ik
from baxter_kin.display import MAX_LINE, OneLine, clear, line, millimetres, numbers, seconds
from baxter_kin.fields import evolve
from planner import Body, Grip, Manipulator, Plan, PlanFailure, RobotBody, Scene, Sphere
from planner.collision import Clearance
from sim import Recorder, Simulation, World
from sim.view.live.viewer import Viewer
from tests.conftest import at, overhead, state_at
from tests.front_doors import FRONT_DOORS


def public_classes() -> dict[str, type[Any]]:
    """By name, those that objects can be made of."""
    found = (getattr(package, name) for package in FRONT_DOORS for name in package.__all__)
    return {
        each.__name__: each
        for each in found
        if isinstance(each, type)
        and not issubclass(each, BaseException)
        and not getattr(each, "_is_protocol", False)
    }


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], Any]]:
    """Gives a valid object of a class, from the fuzzing script."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[1] / "scripts"))
        patch.chdir(tmp_path_factory.mktemp("written"))
        values = importlib.import_module("fuzzing.values")
        # wrapped, as hypothesis asks for the long `repr` of what `find` finds
        yield lambda name: find(values.objects(name).map(lambda it: lambda: it), lambda _: True)()
        for name in ("PlanCsvFile", "Viewer"):
            values.one(name).close()


@pytest.mark.parametrize("name", public_classes())
def test_every_public_class_is_shown_in_one_short_line(
    name: str, example: Callable[[str], Any]
) -> None:
    shown = repr(example(name))
    assert shown.isprintable()
    assert len(shown) <= MAX_LINE
    assert shown.removeprefix("<").startswith((f"{name}(", f"{name}."))
    assert " at 0x" not in shown
    assert "array(" not in shown


def test_only_short_values_are_shown_as_python_would() -> None:
    """Shapes whose fields are numbers, enumerations, and two that show themselves."""
    others = {
        name
        for name, each in public_classes().items()
        if not issubclass(each, OneLine) and not attrs.has(each)
    }
    enums = {name for name, each in public_classes().items() if issubclass(each, Enum)}
    unchanging = {"FarthestFromLimits", "MostManipulable"}
    assert others - enums - unchanging == {
        "Arm",
        "NotedRecording",  # a named tuple cannot inherit
    }


class TestWhatMatters:
    def test_robot_and_arm(self, robot: Baxter, left: Arm) -> None:
        assert repr(robot) == "Baxter(arms left and right, 19 joints)"
        assert repr(left) == "Arm('left')"
        assert repr(left.with_tip(at(0.0, 0.0, 0.1))) == "Arm('left', tip='tool')"

    def test_limits(self, left: Arm) -> None:
        assert repr(left.limits) == (
            "JointLimits(7 joints left_s0 .. left_w2, up to 4 rad/s, 2 rad/s^2, 20 rad/s^3)"
        )
        one = JointLimits(("x",), *np.array([[-1.0], [1.0], [1.5], [2.0], [20.0]]))
        assert repr(one) == "JointLimits(1 joint x, up to 1.5 rad/s, 2 rad/s^2, 20 rad/s^3)"

    def test_inverse_kinematics(self, left: Arm) -> None:
        service = IKService(left, "casadi")
        assert repr(service) == "IKService(Arm('left'), backend casadi)"
        q, names = left.neutral, left.joint_names
        found = IKResult(names, q, SeedType.NS_MAP, 1.5e-9, 2e-12)
        assert repr(found) == "IKResult(left, valid, from NS_MAP, 1.5e-09 m and 2e-12 rad off)"
        failure = IKFailure("the pose is 12 mm too far")
        assert repr(failure) == "IKFailure(the pose is 12 mm too far)"
        missed = IKResult(names, q, SeedType.INVALID, 0.01, 0.0, failure)
        assert repr(missed) == "IKResult(left, invalid: the pose is 12 mm too far)"
        curve = ik.trace_self_motion(left, q, step_rad=0.1)
        points = f"{len(curve.q)} points, {curve.length_rad:.3g} rad long, open"
        assert repr(curve) == f"SelfMotion(Arm('left'), {points})"
        assert repr(ik.Tolerance.about("z", tilt_rad=math.pi / 36)) == (
            "Tolerance(rotation_rad=(0, 0, inf), tilt_rad=0.08727)"
        )

    def test_what_planning_needs(self, manipulator: Manipulator, block: Body) -> None:
        assert repr(manipulator) == "Manipulator(Arm('left'), hand opens 57.0 mm, up to 4 rad/s)"
        assert repr(manipulator.hand) == "Hand(left, opens 15.3 .. 57.0 mm)"
        body = RobotBody.load()
        assert repr(body) == "RobotBody(38 links, 175133 triangles)"
        assert repr(body.padded(0.01)) == "RobotBody(38 links, 175133 triangles, padded 10.0 mm)"
        made = planner.make_block("red", at(0.7, 0.15, -0.13))
        assert repr(made) == "Body('red', movable, 1 part, at (0.7, 0.15, -0.13) m)"
        assert repr(Scene.of([made, block])) == "Scene(2 bodies: red, block)"
        assert repr(Scene.of()) == "Scene(0 bodies)"

    def test_clearances(self) -> None:
        near = Clearance(0.0188, "left_hand", "table", 0.5)
        assert repr(near) == "Clearance(left_hand is 18.8 mm from table, at 0.50 s)"
        inside = Clearance(-0.01, "left_hand", "table")
        assert repr(inside) == "Clearance(left_hand is 10.0 mm inside table)"

    def test_a_plan_that_is_none(self, left: Arm) -> None:
        failure = PlanFailure("pick: approach", "it is 12 mm too far")
        assert repr(Plan(state_at(left.start), (), failure, limb="left")) == (
            "Plan(left, 0 steps, 0.00 s, invalid: pick: approach: it is 12 mm too far)"
        )
        unproven = Plan(
            state_at(left.start, "right"), (Grip("open", planner.GripperAction.OPEN),), limb="right"
        )
        assert repr(unproven) == "Plan(right, 1 step, 0.00 s, valid)"


def test_a_plan_and_what_comes_of_it(robot: Baxter, manipulator: Manipulator, table: Body) -> None:
    start = Scene.of([table, planner.make_block("red", at(0.7, 0.15, -0.13))])
    task = planner.PickAndPlace("red", overhead(0.7, 0.15, -0.129), overhead(0.75, 0.0, -0.129))
    plan = planner.plan_pick_and_place(task, manipulator, start, manipulator.arm.neutral)
    proven_m, time = plan.proven_clearance_m, f"{plan.motion_time_s:.2f} s"
    assert proven_m is not None
    assert repr(plan) == f"Plan(left, 9 steps, {time}, valid, {clear(proven_m)})"
    move = plan.moves[1]
    duration = f"{move.trajectory.duration:.2f} s"
    knots = len(move.trajectory.knots_s)
    assert repr(move.trajectory) == f"Trajectory(left, {duration}, {knots} knots)"
    assert move.proof is not None
    assert repr(move) == (
        f"Move(pick: descend, {duration}, straight, {clear(move.proof.proven_m)})"
    )
    certificate = planner.verify(plan)
    checks = f"{len(certificate.checks)} checks"
    assert repr(certificate) == f"Certificate(left, 9 steps, {time}, valid, {checks})"
    refused = planner.verify(plan, limits=evolve(manipulator.limits, j_max=np.full(7, 1.0)))
    assert repr(refused) == f"Certificate(left, 9 steps, {time}, not valid: {refused.reason})"
    assert repr(refused.failures[0]).startswith("Check(failed, ")
    recorder, world = Recorder(robot), World(robot)
    simulation = Simulation(world, [recorder], check_contacts=False)
    for body in start:
        simulation.spawn(body)
    assert repr(world) == "World(2 bodies: table, red)"
    simulation.execute(plan)
    assert repr(simulation) == f"Simulation({simulation.time_s:.2f} s, {world!r})"
    recording = recorder.recording()
    rows, events = len(recording.times_s), len(recording.events)
    assert repr(recording) == (
        f"Recording({rows} snapshots, {recording.duration_s:.2f} s, {events} events, 2 bodies: "
        "table, red)"
    )
    world.attach("right", "red", pin.SE3.Identity())
    assert repr(world) == "World(2 bodies: table, red, right hand full)"


def test_what_writes_a_file_names_it(robot: Baxter, tmp_path: Path) -> None:
    recorder = Recorder(robot, tmp_path / "a.csv")
    assert repr(recorder).endswith("a.csv, open))")
    recorder.close()
    assert repr(recorder).endswith("a.csv, closed))")
    with Viewer(robot) as viewer:
        assert repr(viewer) == f"Viewer({viewer.url})"


names = st.text(min_size=1, max_size=100).filter(lambda name: name.isprintable() or "\n" in name)
lengths = st.floats(allow_nan=False)


@given(names, lengths, st.none() | st.floats(allow_nan=False))
def test_odd_names_and_numbers_are_shown_too(
    name: str, length: float, time_s: float | None
) -> None:
    near = Clearance(length, name, name, time_s)
    body = Body(name, (planner.Part(Sphere(0.1), at(0.0, 0.0, 0.0)),), at(0.0, 0.0, 1000.0))
    proof = planner.collision.ContinuousProof(length, near, 0.0, 1, 1)
    state = planner.State(Scene.of([body]), {}, ())
    odd: tuple[object, ...] = (
        *(near, body, proof, state, state.scene, IKFailure(name * 5)),
        planner.verification.Check(
            name, length, planner.verification.Relation.ABOVE, 1.0, name, name
        ),
        Grip(name, planner.GripperAction.OPEN, body=name, opening_m=1e300, proof=proof),
        planner.trajectory.JointState(*np.zeros((3, 0))),
        planner.trajectory.JointState(*np.zeros((3, 4, 7))),
        planner.trajectory.JointState(np.array(["x"]), name, 5),  # type: ignore[arg-type]
        sim.recording.NotedRecording(None, -1),  # type: ignore[arg-type]
        sim.world.Contact(1e300, name, name, False, length, True, 0.0),
        sim.Outcome(name * 3, 1e300),
        sim.perception.LoopResult((), name),
        sim.Noise(1e300, 1e-300, 0.1234567890123, 1e9),
    )
    for each in odd:
        shown = repr(each)
        assert shown.startswith(f"{type(each).__name__}(")
        assert len(shown) <= MAX_LINE
        assert len(shown.splitlines()) == 1


def test_a_reason_is_left_out_in_one_place_between_words(left: Arm) -> None:
    reason = (
        "wide measures 50.0 mm, 51.3 mm between the pads as it lies, which the right hand opens "
        "for (52.7 mm), but off its middle: a pad would come down 0.1 mm inside it"
    )
    shown = repr(Plan(state_at(left.start), (), PlanFailure("pick: open", reason), limb="left"))
    assert shown.startswith("Plan(left, 0 steps, 0.00 s, invalid: pick: open: wide measures ")
    assert shown.endswith("inside it)")
    (head, tail) = shown.split(" ... ")
    assert head.removeprefix("Plan(left, 0 steps, 0.00 s, invalid: pick: open: ") + " " in reason
    assert " " + tail.removesuffix(")") in reason


@given(st.lists(st.text()))
def test_a_line_is_one_and_short(facts: list[str]) -> None:
    shown = line("Thing", facts)
    assert len(shown) <= MAX_LINE
    assert len(shown.splitlines()) == 1
    assert shown.startswith("Thing(")


@given(st.floats(-9.99, 9.99) | st.floats(10.0, 9999.0))
def test_what_is_proven_is_never_shown_larger(proven_m: float) -> None:
    number, unit, _ = clear(proven_m).split()
    shown_m = float(number) * {"mm": 1e-3, "m": 1.0}[unit]
    assert shown_m <= proven_m + 1e-12


def test_numbers_are_rounded_and_have_units() -> None:
    assert (millimetres(0.01876), millimetres(700.0), millimetres(-1e-9)) == (
        *("18.8 mm", "700 m"),
        "0.0 mm",
    )
    assert (seconds(4.3149), seconds(1e9)) == ("4.31 s", "1e+09 s")
    assert numbers([0.7, -0.0, 1 / 3]) == "(0.7, 0, 0.3333)"
