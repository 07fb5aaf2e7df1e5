"""A body goes from hand to hand in the simulation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.kinematics.arm import LIMBS
from planner import Manipulator, TwoArmPlan, plan_handover, verify_both
from sim import EventKind, Outcome, Recorder, Recording, Replay, Simulation, World, write_csv
from sim.recording.recorder import planned_recording
from tests.planner.two_arms.pairs import HandoverCase, handover_of_stick
from tests.sim.runs import Witness


@pytest.fixture(scope="module")
def case(robot: Baxter) -> HandoverCase:
    return handover_of_stick({side: Manipulator.of(robot, side) for side in LIMBS})


@pytest.fixture(scope="module")
def plan(case: HandoverCase) -> TwoArmPlan:
    return plan_handover(*case)


@pytest.fixture(scope="module")
def run(
    robot: Baxter, case: HandoverCase, plan: TwoArmPlan
) -> tuple[World, Witness, Recording, Outcome]:
    world, witness, recorder = World.from_state(case.state, robot), Witness(), Recorder(robot)
    simulation = Simulation(world, [witness, recorder])
    outcome = simulation.execute(plan, unverified=True)
    simulation.finish()
    return world, witness, recorder.recording(), outcome


def test_the_body_ends_where_it_is_to_go(
    run: tuple[World, Witness, Recording, Outcome], case: HandoverCase
) -> None:
    world, _, _, outcome = run
    assert outcome.is_success, outcome.failure
    assert outcome.hits == ()
    np.testing.assert_allclose(
        world.body("stick").T_base_body.homogeneous, case.task.T_base_goal.homogeneous, atol=1e-6
    )
    assert world.held == ()


def test_the_second_hand_grasps_before_the_first_one_releases_and_nothing_falls(
    run: tuple[World, Witness, Recording, Outcome],
) -> None:
    events = [e for e in run[1].events if e.body is not None and e.body.name == "stick"]
    kinds = (EventKind.GRASPED, EventKind.RELEASED, EventKind.SETTLED)
    found = [(e.kind, e.side) for e in events if e.kind in kinds]
    assert found == [
        (EventKind.GRASPED, "left"),
        (EventKind.GRASPED, "right"),
        (EventKind.RELEASED, "left"),
        (EventKind.RELEASED, "right"),
        (EventKind.SETTLED, None),
    ]


def test_the_body_never_jumps(run: tuple[World, Witness, Recording, Outcome]) -> None:
    poses = run[2].body_poses["stick"]
    steps_m = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)
    assert steps_m.max() < 0.02  # in a hundredth of a second


def test_a_certified_one_is_not_checked_for_contacts(
    robot: Baxter, case: HandoverCase, plan: TwoArmPlan, looks: list[Any]
) -> None:
    world = World.from_state(case.state, robot)
    assert Simulation(world).execute(plan, certificate=verify_both(plan)).is_success
    assert looks == []


def test_what_is_planned_can_be_recorded_written_and_shown(
    robot: Baxter, plan: TwoArmPlan, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("handover")
    write_csv(plan, folder / "both.csv")
    assert len((folder / "both.csv").read_text().splitlines()) > 500
    recording = planned_recording(plan, robot)
    assert recording.times_s[-1] == pytest.approx(plan.duration_s, abs=0.01)
    page = Replay(recording, robot).html
    assert "stick" in page
