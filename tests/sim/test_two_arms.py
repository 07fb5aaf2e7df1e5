"""A plan of both arms in the simulation: two streams on one clock, recorded and written."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import LIMBS, arm_joints
from planner import (
    Grip,
    Manipulator,
    Move,
    Plan,
    PlanFailure,
    State,
    TwoArmCertificate,
    TwoArmPlan,
    make_block,
    plan_joint_move,
    verify_both,
)
from planner.clearance import Clearance, ContinuousProof
from planner.completion import after, state_of
from sim import (
    Event,
    EventKind,
    Observer,
    Outcome,
    Recorder,
    Recording,
    Simulation,
    SimulationError,
    World,
    read_recording,
    save_recording,
    write_csv,
)
from sim.errors import RecordingError
from sim.recording.comparison import compare_run
from sim.recording.recorder import planned_recording
from tests.conftest import at
from tests.sim.recording.identical import differences
from tests.sim.runs import PICKS, PLACES, Witness

TIME_S = 1e-9
"""Sums of some dozen durations below 10 s."""

RAD = 1e-9
REST_M = 1e-6
"""Bodies end where the plan says within this; contacts are found to 1e-8 m."""

TICK_S = 0.0025
"""At 400 Hz, most ends of moves are between two ticks, as they are at 100 Hz."""


class Both:
    """A table with a block for each arm, and a simulation with a witness and a recorder."""

    def __init__(self, robot: Baxter, start: State, **options: object) -> None:
        self.world = World.from_state(start, robot)
        self.witness, self.recorder = Witness(), Recorder(robot)
        observers = [self.witness, self.recorder]
        self.simulation = Simulation(self.world, observers, tick_s=TICK_S, **options)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def executed(robot: Baxter, start: State, both: TwoArmPlan) -> tuple[Both, Outcome]:
    run = Both(robot, start)
    outcome = run.simulation.execute(both, unverified=True)
    run.simulation.finish()
    return run, outcome


@pytest.fixture(scope="module")
def certificate(both: TwoArmPlan) -> TwoArmCertificate:
    return verify_both(both)


@pytest.fixture(scope="module")
def recording(executed: tuple[Both, Outcome]) -> Recording:
    return executed[0].recorder.recording()


def test_a_certified_plan_is_executed_without_a_warning(
    robot: Baxter,
    start: State,
    both: TwoArmPlan,
    certificate: TwoArmCertificate,
    caplog: pytest.LogCaptureFixture,
) -> None:
    invalid = evolve(certificate, reason="too near")
    short = evolve(both, plans={side: both.plans[side] for side in LIMBS})
    for plan, given, warning in (
        (both, None, "certificate=verify_both(plan)"),
        (both, invalid, "not valid"),
        (short, certificate, "certificate of another plan"),
        (both, certificate, ""),
    ):
        caplog.clear()
        assert Both(robot, start).simulation.execute(plan, certificate=given).is_success
        assert warning in caplog.text
        assert bool(caplog.records) == bool(warning)


def test_both_arms_follow_the_plan_at_every_tick(
    executed: tuple[Both, Outcome], recording: Recording, both: TwoArmPlan
) -> None:
    outcome = executed[1]
    assert outcome.is_success, outcome.failure
    assert outcome.hits == ()
    assert outcome.duration_s == pytest.approx(both.duration_s, abs=TIME_S)
    names = [*arm_joints("left"), *arm_joints("right")]
    found = recording.q[:, [recording.joint_names.index(name) for name in names]]
    planned = both.trajectory.sample(np.minimum(recording.times_s, both.duration_s)).q
    np.testing.assert_allclose(found, planned, atol=RAD)
    for side in LIMBS:
        assert recording.motion(side).is_exact.sum() > 1000
        assert compare_run(both.plans[side], recording).worst_rad.max() < 1e-6


def test_bodies_end_where_the_plans_of_the_arms_say(
    executed: tuple[Both, Outcome], robot: Baxter, both: TwoArmPlan
) -> None:
    world = executed[0].world
    for side, (name, _, _) in PICKS.items():
        last = both.plans[side].steps[-1]
        end = after(last, state_of(last), Manipulator.of(robot, side)).scene[name].T_base_body
        found = world.body(name).T_base_body
        np.testing.assert_allclose(found.homogeneous, end.homogeneous, atol=REST_M)
        assert world.supports[name] == ("table",)
        np.testing.assert_allclose(found.translation[:2], PLACES[side], atol=5e-3)
    assert world.held == ()


def test_events_are_in_order_of_time_and_begin_when_the_clock_says(
    executed: tuple[Both, Outcome], both: TwoArmPlan
) -> None:
    witness = executed[0].witness
    times = [item.time_s for item in witness.received]
    assert all(one <= other for one, other in pairwise(times))
    begun = [e for e in witness.events if e.kind is EventKind.MOVE_STARTED]
    wanted = [each for each in both.steps if isinstance(each.step, Move)]
    assert [(e.side, e.text) for e in begun] == [(each.side, each.step.label) for each in wanted]
    for event, each in zip(begun, wanted, strict=True):
        assert event.time_s == pytest.approx(each.begin_s, abs=TIME_S)
    for side, (name, _, _) in PICKS.items():
        own = [e for e in witness.events if e.side == side and e.body is not None]
        kinds = (EventKind.GRASPED, EventKind.RELEASED)
        assert [e.kind for e in own if e.kind in kinds] == list(kinds)
        assert {e.body.name for e in own if e.body is not None} == {name}
        closes, opens = (
            each
            for each in both.steps_of(side)
            if isinstance(each.step, Grip) and each.step.body is not None
        )
        grasped, released = (e for e in own if e.kind in kinds)
        assert closes.begin_s < grasped.time_s <= closes.end_s
        assert released.time_s == pytest.approx(opens.begin_s, abs=TIME_S)


def test_the_caption_says_what_each_arm_does(recording: Recording) -> None:
    captions = [text for _, text in recording.captions]
    assert "left arm: pick: descend, right arm: pick: descend" in captions
    assert "left arm: pick: close, right arm: pick: close" in captions
    assert "left arm: waits, right arm: waits" in captions  # until the grips' time is over


@pytest.mark.parametrize("side", LIMBS)
def test_a_missed_grasp_of_one_arm_stops_both(
    robot: Baxter, start: State, both: TwoArmPlan, side: str
) -> None:
    other = LIMBS[1 - LIMBS.index(side)]
    waits_s = 0.4  # of the one that misses, so that the other is on its way with its block
    late = {s: tuple(b + waits_s * (s == side) for b in both.begins_s[s]) for s in LIMBS}
    run = Both(robot, start, check_contacts=False)
    run.world.place_body(PICKS[side][0], at(0.9, 0.6 if side == "left" else -0.6, -0.13))
    outcome = run.simulation.execute(evolve(both, begins_s=late), unverified=True)
    assert outcome.failure is not None
    assert outcome.failure.startswith(f"{side} arm, pick: close: missed: ")
    missed = run.witness.events[-1]
    assert (missed.kind, missed.side) == (EventKind.MISSED, side)
    assert run.simulation.time_s == missed.time_s == outcome.duration_s
    timed = next(each for each in both.steps_of(side) if each.step.label == "pick: close")
    assert missed.time_s <= timed.end_s + waits_s
    held = run.world.holding(other)
    assert held is not None
    assert held.body == PICKS[other][0]
    # each arm stands where the plan has it at that time
    stopped = evolve(both, begins_s=late).trajectory.sample(missed.time_s).q
    np.testing.assert_allclose(
        np.concatenate([run.world.arm_q(s) for s in LIMBS]), stopped, atol=RAD
    )


def test_a_hand_that_is_opening_ends_that_when_the_other_arm_fails(
    robot: Baxter, start: State, both: TwoArmPlan
) -> None:
    """The left arm begins so late that the right hand is letting go when it misses."""
    missed_s = next(e.begin_s for e in both.steps_of("left") if e.step.label == "pick: close")
    opens_s = next(e.begin_s for e in both.steps_of("right") if e.step.label == "place: open")
    stroke_s = 0.42
    late = {"left": tuple(b + opens_s - missed_s - stroke_s + 0.005 for b in both.begins_s["left"])}
    run = Both(robot, start, check_contacts=False)
    run.world.place_body("red", at(0.9, 0.6, -0.13))
    changed = evolve(both, begins_s={**both.begins_s, **late})
    outcome = run.simulation.execute(changed, unverified=True)
    assert not outcome.is_success
    kinds = [(e.kind, e.side) for e in run.witness.events]
    assert kinds[-1] == (EventKind.SETTLED, None)
    assert run.world.supports["blue"] == ("table",)
    assert run.world.finger_m("right") == pytest.approx(run.world.hands["right"].stroke_m)


def test_arms_that_run_into_each_other_both_stop_before(robot: Baxter, start: State) -> None:
    plan = across(robot, start)
    run = Both(robot, start)
    outcome = run.simulation.execute(plan, unverified=True)
    assert outcome.failure is not None
    assert outcome.failure.startswith("across: the ")
    (hit,) = outcome.hits
    assert hit.stops
    assert {name.split("_")[0][0] for name in (hit.mover, hit.other)} == {"l", "r"}
    stopped = plan.trajectory.sample(outcome.duration_s).q
    found = [run.world.arm_q(side) for side in LIMBS]
    np.testing.assert_allclose(np.concatenate(found), stopped, atol=RAD)
    assert outcome.duration_s < plan.duration_s


def test_a_certified_plan_is_checked_only_where_the_world_is_another_one(
    robot: Baxter,
    start: State,
    both: TwoArmPlan,
    certificate: TwoArmCertificate,
    looks: list[Any],
) -> None:
    class Spawner(Observer):
        """Adds a block far away when the left hand has grasped its own."""

        def on_event(self, event: Event) -> None:
            if (event.kind, event.side) == (EventKind.GRASPED, "left"):
                world.spawn(make_block("late", at(1.2, -0.6, 0.0)))

    def far(world: World) -> None:
        world.spawn(make_block("far", at(1.2, -0.6, 0.0)))

    def turned(world: World) -> None:
        world.turn_head(0.1)

    def moved(world: World) -> None:
        world.place_body("blue", at(0.65, -0.2501, -0.13))

    for change, observers, are_checked in (
        (lambda _: None, [], False),
        (lambda _: None, [Spawner()], True),
        (far, [], True),
        (turned, [], True),
        (moved, [], True),
    ):
        looks.clear()
        world = World.from_state(start, robot)
        change(world)
        Simulation(world, observers).execute(both, certificate=certificate)
        assert {side for paths in looks for side in paths} == (set(LIMBS) if are_checked else set())


@pytest.mark.parametrize("name", [None, "red", "blue"])
def test_a_certificate_counts_for_its_plan_in_its_world(
    robot: Baxter, start: State, name: str | None
) -> None:
    """The certificate is a lie, too; without it, the arms stop before they run into each other."""
    plan = across(robot, start)
    certificate = TwoArmCertificate({}, duration_s=plan.duration_s, subject=plan)
    run = Both(robot, start)
    if name is not None:  # a body that is not near the arms
        run.world.place_body(name, at(0.9, 0.6, -0.13))
    outcome = run.simulation.execute(plan, certificate=certificate)
    assert outcome.is_success is (name is None)
    copy = Both(robot, start).simulation.execute(evolve(plan), certificate=certificate)
    assert not copy.is_success


def across(robot: Baxter, start: State) -> TwoArmPlan:
    """Both arms turn to the other side; the proof is a lie."""
    plans = {}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        arm = robot.arm(side)
        goal = np.array(arm.start)
        goal[0] -= sign * 1.2
        move = Move("across", plan_joint_move(arm.start, goal, arm.limits), state=start)
        plans[side] = Plan(start, (move,), limb=side)
    proof = ContinuousProof(0.01, Clearance(0.02, "left_hand", "right_hand", 1.0), 0.0, 10, 5)
    return TwoArmPlan(start, plans, dict.fromkeys(LIMBS, (0.0,)), 0.5, proof)


def test_what_the_hands_hold_counts_against_each_other(robot: Baxter, start: State) -> None:
    """Blocks that are held far from the hands meet before the arms do."""
    run = Both(robot, start)
    for side, y in (("left", 0.05), ("right", -0.05)):
        T_tip_body = run.world.T_base_tip(side).inverse() * at(1.0, y, 0.3)
        run.world.attach(side, PICKS[side][0], T_tip_body)
    outcome = run.simulation.execute(across(robot, start), unverified=True)
    (hit,) = outcome.hits
    assert hit.is_held
    assert {hit.mover, hit.other} == {"red", "blue"}


def test_a_gripper_action_that_takes_longer_than_the_clock_allows_ends_the_plan(
    robot: Baxter, start: State, both: TwoArmPlan
) -> None:
    run = Both(robot, start)
    outcome = run.simulation.execute(evolve(both, grip_s=0.01), unverified=True)
    assert outcome.failure is not None
    assert "on the clock" in outcome.failure


def test_refusals(robot: Baxter, start: State, both: TwoArmPlan) -> None:
    run = Both(robot, start)
    for wrong in (evolve(both, failure=PlanFailure("here", "too far")), "plan"):
        with pytest.raises(SimulationError):
            run.simulation.execute(wrong)  # type: ignore[arg-type]
    run.world.move_arm("right", robot.arm("right").neutral)
    with pytest.raises(SimulationError, match="where the right arm stands"):
        run.simulation.execute(both)
    assert run.simulation.time_s == 0.0
    assert run.witness.received == []


def test_the_plan_alone_gives_the_same_recording(
    robot: Baxter, both: TwoArmPlan, recording: Recording
) -> None:
    planned = planned_recording(both, robot)
    assert planned.duration_s == pytest.approx(recording.duration_s, abs=TIME_S)
    every = round(0.01 / TICK_S)
    rows = recording.q[::every][: len(planned.q) - 1]
    np.testing.assert_allclose(planned.q[:-1], rows, atol=RAD)
    assert [(e.kind, e.side, e.text) for e in planned.events] == [
        (e.kind, e.side, e.text) for e in recording.events
    ]


@pytest.mark.parametrize("suffix", [".mcap", ".csv"])
def test_files_keep_both_arms(recording: Recording, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"both{suffix}"
    save = write_csv if suffix == ".csv" else save_recording
    save(recording, path)
    found = read_recording(path).recording
    names = [*arm_joints("left"), *arm_joints("right")]
    one, other = (
        each.q[:, [each.joint_names.index(name) for name in names]] for each in (found, recording)
    )
    np.testing.assert_allclose(one, other, atol=1e-6)
    np.testing.assert_allclose(found.gripper_percent, recording.gripper_percent, atol=1e-6)
    if suffix == ".mcap":
        assert list(differences(found, recording)) == []


def test_a_plan_is_written_for_a_robot_on_its_clock(both: TwoArmPlan, tmp_path: Path) -> None:
    path = tmp_path / "both.csv"
    write_csv(both, path)
    found = read_recording(path).recording
    names = [*arm_joints("left"), *arm_joints("right")]
    q = found.q[:, [found.joint_names.index(name) for name in names]]
    planned = both.trajectory.sample(np.minimum(found.times_s, both.duration_s)).q
    np.testing.assert_allclose(q, planned, atol=1e-6)
    assert found.duration_s == pytest.approx(both.duration_s, abs=0.02)
    for side, percent in zip(LIMBS, found.gripper_percent.T, strict=True):
        commands = {s.step.label: s for s in both.steps_of(side) if isinstance(s.step, Grip)}
        closed_s = found.times_s[percent == 0.0]
        close, release = commands["pick: close"], commands["place: open"]
        assert close.begin_s <= closed_s[0] <= close.end_s
        assert release.begin_s <= closed_s[-1] <= release.end_s
    with pytest.raises(RecordingError):
        write_csv(both, path, dwell_s=1.0)
