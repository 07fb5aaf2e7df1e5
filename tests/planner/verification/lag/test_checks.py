"""Checks of an arm that lags: independent code, the same verdicts."""

from __future__ import annotations

import pytest

from planner import Plan, Response, verify
from planner.verification import Certificate

NAMES = ("tracking: clearance", "tracking: tip off its path", "tracking: tip off its goal")


@pytest.fixture(scope="module")
def slow(tracked_plan: Plan) -> Certificate:
    return verify(tracked_plan, response=Response((0.35, 0.45), 0.001, 0.3))


@pytest.mark.slow
def test_a_lag_of_0_4_s_passes_at_speed_0_3(slow: Certificate) -> None:
    assert slow.is_valid
    assert [check.name for check in slow.checks[-3:]] == list(NAMES)
    assert 0.015 < slow[NAMES[0]].value < 0.023
    assert "last rested" in slow[NAMES[0]].where


@pytest.mark.slow
def test_it_is_refused_at_full_speed(tracked_plan: Plan) -> None:
    found = verify(tracked_plan, response=Response((0.35, 0.45), 0.001, 1.0))
    assert [check.name for check in found.failures] == ["tracking: tip off its path"]
    assert found["tracking: tip off its path"].where.startswith(("pick: descend", "place: descend"))


def test_the_move_that_may_collide_is_named(tracked_plan: Plan) -> None:
    found = verify(tracked_plan, response=Response((0.35, 0.45), 0.001, 1.0, 0.4))
    assert not found[NAMES[0]].is_passed
    assert "pick: approach" in found[NAMES[0]].where


def test_without_a_response_nothing_is_added(
    tracked_certificate: Certificate, slow: Certificate
) -> None:
    assert tracked_certificate.checks == slow.checks[:-3]
    assert not any(check.name.startswith("tracking") for check in tracked_certificate.checks)
