"""Certified plans with one thing changed, as `scripts/try_mutants.py` makes and judges them."""

from __future__ import annotations

import copy
import importlib
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from planner.certificate.body import Body

script: Any = importlib.import_module("try_mutants")


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    found: dict[str, Any] = next(script.certified_plans(35, 1))
    return found


@pytest.fixture(scope="module")
def body(robot: Baxter) -> Body:
    return Body(robot.description.text)


@pytest.mark.slow
@pytest.mark.parametrize("kind", script.MUTATIONS)
def test_no_mutant_is_certified_wrongly(
    document: dict[str, Any], body: Body, robot: Baxter, kind: str
) -> None:
    rng = np.random.default_rng(35)
    for _ in range(5):
        mutant = script.Mutant(copy.deepcopy(document), robot.description.text)
        what = script.MUTATIONS[kind](rng, mutant)
        outcome = script.judged(mutant, body)
        assert not outcome.startswith("WRONG"), what


@pytest.mark.slow
def test_a_plan_that_is_unchanged_is_certified(
    document: dict[str, Any], body: Body, robot: Baxter
) -> None:
    mutant = script.Mutant(copy.deepcopy(document), robot.description.text)
    assert script.judged(mutant, body) == "certified"


def test_a_longer_arm_that_reaches_elsewhere_would_be_told(
    document: dict[str, Any], robot: Baxter
) -> None:
    """The judge of changed robots does not rest on the checker."""
    longer = robot.description.text.replace("0.26242", "0.27242")
    assert longer != robot.description.text
    assert script._moved_m(document, longer) > 1e-3
