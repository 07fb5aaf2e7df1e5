"""Fingers and the gripper's commands, in a world with a block on a table."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from baxter_kin import Baxter
from planner import Body
from sim import EventKind, Simulation, World
from sim.ros1.robot.arm_motion import BadOrderError
from sim.ros1.robot.gripper import PARAMETERS, ElectricGripper, Fingers, GripperOrder
from sim.timeline import Timeline
from sim.world import Gripper
from sim.world.contacts import ContactWatch
from sim.world.gripper import Closing
from tests.conftest import overhead, state_at
from tests.sim.runs import Witness

TICK_S = 0.01
STROKE_S = 0.020833 / 0.05
"""How long the fingers take from open to closed."""

CONTACT_M = 1e-6
PICK = overhead(0.70, 0.15, -0.129)


class Bench:
    """A hand over the block, the arm at the pick."""

    def __init__(self, robot: Baxter, *bodies: Body) -> None:
        self.world, self.witness = World(robot), Witness()
        for body in bodies:
            self.world.spawn(body)
        grippers = {side: Gripper(self.world, side) for side in self.world.hands}
        self.timeline = Timeline(self.world, grippers, [self.witness], TICK_S)
        watch = ContactWatch(self.world)
        self.fingers = Fingers(self.world, "left", grippers["left"], self.timeline, watch)
        self.gripper = ElectricGripper(self.fingers)
        self.sequence = 0

    def send(self, command: str, *, is_enabled: bool = True, **args: Any) -> None:
        self.sequence += 1
        text = json.dumps(args) if args else ""
        self.gripper.order(GripperOrder(command, text, "me", self.sequence), is_enabled=is_enabled)

    def run(self, seconds: float, meanwhile: Callable[[int], None] = lambda _: None) -> None:
        for tick in range(round(seconds / TICK_S)):
            meanwhile(tick)
            self.gripper.step(TICK_S)

    @property
    def kinds(self) -> list[EventKind]:
        return self.witness.kinds


@pytest.fixture(scope="module")
def q_pick(robot: Baxter) -> np.ndarray[Any, Any]:
    from baxter_kin import IKService  # noqa: PLC0415

    arm = robot.arm("left")
    return IKService(arm).solve(PICK, current=arm.start).q


@pytest.fixture
def bench(robot: Baxter, table: Body, block: Body, q_pick: Any) -> Bench:
    bench = Bench(robot, table, block)
    bench.world.move_arm("left", q_pick)
    return bench


@pytest.fixture
def empty(robot: Baxter) -> Bench:
    return Bench(robot)


def closed_in_a_simulation(robot: Baxter, table: Body, block: Body, q: Any) -> World:
    """The same close by the simulation's own steps."""
    from planner import Grip, GripperAction, Plan  # noqa: PLC0415

    world = World(robot)
    world.move_arm("left", q)
    simulation = Simulation(world)
    simulation.spawn(table)
    simulation.spawn(block)
    grip = Grip("close", GripperAction.CLOSE, body="block")
    assert simulation.execute(Plan(state_at(q), (grip,), limb="left")).is_success
    return world


class TestClosing:
    """A `go` to zero holds what is there or misses it."""

    def test_holds_the_block_where_a_simulation_does(
        self, robot: Baxter, table: Body, block: Body, bench: Bench, q_pick: Any
    ) -> None:
        bench.send("go", position=0.0)
        bench.run(1.0)
        world = closed_in_a_simulation(robot, table, block, q_pick)
        assert bench.gripper.fingers.is_gripping
        assert not bench.gripper.fingers.has_missed
        assert abs(bench.world.finger_m("left") - world.finger_m("left")) <= CONTACT_M
        ours, theirs = bench.world.body("block"), world.body("block")
        assert ours.T_base_body.isApprox(theirs.T_base_body, CONTACT_M)
        assert bench.kinds == [EventKind.PUSHED, EventKind.GRASPED]
        bench.world.move_arm("left", bench.world.robot.arm("left").start)
        assert not bench.world.body("block").T_base_body.isApprox(theirs.T_base_body, 0.01)

    def test_nothing_between_the_pads_is_missed(self, empty: Bench) -> None:
        empty.send("go", position=0.0)
        empty.run(STROKE_S - 2 * TICK_S)
        assert empty.gripper.fingers.is_moving
        assert not empty.gripper.is_ready
        empty.run(0.1)
        assert (empty.gripper.fingers.percent, empty.gripper.fingers.has_missed) == (0.0, True)
        assert empty.gripper.is_ready
        assert empty.kinds == [EventKind.MISSED]

    def test_a_hand_that_moves_while_it_closes_holds_the_block_where_it_is_then(
        self, bench: Bench
    ) -> None:
        q = bench.world.arm_q("left")

        def creep(tick: int) -> None:
            bench.world.move_arm("left", q + 2e-5 * min(tick, 30) * np.ones(7))

        bench.send("go", position=0.0)
        bench.run(1.0, creep)
        assert bench.gripper.fingers.is_gripping
        held = bench.world.holding("left")
        assert held is not None
        expected = bench.world.T_base_tip("left") * held.T_link_body
        assert bench.world.body("block").T_base_body.isApprox(expected, 1e-12)

    def test_a_hand_that_settles_while_it_closes_needs_few_predictions(
        self, bench: Bench, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """As a lagging arm, which moves by less and less; each takes longer than a tick."""
        q, predict, calls = bench.world.arm_q("left"), Gripper.closing, list[float]()

        def counted(gripper: Gripper) -> Closing:
            calls.append(bench.world.finger_m("left"))
            return predict(gripper)

        def settle(tick: int) -> None:
            bench.world.move_arm("left", q + 2e-3 * 0.8**tick * np.ones(7))

        settle(0)
        monkeypatch.setattr(Gripper, "closing", counted)
        bench.send("go", position=0.0)
        bench.run(1.0, settle)
        assert bench.gripper.fingers.is_gripping
        assert len(calls) <= 12

    def test_a_hand_that_leaves_while_it_closes_misses(self, bench: Bench) -> None:
        bench.send("go", position=0.0)
        start = bench.world.robot.arm("left").start
        bench.run(1.0, lambda tick: bench.world.move_arm("left", start) if tick == 3 else None)
        assert bench.gripper.fingers.has_missed
        assert not bench.gripper.fingers.is_gripping

    def test_a_block_taken_away_while_it_closes_is_missed(self, bench: Bench) -> None:
        bench.send("go", position=0.0)
        bench.run(0.02)
        bench.world.delete("block")
        bench.gripper.refresh()
        bench.run(1.0)
        assert bench.gripper.fingers.has_missed

    def test_a_position_above_the_block_pushes_but_does_not_hold(self, bench: Bench) -> None:
        bench.send("go", position=92.0)
        bench.run(1.0)
        assert bench.gripper.fingers.percent == pytest.approx(92.0)
        assert not bench.gripper.fingers.is_gripping
        assert not bench.gripper.fingers.has_missed

    def test_an_opening_recorded_while_holding_holds_again(self, bench: Bench) -> None:
        bench.send("go", position=0.0)
        bench.run(1.0)
        recorded = float(np.float32(bench.gripper.fingers.percent))
        bench.send("go", position=100.0)
        bench.run(1.0)
        bench.send("go", position=recorded)
        bench.run(1.0)
        assert bench.gripper.fingers.is_gripping


class TestRepeats:
    """What is heard again restarts nothing."""

    def test_the_same_position_a_hundred_times_a_second_makes_one_grasp(self, bench: Bench) -> None:
        bench.run(1.0, lambda _: bench.send("go", position=0.0))
        assert bench.kinds.count(EventKind.GRASPED) == 1
        assert bench.gripper.last.sequence == 100

    def test_a_full_hand_told_to_close_keeps_what_it_has(self, bench: Bench) -> None:
        for position in (0.0, 50.0, 0.0, 80.0):
            bench.send("go", position=position)
            bench.run(0.5)
        assert bench.gripper.fingers.is_gripping
        assert bench.kinds.count(EventKind.RELEASED) == 0

    def test_a_calibration_repeated_until_it_works_works_once(self, empty: Bench) -> None:
        empty.send("clear_calibration")
        order = GripperOrder("calibrate", "", "me", 77)
        ready = []
        for _ in range(150):
            empty.gripper.order(order, is_enabled=True)
            empty.gripper.step(TICK_S)
            ready.append(empty.gripper.is_calibrated and empty.gripper.is_ready)
        assert ready == sorted(ready)  # once ready, ready for good
        assert ready[-1]
        assert not ready[50]


class TestOpening:
    """What is let go falls."""

    def test_a_block_let_go_in_the_air_falls_to_the_table(self, bench: Bench) -> None:
        bench.send("go", position=0.0)
        bench.run(0.5)
        q = bench.world.arm_q("left")
        bench.world.move_arm("left", q - [0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
        high = bench.world.body("block").T_base_body.translation[2]
        bench.send("go", position=100.0)
        heights = []
        bench.run(
            0.6,
            lambda _: heights.append(bench.world.body("block").T_base_body.translation[2]),
        )
        assert heights[0] == high
        assert heights == sorted(heights, reverse=True)
        assert bench.world.supports["block"] == ("table",)
        assert bench.kinds[-2:] == [EventKind.RELEASED, EventKind.SETTLED]

    def test_a_block_let_go_just_above_the_table_is_there_at_once(self, bench: Bench) -> None:
        bench.send("go", position=0.0)
        bench.run(1.0)
        where = bench.world.body("block").T_base_body
        q = bench.world.arm_q("left")
        bench.world.move_arm("left", q + 3e-3 * np.ones(7))
        assert not bench.world.body("block").T_base_body.isApprox(where, 1e-3)
        bench.send("go", position=100.0)
        assert bench.kinds[-2:] == [EventKind.RELEASED, EventKind.SETTLED]

    def test_it_falls_no_farther_when_it_is_taken_away(self, bench: Bench) -> None:
        bench.send("go", position=0.0)
        bench.run(0.5)
        q = bench.world.arm_q("left")
        bench.world.move_arm("left", q - [0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
        bench.send("go", position=100.0)
        bench.run(0.02)
        bench.world.delete("block")
        bench.gripper.refresh()
        bench.run(0.5)
        assert EventKind.SETTLED not in bench.kinds

    @settings(max_examples=15)
    @given(st.floats(0.0, 100.0), st.floats(0.0, 100.0))
    @example(1.0, 0.0625)  # nearly closed
    def test_empty_fingers_go_where_they_are_told(
        self, robot: Baxter, first: float, second: float
    ) -> None:
        bench = Bench(robot)
        for position in (first, second):
            bench.send("go", position=position)
            bench.run(STROKE_S + 0.05)
        assert bench.gripper.fingers.percent == pytest.approx(second, abs=1e-9)

    def test_a_stop_leaves_them_where_they_are(self, empty: Bench) -> None:
        empty.send("go", position=0.0)
        empty.run(0.2)
        empty.send("stop")
        before = empty.gripper.fingers.percent
        empty.run(1.0)
        assert 0.0 < before < 100.0
        assert empty.gripper.fingers.percent == before


class TestCommands:
    """What is answered, refused, configured."""

    def test_every_command_is_answered_at_once(self, empty: Bench) -> None:
        for command in ("configure", "stop", "reset", "no_op", "clear_calibration", "reboot"):
            empty.send(command)
            assert empty.gripper.last == GripperOrder(command, "", "me", empty.sequence)

    @pytest.mark.parametrize(
        ("command", "args", "said"),
        [
            ("go", "", "JSON object"),
            ("go", "[1]", "JSON object"),
            ("go", "{}", "position"),
            ("go", '{"position": "wide"}', "number of per cent"),
            ("go", '{"position": NaN}', "finite"),
            ("go", '{"position": true}', "number of per cent"),
            ("go", '{"position": 1' + 400 * "0" + "}", "number of per cent"),
            ("go", 5000 * "[", "JSON object"),
            ("configure", '{"colour": 1}', "no parameter 'colour'"),
            ("dance", "", "no command 'dance'"),
        ],
    )
    def test_nonsense_is_ignored_whole(
        self, empty: Bench, command: str, args: str, said: str
    ) -> None:
        with pytest.raises(BadOrderError, match=said):
            empty.gripper.order(GripperOrder(command, args, "me", 1), is_enabled=True)
        assert empty.gripper.last == GripperOrder("")
        assert not empty.gripper.fingers.is_moving

    def test_a_disabled_robots_gripper_can_be_configured_but_does_not_move(
        self, empty: Bench
    ) -> None:
        for command in ("go", "calibrate"):
            with pytest.raises(BadOrderError, match="disabled"):
                empty.send(command, is_enabled=False, position=0.0)
        empty.send("configure", is_enabled=False, velocity=100.0)
        assert empty.gripper.parameters == {**PARAMETERS, "velocity": 100.0}

    def test_what_is_not_calibrated_goes_nowhere_until_it_is(self, empty: Bench) -> None:
        empty.send("clear_calibration")
        assert not empty.gripper.is_calibrated
        assert empty.gripper.is_ready
        with pytest.raises(BadOrderError, match="not calibrated"):
            empty.send("go", position=0.0)
        empty.send("calibrate")
        empty.send("configure")  # as the original does at once
        empty.run(1.5)
        assert empty.gripper.is_calibrated
        empty.send("go", position=0.0)
        assert empty.gripper.fingers.is_moving

    def test_a_reboot_forgets_calibration_and_parameters(self, empty: Bench) -> None:
        empty.send("configure", holding_force=70.0)
        empty.send("reboot")
        assert not empty.gripper.is_ready
        empty.run(1.1)
        assert empty.gripper.is_ready
        assert not empty.gripper.is_calibrated
        assert empty.gripper.parameters == PARAMETERS

    def test_the_velocity_scales_the_speed(self, empty: Bench) -> None:
        empty.send("configure", velocity=25.0)
        empty.send("go", position=0.0)
        empty.run(STROKE_S)
        assert empty.gripper.fingers.percent == pytest.approx(50.0, abs=100 * TICK_S / STROKE_S)

    @pytest.mark.parametrize(
        ("holding", "moving", "force"), [(55.0, 40.0, 55.0), (30.0, 40.0, 41.0)]
    )
    def test_the_force_of_a_grasp_is_that_of_holding_but_above_that_of_moving(
        self, bench: Bench, holding: float, moving: float, force: float
    ) -> None:
        assert bench.gripper.force == 0.0
        bench.send("configure", holding_force=holding, moving_force=moving)
        bench.send("go", position=0.0)
        bench.run(0.5)
        assert bench.gripper.force == force
