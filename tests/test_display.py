"""What a notebook or a prompt shows of every public class: one short line with what matters."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from hypothesis import given
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
from baxter_kin.display import MAX_LINE, clear, line, millimetres, numbers, seconds
from planner import Body, Grip, Plan, PlanFailure, Scene, Sphere
from planner.collision import Clearance
from sim import Recorder, World
from sim.view.live.viewer import Viewer
from tests.conftest import at, state_at
from tests.front_doors import FRONT_DOORS
from tests.specimens import parts_of


def public_classes() -> set[type[Any]]:
    """Those that objects are made of, without enumerations and protocols."""
    found = {getattr(package, name) for package in FRONT_DOORS for name in package.__all__}
    return {
        each
        for each in found
        if isinstance(each, type)
        and not issubclass(each, (BaseException, Enum))
        and not getattr(each, "_is_protocol", False)
    }


def test_every_public_class_is_shown_in_one_short_line(
    specimens: dict[str, object], left: Arm
) -> None:
    objects = {type(each): each for each in parts_of((specimens, ik.Program.of(left)))}
    missing = public_classes() - set(objects)
    assert {each.__name__ for each in missing} <= WITHOUT_SPECIMEN
    for kind in public_classes() & set(objects):
        shown = repr(objects[kind])
        assert shown.isprintable()
        assert len(shown) <= MAX_LINE
        assert shown.startswith(f"{kind.__name__}(")
        assert " at 0x" not in shown
        assert "array(" not in shown


WITHOUT_SPECIMEN = {"Observer", "PlanCsvFile", "PoseSource", "TipTarget", "Viewer"}
"""Abstract classes, and those that hold files or sockets."""


def test_what_matters_is_shown(left: Arm, robot: Baxter, specimens: dict[str, Any]) -> None:
    q, names = left.neutral, left.joint_names
    failure = IKFailure("the pose is 12 mm too far")
    block = planner.make_block("red", at(0.7, 0.15, -0.13))
    unproven = Grip("open", planner.GripperAction.OPEN)
    shown = {
        "Baxter(arms left and right, 19 joints)": robot,
        "Arm('left', tip='tool')": left.with_tip(at(0.0, 0.0, 0.1)),
        "JointLimits(1 joint x, up to 1.5 rad/s, 2 rad/s^2, 20 rad/s^3)": JointLimits(
            ("x",), *np.array([[-1.0], [1.0], [1.5], [2.0], [20.0]])
        ),
        "IKService(Arm('left'), backend casadi)": IKService(left, "casadi"),
        "IKResult(left, valid, from NS_MAP, 1.5e-09 m and 2e-12 rad off)": IKResult(
            names, q, SeedType.NS_MAP, 1.5e-9, 2e-12
        ),
        "IKResult(left, invalid: the pose is 12 mm too far)": IKResult(
            names, q, SeedType.INVALID, 0.01, 0.0, failure
        ),
        "Tolerance(rotation_rad=(0, 0, inf), tilt_rad=0.1)": ik.Tolerance.about("z", tilt_rad=0.1),
        "Body('red', movable, 1 part, at (0.7, 0.15, -0.13) m)": block,
        "Scene(1 body: red)": Scene.of([block]),
        "Clearance(left_hand is 18.8 mm from table, at 0.50 s)": Clearance(
            0.0188, "left_hand", "table", 0.5
        ),
        "Clearance(left_hand is 10.0 mm inside table)": Clearance(-0.01, "left_hand", "table"),
        "Plan(right, 1 step, 0.00 s, valid)": Plan(
            state_at(left.start, "right"), (unproven,), limb="right"
        ),
    }
    assert {text: repr(each) for text, each in shown.items()} == {text: text for text in shown}
    plan = specimens["plan"]
    assert repr(plan) == (
        f"Plan(left, 9 steps, {plan.motion_time_s:.2f} s, valid, {clear(plan.proven_clearance_m)})"
    )
    assert repr(specimens["certificate"]).startswith("Certificate(left, 9 steps, ")
    world = World(robot)
    world.spawn(block)
    world.attach("right", "red", pin.SE3.Identity())
    assert repr(world) == "World(1 body: red, right hand full)"


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


def test_a_long_reason_is_cut_in_one_place_between_words(left: Arm) -> None:
    reason = (
        "wide measures 50.0 mm, 51.3 mm between the pads as it lies, which the right hand opens "
        "for (52.7 mm), but off its middle: a pad would come down 0.1 mm inside it"
    )
    begin = "Plan(left, 0 steps, 0.00 s, invalid: pick: open: "
    shown = repr(Plan(state_at(left.start), (), PlanFailure("pick: open", reason), limb="left"))
    (head, tail) = shown.split(" ... ")
    assert reason.startswith(head.removeprefix(begin) + " ")
    assert reason.endswith(" " + tail.removesuffix(")"))


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
