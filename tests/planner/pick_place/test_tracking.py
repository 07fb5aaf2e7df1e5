"""Tracking proofs: refusals, and simulated arms that never come nearer than proven."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from planner import (
    Body,
    Manipulator,
    Part,
    PickAndPlace,
    Plan,
    PlanFailure,
    Response,
    Scene,
    Sphere,
    TrackingProof,
    load_plan,
    plan_pick_and_place,
    prove_tracking,
    save_plan,
    verify,
)
from planner.clearance import Clearance
from planner.completion import move_contexts
from planner.errors import ResponseError, TaskError, TrajectoryError
from planner.motion.tracking_tube import SETTLED_RAD
from planner.pick_place.tracked_runs import REST_RAD_S, MoveTracking
from planner.pick_place.tracking import START_RAD, planned_for
from planner.trajectory import Trajectory, joined
from tests.conftest import overhead

SLOW = Response((0.35, 0.45), 0.001, 0.3)
FULL = Response((0.35, 0.45), 0.001, 1.0)

STEP_S = 5e-3
CHECKED_STEPS = 24
BLOCK_BELOW_M = 0.02
"""Distance below the tip that is inside the held block."""

HELD_M = 0.004
"""Deviation of a tip at speed 0.1 by the age of a set-point and the cells of a tube."""

ACCURACY_M = 2e-5
"""Accuracy of coal's distances, twice."""


@pytest.fixture(scope="module")
def slow(tracked_plan: Plan, manipulator: Manipulator) -> TrackingProof:
    return prove_tracking(tracked_plan, SLOW, manipulator=manipulator)


@pytest.fixture(scope="module")
def full(tracked_plan: Plan, manipulator: Manipulator) -> TrackingProof:
    return prove_tracking(tracked_plan, FULL, manipulator=manipulator)


def runs(plan: Plan) -> Iterator[tuple[list[int], Trajectory]]:
    """Numbers of the moves between rests, and their motion."""
    pending: list[int] = []
    for number, move in enumerate(plan.moves):
        pending.append(number)
        if np.abs(move.trajectory.v[-1]).max() < REST_RAD_S:
            yield pending, joined(plan.moves[k].trajectory for k in pending)
            pending = []


def followed(
    plan: Plan, response: Response, rng: np.random.Generator
) -> Iterator[tuple[int, FloatArray]]:
    """Where one arm goes: number of the move, and joints; it waits where the executor waits."""
    y = plan.q_start + rng.uniform(-START_RAD, START_RAD, 7)
    lag_s = rng.uniform(*response.lag_s.T) if rng.random() < 0.5 else None
    error = response.settled_error_rad
    for numbers, motion in runs(plan):
        ends = np.cumsum([plan.moves[k].trajectory.duration for k in numbers]) / response.speed
        time_s, aim = 0.0, motion.q_start
        while time_s < ends[-1] + response.window_s or np.abs(y - aim).max() > SETTLED_RAD:
            if rng.random() < 0.5:  # the set-point in force is some ticks old
                due_s = max(time_s - rng.uniform(0.0, response.window_s), 0.0)
                aim = response.command(motion, due_s).q
            now = rng.uniform(*response.lag_s.T) if lag_s is None else lag_s
            y = aim + (y - aim) * np.exp(-STEP_S / now)
            time_s += STEP_S
            number = numbers[min(int(np.searchsorted(ends, time_s)), len(numbers) - 1)]
            yield number, y + rng.uniform(-error, error)


def test_a_lag_of_0_4_s_passes_at_speed_0_3(slow: TrackingProof, tracked_plan: Plan) -> None:
    assert slow.is_valid
    assert slow.failure is None
    assert slow.greatest_speed == SLOW.speed
    assert [move.label for move in slow.moves] == [move.label for move in tracked_plan.moves]
    assert all(move.clearance_m > 0.01 for move in slow.moves)
    for move in slow.moves:
        assert move.nearest is not None
        assert move.clearance_m <= move.nearest.distance_m <= 3.0 * move.clearance_m
    assert slow.clearance_m == min(move.clearance_m for move in slow.moves)
    assert str(slow).startswith("every path that the joints may take is clear\n  pick: approach: ")


@pytest.mark.slow
def test_a_refusal_at_full_speed_states_a_speed_that_passes(
    full: TrackingProof, tracked_plan: Plan, manipulator: Manipulator
) -> None:
    assert not full.is_valid
    speed = full.greatest_speed
    assert speed is not None
    assert 0.3 <= speed < 1.0
    assert str(full.failure).endswith(f"; at speed {speed:.2f} instead of 1.00 it is proven")
    assert str(full).splitlines()[0] == full.failure
    assert prove_tracking(tracked_plan, FULL.at_speed(speed), manipulator=manipulator).is_valid


@pytest.mark.slow
def test_a_failure_names_the_body_that_may_be_hit(
    tracked_plan: Plan, manipulator: Manipulator
) -> None:
    """A lead of 0.4 s turns uncertain lags into centimetres: the table is found within reach."""
    led = evolve(FULL, lead_s=0.4)
    proof = prove_tracking(tracked_plan, led, manipulator=manipulator, seek_speed=False)
    failures = [move.failure for move in proof.moves if move.failure]
    assert any("l_gripper_r_finger_tip may be" in failure for failure in failures)
    assert any("inside" in failure for failure in failures)
    assert proof.greatest_speed is None


def test_simulated_arms_never_come_nearer_than_proven(
    slow: TrackingProof, tracked_plan: Plan, manipulator: Manipulator, robot: Baxter
) -> None:
    """Placed by Pinocchio, distances by coal; the tip within what is stated of it."""
    rng = np.random.default_rng(0)
    contexts = move_contexts(tracked_plan, manipulator)
    tips = [_tips(joined([move.trajectory]), manipulator) for move in tracked_plan.moves]
    for _ in range(2):
        smallest_m = dict.fromkeys(range(len(contexts)), np.inf)
        for step, (number, q) in enumerate(followed(tracked_plan, SLOW, rng)):
            if step % CHECKED_STEPS:
                continue
            checker = contexts[number].checker
            full_q = contexts[number].q_others
            full_q[list(robot.indices(checker.arm.joint_names))] = q
            pairs = np.flatnonzero(~checker.may_touch).tolist()
            smallest_m[number] = min(smallest_m[number], *checker.distances_m(full_q, pairs, 0.1))
            tip = checker.arm.T_base_tip(q).translation
            way = np.concatenate(tips[max(number - 1, 0) : number + 1])
            off_m = float(np.linalg.norm(way - tip, axis=1).min())
            assert off_m <= slow.moves[number].tip_m + 1e-3
        for number, move in enumerate(slow.moves):
            assert smallest_m[number] >= move.clearance_m - ACCURACY_M, move.label


def _tips(motion: Trajectory, manipulator: Manipulator) -> FloatArray:
    qs = motion.sample(np.linspace(0.0, motion.duration, 300)).q
    return np.array([manipulator.arm.T_base_tip(q).translation for q in qs])


def test_intended_contacts_are_excluded_with_an_allowance(slow: TrackingProof) -> None:
    allowed = {move.label for move in slow.moves if move.allowance_m > 0.0}
    assert allowed == {"pick: descend", "pick: retract", "place: descend", "place: retract"}
    assert all(move.allowance_m <= slow.most_off_m for move in slow.moves)


@pytest.mark.slow
def test_a_smaller_allowance_is_refused(tracked_plan: Plan, manipulator: Manipulator) -> None:
    proof = prove_tracking(tracked_plan, SLOW, most_off_m=0.01, manipulator=manipulator)
    assert "at most 10.0 mm are allowed" in str(proof.failure)
    assert proof.greatest_speed is not None
    assert proof.greatest_speed < SLOW.speed


@pytest.mark.slow
def test_a_margin_is_kept_or_refused(
    slow: TrackingProof, tracked_plan: Plan, manipulator: Manipulator
) -> None:
    smallest_m = min(move.nearest.distance_m for move in slow.moves if move.nearest)
    kept = prove_tracking(tracked_plan, SLOW, margin_m=0.01, manipulator=manipulator)
    assert kept.is_valid
    assert kept.clearance_m > 0.01
    refused = prove_tracking(
        tracked_plan, SLOW, margin_m=smallest_m + 0.001, manipulator=manipulator, seek_speed=False
    )
    assert "mm are required" in str(refused.failure)


def test_without_lag_and_error_the_plan_itself_is_proven(
    tracked_plan: Plan, manipulator: Manipulator
) -> None:
    exact = Response((0.0, 0.0), speed=0.1, late_s=0.0)
    proof = prove_tracking(tracked_plan, exact, start_rad=0.0, manipulator=manipulator)
    assert proof.is_valid
    for move, planned in zip(proof.moves, tracked_plan.moves, strict=True):
        assert move.tip_m < HELD_M
        assert planned.proof is not None
        assert move.clearance_m <= planned.proof.nearest.distance_m
        assert move.clearance_m >= 0.6 * planned.proof.proven_m


def test_a_body_that_only_a_lagging_arm_hits_is_found(
    tracked_plan: Plan, manipulator: Manipulator
) -> None:
    """The attempt at a counter-example: a small ball where an arm cuts a corner of the plan."""
    lag = Response((0.399, 0.401), speed=1.0, late_s=0.0)
    carried = [k for k, move in enumerate(tracked_plan.moves) if move.label == "place: approach"]
    path = _tips(tracked_plan.moves[carried[0]].trajectory, manipulator)
    arm, rng = manipulator.arm, np.random.default_rng(1)
    way = np.array(
        [arm.T_base_tip(q).translation for k, q in followed(tracked_plan, lag, rng) if k in carried]
    )
    off = np.linalg.norm(way[:, None] - path, axis=2).min(axis=1)
    ball = Body(
        "ball",
        (Part(Sphere(0.002), pin.SE3.Identity()),),
        pin.SE3(np.eye(3), way[off.argmax()] - np.array([0.0, 0.0, BLOCK_BELOW_M])),
    )
    scene = tracked_plan.start.scene.with_body(ball)
    plan = evolve(tracked_plan, start=evolve(tracked_plan.start, scene=scene))
    contexts = move_contexts(plan, manipulator)
    for move, context in zip(plan.moves, contexts, strict=True):
        assert context.prove(move.trajectory).is_clear, move.label
    exact = Response((0.0, 0.0), 0.0, 0.3, late_s=0.0)
    assert prove_tracking(plan, exact, start_rad=0.0, manipulator=manipulator).is_valid
    proof = prove_tracking(plan, lag, start_rad=0.0, manipulator=manipulator, seek_speed=False)
    assert any("inside ball" in str(move.failure) for move in proof.moves)


def test_refuses_invalid_plans_and_arguments(tracked_plan: Plan, robot: Baxter) -> None:
    passing = evolve(tracked_plan, steps=tracked_plan.steps[:2])
    right = Manipulator.of(robot, "right")
    asked: list[tuple[Plan, Any, dict[str, Any], type[Exception], str]] = [
        (passing, SLOW, {}, TrajectoryError, r"pick: approach ends at 0\.5"),
        (
            tracked_plan,
            SLOW,
            {"manipulator": right},
            TaskError,
            "left arm",
        ),
        (tracked_plan, 0.4, {}, ResponseError, "Response"),
        (tracked_plan, SLOW, {"start_rad": -1.0}, ResponseError, "start_rad"),
    ]
    for plan, response, options, error, reason in asked:
        with pytest.raises(error, match=reason):
            prove_tracking(plan, response, **options)
    with pytest.raises(TaskError, match="clearance_m"):
        MoveTracking("lift", None, None, 0.1, 0.01, 0.0)  # type: ignore[arg-type]


def test_a_failed_plan_is_not_proven_and_one_without_steps_is(
    tracked_plan: Plan, manipulator: Manipulator
) -> None:
    failed = evolve(tracked_plan, failure=PlanFailure("place: open", "no way"))
    proof = prove_tracking(failed, SLOW, manipulator=manipulator)
    assert not proof.is_valid
    assert "no way" in str(proof.failure)
    proof = prove_tracking(evolve(tracked_plan, steps=()), SLOW, manipulator=manipulator)
    assert proof.is_valid
    assert proof.moves == ()
    assert proof.clearance_m == np.inf


@pytest.mark.slow
def test_a_plan_for_a_response_says_the_speed_at_which_it_is_proven(
    manipulator: Manipulator, scene: Scene, tracked_plan: Plan, tmp_path: Path
) -> None:
    """It is sent as fast as that allows, and judged by it; a file keeps it."""
    task = PickAndPlace("block", overhead(0.70, 0.15, -0.129), overhead(0.75, 0.0, -0.129))
    plan = plan_pick_and_place(task, manipulator, scene, manipulator.arm.start, response=FULL)
    assert plan.failure is None
    assert plan.response is not None
    assert 0.3 <= plan.response.speed < 1.0
    assert plan.response.lag_s.tolist() == FULL.lag_s.tolist()
    assert [move.label for move in plan.moves] == [move.label for move in tracked_plan.moves]
    assert f"sent at speed {plan.response.speed:g}" in repr(plan)
    certificate = verify(plan)
    assert certificate.is_valid
    assert certificate["tracking: clearance"].value > 0.0
    save_plan(plan, tmp_path / "plan.json")
    again = load_plan(tmp_path / "plan.json").response
    assert again is not None
    assert again.speed == plan.response.speed
    assert again.lag_s.tolist() == plan.response.lag_s.tolist()
    assert again.settled_error_rad.tolist() == plan.response.settled_error_rad.tolist()


@pytest.mark.slow
def test_there_is_no_plan_for_a_response_that_no_speed_suits(
    manipulator: Manipulator, tracked_plan: Plan
) -> None:
    """An arm that may be 0.1 rad off in every joint wherever it goes."""
    loose = Response((0.0, 0.1), 0.1)
    plan = planned_for(tracked_plan, loose, manipulator)
    assert plan.failure is not None
    assert plan.failure.stage in {move.label for move in tracked_plan.moves}
    assert plan.failure.stage not in plan.failure.reason
    assert "no passing speed of at least 0.01 was found" in plan.failure.reason
    assert plan.response is None
    assert planned_for(plan, loose, manipulator) is plan


def test_measurement_errors_at_the_start_count(
    tracked_plan: Plan, manipulator: Manipulator
) -> None:
    """Measured 0.02 rad off with an error one way, and a moment later with one the other way."""
    wait = Trajectory.stay(tracked_plan.q_start, tracked_plan.moves[0].trajectory.limits)
    plan = evolve(tracked_plan, steps=(evolve(tracked_plan.moves[0], trajectory=wait, ik=None),))
    erring = Response((0.35, 0.45), 0.03)
    proof = prove_tracking(plan, erring, manipulator=manipulator, seek_speed=False)
    assert proof.moves[0].deviation_rad >= START_RAD + 2 * 0.03


RESPONSE = Response((0.3, 0.5), 0.001, 0.3)
MOVE = MoveTracking("lift", 0.02, Clearance(0.03, "hand", "table", 1.0), 0.1, 0.01, 0.005, 0.002)


def tracking_proof(**changes: Any) -> TrackingProof:
    values: dict[str, Any] = {
        "response": RESPONSE,
        "moves": (MOVE,),
        "margin_m": 0.0,
        "most_off_m": 0.04,
        "start_rad": 0.02,
        "rate_rad_s": np.full(7, np.inf),
        "greatest_speed": 0.3,
    }
    return TrackingProof(**{**values, **changes})


def test_a_line_states_all_deviations_of_a_move() -> None:
    text = str(tracking_proof())
    assert text.splitlines()[1] == (
        "  lift: 20.0 mm clear, joints within 0.100 rad, tip within 10.0 mm of its path, 5.0 mm "
        "in intended contacts, 2.0 mm from its goal when settled"
    )
    assert str(tracking_proof(failure="lift: it hits")).startswith("lift: it hits\n")
    assert repr(MOVE) == "MoveTracking(lift, 20.0 mm clear, tip up to 10.0 mm off, 5.0 mm allowed)"
