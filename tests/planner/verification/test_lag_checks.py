"""Checks of an arm that lags: independent code, the same verdicts."""

from __future__ import annotations

import pytest

from baxter_kin.fields import evolve
from planner import Manipulator, PickAndPlace, Plan, Response, Scene, plan_pick_and_place, verify
from planner.verification import Certificate
from tests.conftest import overhead

NAMES = ("tracking: clearance", "tracking: tip off its path", "tracking: tip off its goal")


@pytest.fixture(scope="module")
def tracked_plan(manipulator: Manipulator, scene: Scene) -> Plan:
    task = PickAndPlace("block", overhead(0.70, 0.15, -0.129), overhead(0.75, 0.0, -0.129))
    return plan_pick_and_place(task, manipulator, scene, manipulator.arm.start)


@pytest.fixture(scope="module")
def slow(tracked_plan: Plan) -> Certificate:
    return verify(tracked_plan, response=Response((0.35, 0.45), 0.001, 0.3))


def test_a_lag_of_0_4_s_passes_at_speed_0_3(slow: Certificate) -> None:
    assert slow.is_valid
    assert [check.name for check in slow.checks[-3:]] == list(NAMES)
    assert 0.015 < slow[NAMES[0]].value < 0.023
    assert "last rested" in slow[NAMES[0]].where


def test_it_is_refused_at_full_speed(tracked_plan: Plan) -> None:
    found = verify(tracked_plan, response=Response((0.35, 0.45), 0.001, 1.0))
    assert [check.name for check in found.failures] == ["tracking: tip off its path"]
    assert found["tracking: tip off its path"].where.startswith(("pick: descend", "place: descend"))


def test_the_move_that_may_collide_is_named(tracked_plan: Plan) -> None:
    found = verify(tracked_plan, response=Response((0.35, 0.45), 0.001, 1.0, 0.4))
    assert not found[NAMES[0]].is_passed
    assert "pick: approach" in found[NAMES[0]].where


def test_without_a_response_nothing_is_added(tracked_plan: Plan, slow: Certificate) -> None:
    plain = verify(tracked_plan)
    assert plain.checks == slow.checks[:-3]
    assert not any(check.name.startswith("tracking") for check in plain.checks)
    assert plain.is_of(tracked_plan)


def test_a_plan_of_no_moves_has_nothing_to_track(tracked_plan: Plan) -> None:
    empty = evolve(tracked_plan, steps=())
    found = verify(empty, response=Response((0.3, 0.5)))
    assert found[NAMES[0]].is_passed
