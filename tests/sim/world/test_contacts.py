"""Contacts: what an arm runs into when a plan meets another world than it was made for."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from planner import (
    Body,
    Box,
    Certificate,
    Grip,
    GripperAction,
    Manipulator,
    Move,
    Part,
    PickAndPlace,
    Plan,
    Trajectory,
    make_block,
    plan_joint_move,
    plan_pick_and_place,
    plan_straight_move,
    verify,
)
from planner.collision import ClearanceChecker
from planner.scene.contact import PRESSING_TOLERANCE_M
from sim import Event, EventKind, Observer, Outcome, Simulation, World
from sim.world import Contact
from sim.world.contacts import CHECK_S, ContactWatch, is_as_stated
from tests.conftest import at, overhead, state_at

PICK, PLACE = overhead(0.70, 0.15, -0.129), overhead(0.72, -0.15, -0.129)
TABLE_Z_M = -0.155
REST_M = 1e-7


class Diary(Observer):
    """Remembers the events."""

    def __init__(self) -> None:
        self.events: list[Event] = []

    def on_event(self, event: Event) -> None:
        self.events.append(event)

    @property
    def hits(self) -> list[Contact]:
        return [e.detail for e in self.events if isinstance(e.detail, Contact)]


class Bench:
    """The left arm at its start, a table and a red block, and the plan to carry it."""

    def __init__(self, robot: Baxter, manipulator: Manipulator, table: Body, plan: Plan) -> None:
        self.manipulator, self.plan, self.diary = manipulator, plan, Diary()
        self.world = World(robot)
        self.world.move_arm("left", manipulator.arm.start)
        self.simulation = Simulation(self.world, [self.diary])
        self.simulation.spawn(table)
        self.simulation.spawn(red())

    def grasp(self) -> None:
        """The first half: stands at the pick, the block in the hand."""
        outcome = self.simulation.execute(Plan(state_at(self.plan.q_start), self.plan.steps[:4]))
        assert outcome.is_success, outcome.failure

    def line(self, x: float, y: float, z: float) -> Outcome:
        """A straight move that nobody checked."""
        q = self.world.arm_q("left")
        motion = plan_straight_move(
            self.manipulator.arm, q, overhead(x, y, z), self.manipulator.limits
        )
        return self.simulation.execute(Plan(state_at(q), (Move("line", motion),)))


def red() -> Body:
    return make_block("red", at(0.70, 0.15, TABLE_Z_M + 0.025))


@pytest.fixture(scope="module")
def plan(robot: Baxter, manipulator: Manipulator, table: Body) -> Plan:
    world = World(robot)
    world.spawn(table)
    world.spawn(red())
    task = PickAndPlace("red", PICK, PLACE)
    plan = plan_pick_and_place(task, manipulator, world.scene, manipulator.arm.start)
    assert plan.is_valid, str(plan.failure)
    return plan


@pytest.fixture(scope="module")
def certificate(plan: Plan) -> Certificate:
    found = verify(plan)
    assert found.is_valid, found.verdict
    return found


@pytest.fixture
def bench(robot: Baxter, manipulator: Manipulator, table: Body, plan: Plan) -> Bench:
    return Bench(robot, manipulator, table, plan)


class TestOutcome:
    """An execution says what was hit, and whether its plan had been verified."""

    def test_a_success_that_went_into_a_box_says_so_and_the_next_one_does_not(
        self, bench: Bench
    ) -> None:
        bench.simulation.spawn(make_block("box", at(0.70, 0.045, TABLE_Z_M + 0.025)))
        for goal in ((0.70, 0.0, 0.0), (0.70, 0.0, -0.12)):
            outcome = bench.line(*goal)
        assert outcome.is_success
        assert [hit.other for hit in outcome.hits] == ["box"]
        assert list(outcome.hits) == bench.diary.hits
        assert "inside box" in repr(outcome)
        assert not bench.line(0.70, 0.0, 0.1).hits

    def test_a_certificate_that_is_missing_or_not_valid_is_warned_of_unless_on_purpose(
        self, bench: Bench, certificate: Certificate, caplog: pytest.LogCaptureFixture
    ) -> None:
        plan = evolve(bench.plan, steps=bench.plan.steps[:3])
        strict = evolve(plan.moves[0].trajectory.limits, j_max=np.full(7, 1.0))
        invalid = verify(plan, limits=strict)
        assert not invalid.is_valid
        options: dict[str, Any]
        for options, warning in (
            ({}, "without a certificate"),
            ({"certificate": invalid}, "not valid"),
            ({"unverified": True}, ""),
        ):
            caplog.clear()
            bench.world.move_arm("left", plan.q_start)
            bench.simulation.execute(plan, **options)
            assert warning in caplog.text
            assert bool(caplog.records) == bool(warning)
        bench.world.move_arm("left", plan.q_start)
        bench.simulation.execute(bench.plan, certificate=certificate)
        assert not caplog.records


class TestTable:
    """What does not give way ends the move."""

    def test_a_held_block_does_not_pass_through_the_table_and_stays_at_the_last_free_check(
        self, bench: Bench
    ) -> None:
        bench.grasp()
        outcome = bench.line(0.70, 0.15, -0.2)
        assert outcome.failure == "line: the held red would pass through the table"
        lowest = bench.world.body("red").extent_m((0, 0, 1))[0]
        assert lowest >= TABLE_Z_M - PRESSING_TOLERANCE_M
        (contact,) = bench.diary.hits
        assert outcome.duration_s == pytest.approx(contact.free_s, abs=1e-9)
        assert 0.0 < contact.time_s - contact.free_s <= CHECK_S + 1e-9
        assert contact.depth_m > PRESSING_TOLERANCE_M
        bench.simulation = Simulation(bench.world, check_contacts=False)
        assert bench.line(0.70, 0.15, -0.2).is_success

    def test_the_fingers_do_not_either(self, bench: Bench) -> None:
        bench.world.delete("red")
        bench.simulation.execute(Plan(state_at(bench.plan.q_start), bench.plan.steps[:3]))
        outcome = bench.line(0.70, 0.15, -0.2)
        assert outcome.failure is not None
        assert "line: the left hand (l_gripper_" in outcome.failure
        assert "would pass through the table" in outcome.failure

    def test_a_block_may_be_lowered_to_touch(self, bench: Bench) -> None:
        bench.grasp()
        assert bench.line(0.70, 0.15, -0.129 + 0.03).is_success
        assert bench.line(0.70, 0.15, -0.129 - 0.8 * PRESSING_TOLERANCE_M).is_success
        assert bench.diary.hits == []

    def test_a_riding_block_is_checked_too(self, bench: Bench) -> None:
        bench.simulation.spawn(make_block("top", at(0.70, 0.15, 0.0), edge_m=(0.2, 0.02, 0.02)))
        shelf = make_block("shelf", at(0.78, 0.15, 0.0), edge_m=(0.02, 0.1, 0.02), is_movable=False)
        bench.grasp()
        bench.simulation.spawn(shelf)
        outcome = bench.line(0.70, 0.15, 0.0)
        assert outcome.failure == "line: the held red would pass through the shelf"

    def test_the_robot_itself_is_in_the_way(self, bench: Bench) -> None:
        arm = bench.manipulator.arm
        q, goal = bench.world.arm_q("left"), np.array([1.0, -1.0, -3.0, 2.5, 0.0, 1.9, 0.0])
        move = Move("fold", plan_joint_move(q, goal, arm.limits))
        outcome = bench.simulation.execute(Plan(state_at(q), (move,)))
        assert outcome.failure is not None
        assert "would pass through" in outcome.failure


class TestMovable:
    """What gives way is reported and left where it is."""

    @pytest.fixture
    def blocked(self, bench: Bench) -> Bench:
        """A brick stands in the way of the transfer."""
        bench.simulation.spawn(make_block("brick", at(0.70, 0.0, 0.0), edge_m=(0.03, 0.03, 0.25)))
        return bench

    def test_a_hit_is_reported_once_at_its_time_and_the_plan_goes_on(self, blocked: Bench) -> None:
        before = blocked.world.body("brick").T_base_body
        outcome = blocked.simulation.execute(blocked.plan)
        assert outcome.is_success
        assert [(hit.other, hit.stops) for hit in blocked.diary.hits] == [("brick", False)]
        assert blocked.world.body("brick").T_base_body == before
        events = blocked.diary.events
        number = next(i for i, e in enumerate(events) if e.kind is EventKind.HIT)
        begin = max(e.time_s for e in events[:number] if e.kind is EventKind.MOVE_STARTED)
        hit = events[number]
        assert isinstance(hit.detail, Contact)
        assert hit.time_s == pytest.approx(begin + hit.detail.time_s, abs=1e-9)
        assert "brick, which is left where it is" in hit.text
        for tick_s in (0.0037, 0.5):
            diary, world = Diary(), World(blocked.world.robot)
            world.move_arm("left", blocked.plan.q_start)
            simulation = Simulation(world, [diary], tick_s=tick_s)
            for body in (*blocked.plan.start.scene, blocked.world.body("brick")):
                simulation.spawn(body)
            simulation.execute(blocked.plan)
            assert diary.hits == blocked.diary.hits

    def test_a_block_that_was_displaced_is_hit_by_the_fingers_and_reported_once(
        self, bench: Bench
    ) -> None:
        bench.world.place_body("red", at(0.70, 0.162, TABLE_Z_M + 0.025))
        outcome = bench.simulation.execute(bench.plan)
        (hit,) = bench.diary.hits
        assert (hit.other, hit.is_held, hit.stops) == ("red", False, False)
        assert "missed" in str(outcome.failure)
        assert bench.line(0.70, 0.15, -0.129 + 0.02).is_success
        assert len(bench.diary.hits) == 1

    def test_what_the_other_hand_holds_does_not_give_way(self, blocked: Bench) -> None:
        world = blocked.world
        pose = world.T_base_tip("right").inverse() * world.body("brick").T_base_body
        world.attach("right", "brick", pose)
        outcome = blocked.simulation.execute(blocked.plan)
        assert "would pass through the brick" in str(outcome.failure)

    def test_touching_less_than_a_contact_may_press_is_no_hit(self, bench: Bench) -> None:
        bench.grasp()
        side = 0.70 + 0.0265  # half a block, its yaw, and a little: beside, not inside
        bench.simulation.spawn(make_block("brick", at(side + 0.025, 0.15, 0.0)))
        assert bench.line(0.70, 0.15, 0.0).is_success
        assert bench.diary.hits == []


def ends(move: Move) -> dict[str, list[list[float]]]:
    trajectory = move.trajectory
    return {move.limb: [trajectory.q_start.tolist(), trajectory.q_goal.tolist()]}


def contacts(bench: Bench, motion: Trajectory) -> list[Contact]:
    """Those of a move of the left arm that begins now."""
    times_s = np.linspace(0.0, motion.duration, max(1, math.ceil(motion.duration / CHECK_S)) + 1)
    paths = {"left": motion.sample(times_s).q}
    return [each for _, each in ContactWatch(bench.world).along(paths, times_s, ("left",))]


@pytest.mark.parametrize("has_pole", [False, True])
def test_what_the_other_hand_holds_moves_with_that_hand(bench: Bench, has_pole: bool) -> None:
    """With a pole that stands on it; the watch has known both before the hand moves on."""
    world, watch = bench.world, ContactWatch(bench.world)
    q, q_left = world.robot.arm("right").start - 0.5 * np.eye(7)[1], world.arm_q("left")
    below_m = 0.3 if has_pole else 0.0
    there = at(*world.robot.arm("right").T_base_tip(q).translation - (0.0, 0.0, below_m))
    world.attach("left", "red", world.T_base_tip("left").inverse() * there)
    if has_pole:
        assert watch.at("right", q) == []
        pole = Part(Box((0.06, 0.06, below_m)), at(0.0, 0.0, 0.0))
        stands = there * at(0.0, 0.0, 0.5 * below_m + 0.025)
        world.spawn(Body("pole", (pole,), stands, is_movable=True))
        assert world.riders("red") == ("pole",)
    for turn, is_met in ((0.0, True), (0.6, False), (0.0, True)):
        world.move_arm("left", q_left + turn * np.eye(7)[0])
        met = {contact.other for contact in watch.at("right", q)}
        assert met == ({"pole" if has_pole else "red"} if is_met else set())


class TestProofs:
    """Moves of a certified plan, in the world that they state, are not checked."""

    def test_none_of_them_is(
        self, bench: Bench, looks: list[Any], certificate: Certificate
    ) -> None:
        assert bench.simulation.execute(bench.plan, certificate=certificate).is_success
        assert looks == []

    def test_a_certificate_of_another_plan_is_not_one_of_this(
        self, bench: Bench, looks: list[Any], certificate: Certificate
    ) -> None:
        copy = evolve(bench.plan)
        assert bench.simulation.execute(copy, certificate=certificate).is_success
        assert looks == [ends(move) for move in bench.plan.moves]

    def test_moves_after_a_change_that_an_observer_made_are(
        self, bench: Bench, looks: list[Any], certificate: Certificate
    ) -> None:
        class Spawner(Observer):
            def on_event(self, event: Event) -> None:
                if event.kind is EventKind.RELEASED:
                    bench.world.spawn(make_block("late", at(1.2, -0.3, 0.0)))

        bench.simulation = Simulation(bench.world, [Spawner()])
        assert bench.simulation.execute(bench.plan, certificate=certificate).is_success
        assert looks == [ends(bench.plan.moves[-1])]

    def test_moves_with_something_on_the_held_body_are(
        self, bench: Bench, looks: list[Any], certificate: Certificate
    ) -> None:
        class Loader(Observer):
            def on_event(self, event: Event) -> None:
                if event.kind is EventKind.GRASPED:
                    bench.world.spawn(make_block("top", at(0.70, 0.15, 0.0), edge_m=0.02))

        bench.simulation = Simulation(bench.world, [Loader()])
        bench.simulation.execute(bench.plan, certificate=certificate)
        carrying = bench.plan.moves[2:]
        assert looks == [ends(move) for move in carrying]

    @pytest.mark.parametrize(
        "change",
        [
            lambda world: world.place_body("red", at(0.70, 0.1501, TABLE_Z_M + 0.025)),
            lambda world: world.spawn(make_block("far", at(1.2, -0.3, 0.0))),
            lambda world: world.move_arm("right", world.robot.arm("right").neutral + 0.01),
            lambda world: world.set_fingers("right", 0.01),
        ],
    )
    def test_in_another_world_every_move_is(
        self,
        bench: Bench,
        looks: list[Any],
        change: Callable[[World], None],
    ) -> None:
        change(bench.world)
        plan = evolve(bench.plan, steps=bench.plan.steps[:3])
        bench.simulation.execute(plan, certificate=verify(plan))
        assert looks == [ends(move) for move in plan.moves]

    def test_a_world_is_as_a_step_states_it(self, bench: Bench) -> None:
        step = bench.plan.steps[0]
        assert is_as_stated(bench.world, step)
        assert not is_as_stated(bench.world, evolve(step, state=None))
        assert not is_as_stated(bench.world, evolve(step, state=state_at(bench.plan.q_start)))
        bench.world.attach("left", "red", pin.SE3.Identity())
        assert not is_as_stated(bench.world, step)


def test_a_contact_is_as_deep_as_the_planner_measures(bench: Bench) -> None:
    bench.simulation.execute(Plan(state_at(bench.plan.q_start), bench.plan.steps[:3]))
    bench.world.place_body("red", at(0.70, 0.162, TABLE_Z_M + 0.025))
    q = bench.world.arm_q("left")
    motion = plan_joint_move(q, q + 1e-4, bench.manipulator.limits)
    (contact,) = contacts(bench, motion)
    world = bench.world
    checker = ClearanceChecker(world.shapes, world.robot.arm("left"), world.scene)
    assert -contact.depth_m == pytest.approx(checker.clearance(world.q).distance_m, abs=1e-6)


def test_a_released_block_between_the_fingers_is_no_hit(bench: Bench) -> None:
    bench.grasp()
    q = bench.world.arm_q("left")
    opening = Plan(state_at(q), (Grip("open", GripperAction.OPEN),), limb="left")
    assert bench.simulation.execute(opening).is_success
    assert bench.line(0.70, 0.15, 0.0).is_success
    assert bench.diary.hits == []


class TestSteps:
    """An arm that is led step by step meets what it would meet on the whole move."""

    def motion(self, bench: Bench, x: float, y: float, z: float) -> Trajectory:
        q, arm = bench.world.arm_q("left"), bench.manipulator.arm
        return plan_straight_move(arm, q, overhead(x, y, z), bench.manipulator.limits)

    def test_it_is_stopped_by_what_stops_the_move(self, bench: Bench) -> None:
        bench.grasp()
        motion = self.motion(bench, 0.70, 0.15, -0.2)
        (wanted,) = contacts(bench, motion)
        watch = ContactWatch(bench.world)
        steps = max(1, math.ceil(motion.duration / CHECK_S))
        for time_s in np.linspace(0.0, motion.duration, steps + 1):
            found = watch.at("left", motion.sample(time_s).q)
            if found:
                break
        assert time_s == wanted.time_s
        assert [(c.mover, c.other, c.stops, c.depth_m) for c in found] == [
            (wanted.mover, wanted.other, True, wanted.depth_m)
        ]
        assert watch.at("left", motion.sample(time_s).q)  # and again, as long as it would go on

    def test_a_movable_body_is_reported_once_for_as_long_as_it_lasts(self, bench: Bench) -> None:
        watch, q = ContactWatch(bench.world), bench.world.arm_q("left")
        bench.world.place_body("red", bench.world.T_base_tip("left") * at(0.0, 0.0, -0.1))
        first, second = watch.at("left", q), watch.at("left", q)
        assert {contact.other for contact in first} == {"red"}
        assert not second
        aside = q + np.eye(7)[0] * 0.5
        assert not watch.at("left", aside)
        assert [contact.other for contact in watch.at("left", q)] == ["red"]
