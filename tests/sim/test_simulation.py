"""Simulation: exact time, events in order, and no blind waits."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from planner import Body, PickAndPlace, Plan, PlanFailure, Scene, plan_pick_and_place
from planner.errors import SceneError
from planner.grasping.finger_travel import FINGER_SPEED_M_S
from sim import EventKind, Outcome, Simulation, SimulationError
from sim.simulation import Strokes
from sim.timeline import DEFAULT_TICK_S
from sim.world import Push
from tests.sim.runs import PICK, PLACE, Run

TIME_S = 1e-9
"""Sums of some dozen durations below 10 s."""

RIGID = 1e-12
"""Products of rotations of order 1."""

REST_M = 1e-7


class TestCycle:
    """The demo's pick and place."""

    def test_it_succeeds_and_the_block_ends_at_the_place_level_on_the_table(
        self, cycle: tuple[Run, Outcome], table: Body
    ) -> None:
        run, outcome = cycle
        assert outcome.is_success, outcome.failure
        x, y, z = run.world.body("block").centre_base
        assert (x, y) == pytest.approx((0.75, 0.0), abs=5e-3)
        assert z == pytest.approx(-0.130, abs=REST_M)
        assert run.world.supports["block"] == ("table",)
        for snapshot in run.witness.snapshots:
            assert snapshot.T_base_bodies["table"] == table.T_base_body

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
        assert outcome.duration_s < 9.0
        times = [snapshot.time_s for snapshot in run.witness.snapshots]
        assert times == [tick * DEFAULT_TICK_S for tick in range(len(times))]
        assert 0.0 <= outcome.duration_s - times[-1] < DEFAULT_TICK_S
        told = [item.time_s for item in run.witness.received]
        assert told == sorted(told)

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
        arm = run.world.robot.arm("left")
        q = np.array([snapshot.q[where] for snapshot in run.witness.snapshots])
        speeds = np.abs(np.diff(q, axis=0)) / DEFAULT_TICK_S
        assert (speeds <= arm.limits.v_max * (1 + 1e-9)).all()
        others = list(run.world.robot.indices(run.world.robot.arm("right").joint_names))
        assert len({tuple(snapshot.q[others]) for snapshot in run.witness.snapshots}) == 1

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

    def test_the_block_rests_until_a_finger_touches_it_and_slides_with_that(
        self, cycle: tuple[Run, Outcome]
    ) -> None:
        run, _ = cycle
        begin_s, end_s = self.touched_s(run), self.grasped_s(run)
        shots = [(s.time_s, s.T_base_bodies["block"]) for s in run.witness.snapshots]
        resting = [T.homogeneous.tolist() for time_s, T in shots if time_s <= begin_s]
        assert len(resting) > 100
        assert all(pose == resting[0] for pose in resting)
        slides = [(time_s, T.translation) for time_s, T in shots if begin_s <= time_s <= end_s]
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

    def test_gripper_reports_open_then_gripping_then_open(self, cycle: tuple[Run, Outcome]) -> None:
        states = [snapshot.grippers["left"] for snapshot in cycle[0].witness.snapshots]
        gripping = [state.is_gripping for state in states]
        first, last = gripping.index(True), len(gripping) - gripping[::-1].index(True)
        assert all(gripping[first:last])
        assert states[0].percent == pytest.approx(100.0)
        assert states[-1].percent == pytest.approx(100.0)
        assert not any(state.has_missed for state in states)

    def test_a_started_move_comes_with_its_side_and_seed_type(
        self, cycle: tuple[Run, Outcome], plan: Plan
    ) -> None:
        started = [e for e in cycle[0].witness.events if e.kind is EventKind.MOVE_STARTED]
        assert [event.move for event in started] == list(plan.moves)
        assert {event.side for event in started} == {"left"}
        captions = {snapshot.caption for snapshot in cycle[0].witness.snapshots}
        assert captions == {step.label for step in plan}
        labels = [event.move.seed_label for event in started if event.move is not None]
        assert any("Joint Angles, optimised by 0." in label for label in labels)

    def test_a_grasp_and_a_release_say_hand_and_body(self, cycle: tuple[Run, Outcome]) -> None:
        kinds = (EventKind.GRASPED, EventKind.RELEASED)
        told = [event for event in cycle[0].witness.events if event.kind in kinds]
        assert [event.side for event in told] == ["left", "left"]
        assert [event.body and event.body.name for event in told] == ["block", "block"]
        T_base_block = [event.body.T_base_body for event in told if event.body is not None]
        assert np.linalg.norm(T_base_block[1].translation - T_base_block[0].translation) > 0.1


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
    run: Run, cycle: tuple[Run, Outcome], plan: Plan
) -> None:
    run.simulation.execute(plan)
    assert pictures(run) == pictures(cycle[0])


@pytest.mark.parametrize("tick_s", [0.037, 1.0])
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

    def test_an_invalid_plan_and_one_that_starts_elsewhere(self, run: Run, plan: Plan) -> None:
        failed = Plan(plan.start, plan.steps, PlanFailure("here", "too far"))
        with pytest.raises(SimulationError, match="here: too far"):
            run.simulation.execute(failed)
        run.world.move_arm("left", run.manipulator.arm.neutral)
        before = run.world.q.tolist()
        with pytest.raises(SimulationError, match="where the left arm stands"):
            run.simulation.execute(plan)
        assert run.world.q.tolist() == before
        assert run.simulation.time_s == 0.0
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

    def test_invalid_arguments(self, run: Run, plan: Plan) -> None:
        wrong: Any
        for wrong in (-1e-9, np.nan, 1e6, None):
            with pytest.raises(SimulationError):
                run.simulation.wait(wrong)
        wrong = "plan"
        with pytest.raises(SimulationError):
            run.simulation.execute(wrong)
        for wrong in ([[0.0, 1.0]], Strokes("brick", np.array([[0.0, 1.0]]))):
            with pytest.raises((SimulationError, SceneError)):
                run.simulation.execute(plan, strokes=wrong, unverified=True)
        for wrong in ([[1.0, 0.5]], [[-0.1, 0.5]], [[0.0, 1.0], [0.5, 2.0]], [0.0, 1.0]):
            with pytest.raises(SimulationError):
                Strokes("table", wrong)
        assert run.simulation.time_s == 0.0

    def test_bodies_that_are_there_already_or_not(self, run: Run, block: Body) -> None:
        received = len(run.witness.received)
        with pytest.raises(SceneError, match="already has"):
            run.simulation.spawn(block)
        with pytest.raises(SceneError, match="no body 'brick'"):
            run.simulation.delete("brick")
        assert len(run.witness.received) == received
