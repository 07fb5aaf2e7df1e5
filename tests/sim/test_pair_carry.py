"""A body in both hands in the simulation: it follows, is recorded, and is not torn apart."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import LIMBS
from planner import Manipulator, TwoArmPlan, plan_pair_carry, verify_both
from sim import EventKind, Recorder, Recording, Simulation, SimulationError, World
from sim.recording.recorder import planned_recording
from sim.view.clearance import ClearanceMeter, HandState
from sim.view.replay import replay_html
from tests.conftest import at
from tests.planner.two_arms.pair_moves import carries
from tests.sim.runs import Witness

TOGETHER_M = 1e-4
"""By how much the body may be elsewhere for the right hand, m, and entries of its rotation."""

PLACE_M = 1e-5


class Run:
    """A plan of a body in both hands, executed with a witness and a recorder."""

    def __init__(self, robot: Baxter, plan: TwoArmPlan) -> None:
        self.plan, self.world = plan, World.from_state(plan.start, robot)
        self.witness, self.recorder = Witness(), Recorder(robot)
        simulation = Simulation(self.world, [self.witness, self.recorder])
        self.outcome = simulation.execute(plan, unverified=True)
        simulation.finish()

    @property
    def recording(self) -> Recording:
        return self.recorder.recording()


@pytest.fixture(scope="module", params=["bar", pytest.param("tray", marks=pytest.mark.slow)])
def run(request: pytest.FixtureRequest, robot: Baxter) -> Run:
    manipulators = {side: Manipulator.of(robot, side) for side in LIMBS}
    task, state = getattr(carries, request.param)(manipulators)
    plan = plan_pair_carry(task, manipulators, state)
    assert plan.is_valid, plan.failure
    return Run(robot, plan)


def poses_of(recording: Recording, name: str) -> list[pin.SE3]:
    return [pin.XYZQUATToSE3(row) for row in recording.body_poses[name]]


def carried(run: Run) -> str:
    return next(name for name in ("bar", "tray") if name in run.world.scene.bodies)


def test_the_body_moves_with_both_hands_and_ends_at_its_place(run: Run, robot: Baxter) -> None:
    assert run.outcome.is_success, run.outcome.failure
    assert run.outcome.hits == ()
    name, recording = carried(run), run.recording
    events = {(e.kind, e.side): e.time_s for e in recording.events}
    held_s = max(events[EventKind.GRASPED, side] for side in LIMBS)
    released_s = min(events[EventKind.RELEASED, side] for side in LIMBS)
    seen: dict[str, list[pin.SE3]] = {side: [] for side in LIMBS}
    for time_s, q, T in zip(recording.times_s, recording.q, poses_of(recording, name), strict=True):
        if held_s <= time_s <= released_s:
            for side in LIMBS:
                arm = robot.arm(side)
                own = q[[recording.joint_names.index(n) for n in arm.joint_names]]
                seen[side].append(arm.T_base_tip(own).inverse() * T)
    for side, within in (("left", 1e-9), ("right", TOGETHER_M)):
        assert len(seen[side]) > 200
        assert all(np.allclose(T, seen[side][0], atol=within) for T in seen[side])
    assert run.world.held == ()
    end = run.world.body(name).T_base_body
    assert run.world.supports[name] == (("table",) if name == "bar" else ("stand",))
    last = run.plan.plans["left"].steps[-1].state
    assert last is not None
    np.testing.assert_allclose(end, last.scene[name].T_base_body, atol=PLACE_M)


def test_a_certified_one_is_not_checked_for_contacts(
    run: Run, robot: Baxter, looks: list[Any]
) -> None:
    world = World.from_state(run.plan.start, robot)
    outcome = Simulation(world).execute(run.plan, certificate=verify_both(run.plan))
    assert outcome.is_success
    assert looks == []


def test_the_hand_that_opens_last_lets_it_go(run: Run) -> None:
    kinds = [(e.kind, e.side) for e in run.witness.events if e.body is not None]
    assert {(EventKind.GRASPED, side) for side in LIMBS} <= set(kinds)
    released = [k for k, (kind, _) in enumerate(kinds) if kind is EventKind.RELEASED]
    assert len(released) == len(LIMBS)
    assert kinds.count((EventKind.SETTLED, None)) == 1
    assert kinds.index((EventKind.SETTLED, None)) > released[-1]


def test_the_plan_alone_gives_the_same_recording_and_a_page(run: Run, robot: Baxter) -> None:
    planned = planned_recording(run.plan, robot)
    assert [(e.kind, e.side, e.text) for e in planned.events] == [
        (e.kind, e.side, e.text) for e in run.recording.events
    ]
    assert len(replay_html(run.recording, robot)) > 1e6
    heights_m = run.recording.body_poses[carried(run)][:, 2]
    assert np.ptp(heights_m) == pytest.approx(0.05, abs=1e-3)  # it is lifted


def test_the_page_measures_no_clearance_of_the_body_from_the_hands_that_hold_it(run: Run) -> None:
    name, world = carried(run), World(run.world.robot)
    step = next(s for s in run.plan.plans["left"] if s.label == "place: approach")
    assert step.state is not None
    recording = run.recording
    begin_s = next(t.begin_s for t in run.plan.steps_of("left") if t.step is step)
    number = int(np.searchsorted(recording.times_s, begin_s + 0.1))
    poses = {each: poses_of(recording, each)[number] for each in recording.bodies}
    free = dict.fromkeys(LIMBS, HandState(name, None, frozenset()))
    meter = ClearanceMeter(world.shapes, recording.bodies)
    nearest = meter.at(recording.q[number], poses, free, LIMBS)
    assert nearest is not None
    assert nearest[0].distance_m > 1e-3


def test_hands_that_tear_the_body_apart_are_stopped(run: Run, robot: Baxter) -> None:
    """The right arm carries a little later than the left one; both open later."""
    at_end = {"place: open", "place: retract"}
    late_s = {"left": at_end, "right": at_end | {"pick: retract", "place: approach"}}
    late_s["right"].add("place: descend")
    later = {
        side: tuple(
            begin_s + 0.05 * (step.label in late_s[side])
            for begin_s, step in zip(own, run.plan.plans[side], strict=True)
        )
        for side, own in run.plan.begins_s.items()
    }
    torn = Run(robot, evolve(run.plan, begins_s=later))
    assert not torn.outcome.is_success
    (hit,) = torn.outcome.hits
    assert hit.stops
    assert (hit.mover, hit.other) == (carried(run), "right_gripper")
    assert 5e-4 < hit.depth_m < 5e-3


def test_a_hand_takes_hold_of_a_body_in_the_other_hand_only_where_it_is(robot: Baxter) -> None:
    manipulators = {side: Manipulator.of(robot, side) for side in LIMBS}
    task, state = carries.bar(manipulators)
    world = World.from_state(state, robot)
    where = {side: world.T_base_tip(side).inverse() * at(0.8, 0.0, 0.2) for side in LIMBS}
    world.attach("right", "bar", where["right"])
    with pytest.raises(SimulationError, match="in the right hand"):
        world.attach("left", "bar", where["left"] * at(0.0, 0.0, 0.01))
    world.attach("left", "bar", where["left"])
    assert {each.side for each in world.held} == set(LIMBS)
    world.move_arm("right", robot.arm("right").neutral)  # the left hand has it
    assert np.allclose(world.body("bar").T_base_body, at(0.8, 0.0, 0.2))
    assert world.detach("left") == "bar"
    assert world.is_held("bar")
    assert task.body == "bar"
