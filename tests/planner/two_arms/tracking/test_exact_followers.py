"""Arms of one lag that follow exactly: what planner and checker state is never contradicted.

An arm of a constant lag, sent an even stream, follows by exponentials. Distances are those that
coal measures between the shapes of both arms, and between the bodies in their hands.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from planner import (
    Grip,
    GripperAction,
    Manipulator,
    Response,
    TwoArmPlan,
    prove_tracking_of_both,
    verify_both,
)
from planner.collision.context import CollisionContext
from planner.plan import Step
from planner.two_arms.across import HandState, context_between, episodes_of
from planner.verification.lag.both_arms import APART, HANDS
from tests.planner.two_arms.pairs import SIDES, one_move_each
from tests.planner.two_arms.tracking.lagging import exactly_followed

ACCURACY_M = 2e-3
"""Difference of coal's distances, as its shapes contain the meshes that proofs use."""

ALIKE_M = 2e-3
"""How far the proofs of planner and checker may differ: they cut time otherwise."""

OPEN = HandState(0.02, 0.0, ())
"""An empty hand."""


def followed_by_both(
    plan: TwoArmPlan, lags_s: Mapping[str, float], speed: float, clock_s: FloatArray
) -> FloatArray:
    """Positions of both arms, the left one's first, shape (k, 14), rad."""
    return np.hstack(
        [exactly_followed(plan.motion_of(side), lags_s[side], speed, clock_s) for side in SIDES]
    )


def least_m(context: CollisionContext, q: FloatArray, pairs: Sequence[int] | None = None) -> float:
    """The smallest distance of pairs, all when not given, at positions of shape (k, 14), m."""
    checker = context.checker
    numbers = list(range(len(checker.checked.pairs))) if pairs is None else list(pairs)
    full, least = np.array(context.q_others), np.inf
    for row in q:
        full[checker.motion_bounds.q_index] = row
        least = min(least, float(np.min(checker.distances_m(full, numbers))))
    return least


@pytest.fixture(scope="module")
def approaching(plain_plan: TwoArmPlan, manipulators: dict[str, Manipulator]) -> TwoArmPlan:
    """Each arm makes one move; at its goal, the right one is near to the left one's."""
    turns = {"left": (0.15, 0.0), "right": (-0.5, 0.42)}
    return one_move_each(plain_plan, manipulators, turns)


def test_the_slower_arm_is_proven_until_it_has_settled(
    approaching: TwoArmPlan, manipulators: dict[str, Manipulator]
) -> None:
    """It comes near to the other one seconds after that has settled."""
    lags_s = {"left": 0.0, "right": 2.0}
    responses = {side: Response((lag_s, lag_s)) for side, lag_s in lags_s.items()}
    q_others = manipulators["left"].robot.configuration(dict(approaching.start.joints))
    context = context_between(
        manipulators["left"].shapes, manipulators, (OPEN, OPEN), q_others, 0.0
    )
    clock_s = np.arange(2.0, 16.0, 1.0)  # it comes nearer all the time
    measured_m = least_m(context, followed_by_both(approaching, lags_s, 1.0, clock_s))
    assert measured_m < 0.03
    proof = prove_tracking_of_both(
        approaching, responses, manipulators=manipulators, seek_speed=False, slowing_s=0.1
    )
    assert 0.01 < proof.apart_m <= measured_m + ACCURACY_M
    certificate = verify_both(approaching, response=responses, slowing_s=0.1)
    (apart,) = (check for check in certificate.checks if check.name == APART)
    assert 0.01 < apart.value <= measured_m + ACCURACY_M
    assert apart.value == pytest.approx(proof.apart_m, abs=ALIKE_M)


def test_both_refuse_a_slower_arm_that_may_settle_too_near(
    approaching: TwoArmPlan, manipulators: dict[str, Manipulator]
) -> None:
    responses = {"left": Response((0.0, 0.0)), "right": Response((2.0, 2.0), 0.045)}
    proof = prove_tracking_of_both(
        approaching, responses, manipulators=manipulators, seek_speed=False
    )
    assert not proof.is_valid
    certificate = verify_both(approaching, response=responses)
    assert APART in [check.name for check in certificate.checks if not check.is_passed]


@pytest.fixture(scope="module")
def slow_giver(handover_plan: TwoArmPlan) -> TwoArmPlan:
    """The handover of a stick, with 1.5 s for the giver to withdraw before the taker leaves."""
    taken_s = handover_plan.begins_s["right"]
    closes = next(k for k, each in enumerate(handover_plan.plans["right"]) if is_close(each))
    later = (begin_s + (1.5 if k > closes else 0.0) for k, begin_s in enumerate(taken_s))
    begins_s = {"left": handover_plan.begins_s["left"], "right": tuple(later)}
    return evolve(handover_plan, begins_s=begins_s)


def is_close(step: Step) -> bool:
    return isinstance(step, Grip) and step.action is GripperAction.CLOSE


def holding(plan: TwoArmPlan, manipulators: dict[str, Manipulator], name: str) -> CollisionContext:
    """Both arms with the body in the left hand and the right hand open."""
    left = episodes_of(plan.plans["left"], manipulators["left"], [name])
    brings = next(
        each.state
        for each in left
        if not each.is_grip and any(of.T_tip_body is not None for of in each.state.bodies)
    )
    right = episodes_of(plan.plans["right"], manipulators["right"], [])[0].state
    q_others = manipulators["left"].robot.configuration(dict(plan.start.joints))
    return context_between(
        manipulators["left"].shapes, manipulators, (brings, right), q_others, 0.0
    )


@pytest.mark.slow
def test_a_taker_that_may_reach_into_a_body_that_still_comes_is_refused(
    slow_giver: TwoArmPlan, manipulators: dict[str, Manipulator]
) -> None:
    """The giver is on its way when the taker, which lags less, has its fingers around the place."""
    lags_s, speed = {"left": 0.4, "right": 0.005}, 0.5
    responses = {
        "left": Response((0.38, 0.42), 0.001, speed),
        "right": Response((0.0, 0.01), 0.001, speed),
    }
    context = holding(slow_giver, manipulators, "stick")
    checked = context.checker.checked
    with_stick = [
        number
        for number in range(len(checked.pairs))
        if "stick" in (near := checked.clearance_of(number, 0.0)).first + near.second
    ]
    closes = next(each for each in slow_giver.steps_of("right") if is_close(each.step))
    clock_s = np.arange(0.0, closes.begin_s, 0.02)
    assert verify_both(slow_giver).is_valid
    planned = np.hstack([slow_giver.motion_of(side).sample(clock_s).q for side in SIDES])
    assert least_m(context, planned, with_stick) > 0.001
    assert least_m(context, followed_by_both(slow_giver, lags_s, speed, clock_s), with_stick) < 0.0
    proof = prove_tracking_of_both(
        slow_giver,
        responses,
        manipulators=manipulators,
        seek_speed=False,
        start_rad=0.002,
        slowing_s=0.2,
    )
    assert not proof.is_valid
    certificate = verify_both(slow_giver, response=responses, slowing_s=0.2)
    failed = [check.name for check in certificate.checks if not check.is_passed]
    assert failed
    assert set(failed) <= {APART, HANDS}
