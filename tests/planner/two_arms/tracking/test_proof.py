"""Tracking proofs of both arms: refusals, and simulated arms that never come nearer than proven."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.errors import BaxterError
from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from planner import (
    Body,
    Grip,
    Manipulator,
    PlanFailure,
    Response,
    TwoArmCertificate,
    TwoArmPlan,
    TwoArmTrackingProof,
    plan_pair_carry,
    prove_tracking,
    prove_tracking_of_both,
    verify_both,
)
from planner.completion import after, complete, state_of
from planner.errors import ResponseError, TaskError
from planner.two_arms.tracking.clocked_arm import alone
from planner.two_arms.tracking.proof import MAX_HANDS_M, SKEW_S
from planner.verification.lag.both_arms import APART, HANDS
from tests.planner.two_arms.pair_moves import carries
from tests.planner.two_arms.pairs import SIDES, Measured
from tests.planner.two_arms.tracking.conftest import TYPICAL
from tests.planner.two_arms.tracking.lagging import Instant, followed

ACCURACY_M = 2e-3
"""Difference of coal's distances, as its shapes contain the meshes that proofs use."""

ALIKE_M = 2e-3
"""How far the proofs of planner and checker may differ: they cut time otherwise."""

EVERY = 60
"""One of so many instants of a simulation is measured."""

STILL = Response((0.0, 0.0), 0.0, 0.3, late_s=0.0)
"""Arms that are where they are sent."""


TURNS = (("left", 1.0), ("right", -1.0))
"""Signs of a wrist's turn of each arm."""


class LaggingMeasured(Measured):
    """Both arms where they are as they lag, with what their hands hold then.

    Attributes:
        now: the instant.
    """

    now: Instant

    def _at(
        self,
        side: str,
        time_s: float,  # noqa: ARG002 - what both arms do is that of an instant
        share: float,  # noqa: ARG002
    ) -> tuple[dict[str, float], list[Body]]:
        steps, manipulator = self._plan.plans[side].steps, self._manipulators[side]
        number = self.now.acted[side]
        if number + 1 < len(steps):
            state = state_of(steps[number + 1])
        else:
            state = after(steps[number], state_of(steps[number]), manipulator)
        joints = manipulator.arm.joints(self.now.q[side])
        moved, finger = state.moved(self._robot, joints), manipulator.hand.joint_names[0]
        names = {step.body for step in steps if isinstance(step, Grip) and step.body}
        bodies = [moved.scene[name] for name in sorted(names)]
        return joints | manipulator.hand.finger_joints(state.joints[finger]), bodies


def test_a_plain_pair_is_clear_with_less_distance(
    plain_proof: TwoArmTrackingProof, plain_plan: TwoArmPlan
) -> None:
    assert plain_proof.is_valid
    assert plain_proof.failure is None
    assert plain_proof.greatest_speed == TYPICAL.speed
    assert plain_proof.hands == ()
    assert plain_plan.proof is not None
    assert 0.1 < plain_proof.apart_m < plain_plan.proof.proven_m
    for side in SIDES:
        labels = [move.label for move in plain_plan.plans[side].moves]
        assert [move.label for move in plain_proof.arms[side].moves] == labels
    lines = str(plain_proof).splitlines()
    assert lines[0] == "every path that the joints of both arms may take is clear"
    assert any(line.startswith("  both arms, 0.00 s to ") for line in lines)


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_simulated_arms_never_come_nearer_than_proven(
    plain_proof: TwoArmTrackingProof,
    plain_plan: TwoArmPlan,
    manipulators: Mapping[str, Manipulator],
    robot: Baxter,
    seed: int,
) -> None:
    """Placed by Pinocchio, distances by coal, pair by pair."""
    measured = LaggingMeasured(plain_plan, robot, manipulators)
    rng, within_m = np.random.default_rng(seed), plain_proof.apart_m - ACCURACY_M
    responses = dict.fromkeys(SIDES, TYPICAL)
    for number, now in enumerate(followed(plain_plan, responses, rng, skew_s=SKEW_S)):
        if number % EVERY == 0:
            measured.now = now
            assert not measured.are_within(now.clock_s, 0.5, within_m)


def test_the_checker_agrees(plain_proof: TwoArmTrackingProof, plain_plan: TwoArmPlan) -> None:
    certificate = verify_both(plain_plan, response=TYPICAL)
    assert certificate.is_valid
    (apart,) = (check for check in certificate.checks if check.name == APART)
    assert apart.value == pytest.approx(plain_proof.apart_m, abs=ALIKE_M)
    for side in SIDES:
        found = certificate.arms[side]["tracking: clearance"].value
        assert found == pytest.approx(plain_proof.arms[side].clearance_m, abs=ALIKE_M)


def test_without_a_response_the_checker_says_nothing_of_it(
    plain_certificate: TwoArmCertificate,
) -> None:
    names = [check.name for arm in plain_certificate.arms.values() for check in arm.checks]
    assert not any(name.startswith("tracking") for name in names)
    assert plain_certificate.checks == ()


@pytest.mark.slow
def test_a_crossing_pair_that_is_clear_is_refused_with_a_lag(
    crossing_plan: TwoArmPlan, manipulators: Mapping[str, Manipulator]
) -> None:
    """The planner leaves a millimetre between both arms; arms that follow at once keep it."""
    still = prove_tracking_of_both(
        crossing_plan, STILL, manipulators=manipulators, start_rad=0.0, seek_speed=False, skew_s=0.0
    )
    assert still.is_valid, still.failure
    lagging = prove_tracking_of_both(
        crossing_plan, TYPICAL, manipulators=manipulators, seek_speed=False
    )
    assert not lagging.is_valid
    assert str(lagging.failure).startswith("both arms, ")
    assert lagging.clearance_m > 0.0
    certificate = verify_both(crossing_plan, response=TYPICAL)
    assert [check.name for check in certificate.checks if not check.is_passed] == [APART]
    assert not certificate.is_valid


@pytest.mark.parametrize("skew_s", [pytest.param(0.0, marks=pytest.mark.slow), 0.2])
def test_a_skew_brings_both_arms_nearer(
    plain_proof: TwoArmTrackingProof,
    plain_plan: TwoArmPlan,
    manipulators: Mapping[str, Manipulator],
    skew_s: float,
) -> None:
    other = prove_tracking_of_both(
        plain_plan, TYPICAL, manipulators=manipulators, skew_s=skew_s, seek_speed=False
    )
    least, most = sorted([plain_proof, other], key=lambda proof: proof.skew_s)
    assert sum(each.clearance_m for each in least.apart[-2:]) >= sum(
        each.clearance_m for each in most.apart[-2:]
    )
    assert len(most.apart) >= len(least.apart)


def test_one_arm_of_both_is_proven_no_better_than_alone(
    plain_proof: TwoArmTrackingProof,
    plain_plan: TwoArmPlan,
    manipulators: Mapping[str, Manipulator],
) -> None:
    """On the clock, an arm does not wait until it has settled, and may be held up."""
    by_itself = prove_tracking(
        plain_plan.plans["left"],
        TYPICAL,
        manipulator=alone(plain_plan, "left", manipulators["left"]),
        seek_speed=False,
    )
    assert by_itself.is_valid
    assert plain_proof.arms["left"].clearance_m <= by_itself.clearance_m + ALIKE_M


def test_a_margin_that_is_not_kept_is_refused_with_a_speed(
    plain_proof: TwoArmTrackingProof,
    plain_plan: TwoArmPlan,
    manipulators: Mapping[str, Manipulator],
) -> None:
    margin_m = plain_proof.clearance_m + 1e-3
    found = prove_tracking_of_both(
        plain_plan, TYPICAL, manipulators=manipulators, margin_m=margin_m
    )
    assert not found.is_valid
    assert found.greatest_speed is None or found.greatest_speed < TYPICAL.speed
    assert not all(arm.is_valid for arm in found.arms.values())


@pytest.fixture(scope="module")
def carried(manipulators: dict[str, Manipulator]) -> TwoArmPlan:
    task, state = carries.bar(manipulators)
    plan = plan_pair_carry(task, manipulators, state)
    assert plan.is_valid, plan.failure
    return plan


@pytest.mark.slow
def test_hands_in_one_body_stay_together_at_a_low_speed_alone(
    carried: TwoArmPlan, manipulators: Mapping[str, Manipulator]
) -> None:
    """Also of the handover's kind: bounds of planner and checker are alike."""
    exact = Response((0.02, 0.06), 0.001, 0.3)
    fast, slow = (
        prove_tracking_of_both(
            carried, exact.at_speed(speed), manipulators=manipulators, seek_speed=False
        )
        for speed in (0.3, 0.05)
    )
    assert not fast.is_valid
    assert "the hands that hold bar may be" in str(fast.failure)
    assert slow.is_valid, slow.failure
    assert slow.hands[0].apart_m <= MAX_HANDS_M < fast.hands[0].apart_m
    certificate = verify_both(carried, response=exact.at_speed(0.05))
    assert certificate.is_valid, certificate.verdict
    (hands,) = (check for check in certificate.checks if check.name == HANDS)
    assert hands.value == pytest.approx(slow.hands[0].apart_m, abs=ALIKE_M)


@pytest.mark.slow
def test_no_simulated_hands_are_farther_apart_in_one_body_than_stated(
    carried: TwoArmPlan, manipulators: Mapping[str, Manipulator]
) -> None:
    proof = prove_tracking_of_both(carried, TYPICAL, manipulators=manipulators, seek_speed=False)
    motions = {side: carried.motion_of(side) for side in SIDES}
    grips = [each for each in carried.steps if isinstance(each.step, Grip) and each.step.body]
    begin_s, end_s = grips[0].end_s, grips[-1].begin_s
    rng, worst_m = np.random.default_rng(5), 0.0
    for now in followed(carried, dict.fromkeys(SIDES, TYPICAL), rng, skew_s=SKEW_S):
        if not begin_s <= now.clock_s <= end_s:
            continue
        planned = {side: motions[side].sample(now.clock_s).q for side in SIDES}
        worst_m = max(worst_m, *displacements_m(manipulators, planned, now.q))
    assert 0.002 < worst_m <= proof.hands[0].apart_m


def displacements_m(
    manipulators: Mapping[str, Manipulator],
    planned: Mapping[str, FloatArray],
    q: Mapping[str, FloatArray],
) -> list[float]:
    """How far each tip is from its planned place, seen from the other tip."""
    there, here = (
        {side: manipulators[side].arm.T_base_tip(of[side]) for side in SIDES} for of in (planned, q)
    )
    return [
        float(
            np.linalg.norm(
                here[one].actInv(here[other]).translation
                - there[one].actInv(there[other]).translation
            )
        )
        for one, other in (SIDES, SIDES[::-1])
    ]


@pytest.mark.slow
def test_an_error_of_a_wrist_moves_the_other_hand_as_seen_from_it(
    carried: TwoArmPlan, manipulators: Mapping[str, Manipulator]
) -> None:
    wrist = Response((0.0, 0.0), (*(5e-4,) * 5, 0.0, 0.03), 0.05)
    proof = prove_tracking_of_both(carried, wrist, manipulators=manipulators, seek_speed=False)
    clock_s = proof.hands[0].time_s
    planned = {side: carried.motion_of(side).sample(clock_s).q for side in SIDES}
    turned = {side: planned[side] + [0, 0, 0, 0, 0, 0, sign * 0.03] for side, sign in TURNS}
    assert 0.005 < max(displacements_m(manipulators, planned, turned)) <= proof.hands[0].apart_m


def sampled_hands_off_m(
    plan: TwoArmPlan,
    manipulators: Mapping[str, Manipulator],
    error: FloatArray,
    clock_s: FloatArray,
) -> float:
    """The greatest of `displacements_m` of joints that are each off by their error, either way."""
    rng, worst_m = np.random.default_rng(1), 0.0
    for at_s in clock_s.tolist():
        planned = {side: plan.motion_of(side).sample(at_s).q for side in SIDES}
        for _ in range(50):
            off = {side: error * rng.choice([-1.0, 1.0], 7) for side in SIDES}
            q = {side: planned[side] + off[side] for side in SIDES}
            worst_m = max(worst_m, *displacements_m(manipulators, planned, q))
    return worst_m


def part_of(
    plan: TwoArmPlan, manipulators: Mapping[str, Manipulator], first: int, last: int
) -> TwoArmPlan:
    """Some steps of each arm as a plan, from the state before them."""
    since_s = min(plan.begins_s[side][first] for side in SIDES)
    states = [state_of(plan.plans[side].steps[first]) for side in SIDES]
    joints = dict(plan.start.joints)
    for side, state in zip(SIDES, states, strict=True):
        names = *manipulators[side].arm.joint_names, *manipulators[side].hand.joint_names
        joints |= {name: state.joints[name] for name in names}
    attachments = [each for state in states for each in state.attachments]
    start = evolve(states[0], joints=joints, attachments=attachments)
    whole = evolve(plan, start=start)
    plans = {}
    for side, state in zip(SIDES, states, strict=True):
        own = plan.plans[side]
        steps = tuple(evolve(each, state=None, contacts=()) for each in own.steps[first:last])
        bare = evolve(own, start=evolve(state, joints=joints), steps=steps)
        plans[side] = complete(bare, manipulator=alone(whole, side, manipulators[side]))
    begins_s = {
        side: tuple(max(at - since_s, 0.0) for at in plan.begins_s[side][first:last])
        for side in SIDES
    }
    return evolve(plan, start=start, plans=plans, begins_s=begins_s)


@pytest.mark.slow
@pytest.mark.parametrize(("first", "last"), [(0, 6), (4, 7), (4, 9)])
def test_hands_that_hold_a_body_at_first_or_at_last_are_bounded(
    carried: TwoArmPlan, manipulators: Mapping[str, Manipulator], first: int, last: int
) -> None:
    """Without the action in which they take it, or release it, or both.

    The checker certifies no plan in which a hand holds something at first.
    """
    plan, error = part_of(carried, manipulators, first, last), np.full(7, 1e-3)
    exact = Response((0.0, 0.0), error, 0.05, late_s=0.0)
    proof = prove_tracking_of_both(
        plan, exact, manipulators=manipulators, seek_speed=False, start_rad=0.0
    )
    move = plan.steps_of("left")[-1 if last < 7 else 0]
    clock_s = np.linspace(move.begin_s, move.end_s, 5)
    worst_m = sampled_hands_off_m(plan, manipulators, error, clock_s)
    assert [each.body for each in proof.hands] == ["bar"]
    assert 0.001 < worst_m <= proof.hands[0].apart_m
    certificate = verify_both(plan, response=exact)
    assert certificate.is_valid == (first == 0)
    stated = [check.value for check in certificate.checks if check.name == HANDS]
    assert len(stated) == (first == 0)
    assert all(worst_m <= value for value in stated)


@pytest.mark.slow
def test_a_turn_of_one_hand_counts_by_the_distance_of_the_other(
    carried: TwoArmPlan, manipulators: Mapping[str, Manipulator]
) -> None:
    """Wrists that are off by 30 mrad turn the hands about their tips, which are 0.4 m apart."""
    error = np.array([5e-4] * 6 + [0.03])
    turning = Response((0.0, 0.0), error, 0.05, late_s=0.0)
    proof = prove_tracking_of_both(
        carried, turning, manipulators=manipulators, seek_speed=False, start_rad=0.0, skew_s=0.0
    )
    certificate = verify_both(carried, response=turning, skew_s=0.0)
    (hands,) = (check for check in certificate.checks if check.name == HANDS)
    grips = [each for each in carried.steps if isinstance(each.step, Grip) and each.step.body]
    clock_s = np.linspace(grips[0].end_s, grips[-1].begin_s, 40)
    worst_m = sampled_hands_off_m(carried, manipulators, error, clock_s)
    assert worst_m > 0.01
    assert worst_m <= proof.hands[0].apart_m < 1.5 * worst_m
    assert worst_m <= hands.value < 1.5 * worst_m


@pytest.mark.slow
def test_a_handover_bounds_how_far_both_hands_are_off(
    handover_plan: TwoArmPlan, manipulators: Mapping[str, Manipulator]
) -> None:
    exact = Response((0.02, 0.04), 0.001, 0.1)
    found = prove_tracking_of_both(
        handover_plan, exact, manipulators=manipulators, seek_speed=False
    )
    assert [hands.body for hands in found.hands] == ["stick"]
    assert found.hands[0].failure is None
    certificate = verify_both(handover_plan, response=exact)
    (hands,) = (check for check in certificate.checks if check.name == HANDS)
    assert hands.value == pytest.approx(found.hands[0].apart_m, abs=ALIKE_M)


@pytest.mark.slow
def test_a_giver_that_is_late_is_not_where_the_taker_closes(
    handover_plan: TwoArmPlan, manipulators: Mapping[str, Manipulator]
) -> None:
    """The giver still comes, 0.4 s late, when the taker's hand is around the body."""
    late = {"left": Response((0.38, 0.42), 0.001, 0.5), "right": Response((0.0, 0.01), 0.001, 0.5)}
    proof = prove_tracking_of_both(
        handover_plan, late, manipulators=manipulators, seek_speed=False, slowing_s=0.2
    )
    taking = next(
        number
        for number, each in enumerate(handover_plan.steps_of("right"))
        if isinstance(each.step, Grip) and each.step.body == "stick"
    )
    at_s = handover_plan.steps_of("right")[taking].begin_s
    motion, arm = handover_plan.motion_of("left"), manipulators["left"].arm
    clock_s = np.arange(0.0, at_s, 0.5e-3)  # half a millisecond of the clock is one of time
    q, share = motion.q_start, np.exp(-1e-3 / 0.4)
    for wanted in motion.sample(clock_s).q:
        q = wanted + share * (q - wanted)
    off_m = np.linalg.norm(arm.T_base_tip(q).translation - arm.T_base_tip(wanted).translation)
    assert proof.hands[0].failure is not None
    assert off_m <= proof.hands[0].apart_m
    assert not verify_both(handover_plan, response=late, slowing_s=0.2).is_valid


def test_a_failed_plan_is_not_proven(plain_plan: TwoArmPlan) -> None:
    failed = evolve(plain_plan, failure=PlanFailure("together", "none is found"))
    proof = prove_tracking_of_both(failed, TYPICAL)
    assert not proof.is_valid
    assert proof.apart == ()


REFUSALS: dict[str, tuple[Callable[[TwoArmPlan], object], type[BaxterError]]] = {
    "a plan of one arm": (
        lambda plan: prove_tracking_of_both(plan.plans["left"], TYPICAL),  # type: ignore[arg-type]
        TaskError,
    ),
    "no response": (lambda plan: prove_tracking_of_both(plan, 0.3), ResponseError),  # type: ignore[arg-type]
    "the response of one arm": (
        lambda plan: prove_tracking_of_both(plan, {"left": TYPICAL}),
        ResponseError,
    ),
    "two speeds": (
        lambda plan: prove_tracking_of_both(
            plan, {"left": TYPICAL, "right": TYPICAL.at_speed(0.2)}
        ),
        ResponseError,
    ),
    "a skew below zero": (
        lambda plan: prove_tracking_of_both(plan, TYPICAL, skew_s=-0.1),
        ResponseError,
    ),
    "a clock that stops at once": (
        lambda plan: prove_tracking_of_both(plan, TYPICAL, slowing_s=0.0),
        ResponseError,
    ),
    "a clock that stops at once, for the checker": (
        lambda plan: verify_both(plan, response=TYPICAL, slowing_s=0.0),
        ResponseError,
    ),
    "a skew that is a word": (
        lambda plan: verify_both(plan, response=TYPICAL, skew_s="none"),  # type: ignore[arg-type]
        ResponseError,
    ),
    "one manipulator": (
        lambda plan: prove_tracking_of_both(plan, TYPICAL, manipulators={}),
        TaskError,
    ),
}


@pytest.mark.parametrize("name", REFUSALS)
def test_bad_arguments_are_refused(plain_plan: TwoArmPlan, name: str) -> None:
    make, error = REFUSALS[name]
    with pytest.raises(error):
        make(plain_plan)
