"""Every fault of the original demo and its IK service, and that it is gone.

The faults are those that were measured in, or read from the sources of, Rethink's pick-and-place
demo, its Gazebo IK service and its joint mover.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from baxter_kin import Arm, Baxter, IKService, SeedMode, SeedType
from baxter_kin.errors import RequestError
from baxter_kin.frames import angle_between
from planner import (
    Body,
    Box,
    Manipulator,
    Part,
    PickAndPlace,
    Scene,
    plan_pick_and_place,
    plan_start_move,
)
from sim import EventKind, Observer, Outcome, Simulation, World
from sim.demo import main
from sim.events import Event
from tests.conftest import at, overhead

PICK, PLACE = overhead(0.70, 0.15, -0.129), overhead(0.75, 0.00, -0.129)


class Diary(Observer):
    """Remembers which kinds of events came."""

    def __init__(self) -> None:
        self.kinds: list[EventKind] = []

    def on_event(self, event: Event) -> None:
        self.kinds.append(event.kind)


@pytest.fixture
def world(robot: Baxter, table: Body, block: Body) -> World:
    world = World(robot)
    world.spawn(table)
    world.spawn(block)
    return world


def run_cycle(
    world: World, manipulator: Manipulator, before: Callable[[World], None] = lambda _: None
) -> tuple[Outcome, Diary]:
    """Start and one pick and place, with something done to the world after planning."""
    diary = Diary()
    simulation = Simulation(world, [diary])
    start = manipulator.arm.start
    simulation.execute(plan_start_move(manipulator, world.scene, world.arm_q("left"), start))
    plan = plan_pick_and_place(
        PickAndPlace("block", PICK, PLACE), manipulator, world.scene, world.arm_q("left")
    )
    before(world)
    return simulation.execute(plan), diary


@pytest.mark.slow
def test_fault_tip_stays_5_6_mm_above_the_pick(manipulator: Manipulator, scene: Scene) -> None:
    """The original stops as soon as every joint is within 0.0087 rad."""
    plan = plan_pick_and_place(
        PickAndPlace("block", PICK, PLACE), manipulator, scene, manipulator.arm.start
    )
    descend = next(move for move in plan.moves if move.label == "pick: descend")
    reached = manipulator.arm.T_base_tip(descend.trajectory.q_goal)
    assert np.linalg.norm(reached.translation - PICK.translation) < 1e-6
    assert angle_between(reached.rotation, PICK.rotation) < 1e-6


def test_fault_solution_counts_as_valid_within_10_mm(ik: IKService, left: Arm) -> None:
    result = ik.solve(PICK, current=left.start)
    assert result.position_error_m <= 1e-6
    assert result.orientation_error_rad <= 1e-6


@pytest.mark.slow
def test_fault_half_of_the_reachable_poses_unsolved(ik: IKService, left: Arm) -> None:
    """The original solves 47-57 %."""
    rng = np.random.default_rng(9)
    poses = [left.T_base_tip(left.random_configuration(rng)) for _ in range(100)]
    assert sum(result.is_valid for result in ik.solve_batch(poses)) >= 98


def test_fault_null_space_map_not_implemented(ik: IKService) -> None:
    assert ik.solve(PICK, mode=SeedMode.NS_MAP).seed_type is SeedType.NS_MAP


def test_fault_user_mode_without_seeds_fails_the_call(ik: IKService, left: Arm) -> None:
    """One pose without a seed must not spoil the others."""
    results = ik.solve_batch([PICK, PICK], seeds=[None, left.start], mode=SeedMode.USER)
    assert [result.is_valid for result in results] == [False, True]
    assert "no USER seed was given" in str(results[0].failure)


def test_fault_fewer_seeds_than_poses_reads_out_of_bounds(ik: IKService, left: Arm) -> None:
    with pytest.raises(RequestError, match="2 poses came with 1 seeds"):
        ik.solve_batch([PICK, PLACE], seeds=[left.start])


def test_fault_no_restarts(ik: IKService, left: Arm) -> None:
    """From some seeds a search gets stuck; the pose is solved all the same."""
    rng = np.random.default_rng(12)
    results = [ik.solve(PICK, seed=left.random_configuration(rng)) for _ in range(50)]
    assert all(result.is_valid for result in results)
    assert {result.seed_type for result in results} == {SeedType.USER, SeedType.NS_MAP}


def test_fault_no_collision_check(manipulator: Manipulator, scene: Scene) -> None:
    """The way to a shelf below the table is refused because of the table, and of nothing else."""
    shelf = Body("shelf", (Part(Box((0.1, 0.1, 0.01)), at(0.0, 0.0, 0.0)),), at(0.7, 0.0, -0.282))
    onto_shelf = PickAndPlace("block", PICK, overhead(0.70, 0.0, -0.25))
    start, without_table = manipulator.arm.start, scene.without("table").with_body(shelf)
    plan = plan_pick_and_place(onto_shelf, manipulator, scene.with_body(shelf), start)
    assert not plan.is_valid
    assert "with table, at best" in str(plan.failure)
    assert plan_pick_and_place(onto_shelf, manipulator, without_table, start).is_valid


def test_fault_failed_ik_goes_on_and_grasps_air(manipulator: Manipulator, scene: Scene) -> None:
    """The original reports a pose without a solution, stays put, and closes the gripper anyway."""
    unreachable = PickAndPlace("block", PICK, overhead(2.0, 0.0, -0.129))
    plan = plan_pick_and_place(unreachable, manipulator, scene, manipulator.arm.start)
    assert plan.failure is not None
    assert plan.failure.stage == "place: approach"
    assert plan.failure.ik is not None
    assert "out of reach" in plan.failure.reason


def test_fault_start_without_angles_crashes(
    manipulator: Manipulator, scene: Scene, left: Arm
) -> None:
    plan = plan_start_move(manipulator, scene, left.neutral)
    assert plan.is_valid
    np.testing.assert_array_equal(plan.moves[0].trajectory.q_goal, np.zeros(7))


def test_fault_timeout_of_15_s_is_silent(world: World, manipulator: Manipulator) -> None:
    """A move ends at its goal at a time known beforehand; there is nothing to time out."""
    outcome, _ = run_cycle(world, manipulator)
    assert outcome.is_success
    plan = plan_start_move(manipulator, world.scene, world.arm_q("left"), manipulator.arm.neutral)
    simulation = Simulation(world)
    expected_s = plan.motion_time_s
    assert simulation.execute(plan).duration_s == pytest.approx(expected_s, abs=1e-9)
    np.testing.assert_allclose(world.arm_q("left"), manipulator.arm.neutral, atol=1e-12)


def test_fault_a_miss_goes_unnoticed(world: World, manipulator: Manipulator) -> None:
    def take_away(world: World) -> None:
        world.place_body("block", at(1.0, 0.3, -0.155))

    outcome, diary = run_cycle(world, manipulator, take_away)
    assert outcome.failure is not None
    assert "missed" in outcome.failure
    assert EventKind.MISSED in diary.kinds
    assert EventKind.RELEASED not in diary.kinds  # the place was not attempted


def test_fault_gripper_never_reports_that_it_grips(world: World, manipulator: Manipulator) -> None:
    gripped = []

    class Watch(Observer):
        def on_event(self, event: Event) -> None:
            if event.kind in (EventKind.GRASPED, EventKind.SETTLED):
                gripped.append(simulation.grippers["left"].state.is_gripping)

    simulation = Simulation(world, [Watch()])
    start = manipulator.arm.start
    simulation.execute(plan_start_move(manipulator, world.scene, world.arm_q("left"), start))
    task = PickAndPlace("block", PICK, PLACE)
    plan = plan_pick_and_place(task, manipulator, world.scene, start)
    simulation.execute(plan)
    assert gripped == [True, False]


def test_fault_blind_dwells_of_1_s(world: World, manipulator: Manipulator) -> None:
    """One pick and place of the original takes 16.7 s, a third of it waiting."""
    outcome, _ = run_cycle(world, manipulator)
    assert outcome.duration_s < 9.0


def test_fault_right_hand_is_asked_to_hold_what_it_cannot(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["--headless", "-q", "--limb", "right", "--right-hand", "half_round"]) == 1
    said = capsys.readouterr().err
    assert "50.0 mm" in said
    assert "52.7 mm" in said
