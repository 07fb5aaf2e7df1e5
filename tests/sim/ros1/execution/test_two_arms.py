"""Plans of both arms: one clock, both limbs' set-points, and whatever stops one arm stops both."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray
from planner import (
    Manipulator,
    PlanFailure,
    Response,
    TwoArmPlan,
    plan_handover,
    plan_pair_carry,
)
from planner.motion.response import TICK_S
from sim import EventKind
from sim.errors import SimulationError
from sim.ros1.execution.execution import MeasuredOutcome
from sim.ros1.execution.link import BaxterLink
from sim.ros1.execution.readiness.plans import START_MOVE_LABEL
from sim.ros1.execution.readiness.ready import ExecutionOptions, ReadyTwoArmPlan
from sim.ros1.execution.set_points import Pace
from sim.ros1.execution.stops import StopCause
from tests.planner.two_arms.pair_moves import carries
from tests.planner.two_arms.pairs import handover_of_stick
from tests.sim.ros1.execution.bus import BusNode
from tests.sim.ros1.execution.conftest import FAST, Network, networked_at
from tests.sim.runs import Witness

GRID = 0.02
"""Share by which differences of set-points may exceed an acceleration between them."""

HELD_S = 1.0
"""How long arms are commanded to stay after a stop."""


@pytest.fixture
def both(robot: Baxter, two_arm_plan: TwoArmPlan) -> Iterator[Network]:
    with networked_at(robot, two_arm_plan) as network:
        yield network


def sent_to(network: Network, side: str) -> tuple[FloatArray, FloatArray]:
    """Times of arrival, shape (n,), and set-points, shape (n, 7), of one arm."""
    own = [
        (t, list(asked.values())) for t, asked in network.robot.commands if f"{side}_s0" in asked
    ]
    return np.array([t for t, _ in own]), np.array([q for _, q in own])


def measured(network: Network, robot: Baxter, side: str) -> FloatArray:
    return np.array([network.robot.q[name] for name in robot.arm(side).joint_names])


def assert_rest(network: Network, sides: Iterable[str] = LIMBS) -> None:
    """Arms were sent the same set-point for as long as they are held, and then nothing."""
    ends = set()
    for side in sides:
        times, q = sent_to(network, side)
        is_last = np.abs(q - q[-1]).max(axis=1) == 0.0
        moved_s = times[~is_last].max(initial=times[0])
        assert times[-1] - moved_s >= HELD_S - 2.5 * TICK_S
        ends.add(times[-1])
    assert len(ends) == 1


def assert_gentle(network: Network, both_ready: ReadyTwoArmPlan) -> None:
    """What was sent accelerates no joint beyond its limit."""
    for side in LIMBS:
        times, q = sent_to(network, side)
        passed = np.diff(times)[:, None]
        v = np.diff(q, axis=0) / passed
        a = np.abs(np.diff(v, axis=0)) / ((passed[1:] + passed[:-1]) / 2.0)
        a_max = both_ready.arms[side].manipulator.arm.limits.a_max
        assert (a.max(axis=0) <= (1.0 + GRID) * a_max).all()


def test_both_arms_are_at_one_time_on_the_clock_and_end_where_the_plan_says(
    both: Network, robot: Baxter, both_ready: ReadyTwoArmPlan
) -> None:
    witness = Witness()
    outcome = both.executor(witness).execute(both_ready)
    assert outcome.is_success, outcome.failure
    for side in LIMBS:
        goal = both_ready.plan.plans[side].moves[-1].trajectory.q_goal
        assert np.abs(measured(both, robot, side) - goal).max() < 0.0087
        body = both_ready.plan.plans[side].start.scene
        assert side in [each.name for each in body]
    kinds = witness.kinds
    assert kinds.count(EventKind.GRASPED) == kinds.count(EventKind.RELEASED) == 2
    assert {(each.kind, each.side) for each in witness.events} >= {
        (EventKind.GRASPED, side) for side in LIMBS
    }
    own = both.bus.registered("/baxter_kin")
    assert not [
        t for t in own if "joint_command" in t and "/baxter_kin" in both.node.publishers_of(t)
    ]
    (left_s, left), (right_s, right) = (sent_to(both, side) for side in LIMBS)
    assert np.array_equal(left_s, right_s)
    whole = both_ready.plan.trajectory
    clock_s = np.arange(0.0, both_ready.plan.duration_s, 2e-4)
    planned = whole.sample(clock_s).q
    found = []
    for q in np.hstack([left, right]):
        off = np.abs(planned - q).max(axis=1)
        assert off.min() < 1e-3  # both are at one instant of the plan
        found.append(clock_s[int(off.argmin())])
    assert len(found) * TICK_S >= both_ready.plan.duration_s / FAST.pace.speed


def test_the_clock_waits_for_a_slow_gripper_and_keeps_accelerations_within_limits(
    both: Network, robot: Baxter, both_ready: ReadyTwoArmPlan
) -> None:
    """Fingers that take five times as long as the plan assumes; no step begins before they end."""
    both.robot.faults.finger_percent_s = 40.0
    both.robot.faults.block_percent = 30.0
    witness = Witness()
    outcome = both.executor(witness).execute(both_ready)
    assert outcome.is_success, outcome.failure
    assert outcome.duration_s > both_ready.plan.duration_s / FAST.pace.speed + 2.0
    assert_gentle(both, both_ready)
    for side in LIMBS:
        goal = both_ready.plan.plans[side].moves[-1].trajectory.q_goal
        assert np.abs(measured(both, robot, side) - goal).max() < 0.0087
    order = [(each.side, each.kind) for each in witness.events]
    grasps = [order.index((side, EventKind.GRASPED)) for side in LIMBS]
    for side, at in zip(LIMBS, grasps, strict=True):
        moves = [kind for own, kind in order[:at] if own == side and kind is EventKind.MOVE_STARTED]
        assert len(moves) == 2  # approach and descend


@dataclass(frozen=True)
class Trouble:
    """Something that goes wrong with one arm.

    Attributes:
        cause: what it ends as.
        make: does it.
        options: with which the plan is carried out.
        held: the arms that can be held then.
    """

    cause: StopCause
    make: Callable[[Network], object]
    options: ExecutionOptions = FAST
    held: tuple[str, ...] = LIMBS


def push(joint: str) -> Callable[[Network], None]:
    def make(network: Network) -> None:
        network.robot.faults.push[joint] = 3.0

    return make


def lose_limb(network: Network) -> None:
    """The robot receives the right arm's set-points no more."""
    topic = "/robot/limb/right/joint_command"
    ends = network.bus.subscribers[topic]
    ends[:] = [end for end in ends if end.node.name != "/baxter"]


def announce_other(network: Network) -> None:
    """The master announces another node that commands the right arm; it is connected later."""
    topic, kind = "/robot/limb/right/joint_command", "baxter_core_msgs/JointCommand"
    publisher = BusNode("/other", network.bus).advertise(topic, kind)
    publisher.is_connected = False
    begin_s = network.bus.clock.now_s
    network.when(
        lambda: network.bus.clock.now_s > begin_s + 0.1,
        lambda: setattr(publisher, "is_connected", True),
    )


ENDS = [
    Trouble(StopCause.OTHER_COMMANDER, announce_other),
    Trouble(StopCause.JOINT_OFF, push("left_w2")),
    Trouble(StopCause.JOINT_OFF, push("right_w2")),
    Trouble(StopCause.CONNECTION_LOST, lose_limb, held=("left",)),
    Trouble(StopCause.TIME_OUT, lambda _: None, evolve(FAST, timeout_s=2.0)),
]


def troubled(network: Network, both_ready: ReadyTwoArmPlan, trouble: Trouble) -> MeasuredOutcome:
    """Execute the plan; the trouble begins while both arms are on their first moves."""
    begin_s = network.bus.clock.now_s

    def is_moving() -> bool:
        return network.bus.clock.now_s > begin_s + 1.8

    network.when(is_moving, lambda: trouble.make(network))
    arms = {side: evolve(arm, options=trouble.options) for side, arm in both_ready.arms.items()}
    return network.executor().execute(evolve(both_ready, arms=arms))


@pytest.mark.parametrize("trouble", ENDS, ids=lambda each: each.cause.name)
def test_what_stops_one_arm_stops_both(
    both: Network, both_ready: ReadyTwoArmPlan, trouble: Trouble
) -> None:
    outcome = troubled(both, both_ready, trouble)
    assert outcome.stop is not None
    assert outcome.stop.cause is trouble.cause, outcome.failure
    assert_rest(both, trouble.held)


def test_another_node_stops_both_before_it_is_connected_and_is_named_afterwards(
    both: Network, both_ready: ReadyTwoArmPlan
) -> None:
    announced_s: list[float] = []

    def announce(network: Network) -> None:
        announced_s.append(network.bus.clock.now_s)
        announce_other(network)

    outcome = troubled(both, both_ready, Trouble(StopCause.OTHER_COMMANDER, announce))
    assert outcome.stop is not None
    assert outcome.stop.subject == "/other"
    for side in LIMBS:
        times, q = sent_to(both, side)
        moved_s = times[np.abs(q - q[-1]).max(axis=1) > 0.0].max()
        assert moved_s <= announced_s[0] + TICK_S


@pytest.mark.parametrize("side", LIMBS)
def test_a_gripper_that_misses_stops_both_along_their_paths(
    both: Network, both_ready: ReadyTwoArmPlan, side: str
) -> None:
    both.robot.faults.missing = side
    witness = Witness()
    outcome = both.executor(witness).execute(both_ready)
    assert outcome.stop is not None
    assert outcome.stop.cause is StopCause.GRIPPER_MISSED, outcome.failure
    assert outcome.stop.subject == side
    assert EventKind.MISSED in witness.kinds
    assert_rest(both)
    assert_on_paths(both, both_ready)


def test_a_gripper_that_does_nothing_stops_both(both: Network, both_ready: ReadyTwoArmPlan) -> None:
    both.robot.faults.deaf_gripper = True
    both.robot.hands["right"].percent = 50.0
    outcome = both.executor().execute(both_ready)
    assert outcome.stop is not None
    assert outcome.stop.cause is StopCause.GRIPPER_SILENT
    assert outcome.stop.subject == "right"
    assert_rest(both)


def test_arms_that_are_told_to_stop_slow_down_along_their_paths(
    both: Network, both_ready: ReadyTwoArmPlan
) -> None:
    executor = both.executor()
    begin_s = both.bus.clock.now_s
    told_s: list[float] = []

    def tell() -> None:
        told_s.append(both.bus.clock.now_s)
        executor.stop(StopCause.SIGTERM)

    both.when(lambda: both.bus.clock.now_s > begin_s + 1.8, tell)
    outcome = executor.execute(both_ready)
    assert outcome.stop is not None
    assert outcome.stop.cause is StopCause.SIGTERM
    assert_rest(both)
    assert_on_paths(both, both_ready)
    assert_gentle(both, both_ready)
    for side in LIMBS:
        times, q = sent_to(both, side)
        speeds = np.abs(np.diff(q, axis=0)).max(axis=1) / TICK_S
        assert speeds[times[1:] < told_s[0]][-1] > 0.05  # it moved


def assert_on_paths(network: Network, both_ready: ReadyTwoArmPlan) -> None:
    """All that was sent to both arms is at one instant of the plan, as long as they were moved."""
    (_, left), (_, right) = (sent_to(network, side) for side in LIMBS)
    planned = both_ready.plan.trajectory.sample(np.arange(0.0, both_ready.plan.duration_s, 2e-4)).q
    for q in np.hstack([left, right])[::5]:
        assert np.abs(planned - q).max(axis=1).min() < 1e-3


def test_arms_that_lag_alike_are_not_stopped(
    robot: Baxter,
    two_arm_plan: TwoArmPlan,
    both_ready: ReadyTwoArmPlan,
) -> None:
    slow = evolve(FAST, pace=Pace(0.4))
    arms = {side: evolve(arm, options=slow) for side, arm in both_ready.arms.items()}
    with networked_at(robot, two_arm_plan, lag_s=0.075) as network:
        outcome = network.executor().execute(evolve(both_ready, arms=arms, apart_m=0.02))
    assert outcome.is_success, outcome.failure
    assert outcome.joint_deviation_rad > 0.02  # 15 mm of each tip from where it should be now


def test_arms_that_may_be_too_near_to_each_other_are_stopped(
    robot: Baxter,
    two_arm_plan: TwoArmPlan,
    both_ready: ReadyTwoArmPlan,
) -> None:
    """As if they were proven to be 5 mm apart; each arm is near enough to its own path."""
    near = evolve(both_ready, apart_m=0.005)
    with networked_at(robot, two_arm_plan) as network:
        network.robot.sag = {"left_w1": 0.008, "right_w1": 0.008}
        outcome = network.executor().execute(near)
    assert outcome.stop is not None
    assert outcome.stop.cause is StopCause.ARMS_APART, outcome.failure
    assert outcome.stop.bound == pytest.approx(0.002)


@pytest.mark.parametrize("max_late_s", [np.inf, 0.3, 0.02])
def test_a_stream_that_stood_still_longer_than_is_proven_stops_both(
    both: Network, both_ready: ReadyTwoArmPlan, max_late_s: float
) -> None:
    """The executor is not scheduled for 0.2 s while both arms move."""
    begin_s = both.bus.clock.now_s
    both.when(lambda: both.bus.clock.now_s > begin_s + 1.8, lambda: both.bus.clock.sleep(0.2))
    outcome = both.executor().execute(evolve(both_ready, max_late_s=max_late_s))
    if max_late_s > 0.2:
        assert outcome.is_success, outcome.failure
        return
    assert outcome.stop is not None
    assert outcome.stop.cause is StopCause.TOO_LATE, outcome.failure
    assert 0.18 < outcome.stop.value < 0.22
    assert_rest(both)
    assert_on_paths(both, both_ready)


@dataclass(frozen=True)
class Refusal:
    """What is refused before anything is sent, by which finding, in which words."""

    name: str
    text: str
    options: ExecutionOptions = FAST
    right_w0_off: float = 0.0


REFUSALS = [
    Refusal("speed", "lower speed", evolve(FAST, pace=Pace(1.0))),
    Refusal("tracking", "left arm alone", evolve(FAST, response={"left": Response((0.1, 0.2))})),
    Refusal("start", "right_w0 stands", right_w0_off=6.0),
]


@pytest.mark.parametrize("refusal", REFUSALS, ids=lambda each: each.name)
def test_what_cannot_be_executed_is_refused_and_nothing_is_sent(
    both: Network, two_arm_plan: TwoArmPlan, refusal: Refusal
) -> None:
    both.robot.q["right_w0"] += refusal.right_w0_off
    both.robot.goal["right_w0"] += refusal.right_w0_off
    both.bus.clock.sleep(0.1)
    found = both.executor(options=refusal.options).prepare(two_arm_plan)
    assert found.ready is None
    assert [finding.name for finding in found.failures] == [refusal.name]
    assert refusal.text in found.failures[0].text
    assert both.robot.commands == []


def test_a_known_lag_is_proven_and_bounds_how_far_joints_may_be_off(
    both: Network, two_arm_plan: TwoArmPlan, both_ready: ReadyTwoArmPlan
) -> None:
    known = {"left": Response((0.02, 0.04), 0.002), "right": Response((0.02, 0.06), 0.002)}
    found = both.executor(options=evolve(FAST, response=known)).prepare(two_arm_plan)
    assert found.ready is not None, found.failures
    (tracking,) = (each for each in found.findings if each.name == "tracking")
    assert "of each other" in tracking.text
    for side in LIMBS:
        for each, unknown in zip(
            found.ready.arms[side].clearances, both_ready.arms[side].clearances, strict=True
        ):
            assert each.max_off_rad < unknown.max_off_rad
    assert found.ready.apart_m == both_ready.apart_m
    assert found.ready.max_late_s == known["left"].late_s
    assert both_ready.max_late_s == np.inf


@pytest.mark.slow
def test_a_lag_that_is_not_proven_is_carried_out_by_a_simulated_baxter_alone(
    both: Network, two_arm_plan: TwoArmPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    lagging = evolve(FAST, response=Response((0.0, 1.5)))
    for options in (lagging, evolve(lagging, despite_lag=True)):
        refused = both.executor(options=options).prepare(two_arm_plan)
        assert [each.name for each in refused.failures] == ["tracking"]
    monkeypatch.setattr(BaxterLink, "is_simulated", True)
    assert both.executor(options=lagging).prepare(two_arm_plan).ready is None
    found = both.executor(options=evolve(lagging, despite_lag=True)).prepare(two_arm_plan)
    assert found.ready is not None, found.failures
    assert any("carried out despite this" in each.text for each in found.findings)


def assert_starts_in_order(ready: ReadyTwoArmPlan, order: tuple[str, ...]) -> None:
    """Arms move to the start one after the other, before anything else begins."""
    steps = ready.plan.steps
    first = steps[: len(order)]
    assert [timed.side for timed in first] == list(order)
    assert {timed.step.label for timed in first} == {START_MOVE_LABEL}
    for before, after in pairwise(steps[: len(order) + 1]):
        assert after.begin_s >= before.end_s - 1e-9


def test_arms_that_stand_elsewhere_go_to_the_start_one_after_the_other(
    both: Network, robot: Baxter, two_arm_plan: TwoArmPlan
) -> None:
    for name, off in (("left_w1", 0.3), ("right_s0", -0.2)):
        both.robot.q[name] += off
        both.robot.goal[name] += off
    both.bus.clock.sleep(0.1)
    found = both.executor().prepare(two_arm_plan)
    ready = found.ready
    assert ready is not None, found.failures
    assert_starts_in_order(ready, LIMBS)
    for side in LIMBS:
        at = robot.arm(side).joint_names
        assert [both.robot.q[name] for name in at] == pytest.approx(ready.plan.plans[side].q_start)
    witness = Witness()
    outcome = both.executor(witness).execute(ready)
    assert outcome.is_success, outcome.failure
    assert witness.kinds.count(EventKind.RELEASED) == 2
    for side in LIMBS:
        goal = two_arm_plan.plans[side].moves[-1].trajectory.q_goal
        assert np.abs(measured(both, robot, side) - goal).max() < 0.0087


def test_an_arm_in_the_way_of_the_other_goes_to_its_start_first(
    both: Network, robot: Baxter, two_arm_plan: TwoArmPlan
) -> None:
    """The right hand is where the left one starts, so the left arm cannot go there first."""
    left, right = robot.arm("left"), robot.arm("right")
    there = left.T_base_tip(two_arm_plan.plans["left"].q_start)
    in_the_way = Manipulator.of(robot, "right").ik.solve(there, seed=right.start)
    assert in_the_way.q is not None
    standing = left.joints(left.neutral) | right.joints(in_the_way.q)
    both.robot.q |= standing
    both.robot.goal |= standing
    both.bus.clock.sleep(0.1)
    found = both.executor().prepare(two_arm_plan)
    assert found.ready is not None, found.failures
    assert_starts_in_order(found.ready, ("right", "left"))


def test_an_invalid_plan_is_refused(both: Network, two_arm_plan: TwoArmPlan) -> None:
    broken = evolve(two_arm_plan, failure=PlanFailure("together", "no solution"))
    with pytest.raises(SimulationError, match="cannot be executed: together: no solution"):
        both.executor().execute(broken)
    assert both.robot.commands == []


@pytest.mark.slow
def test_a_simulated_baxter_hands_a_body_over(
    robot: Baxter, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = handover_of_stick({side: Manipulator.of(robot, side) for side in LIMBS})
    plan, witness = plan_handover(*case), Witness()
    with networked_at(robot, plan) as network:
        executor = network.executor(witness)
        refused = executor.prepare(plan)
        assert [each.name for each in refused.failures] == ["tracking"]
        monkeypatch.setattr(BaxterLink, "is_simulated", True)
        found = executor.prepare(plan)
        assert found.ready is not None, found.failures
        outcome = executor.execute(found.ready)
    assert outcome.is_success, outcome.failure
    kinds = EventKind.GRASPED, EventKind.RELEASED
    order = [(each.kind, each.side) for each in witness.events if each.kind in kinds]
    assert order == [
        (EventKind.GRASPED, "left"),
        (EventKind.GRASPED, "right"),
        (EventKind.RELEASED, "left"),
        (EventKind.RELEASED, "right"),
    ]


def test_a_body_in_both_hands_is_refused_unless_it_is_known_how_arms_lag(robot: Baxter) -> None:
    manipulators = {side: Manipulator.of(robot, side) for side in LIMBS}
    task, state = carries.bar(manipulators)
    plan = plan_pair_carry(task, manipulators, state)
    assert plan.is_valid, plan.failure
    with networked_at(robot, plan) as network:
        found = network.executor().prepare(plan)
        assert found.ready is None
        assert [each.name for each in found.failures] == ["tracking"]
        assert "both hands hold one body" in str(found.failures[0])
        exact = evolve(FAST, pace=Pace(0.1), response=Response((0.01, 0.02), 0.0005))
        assert network.executor(options=exact).prepare(plan).ready is not None
