"""Tolerances are numbers, the toolkit's or those that a plan states."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from planner import LineTolerance, Manipulator, Plan
from planner.errors import TaskError
from planner.verification import Tolerances
from tests.conftest import state_at


@pytest.mark.parametrize("value", [-1.0, math.nan, "1"])
def test_a_tolerance_is_a_number_not_below_zero(value: Any) -> None:
    with pytest.raises(TaskError, match="tip_m"):
        Tolerances(tip_m=value)


@pytest.mark.parametrize("name", [field.name for field in fields(Tolerances)])
def test_no_tolerance_may_be_negative(name: str) -> None:
    assert getattr(Tolerances(), name) >= 0.0
    with pytest.raises(TaskError, match=name):
        Tolerances(**{name: -1e-12})


def test_off_its_lines_a_plan_is_allowed_what_it_states(manipulator: Manipulator) -> None:
    loose = LineTolerance(2e-3, 0.01)
    plan = Plan(state_at(manipulator.arm.neutral), (), line_tolerance=loose, limb="left")
    assert Tolerances.of(plan) == replace(Tolerances(), line_m=2e-3, line_rad=0.01)


def test_a_plan_that_states_nothing_is_allowed_the_toolkits_promises(
    manipulator: Manipulator,
) -> None:
    assert Tolerances.of(Plan(state_at(manipulator.arm.neutral), (), limb="left")) == Tolerances()


@pytest.mark.parametrize("wrong", [None, "plan", np.zeros(7)], ids=str)
def test_what_is_no_plan_has_no_tolerances(wrong: Any) -> None:
    with pytest.raises(TaskError, match="plan must be of class Plan"):
        Tolerances.of(wrong)
