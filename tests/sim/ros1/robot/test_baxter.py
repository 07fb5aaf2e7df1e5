"""The simulated Baxter without its wire: orders, ticks, contacts, stops."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Baxter, IKService
from baxter_kin.kinematics.arm import LIMBS
from planner import Body
from planner.scene.contact import PRESSING_TOLERANCE_M
from sim import EventKind, World
from sim.ros1.robot.arm_motion import BadOrderError
from sim.ros1.robot.baxter import MAX_TICKS, SimulatedBaxter
from sim.ros1.robot.gazebo import GAZEBO_START_RAD, furniture, start_rad
from sim.ros1.robot.gripper import GripperOrder
from sim.world import contacts
from tests.conftest import at, overhead
from tests.sim.runs import Witness

ABOVE, PICK, BELOW = (overhead(0.70, 0.15, z) for z in (-0.05, -0.129, -0.20))


class Bench:
    """A robot that is enabled, its left arm at the demo's start."""

    def __init__(self, robot: Baxter, *bodies: Body) -> None:
        self.witness = Witness()
        start = {side: robot.arm(side).start for side in LIMBS}
        self.baxter = SimulatedBaxter(World(robot), [self.witness], q_start=start)
        for body in bodies:
            self.baxter.spawn(body)
        self.baxter.enable()

    def move(self, goal: np.ndarray, ticks: int = 1000, *, side: str = "left") -> None:
        """Send the goal once and tick until the arm is there, or the ticks are over."""
        names = self.baxter.world.robot.arm(side).joint_names
        self.baxter.order_joints(side, 1, names, goal.tolist())
        for _ in range(ticks):
            self.baxter.tick()
            if np.abs(self.baxter.arms[side].q - goal).max() < 1e-9:
                return

    @property
    def stops(self) -> list[str]:
        return [e.text for e in self.witness.events if e.kind is EventKind.HIT]


@pytest.fixture(scope="module")
def ik(robot: Baxter) -> IKService:
    return IKService(robot.arm("left"))


def solved(ik: IKService, pose: object) -> np.ndarray:
    result = ik.solve(pose, current=ik.arm.start)
    assert result.is_valid
    return np.array(result.q)


def counted_measurements(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """What grows whenever it is measured how deep a contact is."""
    measured: list[object] = []
    deepest = contacts._Surroundings.deepest

    def counted(around: contacts._Surroundings, *place: Any) -> contacts.Contact:
        measured.append(place)
        return deepest(around, *place)

    monkeypatch.setattr(contacts._Surroundings, "deepest", counted)
    return measured


@pytest.fixture
def bench(robot: Baxter, table: Body, block: Body) -> Bench:
    return Bench(robot, table, block)


class TestArms:
    """Arms of the world are where the motion has them."""

    def test_an_arm_goes_where_it_is_told_and_takes_the_world_along(
        self, bench: Bench, ik: IKService
    ) -> None:
        bench.move(goal := solved(ik, ABOVE))
        assert bench.baxter.world.arm_q("left").tolist() == pytest.approx(goal.tolist(), abs=1e-9)
        assert bench.baxter.world.T_base_tip("left").isApprox(ABOVE, 1e-6)

    def test_a_disabled_robot_checks_commands_and_does_nothing(self, robot: Baxter) -> None:
        baxter = SimulatedBaxter(World(robot))
        names = robot.arm("left").joint_names
        before = baxter.arms["left"].q.tolist()
        assert baxter.order_joints("left", 1, names, [0.5] * 7) == ()
        with pytest.raises(BadOrderError):
            baxter.order_joints("left", 1, names, [math.nan] * 7)
        baxter.tick()
        assert baxter.arms["left"].q.tolist() == before

    @pytest.mark.parametrize("how", ["disable", "stop", "reset", "press"])
    def test_whatever_disables_it_holds_the_arms_where_they_are(
        self, bench: Bench, ik: IKService, how: str
    ) -> None:
        bench.move(solved(ik, ABOVE), ticks=50)
        if how == "press":
            bench.baxter.press("left", "estop")
        else:
            getattr(bench.baxter, how)()
        where = bench.baxter.arms["left"].q.tolist()
        for _ in range(50):
            bench.baxter.tick()
        assert bench.baxter.arms["left"].q.tolist() == where
        assert not bench.baxter.assembly.state.is_enabled

    @pytest.mark.slow
    @settings(max_examples=15)
    @given(st.integers(1, 40))
    def test_a_late_tick_makes_up_for_a_few_and_no_more(self, robot: Baxter, late: int) -> None:
        witness = Witness()
        baxter = SimulatedBaxter(World(robot), [witness])
        baxter.enable()
        baxter.order_joints("left", 1, ["left_s0"], [1.0])
        baxter.tick(late)
        assert len(witness.snapshots) == 1
        assert baxter.time_s == pytest.approx(0.01 * min(late, MAX_TICKS))
        assert baxter.arms["left"].q[0] == pytest.approx(0.6 * baxter.time_s)

    def test_a_tucked_arm_is_where_it_says_and_its_world_at_the_limits(self, robot: Baxter) -> None:
        baxter = SimulatedBaxter(World(robot), q_start=start_rad(is_tucked=True))
        for _ in range(10):
            baxter.tick()
        assert baxter.arms["left"].q[1] == -2.175
        assert baxter.world.arm_q("left")[1] == -2.147
        assert baxter.is_tucked
        with pytest.raises(BadOrderError, match="tucked"):
            baxter.enable()
        baxter.assembly.suppress_collision_avoidance(baxter.time_s)
        baxter.enable()
        untucked = [-0.08, -1.0, -1.19, 1.94, 0.67, 1.03, -0.50]
        for side, sign in (("left", 1.0), ("right", -1.0)):
            names = robot.arm(side).joint_names
            mirrored = [
                sign * v if n[-2:] in ("s0", "e0", "w0", "w2") else v
                for n, v in zip(names, untucked, strict=True)
            ]
            baxter.order_joints(side, 1, names, mirrored)
        for _ in range(1000):
            baxter.tick()
        assert not baxter.is_tucked
        assert baxter.arms["left"].q == pytest.approx(untucked, abs=1e-9)


class TestContacts:
    """What does not give way."""

    def test_the_hand_does_not_go_into_the_table(
        self, robot: Baxter, table: Body, ik: IKService
    ) -> None:
        bench = Bench(robot, table)
        bench.move(solved(ik, PICK))
        assert not bench.stops
        bench.move(solved(ik, BELOW), ticks=400)
        world = bench.baxter.world
        assert bench.baxter.is_stopped_by_contact("left")
        assert len(bench.stops) == 1
        assert "would pass through the table; the arm stops before it" in bench.stops[0]
        lowest = min(
            part.T_body_part.translation[2]
            for part in world.hands["left"].pads_at(world.T_base_tip("left"), 0.02)
        )
        assert lowest > -0.155 - PRESSING_TOLERANCE_M
        bench.move(goal := solved(ik, ABOVE))
        assert bench.baxter.arms["left"].q == pytest.approx(goal, abs=1e-9)
        assert not bench.baxter.is_stopped_by_contact("left")

    def test_from_gazebos_start_the_original_demos_move_gets_past_the_table(
        self, robot: Baxter
    ) -> None:
        witness = Witness()
        baxter = SimulatedBaxter(World(robot), [witness], q_start=start_rad(is_tucked=False))
        for body in furniture(has_table=True, has_block=True):
            baxter.spawn(body)
        baxter.enable()
        names, goal = robot.arm("left").joint_names, robot.arm("left").start
        command = np.array(GAZEBO_START_RAD["left"])
        for _ in range(600):  # the low-pass filter of its joint moves
            command = 0.012488 * goal + 0.98751 * command
            baxter.order_joints("left", 1, names, command.tolist())
            baxter.tick()
        assert np.abs(baxter.arms["left"].q - goal).max() < 0.0087
        assert [e.kind for e in witness.events].count(EventKind.HIT) == 1

    def test_an_arm_that_is_inside_of_something_may_go_anywhere(
        self, bench: Bench, ik: IKService, table: Body
    ) -> None:
        bench.baxter.delete("table")
        bench.move(solved(ik, BELOW))
        bench.baxter.spawn(table)
        bench.move(goal := solved(ik, ABOVE))
        assert bench.baxter.arms["left"].q == pytest.approx(goal, abs=1e-9)
        assert sum("left where it is" in text for text in bench.stops) == 1

    @pytest.mark.parametrize("is_inside", [False, True])
    def test_how_deep_a_contact_is_is_measured_once_however_long_it_lasts(
        self,
        robot: Baxter,
        table: Body,
        ik: IKService,
        monkeypatch: pytest.MonkeyPatch,
        is_inside: bool,
    ) -> None:
        """Measuring takes longer than a tick."""
        bench = Bench(robot, table)
        bench.move(solved(ik, PICK))
        if is_inside:
            bench.baxter.delete("table")
            bench.move(solved(ik, BELOW))
            bench.baxter.spawn(table)
        measured = counted_measurements(monkeypatch)
        for tick in range(200):
            goal = solved(ik, BELOW) + 1e-4 * tick
            bench.move(goal, ticks=1)
        assert len(measured) == 1
        assert len(bench.stops) == 1

    def test_a_block_in_the_way_is_told_of_once_and_left(
        self, robot: Baxter, table: Body, ik: IKService, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        bench = Bench(robot, table)
        bench.move(solved(ik, ABOVE))
        block = next(iter(furniture(has_table=False, has_block=True)))
        bench.baxter.spawn(block.at(at(0.675, 0.16, -0.155)))
        before = bench.baxter.world.body("block").T_base_body
        measured = counted_measurements(monkeypatch)
        bench.move(goal := solved(ik, PICK))
        assert bench.baxter.arms["left"].q == pytest.approx(goal, abs=1e-9)
        assert len(measured) == 1
        assert [text for text in bench.stops if "hit block" in text] == bench.stops
        assert len(bench.stops) == 1
        assert bench.baxter.world.body("block").T_base_body == before


class TestCarrying:
    """The demo's pick, by commands alone."""

    @pytest.mark.slow
    @pytest.mark.parametrize("lags", [False, True])
    def test_a_block_is_picked_up_and_carried(
        self, robot: Baxter, table: Body, block: Body, ik: IKService, lags: bool
    ) -> None:
        from sim.ros1.robot.arm_motion import Follow, Following  # noqa: PLC0415

        bench = Bench(robot, table, block)
        following = Following(Follow.LAG if lags else Follow.EXACT)
        bench.baxter.arms["left"]._following = following
        bench.move(solved(ik, ABOVE))
        bench.move(solved(ik, PICK), ticks=500)
        bench.baxter.order_gripper("left", GripperOrder("go", '{"position": 0}', "me", 1))
        for _ in range(100):
            bench.baxter.tick()
        assert bench.baxter.grippers["left"].fingers.is_gripping
        bench.move(solved(ik, ABOVE))
        lifted = bench.baxter.world.body("block").T_base_body.translation[2]
        assert lifted == pytest.approx(-0.155 + 0.079, abs=0.002)

    def test_a_hand_without_fingers_takes_no_commands(self) -> None:
        robot = Baxter.load(hands={"left": None})
        baxter = SimulatedBaxter(World(robot))
        with pytest.raises(BadOrderError, match="the left hand has no gripper"):
            baxter.order_gripper("left", GripperOrder("go"))


def test_head_and_buttons_pass_time(bench: Bench) -> None:
    bench.baxter.order_head(0.5)
    bench.baxter.nod()
    bench.baxter.press("left", "ok")
    for _ in range(200):
        bench.baxter.tick()
    head = bench.baxter.world.robot.joint_names.index("head_pan")
    assert bench.baxter.world.q[head] == pytest.approx(0.5, abs=1e-3)
    assert not bench.baxter.head.is_nodding
    assert not any(bench.baxter.panel.buttons("left"))


def test_a_disabled_robots_head_stays(robot: Baxter) -> None:
    baxter = SimulatedBaxter(World(robot))
    baxter.order_head(0.5)
    baxter.nod()
    baxter.tick()
    assert baxter.head.pan_rad == 0.0
    assert not baxter.head.is_nodding
