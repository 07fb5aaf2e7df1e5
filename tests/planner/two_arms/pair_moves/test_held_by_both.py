"""The checker of a body in both hands: against samples by Pinocchio, and against edited plans."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from planner import (
    Claim,
    Manipulator,
    Move,
    Plan,
    Trajectory,
    TwoArmPlan,
    complete,
    load_two_arm_plan,
    save_two_arm_plan,
)
from planner.certificate.__main__ import main as check_file
from planner.certificate.checking import check_both
from planner.certificate.errors import NotCertifiedError
from planner.certificate.timeline import TOGETHER_M, TOGETHER_RAD
from planner.plan import Step
from planner.two_arms.plan_file import two_arm_document
from planner.verification import certificate_of_both, verify_both
from tests.conftest import at
from tests.planner.two_arms.pair_moves import carries
from tests.planner.two_arms.pairs import SIDES

Data = dict[str, Any]

BEND_SHARE = 0.1
"""By how much of the tolerance a bound may exceed what samples find; half of that is usual."""

SLOWER = 2.5
"""Moves that take so much longer leave room below their limits for a change of a joint."""

LIFT, CARRY, LOWER = "pick: retract", "place: approach", "place: descend"


def relative(robot: Baxter, q: FloatArray) -> pin.SE3:
    """The right tip seen from the left one."""
    return robot.arm("left").T_base_tip(q[:7]).actInv(robot.arm("right").T_base_tip(q[7:]))


def test_no_sample_is_beyond_the_bound_and_hardly_below(
    robot: Baxter, manipulators: Mapping[str, Manipulator], tray_plan: TwoArmPlan
) -> None:
    certificate = verify_both(tray_plan)
    assert certificate.is_valid, certificate.verdict
    distance, turn = certificate.checks
    task = carries.tray(manipulators)[0]
    wanted = task.T_body_tips["left"].actInv(task.T_body_tips["right"])
    steps = {each.step.label: each for each in tray_plan.steps_of("left")}
    rng = np.random.default_rng(3)
    times_s = rng.uniform(steps[LIFT].begin_s, steps[LOWER].end_s, 3000)
    errors = [wanted.actInv(relative(robot, q)) for q in tray_plan.trajectory.sample(times_s).q]
    off_m = max(float(np.linalg.norm(each.translation)) for each in errors)
    off_rad = max(float(np.linalg.norm(pin.log3(each.rotation))) for each in errors)
    for check, found, bound in ((distance, off_m, TOGETHER_M), (turn, off_rad, TOGETHER_RAD)):
        assert check.bound == bound
        assert found - 1e-9 <= check.value <= found + BEND_SHARE * bound
        assert "tray" in check.where
    assert certificate.as_dict()["checks"][0]["is_passed"]
    assert distance.name in str(certificate)


@pytest.fixture(scope="module")
def document(bar_plan: TwoArmPlan) -> Data:
    return {**two_arm_document(bar_plan), "certificate": certificate_of_both(bar_plan)}


def test_a_file_has_what_the_checker_needs(
    robot: Baxter,
    bar_plan: TwoArmPlan,
    document: Data,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file, urdf = tmp_path / "bar.json", tmp_path / "robot.urdf"
    urdf.write_text(robot.description.text)
    save_two_arm_plan(bar_plan, file, certificate=document["certificate"])
    assert check_file([str(file), "--urdf", str(urdf)]) == 0
    assert "hands in one body" in capsys.readouterr().out
    assert two_arm_document(load_two_arm_plan(file)) == two_arm_document(bar_plan)


def step_of(document: Data, side: str, label: str) -> Data:
    steps = document["plan"]["plans"][side]["steps"]
    found: Data = next(step for step in steps if step["label"] == label)
    return found


def knot_moved(document: Data) -> None:
    """Move one joint at one knot."""
    step_of(document, "right", CARRY)["trajectory"]["q"][9][5] += 1e-4


def hands_swapped(document: Data) -> None:
    plans = document["plan"]["plans"]
    plans["left"], plans["right"] = plans["right"], plans["left"]


def motions_swapped(document: Data) -> None:
    left, right = (step_of(document, side, CARRY)["trajectory"] for side in SIDES)
    left["q"], right["q"] = right["q"], left["q"]


def later(side: str, by_s: float, first: str) -> Callable[[Data], None]:
    """Let an arm do everything later from a step on."""

    def change(document: Data) -> None:
        number = [s["label"] for s in document["plan"]["plans"][side]["steps"]].index(first)
        begins = document["plan"]["begins_s"][side]
        moved = [b + by_s * (k >= number) for k, b in enumerate(begins)]
        document["plan"]["begins_s"][side] = moved

    return change


def carried_later(document: Data) -> None:
    """Let one arm carry a little later, and both open later, so that the grips still agree."""
    later("right", 0.002, LIFT)(document)
    later("left", 0.002, "place: open")(document)


def not_gripped(document: Data) -> None:
    """Let the right hand close on nothing."""
    step_of(document, "right", "pick: close")["body"] = None
    step_of(document, "right", "place: open")["body"] = None


def stating(side: str, label: str, **claim: Any) -> Callable[[Data], None]:
    return lambda document: step_of(document, side, label)["claims"].append(claim)


EDITS: dict[str, tuple[Callable[[Data], None], str]] = {
    "a knot is moved": (knot_moved, "jumps"),
    "the hands are swapped": (hands_swapped, "plan of the left arm is of the right arm"),
    "their motions are swapped": (motions_swapped, "does not begin where the arm is|jumps"),
    "an arm carries later": (carried_later, "leave their pose in it"),
    "a hand closes on nothing": (not_gripped, "no closing|closing|hand|contact"),
    "a line that is none": (
        stating("right", CARRY, kind="straight", values={}),
        "off its way",
    ),
    "a line with values": (
        stating("left", LIFT, kind="straight", values={"m": 1.0}),
        "another way",
    ),
    "a claim of an empty hand": (
        stating("left", "pick: descend", kind="straight", values={}),
        "not in the hand",
    ),
    "more upright than it is": (
        stating(
            "left",
            CARRY,
            kind="upright",
            values={"axis_x": 0.0, "axis_y": 0.0, "axis_z": 1.0, "max_tilt_rad": 1e-4},
        ),
        "leans",
    ),
}


@pytest.mark.parametrize("name", EDITS)
def test_an_edited_plan_is_refused(robot: Baxter, document: Data, name: str) -> None:
    edit, reason = EDITS[name]
    edited = copy.deepcopy(document)
    edit(edited)
    with pytest.raises(NotCertifiedError, match=reason):
        check_both(edited, robot.description.text)


def bump(knots_s: FloatArray, joint: int, peak_rad: float) -> tuple[FloatArray, ...]:
    """A smooth change of one joint over four pieces: position, velocity, acceleration, jerk."""
    first, states = len(knots_s) // 2, []
    h = np.diff(knots_s)[first : first + 4]
    steps = [np.array([[1.0, t, t**2 / 2], [0.0, 1.0, t], [0.0, 0.0, 1.0]]) for t in h]
    by_jerk = [np.array([t**3 / 6, t**2 / 2, t]) for t in h]
    ends = []
    for k in range(4):
        state = by_jerk[k]
        for step in steps[k + 1 :]:
            state = step @ state
        ends.append(state)
    jerks = np.linalg.svd(np.array(ends).T)[2][-1]  # all that end at rest where they began
    state = np.zeros(3)
    for step, by, jerk in zip(steps, by_jerk, jerks, strict=True):
        state = step @ state + by * jerk
        states.append(state)
    scale = peak_rad / max(abs(each[0]) for each in states)
    qva, j = np.zeros((3, len(knots_s), 7)), np.zeros((len(knots_s) - 1, 7))
    qva[:, first + 1 : first + 5, joint] = scale * np.array(states).T
    j[first : first + 4, joint] = scale * jerks
    return *qva, j


def with_steps(
    plan: TwoArmPlan,
    manipulators: Mapping[str, Manipulator],
    changes: Mapping[str, Callable[[Step], Step]],
) -> TwoArmPlan:
    """The plan with changed steps of some arms, completed again and without proofs."""
    plans = dict(plan.plans)
    for side, change in changes.items():
        bare = (evolve(step, state=None, contacts=(), proof=None) for step in plan.plans[side])
        own = manipulators[side]
        shapes = own.shapes.without(SIDES[1 - SIDES.index(side)])
        changed = evolve(plans[side], steps=tuple(change(step) for step in bare))
        plans[side] = complete(changed, manipulator=evolve(own, shapes=shapes))
    return evolve(plan, plans=plans)


def slowed_and_bent(joint: int, peak_rad: float) -> Callable[[Step], Step]:
    """Slower moves, and a smooth change of a joint while the body is carried."""

    def change(step: Step) -> Step:
        if not isinstance(step, Move):
            return step
        motion = step.trajectory
        parts = [getattr(motion, name) / SLOWER**k for k, name in enumerate("qvaj")]
        knots_s = SLOWER * motion.knots_s
        if step.label == CARRY and peak_rad:
            parts = [x + dx for x, dx in zip(parts, bump(knots_s, joint, peak_rad), strict=True)]
        return evolve(step, trajectory=Trajectory(motion.limits, knots_s, *parts))

    return change


def test_a_smooth_change_of_one_joint_is_refused_where_it_tears(
    bar_plan: TwoArmPlan, manipulators: Mapping[str, Manipulator]
) -> None:
    begins = {side: tuple(SLOWER * b for b in own) for side, own in bar_plan.begins_s.items()}
    later = evolve(bar_plan, begins_s=begins)
    changes = {"left": slowed_and_bent(6, 0.0), "right": slowed_and_bent(6, 4e-4)}
    plan = with_steps(later, manipulators, changes)
    assert "leave their pose in it" in verify_both(plan).verdict


@pytest.mark.parametrize(
    "first", [pytest.param("pick: open", marks=pytest.mark.slow), "pick: close", "place: open"]
)
def test_hands_that_act_one_after_the_other_are_refused(bar_plan: TwoArmPlan, first: str) -> None:
    number = [step.label for step in bar_plan.plans["right"]].index(first)
    late = tuple(b + 0.005 * (k >= number) for k, b in enumerate(bar_plan.begins_s["right"]))
    plan = evolve(bar_plan, begins_s={**bar_plan.begins_s, "right": late})
    assert "one hand alone holds bar" in verify_both(plan).verdict


def test_hands_that_push_the_body_are_refused(
    bar_plan: TwoArmPlan, manipulators: Mapping[str, Manipulator]
) -> None:
    bar = bar_plan.start.scene["bar"]
    scene = bar_plan.start.scene.moved("bar", bar.T_base_body * at(1e-4, 0.0, 0.0))
    start = evolve(bar_plan.start, scene=scene)

    def started(plan: Plan) -> Plan:
        return evolve(plan, start=evolve(plan.start, scene=scene))

    plans = {side: started(plan) for side, plan in bar_plan.plans.items()}
    moved = evolve(bar_plan, start=start, plans=plans)
    moved = with_steps(moved, manipulators, dict.fromkeys(SIDES, lambda step: step))
    assert "pushes bar" in verify_both(moved).verdict


def test_unknown_claims_are_refused(
    tray_plan: TwoArmPlan, manipulators: Mapping[str, Manipulator]
) -> None:
    def change(step: Step) -> Step:
        is_carry = isinstance(step, Move) and step.label == CARRY
        return evolve(step, claims=(Claim("level"),)) if is_carry else step

    plan = with_steps(tray_plan, manipulators, {"left": change})
    assert "a claim that is not known" in verify_both(plan).verdict
