"""The checker of plans of both arms: against samples by other code, and against edited plans."""

from __future__ import annotations

import copy
import json
import pickle
from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from planner import (
    Manipulator,
    PlanFailure,
    Response,
    TwoArmCertificate,
    TwoArmPlan,
    load_two_arm_plan,
    save_two_arm_plan,
)
from planner.certificate.__main__ import main as check_file
from planner.certificate.checking import Witness, check_both
from planner.certificate.errors import NotCertifiedError
from planner.errors import PlanFileError, TaskError
from planner.motion.response import save_response
from planner.plan_file import save_plan
from planner.two_arms.plan_file import two_arm_document
from planner.verification import certificate_of_both, verify_both
from planner.verification.command_line import main
from tests.planner.two_arms.pairs import SIDES, Measured

Data = dict[str, Any]
Change = Callable[[Data], None]

SHOWN_M = 5e-4
"""By how much what is certified may fall short of what samples find, apart from its share of it."""


@pytest.fixture(scope="module")
def document(plain_plan: TwoArmPlan) -> Data:
    return {**two_arm_document(plain_plan), "certificate": certificate_of_both(plain_plan)}


@pytest.mark.parametrize("name", ["plain", pytest.param("crossing", marks=pytest.mark.slow)])
def test_nothing_is_nearer_than_certified_and_hardly_farther(
    request: pytest.FixtureRequest,
    robot: Baxter,
    manipulators: Mapping[str, Manipulator],
    name: str,
) -> None:
    plan: TwoArmPlan = request.getfixturevalue(f"{name}_plan")
    certificate: TwoArmCertificate = request.getfixturevalue(f"{name}_certificate")
    assert certificate.is_valid
    labels = [label for label, _ in certificate.apart_m]
    assert labels[0] == "bodies of both arms at first"
    assert any(label.endswith(": bodies") for label in labels)  # where a hand acts
    measured, rng = Measured(plan, robot, manipulators), np.random.default_rng(5)
    least_m = certificate.clearance_m
    label = min(certificate.apart_m, key=lambda each: each[1])[0]  # "both arms, 1.2 to 3.4 s"
    begin_s, end_s = (float(word) for word in label.split() if word[0].isdigit())
    always, there = np.linspace(0.0, plan.duration_s, 20), np.linspace(begin_s, end_s, 10)
    times_s = [*always.tolist(), *there.tolist()]
    shares = rng.uniform(0.0, 1.0, len(times_s)).tolist()
    assert not any(map(measured.are_within, times_s, shares, [least_m - 1e-6] * len(times_s)))
    within_s = np.linspace(begin_s, end_s, 400).tolist()
    nearly_m = least_m / 0.98 + SHOWN_M
    assert any(measured.are_within(time_s, 0.5, nearly_m) for time_s in within_s)


@pytest.mark.slow
def test_arms_whose_ways_cross_must_keep_their_clock(crossing_plan: TwoArmPlan) -> None:
    begins = dict(crossing_plan.begins_s)
    begins["right"] = tuple(begin_s + 0.6 for begin_s in begins["right"])
    late = verify_both(evolve(crossing_plan, begins_s=begins))
    assert "not valid: both arms, " in late.verdict


def test_a_file_has_what_the_checker_needs(
    robot: Baxter,
    plain_plan: TwoArmPlan,
    document: Data,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file, urdf = tmp_path / "both.json", tmp_path / "robot.urdf"
    urdf.write_text(robot.description.text)
    save_two_arm_plan(plain_plan, file, certificate=document["certificate"])
    assert check_file([str(file), "--urdf", str(urdf)]) == 0
    said = capsys.readouterr().out
    assert all(each in said for each in ("left", "right", "both arms, 0.000 to"))
    read = load_two_arm_plan(file)
    assert two_arm_document(read) == two_arm_document(plain_plan)
    assert all(step.state is not None for plan in read.plans.values() for step in plan)
    assert Witness.of_file(document["certificate"]["between"]).trace.letters.size > 0


def test_files_of_other_plans_are_refused(plain_plan: TwoArmPlan, tmp_path: Path) -> None:
    save_plan(plain_plan.plans["left"], tmp_path / "left.json")
    with pytest.raises(PlanFileError, match="format"):
        load_two_arm_plan(tmp_path / "left.json")
    save_two_arm_plan(plain_plan, tmp_path / "both.json")
    text = (tmp_path / "both.json").read_text()
    (tmp_path / "both.json").write_text(text.replace('"grip_s": 0.5', '"grip_s": 0.4'))
    with pytest.raises(PlanFileError, match="checksum"):
        load_two_arm_plan(tmp_path / "both.json")


def test_a_certificate_of_both_is_of_its_plan_alone(
    plain_plan: TwoArmPlan, plain_certificate: TwoArmCertificate
) -> None:
    certificate = plain_certificate
    assert certificate.is_of(plain_plan)
    assert not certificate.is_of(evolve(plain_plan))
    assert not pickle.loads(pickle.dumps(certificate)).is_of(plain_plan)
    assert not TwoArmCertificate({}, 1.0).is_of(plain_plan)
    with pytest.raises(TaskError):
        certificate.is_of(plain_plan.plans["left"])  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_certificate_for_another_robot_is_of_no_plan(
    robot: Baxter, plain_plan: TwoArmPlan
) -> None:
    faster = robot.description.text.replace('velocity="1.5"', 'velocity="1.6"')
    other = Baxter.load(faster).description
    with pytest.raises(TaskError, match="another robot"):
        verify_both(plain_plan, description=other)
    certificate = verify_both(plain_plan, description=other, on_another_robot=True)
    assert certificate.is_valid
    assert not certificate.is_of(plain_plan)


def test_the_command_checks_files_of_both_arms(
    parting_plan: TwoArmPlan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_two_arm_plan(parting_plan, tmp_path / "both.json")
    assert main([str(tmp_path / "both.json")]) == 0
    said = capsys.readouterr()
    assert said.out.startswith("left arm\n")
    assert "\nright arm\n" in said.out
    assert "\nboth arms, 0.000 to " in said.out
    assert said.out.endswith("\nvalid\n")
    failed = evolve(parting_plan, failure=PlanFailure("together", "none is found"))
    save_two_arm_plan(failed, tmp_path / "failed.json")
    assert main([str(tmp_path / "failed.json"), "--json"]) == 1
    said = capsys.readouterr()
    assert json.loads(said.out)["is_valid"] is False
    assert "none is found" in said.err
    responses = []
    for side in SIDES:
        save_response(Response((0.02, 0.04), 1e-3), side, tmp_path / f"{side}.json")
        responses += ["--response", str(tmp_path / f"{side}.json")]
    both = str(tmp_path / "both.json")
    assert main([both, "--speed", "0.3", *responses]) == 0
    assert "tracking: arms apart" in capsys.readouterr().out
    assert main([both, *responses[:2]]) == 2
    assert "give one file of each arm" in capsys.readouterr().err
    assert main([str(tmp_path / "both.json"), "--jerk", "10"]) == 2
    assert "--jerk" in capsys.readouterr().err


def test_a_plan_that_failed_is_not_certified(plain_plan: TwoArmPlan) -> None:
    failed = evolve(plain_plan, failure=PlanFailure("together", "none is found"))
    assert "failed" in verify_both(failed).verdict
    with pytest.raises(TaskError, match="failed"):
        certificate_of_both(failed)
    with pytest.raises(TaskError, match="TwoArmPlan"):
        verify_both(plain_plan.plans["left"])  # type: ignore[arg-type]


def plan_of(document: Data, side: str = "left") -> Data:
    plan: Data = document["plan"]["plans"][side]
    return plan


def later(side: str, number: int, by_s: float) -> Change:
    """Let a step begin later, but none of those after it."""

    def change(document: Data) -> None:
        begins = list(document["plan"]["begins_s"][side])
        begins[number] += by_s
        document["plan"]["begins_s"][side] = begins

    return change


def all_later(side: str, by_s: float) -> Change:
    """Let an arm do everything later, so that the windows of the certificate are others."""

    def change(document: Data) -> None:
        begins = document["plan"]["begins_s"][side]
        document["plan"]["begins_s"][side] = [begin_s + by_s for begin_s in begins]

    return change


def turned(joint: str, by_rad: float) -> Change:
    """Turn a joint at the start of both arms, but not in the plan of its arm."""

    def change(document: Data) -> None:
        document["plan"]["start"]["joints"][joint] += by_rad

    return change


def moved(body: str, to: str) -> Change:
    """Put one body where another one stands."""

    def change(document: Data) -> None:
        bodies = document["plan"]["start"]["scene"]["bodies"]
        bodies[body]["T_base_body"] = bodies[to]["T_base_body"]

    return change


def handled(body: str) -> Change:
    """Let the first arm's first grasp be of a body of the other one."""

    def change(document: Data) -> None:
        grips = [step for step in plan_of(document)["steps"] if step["type"] == "Grip"]
        grips[1]["body"] = body

    return change


def held(document: Data) -> None:
    """Let a hand hold something at first."""
    T = document["plan"]["start"]["scene"]["bodies"]["left"]["T_base_body"]
    document["plan"]["start"]["attachments"] = [
        {"body": "left", "link": "left_gripper", "T_link_body": T}
    ]


def without_moves(document: Data) -> None:
    """Let one arm stand still."""
    plan_of(document, "right")["steps"] = []
    document["plan"]["begins_s"]["right"] = []
    document["states"]["right"] = []
    document["certificate"]["right"]["steps"] = []


def another_kind(document: Data) -> None:
    """Let a move be a motion of others, whose contacts and limits are the caller's word."""
    move = next(step for step in plan_of(document)["steps"] if step["type"] == "Move")
    move["type"] = "Motion"


def of_no_length(document: Data) -> None:
    """Let all moves of an arm take no time."""
    for step in plan_of(document, "right")["steps"]:
        if step["type"] == "Move":
            given = step["trajectory"]
            given["knots_s"] = given["knots_s"][:1]
            given["j"] = {"shape": [0, 7]}
            for name in "qva":
                given[name] = given[name][:1]


def waiting_at_speed(document: Data) -> None:
    """Let an arm wait between two moves that it goes through at speed."""
    steps = plan_of(document)["steps"]
    number = next(
        k
        for k, (step, following) in enumerate(pairwise(steps))
        if step["type"] == following["type"] == "Move"
        and np.abs(step["trajectory"]["v"][-1]).max() > 0.01
    )
    begins = list(document["plan"]["begins_s"]["left"])
    document["plan"]["begins_s"]["left"] = [
        *begins[: number + 1],
        *(begin_s + 1.0 for begin_s in begins[number + 1 :]),
    ]


def stating(**entries: Any) -> Change:
    return lambda document: document["plan"].update(entries)


def certified(part: str, **entries: Any) -> Change:
    return lambda document: document["certificate"][part].update(entries)


def wider(document: Data) -> None:
    """State a greater distance between the arms than there is."""
    for step in document["certificate"]["between"]["steps"]:
        step["margin_m"] = 0.5


def exchanged(document: Data) -> None:
    """Exchange the certificates of both arms."""
    parts = document["certificate"]
    parts["left"], parts["right"] = parts["right"], parts["left"]


EDITS: dict[str, tuple[Change, str | None]] = {
    "a step begins too early": (later("left", 1, -0.2), "before the one before"),
    "a step begins too late for the next one": (later("right", 2, 0.2), "does not rest"),
    "an arm begins later": (all_later("left", 0.1), "windows|apart|ends too soon|malformed"),
    "times of other steps": (stating(begins_s={"left": [0.0], "right": [0.0]}), "malformed"),
    "times that are no numbers": (later("left", 0, float("nan")), "malformed"),
    "grips take no time": (stating(grip_s=0.0), "too short"),
    "a move of another kind": (another_kind, "no step of type Motion"),
    "moves of no length": (of_no_length, None),
    "a wait at speed": (waiting_at_speed, "does not rest"),
    "grips take longer": (stating(grip_s=0.7), "before the one before"),
    "another start of an arm": (turned("left_w0", 0.01), "does not begin where the arm is"),
    "both bodies at one place": (moved("left", "right"), None),
    "a body of the other arm": (handled("right"), None),
    "a hand holds something": (held, "holds something at first"),
    "an arm stands still": (without_moves, "does not move"),
    "it failed": (stating(failure={"stage": "together", "reason": "none"}), "failed"),
    "arms of other names": (stating(plans={}), "malformed"),
    "too wide apart": (wider, "apart"),
    "exchanged certificates": (exchanged, None),
    "no window": (certified("between", steps=[]), "other windows"),
    "no rows": (certified("between", letters=""), "malformed"),
    "another body": (certified("between", body="0"), "another body"),
}


@pytest.mark.parametrize("name", EDITS)
def test_an_edited_plan_of_both_arms_is_refused(robot: Baxter, document: Data, name: str) -> None:
    edit, reason = EDITS[name]
    edited = copy.deepcopy(document)
    edit(edited)
    with pytest.raises(NotCertifiedError, match=reason):
        check_both(edited, robot.description.text)
