"""Plans of bodies in both hands that all tests of this folder use."""

from __future__ import annotations

import pytest

from planner import Manipulator, TwoArmPlan, plan_pair_carry
from tests.planner.two_arms.pair_moves import carries


@pytest.fixture(scope="session")
def bar_plan(manipulators: dict[str, Manipulator]) -> TwoArmPlan:
    task, state = carries.bar(manipulators)
    return plan_pair_carry(task, manipulators, state)


@pytest.fixture(scope="session")
def tray_plan(manipulators: dict[str, Manipulator]) -> TwoArmPlan:
    task, state = carries.tray(manipulators)
    return plan_pair_carry(task, manipulators, state)
