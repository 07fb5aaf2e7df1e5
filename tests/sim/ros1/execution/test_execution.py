"""RosExecutor: plans carried out, and every cause that ends one early, once."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from baxter_kin.validation import FloatArray
from planner import Grip, Plan, PlanFailure
from sim import EventKind, Observer, Recorder, Snapshot
from sim.errors import RecordingError, SimulationError
from sim.events import Sample, SampleObserver
from sim.ros1.definitions import message_type
from sim.ros1.execution.channel import ArmChannel
from sim.ros1.execution.execution import MeasuredOutcome
from sim.ros1.execution.readiness.ready import ExecutionOptions, ReadyPlan
from sim.ros1.execution.set_points import Pace
from sim.ros1.execution.stops import StopCause
from sim.simulation import Dwell
from tests.sim.ros1.execution.bus import BusNode
from tests.sim.ros1.execution.conftest import FAST, Network, networked
from tests.sim.runs import Witness

COMMAND = "/robot/limb/left/joint_command"
IN_FLIGHT = 2
"""Set-points that may be on their way when the robot says that it has stopped; more are not sent in
the 30 ms that are allowed."""


class Samples(SampleObserver):
    def __init__(self) -> None:
        self.samples: list[Sample] = []

    def on_sample(self, sample: Sample) -> None:
        self.samples.append(sample)


def first_steps(ready: ReadyPlan, count: int = 3) -> ReadyPlan:
    """Only the first steps, by default to open, approach and descend, to be quick."""
    return evolve(ready, plan=evolve(ready.plan, steps=ready.plan.steps[:count]))


def test_the_plan_is_carried_out_and_told_as_a_simulation_tells_it(
    network: Network, ready: ReadyPlan, robot: Baxter
) -> None:
    recorder, samples, witness = Recorder(robot), Samples(), Witness()
    outcome = network.executor(recorder, samples, witness).execute(ready, "cycle 1, ")
    sent = recorder.recording().commands["left"]
    assert np.array_equal(sent.q_sent, [sample.q_sent for sample in samples.samples])
    assert np.array_equal(sent.q_measured, [sample.q_measured for sample in samples.samples])
    assert outcome.is_success, outcome.failure
    assert outcome.stop is None
    kinds = witness.kinds
    grip = [EventKind.MOVE_STARTED] * 2
    assert kinds == [
        *(EventKind.ENABLED, EventKind.OPENED, *grip, EventKind.GRASPED, *grip),
        *(EventKind.MOVE_STARTED, EventKind.RELEASED, EventKind.SETTLED, EventKind.MOVE_STARTED),
    ]
    recording = recorder.recording()
    assert recording.moves[0].label == "cycle 1, pick: approach"
    left = robot.indices(robot.arm("left").joint_names)
    goal = ready.plan.moves[-1].trajectory.q_goal
    assert np.abs(recording.q[-1][list(left)] - goal).max() < 0.0087
    assert np.abs(samples.samples[-1].q_sent - goal).max() == 0.0
    block = recording.body_poses["block"][-1]
    assert block[:3] == pytest.approx([0.7226, -0.025, -0.155], abs=0.003)
    asked = [(command.sequence, command.args) for command in network.robot.gripper_commands]
    positions = (100.0, 0.0, 100.0)  # it is told to close fully
    assert asked == [(i, f'{{"position": {x}}}') for i, x in enumerate(positions, start=1)]
    assert network.robot.ratios == [ready.ratio, 0.3]  # put back at the end
    assert set(network.bus.registered("/baxter_kin")) == listened(network)


@pytest.mark.slow
def test_a_prepared_plan_is_executed_as_it_was_checked(
    robot: Baxter, demo_plan: Plan, ready: ReadyPlan
) -> None:
    """Its tracking proof and its speed ratio hold at that pace alone."""
    slow = evolve(FAST, pace=evolve(FAST.pace, speed=0.5 * FAST.pace.speed))
    first = first_steps(ready, 2)
    durations_s = []
    for options, plan in ((FAST, first), (slow, first), (FAST, evolve(first, options=slow))):
        with networked(robot, demo_plan) as network:
            outcome = network.executor(options=options).execute(plan)
        assert outcome.is_success, outcome.failure
        durations_s.append(outcome.duration_s)
    assert durations_s[1] == pytest.approx(durations_s[0], abs=0.05)
    assert durations_s[2] > durations_s[0] + 0.5


def test_fingers_are_not_sent_beyond_their_stroke(network: Network, ready: ReadyPlan) -> None:
    grip = ready.plan.steps[0]
    assert isinstance(grip, Grip)
    wide = evolve(ready.plan, steps=(evolve(grip, opening_m=0.05),))
    outcome = network.executor().execute(evolve(ready, plan=wide))
    assert outcome.is_success, outcome.failure
    assert [each.args for each in network.robot.gripper_commands] == ['{"position": 100.0}']


def listened(network: Network) -> set[str]:
    """What the link alone has registered."""
    own = set(network.bus.registered("/baxter_kin"))
    return {topic for topic in own if network.node.publishers_of(topic) != ("/baxter_kin",)} | {
        topic for topic in own if "set_speed_ratio" in topic or topic == COMMAND
    }


@dataclass(frozen=True)
class Trouble:
    """Something that goes wrong while the arm moves.

    Attributes:
        cause: what it ends as.
        make: does it.
        options: with which the plan is carried out.
    """

    cause: StopCause
    make: Callable[[Network], object]
    options: ExecutionOptions = FAST


def other_node(topic: str, kind: str) -> Callable[[Network], object]:
    def make(network: Network) -> None:
        publisher = BusNode("/stranger", network.bus).advertise(topic, kind)
        if kind == "sensor_msgs/JointState":
            told = message_type(kind).make(name=["left_s0"], position=[0.0])
            publisher.publish(told)

    return make


def lose_robot(network: Network) -> None:
    """As when its process is killed."""
    network.bus.publishers["/robot/state"].clear()


def set_fault(**faults: object) -> Callable[[Network], None]:
    def make(network: Network) -> None:
        for name, value in faults.items():
            setattr(network.robot.faults, name, value)

    return make


def end_node(network: Network) -> None:
    network.node.reason_for_end = "another node has taken the name /baxter_kin"


def move_other_arm(network: Network) -> None:
    network.robot.goal["right_w0"] += 0.5


SLOW = ExecutionOptions(Pace(0.1), Dwell(0.0, 0.0))
TROUBLES = [
    Trouble(StopCause.JOINT_OFF, set_fault(stuck=True)),
    Trouble(StopCause.OFF_PATH, set_fault(stuck=True), SLOW),
    Trouble(StopCause.OTHER_ARM_MOVED, move_other_arm),
    Trouble(StopCause.DISABLED, lambda network: network.robot.tell(enabled=False)),
    Trouble(StopCause.STOPPED, lambda network: network.robot.tell(stopped=True, estop_button=1)),
    Trouble(StopCause.ROBOT_ERROR, lambda network: network.robot.tell(error=True)),
    Trouble(StopCause.STALE_JOINTS, set_fault(silent_joints=True), SLOW),
    Trouble(StopCause.OTHER_COMMANDER, other_node(COMMAND, "baxter_core_msgs/JointCommand")),
    Trouble(StopCause.OTHER_STATE, other_node("/robot/state", "baxter_core_msgs/AssemblyState")),
    Trouble(StopCause.OTHER_STATE, other_node("/robot/joint_states", "sensor_msgs/JointState")),
    Trouble(StopCause.CONNECTION_LOST, lose_robot),
    Trouble(StopCause.NODE_ENDED, end_node),
    Trouble(StopCause.TIME_OUT, lambda _: None, evolve(FAST, timeout_s=1.0)),
]


def troubled(
    network: Network, ready: ReadyPlan, trouble: Trouble, *observers: Observer
) -> MeasuredOutcome:
    """Carry the plan out; the trouble begins while the arm is on its first move."""
    network.when(lambda: has_moved(network, ready, 0.1), lambda: trouble.make(network))
    return network.executor(*observers).execute(evolve(ready, options=trouble.options))


def has_moved(network: Network, ready: ReadyPlan, least_rad: float) -> bool:
    """Whether a joint of the arm has left the start by so much."""
    names = ready.manipulator.arm.joint_names
    q = np.array([network.robot.q[name] for name in names])
    return bool(np.abs(q - ready.plan.q_start).max() > least_rad)


@pytest.mark.parametrize("trouble", TROUBLES, ids=lambda each: each.cause.name)
def test_every_trouble_ends_it_under_its_name(
    network: Network, ready: ReadyPlan, trouble: Trouble
) -> None:
    outcome = troubled(network, ready, trouble)
    assert outcome.stop is not None
    assert outcome.stop.cause is trouble.cause, outcome.failure
    assert outcome.failure == str(outcome.stop)
    assert outcome.failure.startswith("pick: ")
    assert not outcome.is_success
    own = network.bus.registered("/baxter_kin")
    assert not [t for t in own if "/baxter_kin" in network.node.publishers_of(t)]
    after = [time_s for time_s, _ in network.robot.commands if time_s > network.robot.told_s]
    assert len(after) <= IN_FLIGHT  # once the robot says that it has stopped


@pytest.mark.parametrize("cause", [StopCause.SIGINT, StopCause.SIGTERM])
def test_an_arm_that_is_told_to_stop_holds_where_it_is_measured(
    robot: Baxter, demo_plan: Plan, ready: ReadyPlan, cause: StopCause
) -> None:
    """It lags, so that it is elsewhere than its set-point."""
    names = robot.arm("left").joint_names
    with networked(robot, demo_plan, lag_s=0.2) as network:
        executor = network.executor()
        network.when(lambda: has_moved(network, ready, 0.3), lambda: executor.stop(cause))
        outcome = executor.execute(ready)
        assert outcome.stop is not None
        assert outcome.stop.cause is cause
        sent = np.array([[asked[name] for name in names] for _, asked in network.robot.commands])
        held = int((np.abs(np.diff(sent, axis=0)).max(axis=1) > 0.0).nonzero()[0][-1]) + 1
        q_last, q_held = sent[held - 1], sent[held]
        assert np.abs(q_last - q_held).max() > 0.05
        assert np.abs([network.robot.q[n] for n in names] - q_held).max() < 0.02
        assert 99 <= len(sent) - held <= 101  # a second of them
        network.bus.clock.sleep(0.2)
        assert len(network.robot.commands) == len(sent)  # then silence


def test_a_gripper_that_closes_on_nothing_has_missed(network: Network, ready: ReadyPlan) -> None:
    network.robot.faults.block_percent = None
    witness = Witness()
    outcome = network.executor(witness).execute(ready)
    assert outcome.stop is not None
    assert outcome.stop.cause is StopCause.GRIPPER_MISSED
    assert outcome.failure == (
        "pick: close: missed: the fingers of the left hand stopped at 0 % and hold nothing"
    )
    assert EventKind.MISSED in witness.kinds
    assert EventKind.GRASPED not in witness.kinds


def test_a_gripper_that_does_nothing_is_not_waited_for_for_ever(
    network: Network, ready: ReadyPlan
) -> None:
    network.robot.faults.deaf_gripper = True
    network.robot.hands["left"].percent = 50.0
    outcome = network.executor().execute(ready)
    assert outcome.stop is not None
    assert outcome.stop.cause is StopCause.GRIPPER_SILENT
    assert "50 %" in str(outcome.failure)


def test_the_last_set_point_stands_as_long_as_the_tracking_proof_counts_on(
    network: Network, ready: ReadyPlan
) -> None:
    """This arm follows at once, so nothing else makes it wait."""
    samples = Samples()
    outcome = network.executor(samples).execute(first_steps(ready))
    assert outcome.is_success, outcome.failure
    goal = samples.samples[-1].q_sent
    standing = [each.time_s for each in samples.samples if (each.q_sent == goal).all()]
    assert standing[-1] - standing[0] >= FAST.rest_s
    assert FAST.rest_s > 0.01 + 0.02


def test_an_arm_that_does_not_come_to_rest_is_named(
    network: Network, ready: ReadyPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Gravity, say: always a degree below where it should be."""
    monkeypatch.setattr("sim.ros1.execution.tracks.SETTLE_TIMEOUT_S", 0.5)
    network.robot.sag = {"left_s1": 0.012}
    outcome = network.executor().execute(ready)
    assert outcome.stop is not None
    assert outcome.stop.cause is StopCause.NOT_SETTLED
    assert outcome.stop.subject == "left_s1"


def test_an_arm_that_is_pushed_from_where_it_stands_is_stopped(
    network: Network, ready: ReadyPlan
) -> None:
    """While its fingers open."""
    options = ExecutionOptions(Pace(0.6), Dwell(1.0, 1.0))

    def push() -> None:
        network.robot.faults.stuck = True
        network.robot.faults.push["left_w2"] = 0.2

    network.when(lambda: len(network.robot.gripper_commands) == 2, push)
    outcome = network.executor().execute(evolve(ready, options=options))
    assert outcome.stop is not None
    assert outcome.stop.cause is StopCause.RUNNING_AWAY
    assert outcome.stop.subject == "left_w2"


def test_an_observer_that_fails_ends_the_motion_and_is_heard(
    network: Network, ready: ReadyPlan
) -> None:
    class Full(Observer):
        def on_snapshot(self, snapshot: Snapshot) -> None:
            if snapshot.time_s > 0.3:
                raise RecordingError("no space left on the disk")

    network.bus.clock.on_tick.append(lambda: time.sleep(0.001))  # the observers' thread is real
    with pytest.raises(RecordingError, match="no space left"):
        network.executor(Full()).execute(ready)
    assert len(network.robot.commands) < 200  # the plan takes 300 set-points


def test_observers_have_a_thread_of_their_own(network: Network, ready: ReadyPlan) -> None:
    """So that slow ones delay no set-point."""
    threads = set()

    class Threads(Observer):
        def on_snapshot(self, snapshot: Snapshot) -> None:  # noqa: ARG002
            threads.add(threading.current_thread())

    outcome = network.executor(Threads()).execute(first_steps(ready))
    assert outcome.is_success, outcome.failure
    assert len(threads) == 1
    assert threading.current_thread() not in threads


def test_set_points_do_not_jump_when_the_machine_is_busy(
    network: Network, ready: ReadyPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A pause of 130 ms in the middle of a move."""
    paused = []
    send = ArmChannel.send

    def sleepy(self: ArmChannel, q: FloatArray) -> None:
        send(self, q)
        paused.append(q)
        if len(paused) == 100:
            network.bus.clock.sleep(0.13)

    monkeypatch.setattr(ArmChannel, "send", sleepy)
    outcome = network.executor().execute(first_steps(ready))
    assert outcome.is_success, outcome.failure
    assert outcome.lateness_s[2] > 0.1
    steps = np.abs(np.diff(np.array(paused), axis=0)).max(axis=0)
    assert (steps <= 2.05 * 0.01 * ready.peaks + 1e-9).all()


def test_a_robot_that_cannot_be_enabled_is_told_of_and_nothing_moves(
    network: Network, ready: ReadyPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sim.ros1.execution.execution.ENABLE_S", 1.0)
    network.robot.state["stopped"] = True
    with pytest.raises(SimulationError, match="not enabled"):
        network.executor().execute(ready)
    assert network.robot.commands == []
    assert network.robot.enables >= 3


def test_an_arm_that_was_moved_since_it_was_looked_at_is_not_driven(
    network: Network, ready: ReadyPlan
) -> None:
    network.robot.q["left_s1"] += 0.1
    network.robot.goal["left_s1"] += 0.1
    network.bus.clock.sleep(0.1)
    with pytest.raises(SimulationError, match=r"stands 0\.100 rad from where it stood"):
        network.executor().execute(ready)
    assert network.robot.commands == []
    assert network.robot.enables == 0


def test_an_invalid_plan_is_refused(network: Network, demo_plan: Plan) -> None:
    broken = evolve(demo_plan, failure=PlanFailure("pick: approach", "no solution"))
    with pytest.raises(SimulationError, match="cannot be executed: pick: approach: no solution"):
        network.executor().execute(broken)
    assert network.robot.commands == []
