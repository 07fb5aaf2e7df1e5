"""Certificates: verdicts, text and data, and the plan and world that one is of."""

from __future__ import annotations

import json
import math
import pickle
import re
from pathlib import Path

import pytest

from baxter_kin.errors import UnknownNameError
from baxter_kin.fields import evolve
from planner import Certificate, Plan, Response, Scene, State, verify
from planner.completion import complete
from planner.verification import Check
from planner.verification.certificate import Relation, Worst, greatest, least
from tests.conftest import at
from tests.planner.verification.conftest import TABLE_M

PAGE = Path(__file__).parents[3] / "docs" / "concepts" / "certificate.md"


def check(value: float, relation: Relation, bound: float) -> Check:
    return Check("velocity limit", value, relation, bound, "rad/s", "pick: approach")


@pytest.mark.slow
def test_the_page_explains_every_check(cube_plan: Plan) -> None:
    stated = complete(cube_plan)
    tracked = verify(stated, response=Response((0.0, 0.0), late_s=0.0))
    section = PAGE.read_text("utf-8").split("## Each line of the table\n")[1].split("\n## ")[0]
    rows = re.findall(r"^\| (.+?) \|", section, re.MULTILINE)[1:]
    names = [name for row in rows for name in row.split(", ")]
    assert names == [check.name for check in tracked.checks]


def test_data_and_table_have_every_check(certificate: Certificate) -> None:
    data = certificate.as_dict()
    assert data["is_valid"] is True
    assert [check["name"] for check in data["checks"]] == [c.name for c in certificate.checks]
    assert all(check.name in certificate.table() for check in certificate.checks)


def test_a_certificate_is_of_its_own_plan_and_world_alone(
    cube_plan: Plan, cube_certificate: Certificate
) -> None:
    again = State(Scene(cube_plan.start.scene.bodies), cube_plan.start.joints)
    assert cube_certificate.is_of(cube_plan)
    assert cube_certificate.is_of(cube_plan, again)
    assert not cube_certificate.is_of(evolve(cube_plan))
    moved = evolve(again, scene=again.scene.moved("block", at(0.70, 0.15, TABLE_M + 1e-12)))
    assert not cube_certificate.is_of(cube_plan, moved)
    turned = evolve(again, joints={**again.joints, "head_pan": 1e-12})
    assert not cube_certificate.is_of(cube_plan, turned)


@pytest.mark.slow
def test_a_certificate_for_another_arm_than_the_plan_is_sent_to_is_of_no_plan(
    cube_plan: Plan,
) -> None:
    stated = evolve(cube_plan, response=Response((0.38, 0.42), 0.001, 0.3))
    assert verify(stated).is_of(stated)
    assert not verify(stated, response=Response((0.0, 0.0), late_s=0.0)).is_of(stated)


@pytest.mark.parametrize(
    ("value", "relation", "bound", "passes"),
    [
        (1.0, Relation.AT_MOST, 1.0, True),
        (1.1, Relation.AT_MOST, 1.0, False),
        (1.0, Relation.AT_LEAST, 1.0, True),
        (0.9, Relation.AT_LEAST, 1.0, False),
        (1.0, Relation.ABOVE, 1.0, False),
        (math.inf, Relation.AT_MOST, 1.0, False),
        (math.nan, Relation.AT_MOST, 1.0, False),
        (math.nan, Relation.ABOVE, 1.0, False),
    ],
)
def test_a_check_is_passed_when_its_value_keeps_the_bound(
    value: float, relation: Relation, bound: float, passes: bool
) -> None:
    assert check(value, relation, bound).is_passed is passes


def test_a_certificate_names_what_fails() -> None:
    checks = (check(0.5, Relation.AT_MOST, 1.0), check(math.inf, Relation.AT_MOST, 1.0))
    certificate = Certificate("left", 2.0, checks)
    assert not certificate.is_valid
    assert certificate.failures == checks[1:]
    assert "1 of 2 checks fail: velocity limit inf rad/s" in certificate.verdict
    assert "FAILS" in str(certificate)


def test_a_value_without_a_number_is_null_in_json() -> None:
    certificate = Certificate("left", 2.0, (check(math.inf, Relation.AT_MOST, 1.0),))
    data = json.loads(json.dumps(certificate.as_dict(), allow_nan=False))
    assert data["checks"][0]["value"] is None
    assert data["checks"][0]["relation"] == "<="


def test_an_unknown_check_is_refused() -> None:
    with pytest.raises(UnknownNameError):
        _ = Certificate("left", 2.0, ())["velocity limit"]


def test_a_certificate_without_a_subject_is_of_no_plan(
    cube_plan: Plan, cube_certificate: Certificate
) -> None:
    sent = pickle.loads(pickle.dumps(cube_certificate))
    assert sent == cube_certificate
    assert sent.subject is None
    assert not sent.is_of(cube_plan)
    assert not Certificate("left", 1.0, ()).is_of(cube_plan)


def test_the_worst_of_nothing_gives_the_reason() -> None:
    found = [Worst(1.0, "a"), Worst(3.0, "b"), Worst(-2.0, "c")]
    assert greatest(found, "none") == Worst(3.0, "b")
    assert least(found, "none") == Worst(-2.0, "c")
    assert greatest([], "none") == Worst(0.0, "none")
    assert least([], "none") == Worst(math.inf, "none")


def test_the_verdict_gives_the_checkers_reason() -> None:
    checks = (check(0.5, Relation.AT_MOST, 1.0), check(math.nan, Relation.AT_LEAST, 0.0))
    found = Certificate("left", 2.0, checks, reason="pick: it jumps at a knot")
    assert not found.is_valid
    assert found.verdict.startswith("not valid: left arm, 2.000 s of motion: pick: it jumps at a ")
    assert found.as_dict()["reason"] == "pick: it jumps at a knot"
    assert "not known" in found.table()
