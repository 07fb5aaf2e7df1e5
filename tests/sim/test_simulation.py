"""Simulation: exact time, events in order, and no blind waits."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from planner import Body, Manipulator, PickAndPlace, Plan, PlanFailure, Scene, plan_pick_and_place
from planner.errors import SceneError
from planner.grasping.finger_travel import FINGER_SPEED_M_S
from sim import EventKind, Outcome, Simulation, SimulationError
from sim.timeline import DEFAULT_TICK_S
from sim.world import Push
from tests.conftest import state_at
from tests.sim.runs import PICK, PLACE, Run

TIME_S = 1e-9
"""Sums of some dozen durations below 10 s."""

RIGID = 1e-12
"""Products of rotations of order 1."""

REST_M = 1e-7


class TestCycle:
    """The demo's pick and place."""

    def test_it_succeeds(self, cycle: tuple[Run, Outcome]) -> None:
        _, outcome = cycle
        assert outcome.is_success, outcome.failure

    def test_the_block_ends_at_the_place_level_on_the_table(
        self, cycle: tuple[Run, Outcome]
    ) -> None:
        x, y, z = cycle[0].world.body("block").centre_base
        assert (x, y) == pytest.approx((0.75, 0.0), abs=5e-3)
        assert z == pytest.approx(-0.130, abs=REST_M)
        assert cycle[0].world.supports["block"] == ("table",)

    def test_what_happens_is_reported_in_order(self, cycle: tuple[Run, Outcome]) -> None:
        assert cycle[0].witness.kinds == [
            EventKind.SPAWNED,
            EventKind.SPAWNED,
            EventKind.OPENED,
            EventKind.MOVE_STARTED,
            EventKind.MOVE_STARTED,
            EventKind.PUSHED,
            EventKind.GRASPED,
            EventKind.MOVE_STARTED,
            EventKind.MOVE_STARTED,
            EventKind.MOVE_STARTED,
            EventKind.RELEASED,
            EventKind.SETTLED,
            EventKind.MOVE_STARTED,
        ]

    def test_time_is_the_sum_of_moves_and_finger_travels(
        self, cycle: tuple[Run, Outcome], plan: Plan
    ) -> None:
        run, outcome = cycle
        hand = run.world.hands["left"]
        grasped = next(s for s in run.witness.snapshots if s.grippers["left"].is_gripping)
        finger_m = grasped.grippers["left"].percent / 100 * hand.stroke_m
        fingers_s = 2 * (hand.stroke_m - finger_m) / FINGER_SPEED_M_S
        assert outcome.duration_s == pytest.approx(plan.motion_time_s + fingers_s, abs=TIME_S)
        assert run.simulation.time_s == pytest.approx(outcome.duration_s, abs=TIME_S)

    def test_one_pick_and_place_takes_less_than_9_s(self, cycle: tuple[Run, Outcome]) -> None:
        assert cycle[1].duration_s < 9.0

    def test_snapshots_come_at_every_tick_exactly(self, cycle: tuple[Run, Outcome]) -> None:
        times = [snapshot.time_s for snapshot in cycle[0].witness.snapshots]
        assert times == [tick * DEFAULT_TICK_S for tick in range(len(times))]
        assert 0.0 <= cycle[1].duration_s - times[-1] < DEFAULT_TICK_S

    def test_notifications_are_in_the_order_of_time(self, cycle: tuple[Run, Outcome]) -> None:
        times = [item.time_s for item in cycle[0].witness.received]
        assert times == sorted(times)

    def test_moves_begin_the_moment_the_step_before_ended(
        self, cycle: tuple[Run, Outcome], plan: Plan
    ) -> None:
        events = {event.text: event.time_s for event in cycle[0].witness.events}
        approach, descend = (
            next(time for text, time in events.items() if text.startswith(f"pick: {name}"))
            for name in ("approach", "descend")
        )
        assert approach == 0.0
        assert descend == pytest.approx(plan.moves[0].trajectory.duration, abs=TIME_S)

    def test_each_snapshot_shows_the_trajectory_at_its_time(
        self, cycle: tuple[Run, Outcome], plan: Plan
    ) -> None:
        run, _ = cycle
        where = list(run.world.robot.indices(run.world.robot.arm("left").joint_names))
        trajectory = plan.moves[0].trajectory
        for snapshot in run.witness.snapshots:
            if snapshot.time_s <= trajectory.duration:
                expected = trajectory.sample(snapshot.time_s).q
                assert snapshot.q[where] == pytest.approx(expected, abs=RIGID)

    def test_the_arm_never_moves_faster_than_its_limits_between_ticks(
        self, cycle: tuple[Run, Outcome]
    ) -> None:
        run, _ = cycle
        arm = run.world.robot.arm("left")
        where = list(run.world.robot.indices(arm.joint_names))
        q = np.array([snapshot.q[where] for snapshot in run.witness.snapshots])
        speeds = np.abs(np.diff(q, axis=0)) / DEFAULT_TICK_S
        assert (speeds <= arm.limits.v_max * (1 + 1e-9)).all()

    def test_the_held_block_moves_rigidly_with_the_hand(self, cycle: tuple[Run, Outcome]) -> None:
        run, _ = cycle
        arm = run.world.robot.arm("left")
        where = list(run.world.robot.indices(arm.joint_names))
        offsets = [
            (
                arm.T_base_tip(snapshot.q[where]).inverse() * snapshot.T_base_bodies["block"]
            ).homogeneous
            for snapshot in run.witness.snapshots
            if snapshot.grippers["left"].is_gripping
        ]
        assert len(offsets) > 100
        for offset in offsets:
            assert offset == pytest.approx(offsets[0], abs=RIGID)

    def test_the_block_rests_until_a_finger_touches_it(self, cycle: tuple[Run, Outcome]) -> None:
        run, _ = cycle
        poses = [
            snapshot.T_base_bodies["block"].homogeneous.tolist()
            for snapshot in run.witness.snapshots
            if snapshot.time_s <= self.touched_s(run)
        ]
        assert len(poses) > 100
        assert all(pose == poses[0] for pose in poses)

    def test_the_block_slides_with_the_finger_until_the_other_touches(
        self, cycle: tuple[Run, Outcome]
    ) -> None:
        run, _ = cycle
        begin_s, end_s = self.touched_s(run), self.grasped_s(run)
        slides = [
            (shot.time_s, shot.T_base_bodies["block"].translation)
            for shot in run.witness.snapshots
            if begin_s <= shot.time_s <= end_s
        ]
        assert len(slides) > 2
        for (before_s, before), (after_s, after) in pairwise(slides):
            speed = np.linalg.norm(after - before) / (after_s - before_s)
            assert speed == pytest.approx(FINGER_SPEED_M_S, abs=1e-6)

    @staticmethod
    def grasped_s(run: Run) -> float:
        return next(e.time_s for e in run.witness.events if e.kind is EventKind.GRASPED)

    def touched_s(self, run: Run) -> float:
        """When the first pad touches."""
        push = next(e.detail for e in run.witness.events if e.kind is EventKind.PUSHED)
        assert isinstance(push, Push)
        return self.grasped_s(run) - push.distance_m / FINGER_SPEED_M_S

    def test_the_table_never_moves(self, cycle: tuple[Run, Outcome], table: Body) -> None:
        for snapshot in cycle[0].witness.snapshots:
            assert snapshot.T_base_bodies["table"] == table.T_base_body

    def test_gripper_reports_open_then_gripping_then_open(self, cycle: tuple[Run, Outcome]) -> None:
        states = [snapshot.grippers["left"] for snapshot in cycle[0].witness.snapshots]
        gripping = [state.is_gripping for state in states]
        first, last = gripping.index(True), len(gripping) - gripping[::-1].index(True)
        assert all(gripping[first:last])
        assert states[0].percent == pytest.approx(100.0)
        assert states[-1].percent == pytest.approx(100.0)
        assert not any(state.has_missed for state in states)

    def test_the_right_gripper_and_arm_stay_as_they_were(self, cycle: tuple[Run, Outcome]) -> None:
        run, _ = cycle
        where = list(run.world.robot.indices(run.world.robot.arm("right").joint_names))
        rows = {tuple(snapshot.q[where]) for snapshot in run.witness.snapshots}
        assert len(rows) == 1

    def test_captions_say_the_stage_alone(self, cycle: tuple[Run, Outcome], plan: Plan) -> None:
        captions = {snapshot.caption for snapshot in cycle[0].witness.snapshots}
        assert captions == {step.label for step in plan}

    def test_a_started_move_comes_with_its_side_and_seed_type(
        self, cycle: tuple[Run, Outcome], plan: Plan
    ) -> None:
        started = [e for e in cycle[0].witness.events if e.kind is EventKind.MOVE_STARTED]
        assert [event.move for event in started] == list(plan.moves)
        assert {event.side for event in started} == {"left"}
        labels = [event.move.seed_label for event in started if event.move is not None]
        assert any("Joint Angles, optimised by 0." in label for label in labels)

    def test_a_grasp_and_a_release_say_hand_and_body(self, cycle: tuple[Run, Outcome]) -> None:
        kinds = (EventKind.GRASPED, EventKind.RELEASED)
        told = [event for event in cycle[0].witness.events if event.kind in kinds]
        assert [event.side for event in told] == ["left", "left"]
        assert [event.body and event.body.name for event in told] == ["block", "block"]
        T_base_block = [event.body.T_base_body for event in told if event.body is not None]
        assert np.linalg.norm(T_base_block[1].translation - T_base_block[0].translation) > 0.1

    def test_snapshots_share_nothing_with_the_world(self, cycle: tuple[Run, Outcome]) -> None:
        first, last = cycle[0].witness.snapshots[0], cycle[0].witness.snapshots[-1]
        assert first.q.tolist() != last.q.tolist()
        assert first.T_base_bodies["block"] != last.T_base_bodies["block"]


def pictures(run: Run) -> list[Any]:
    return [
        (
            shot.time_s,
            shot.q.tobytes(),
            {name: T.homogeneous.tobytes() for name, T in shot.T_base_bodies.items()},
            shot.grippers,
            shot.caption,
        )
        for shot in run.witness.snapshots
    ]


def test_two_runs_give_the_same_snapshots_to_the_bit(
    robot: Baxter, manipulator: Manipulator, table: Body, block: Body
) -> None:
    runs = [Run(robot, (table, block), manipulator) for _ in range(2)]
    for run in runs:
        run.simulation.execute(run.plan())
    assert pictures(runs[0]) == pictures(runs[1])


@pytest.mark.parametrize("tick_s", [0.003, 0.037, 1.0])
def test_the_tick_changes_neither_the_end_nor_how_long_it_takes(
    scene: Scene, cycle: tuple[Run, Outcome], plan: Plan, tick_s: float
) -> None:
    manipulator = cycle[0].manipulator
    run = Run(manipulator.robot, scene, manipulator, tick_s=tick_s)
    outcome = run.simulation.execute(plan)
    assert outcome.duration_s == pytest.approx(cycle[1].duration_s, abs=TIME_S)
    assert run.world.q == pytest.approx(cycle[0].world.q, abs=RIGID)
    for name, T in cycle[0].world.body_poses().items():
        assert run.world.body(name).T_base_body.homogeneous == pytest.approx(
            T.homogeneous, abs=REST_M
        )
    times = [shot.time_s for shot in run.witness.snapshots]
    assert times == [tick * tick_s for tick in range(len(times))]
    assert len(times) == math.floor(outcome.duration_s / tick_s) + 1


def test_the_way_back_puts_the_block_back(run: Run, plan: Plan) -> None:
    before = run.world.body("block").centre_base
    run.simulation.execute(plan)
    task = PickAndPlace("block", PLACE, PICK)
    back = plan_pick_and_place(task, run.manipulator, run.world.scene, run.world.arm_q("left"))
    assert run.simulation.execute(back).is_success
    # the first grasp moves the block by up to 4.2 mm, into the middle of the hand
    assert run.world.body("block").centre_base == pytest.approx(before, abs=5e-3)


class TestRefusals:
    """Orders that the world cannot follow; nothing has moved then."""

    def test_an_invalid_plan(self, run: Run) -> None:
        before = run.world.q.tolist()
        failed = Plan(
            state_at(run.world.arm_q("left")), run.plan().steps, PlanFailure("here", "too far")
        )
        with pytest.raises(SimulationError, match="invalid plan cannot be executed: here: too far"):
            run.simulation.execute(failed)
        assert run.world.q.tolist() == before
        assert run.simulation.time_s == 0.0

    def test_a_plan_that_starts_elsewhere(self, run: Run) -> None:
        plan = run.plan()
        run.world.move_arm("left", run.manipulator.arm.neutral)
        with pytest.raises(SimulationError, match=r"starts \S+ rad from where the left arm stands"):
            run.simulation.execute(plan)
        assert run.witness.snapshots == []

    @pytest.mark.parametrize(
        "options",
        [
            {"world": None},
            {"observers": [print]},
            {"dwell": 1.0},
            {"check_contacts": 1},
            *({"tick_s": tick_s} for tick_s in (0.0, np.inf, None, "fast", 1e-300, 10**400)),
        ],
    )
    def test_invalid_options(self, run: Run, options: dict[str, Any]) -> None:
        with pytest.raises(SimulationError):
            Simulation(**{"world": run.world, **options})

    @pytest.mark.parametrize("wait_s", [-1e-9, np.nan, 1e6, None])
    def test_invalid_arguments(self, run: Run, wait_s: Any) -> None:
        with pytest.raises(SimulationError):
            run.simulation.wait(wait_s)
        plan: Any = "plan"
        with pytest.raises(SimulationError):
            run.simulation.execute(plan)
        assert run.simulation.time_s == 0.0

    def test_bodies_that_are_there_already_or_not(self, run: Run, block: Body) -> None:
        received = len(run.witness.received)
        with pytest.raises(SceneError, match="already has"):
            run.simulation.spawn(block)
        with pytest.raises(SceneError, match="no body 'brick'"):
            run.simulation.delete("brick")
        assert len(run.witness.received) == received
