"""Both arms, and pairs of tasks that all tests of this folder use."""

from __future__ import annotations

import pytest

from baxter_kin import Baxter
from planner import (
    Manipulator,
    TwoArmCertificate,
    TwoArmPlan,
    plan_handover,
    plan_together,
    verify_both,
)
from tests.planner.two_arms.pairs import (
    SIDES,
    HandoverCase,
    PairOfTasks,
    handover_of_stick,
    one_move_each,
    pair,
)


@pytest.fixture(scope="session")
def manipulators(robot: Baxter) -> dict[str, Manipulator]:
    return {side: Manipulator.of(robot, side) for side in SIDES}


@pytest.fixture(scope="session")
def plain(manipulators: dict[str, Manipulator]) -> PairOfTasks:
    """Each arm works on its own side."""
    left, right = ((0.65, 0.2, 0.0), (0.75, 0.4, 0.5)), ((0.75, -0.2, 0.3), (0.65, -0.4, 0.0))
    return pair(manipulators, left, right)


@pytest.fixture(scope="session")
def crossing(manipulators: dict[str, Manipulator]) -> PairOfTasks:
    """Each block lies on the other arm's side, so the ways to and from them cross."""
    left, right = ((0.6, -0.08, 0.0), (0.7, 0.35, 0.0)), ((0.72, 0.08, 0.0), (0.62, -0.35, 0.0))
    return pair(manipulators, left, right)


@pytest.fixture(scope="session")
def plain_plan(plain: PairOfTasks) -> TwoArmPlan:
    return plan_together(*plain.arguments)


@pytest.fixture(scope="session")
def crossing_plan(crossing: PairOfTasks) -> TwoArmPlan:
    """It takes about ten seconds: each round is a motion program of both arms."""
    return plan_together(*crossing.arguments)


@pytest.fixture(scope="session")
def plain_certificate(plain_plan: TwoArmPlan) -> TwoArmCertificate:
    return verify_both(plain_plan)


@pytest.fixture(scope="session")
def crossing_certificate(crossing_plan: TwoArmPlan) -> TwoArmCertificate:
    return verify_both(crossing_plan)


@pytest.fixture(scope="session")
def parting_plan(plain_plan: TwoArmPlan, manipulators: dict[str, Manipulator]) -> TwoArmPlan:
    """Each arm makes one short move away from the other one."""
    turns = {"left": (0.0, 0.1), "right": (0.0, -0.1)}
    return one_move_each(plain_plan, manipulators, turns)


@pytest.fixture(scope="session")
def stick_handover(manipulators: dict[str, Manipulator]) -> HandoverCase:
    """A stick that lies on the left side and is to stand on the right side."""
    return handover_of_stick(manipulators)


@pytest.fixture(scope="session")
def handover_plan(stick_handover: HandoverCase) -> TwoArmPlan:
    return plan_handover(*stick_handover)
