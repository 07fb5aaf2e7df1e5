"""Both halves together, through our own master: the executor drives the simulated Baxter."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import LIMBS
from planner import Body, Plan, Response, TwoArmPlan, save_two_arm_plan
from planner.motion.response import save_response
from planner.pick_place.tracking import TrackingProof, prove_tracking
from sim import Event, EventKind, Observer, Simulation, World
from sim.ros1 import execute as executing
from sim.ros1.execution import set_points, stops
from sim.ros1.execution.execution import RosExecutor
from sim.ros1.execution.link import BaxterLink, command_topic
from sim.ros1.execution.readiness import plans, robot
from sim.ros1.execution.readiness.ready import ExecutionOptions, NotReadyError, ReadyTwoArmPlan
from sim.ros1.execution.set_points import Pace
from sim.ros1.execution.stops import StopCause
from sim.ros1.node import Node
from sim.ros1.robot.arm_motion import Follow, Following
from sim.ros1.robot.ros_robot import RosRobot
from sim.simulation import Dwell
from sim.world.contacts import Contact
from tests.sim.ros1.execution.conftest import (  # noqa: F401 - fixtures
    both_ready,
    demo_plan,
    two_arm_plan,
)
from tests.sim.runs import Witness

SAME_PLACE_M = 1e-3
LAG = Following(Follow.LAG, 0.4)
KNOWN_LAG = Response((0.35, 0.45), 0.001)


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both halves share a busy computer, on which a robot may be slower or silent for longer."""
    monkeypatch.setattr(stops, "MAX_AGE_S", 2.0)
    monkeypatch.setattr(robot, "MIN_RATE_HZ", 20.0)


@dataclass
class Halves:
    """A simulated Baxter, and a link to it.

    Attributes:
        world: the robot's own.
        witness: of what happens there.
    """

    world: World
    witness: Witness
    link: BaxterLink
    master_uri: str


@contextmanager
def halves(
    robot: Baxter, plan: Plan, master_uri: str, following: Following | None = None
) -> Iterator[Halves]:
    start = {"left": plan.q_start, "right": robot.arm("right").neutral}
    with halves_at(robot, plan.start.scene, start, master_uri, following=following) as both:
        yield both


@contextmanager
def halves_at(
    robot: Baxter,
    bodies: Iterable[Body],
    start: Mapping[str, np.ndarray],
    master_uri: str,
    *,
    following: Following | None = None,
    name: str = "/baxter_kin",
) -> Iterator[Halves]:
    """A simulated Baxter among bodies, whose arms start somewhere, and a link by a node."""
    world, witness = World(robot), Witness()
    for body in bodies:
        world.spawn(body)
    with (
        RosRobot(
            world, observers=[witness], following=following, q_start=start, master_uri=master_uri
        ),
        Node(name, master_uri=master_uri, host="127.0.0.1") as node,
        BaxterLink(node) as link,
    ):
        yield Halves(world, witness, link, master_uri)


def is_meant(event: Event) -> bool:
    """Whether a contact is one of those that a plan comes nearest to on purpose."""
    contact = event.detail
    assert isinstance(contact, Contact)
    is_held = contact.is_held and (contact.mover, contact.other) == ("block", "table")
    is_hand = contact.other == "block" and "gripper" in contact.mover
    return (is_held or is_hand) and contact.depth_m < 1.5e-3


def options(
    speed: float, response: Response | None = None, *, despite_lag: bool = False
) -> ExecutionOptions:
    pace = Pace(speed)
    return ExecutionOptions(pace, Dwell(0.2, 0.2), response=response, despite_lag=despite_lag)


@pytest.fixture(scope="module")
def block_m(robot: Baxter, demo_plan: Plan) -> np.ndarray:  # noqa: F811
    """Where `Simulation.execute` puts the block."""
    world = World(robot)
    simulation = Simulation(world)
    for body in demo_plan.start.scene:
        simulation.spawn(body)
    world.move_arm("left", demo_plan.q_start)
    assert simulation.execute(demo_plan).is_success
    return np.array(world.body("block").T_base_body.translation)


def test_the_block_ends_where_the_simulation_puts_it(
    robot: Baxter,
    demo_plan: Plan,  # noqa: F811
    block_m: np.ndarray,
    own_master: str,
) -> None:
    with halves(robot, demo_plan, own_master) as both:
        outcome = RosExecutor(both.link, options=options(1.0)).execute(demo_plan)
        assert outcome.is_success, outcome.failure
        moved = both.world.body("block").T_base_body.translation - block_m
    assert np.abs(moved).max() < SAME_PLACE_M
    assert EventKind.HIT not in both.witness.kinds


@pytest.mark.slow
def test_a_real_lag_at_the_usual_speed_troubles_nobody(
    robot: Baxter,
    demo_plan: Plan,  # noqa: F811
    own_master: str,
) -> None:
    lag = Following(Follow.LAG, 0.36)  # what a busy computer adds stays within what is known
    with halves(robot, demo_plan, own_master, lag) as both:
        outcome = RosExecutor(both.link, options=options(0.3, KNOWN_LAG)).execute(demo_plan)
    assert outcome.is_success, outcome.failure
    assert 0.04 < outcome.joint_deviation_rad < 0.2
    assert all(is_meant(event) for event in both.witness.events if event.kind is EventKind.HIT)


@pytest.mark.slow
def test_a_lag_that_is_known_is_refused_or_stopped_by_the_guard_before_anything_is_hit(
    robot: Baxter,
    demo_plan: Plan,  # noqa: F811
    own_master: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    proofs: list[TrackingProof] = []  # proving takes as long as all the rest

    def proven_once(*args: Any, **options: Any) -> TrackingProof:
        if not proofs:
            proofs.append(prove_tracking(*args, **options))
        return proofs[0]

    monkeypatch.setattr(plans, "prove_tracking", proven_once)
    with halves(robot, demo_plan, own_master, LAG) as both:
        careful = RosExecutor(both.link, options=options(1.0, KNOWN_LAG))
        with pytest.raises(
            NotReadyError, match=r"tracking: .*at speed 0\.\d+ instead of 1\.00 it is proven"
        ):
            careful.execute(demo_plan)
        assert both.link.joints.positions()["left_s0"] == pytest.approx(demo_plan.q_start[0])
        assert EventKind.MOVE_STARTED not in both.witness.kinds
        how = options(1.0, KNOWN_LAG, despite_lag=True)
        outcome = RosExecutor(both.link, options=how).execute(demo_plan)
    assert outcome.stop is not None
    assert outcome.stop.cause in (StopCause.OFF_PATH, StopCause.JOINT_OFF)
    assert EventKind.HIT not in both.witness.kinds


@pytest.mark.slow
def test_a_lead_that_fits_the_lag_keeps_the_arm_on_its_path(
    robot: Baxter,
    demo_plan: Plan,  # noqa: F811
    own_master: str,
) -> None:
    how = ExecutionOptions(Pace(0.8, LAG.lag_s), Dwell(0.2, 0.2))
    with halves(robot, demo_plan, own_master, LAG) as both:
        outcome = RosExecutor(both.link, options=how).execute(demo_plan)
    assert outcome.is_success, outcome.failure
    fastest = max(np.abs(move.trajectory.turning_velocities).max() for move in demo_plan.moves)
    unled = 0.8 * fastest * LAG.lag_s
    assert outcome.joint_deviation_rad < unled / 3  # the rest is how late ticks are


MAX_SKEW_S = 5e-3
"""How far apart the clocks of both arms may be, as the robot shows them."""

MOVING_RAD_S = 0.1
"""An arm that is slower in the plan does not show its time on the clock."""

PLACES = {"left": (0.75, 0.4), "right": (0.65, -0.4)}
"""Where the plan of both arms puts the blocks, m."""

PLACED_M = 3e-3

ELSEWHERE = np.array([0.0, -0.05, 0.0, 0.1, 0.0, -0.05, 0.0])
"""How far arms stand from the start of a plan, rad."""


def clocks_of(
    plan: TwoArmPlan, robot: Baxter, witness: Witness
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """For each arm: the time on the clock at which the plan has it where each snapshot has it.

    With whether the arm moves there; both have the shape (snapshots,).
    """
    times = np.arange(0.0, plan.duration_s, 5e-4)
    state = plan.trajectory.sample(times)
    shown = np.array([snapshot.q for snapshot in witness.snapshots[::3]])
    for number, side in enumerate(LIMBS):
        own = slice(7 * number, 7 * number + 7)
        q = shown[:, list(robot.indices(robot.arm(side).joint_names))]
        nearest = [int(np.abs(state.q[:, own] - each).max(axis=1).argmin()) for each in q]
        yield times[nearest], np.abs(state.v[nearest, own]).max(axis=1) > MOVING_RAD_S


def assert_at_rest(both: Halves) -> None:
    """Both arms stand still, and nothing was hit."""
    before = both.link.joints.positions()
    both.link.wait_until(lambda: False, 0.3)
    after = both.link.joints.positions()
    arms = [name for side in LIMBS for name in both.world.robot.arm(side).joint_names]
    assert max(abs(after[name] - before[name]) for name in arms) < 1e-4
    assert EventKind.HIT not in both.witness.kinds


def unhurried(ready: ReadyTwoArmPlan) -> ReadyTwoArmPlan:
    """At a third of the speed that it was prepared for: what a busy computer adds stays small."""
    slow = evolve(ready.options, pace=Pace(0.2))
    arms = {side: evolve(arm, options=slow) for side, arm in ready.arms.items()}
    return evolve(ready, arms=arms)


@contextmanager
def both_arms(
    robot: Baxter, plan: TwoArmPlan, master_uri: str, *, without: str = ""
) -> Iterator[Halves]:
    """A simulated Baxter at the start of a plan of both arms, a body left out."""
    start = {side: plan.plans[side].q_start for side in LIMBS}
    bodies = [body for body in plan.start.scene if body.name != without]
    with halves_at(robot, bodies, start, master_uri) as both:
        both.link.wait_until(lambda: both.link.gripper("right") is not None, 3.0)
        both.link.wait_until(lambda: not both.link.joints.missing(robot.joint_names[:1]), 3.0)
        yield both


@pytest.mark.slow
def test_both_arms_carry_their_blocks_on_one_clock(
    robot: Baxter,
    two_arm_plan: TwoArmPlan,  # noqa: F811
    both_ready: ReadyTwoArmPlan,  # noqa: F811
    own_master: str,
) -> None:
    with both_arms(robot, two_arm_plan, own_master) as both:
        outcome = RosExecutor(both.link).execute(unhurried(both_ready))
        assert outcome.is_success, outcome.failure
        assert_at_rest(both)
        for side in LIMBS:
            goal = two_arm_plan.plans[side].moves[-1].trajectory.q_goal
            assert np.abs(both.world.arm_q(side) - goal).max() < 0.01
            placed = both.world.body(side).T_base_body.translation[:2]
            assert np.abs(placed - PLACES[side]).max() < PLACED_M
        (left_s, left_moves), (right_s, right_moves) = clocks_of(two_arm_plan, robot, both.witness)
    skew_s = np.abs(left_s - right_s)[left_moves & right_moves]
    assert len(skew_s) > 20
    assert np.median(skew_s) < MAX_SKEW_S


@pytest.fixture
def plan_file(two_arm_plan: TwoArmPlan, tmp_path: Path) -> Path:  # noqa: F811
    """The plan of both arms as a file."""
    save_two_arm_plan(two_arm_plan, tmp_path / "both.json")
    return tmp_path / "both.json"


def test_the_command_wants_the_responses_of_all_arms_that_move(
    plan_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    left = tmp_path / "left.json"
    save_response(Response((0.0, 0.1)), "left", left)
    for files in ([left], [left, left]):
        given = [word for file in files for word in ("--response", str(file))]
        assert executing.main([str(plan_file), *given]) == 2
    said = capsys.readouterr().err
    assert "one file of each arm that moves" in said
    assert "as another file is" in said


@pytest.mark.slow
def test_the_command_carries_out_a_plan_file_of_both_arms_from_elsewhere(
    robot: Baxter,
    two_arm_plan: TwoArmPlan,  # noqa: F811
    plan_file: Path,
    own_master: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each arm goes to its start while the other one stands; slow, for a busy computer."""
    monkeypatch.setattr(set_points, "RESERVE", 3.0)  # as a busy computer slows the robot down
    monkeypatch.setenv("ROS_MASTER_URI", own_master)
    monkeypatch.setenv("ROS_IP", "127.0.0.1")
    start = {side: two_arm_plan.plans[side].q_start + ELSEWHERE for side in LIMBS}
    bodies = two_arm_plan.start.scene
    with halves_at(robot, bodies, start, own_master, name="/looker") as both:
        options = "--yes", "--speed", "0.2", "--dwell-s", "0.2"
        assert executing.main([str(plan_file), *options]) == 0
        assert_at_rest(both)
        for side in LIMBS:
            placed = both.world.body(side).T_base_body.translation[:2]
            assert np.abs(placed - PLACES[side]).max() < PLACED_M


@pytest.mark.slow
@pytest.mark.parametrize("side", LIMBS)
def test_a_hand_that_closes_on_nothing_stops_both_arms(
    robot: Baxter,
    two_arm_plan: TwoArmPlan,  # noqa: F811
    both_ready: ReadyTwoArmPlan,  # noqa: F811
    own_master: str,
    side: str,
) -> None:
    with both_arms(robot, two_arm_plan, own_master, without=side) as both:
        outcome = RosExecutor(both.link).execute(unhurried(both_ready))
        assert outcome.stop is not None
        assert outcome.stop.cause is StopCause.GRIPPER_MISSED, outcome.failure
        assert outcome.stop.subject == side
        assert_at_rest(both)


class Intruder(Observer):
    """Advertises the set-points of an arm as soon as it carries its block."""

    def __init__(self, node: Node, side: str) -> None:
        self._node, self._side = node, side

    def on_event(self, event: Event) -> None:
        if (event.kind, event.side) == (EventKind.GRASPED, self._side):
            self._node.advertise(command_topic(self._side), "baxter_core_msgs/JointCommand")


@pytest.mark.slow
@pytest.mark.parametrize("side", LIMBS)
def test_another_node_that_commands_one_arm_stops_both(
    robot: Baxter,
    two_arm_plan: TwoArmPlan,  # noqa: F811
    both_ready: ReadyTwoArmPlan,  # noqa: F811
    own_master: str,
    side: str,
) -> None:
    with (
        both_arms(robot, two_arm_plan, own_master) as both,
        Node("/stranger", master_uri=own_master, host="127.0.0.1") as stranger,
    ):
        outcome = RosExecutor(both.link, [Intruder(stranger, side)]).execute(unhurried(both_ready))
        assert outcome.stop is not None
        assert outcome.stop.cause is StopCause.OTHER_COMMANDER, outcome.failure
        assert_at_rest(both)
