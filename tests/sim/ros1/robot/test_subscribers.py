"""Whatever messages come in whatever order, the robot ticks on, inside its limits."""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baxter_kin import Baxter
from baxter_kin.kinematics.arm import JOINTS
from planner import Body
from planner.errors import SceneError
from sim import World
from sim.ros1.definitions import message_type
from sim.ros1.node import Received
from sim.ros1.robot.baxter import SimulatedBaxter
from sim.ros1.robot.panel import OUTPUTS, PRESSABLE
from sim.ros1.robot.subscribers import MAX_KNOWN, Diagnostics, Subscribers

SPEEDS = np.array([2.0, 2.0, 2.0, 2.0, 4.0, 4.0, 4.0])
ROUNDING = 1e-9

NAMES = [f"{side}_{joint}" for side in ("left", "right") for joint in JOINTS]
NUMBERS = st.one_of(st.floats(-4.0, 4.0), st.floats())
WORDS = st.one_of(st.text(max_size=5), st.sampled_from(["left estop", "left release", *OUTPUTS]))
PRESSES = st.builds(
    "{} {}".format, st.sampled_from(["left", "right", ""]), st.sampled_from(PRESSABLE)
)
ARGS = st.one_of(
    st.text(max_size=10),
    st.dictionaries(
        st.sampled_from(["position", "velocity", "x"]),
        st.one_of(st.none(), st.booleans(), st.integers(), NUMBERS, st.text(max_size=3)),
    ).map(json.dumps),
)
JOINT_MODES = st.sampled_from([1, 1, 2, 4, 3, 0, -1])
SANE_ORDERS = st.builds(
    lambda side, joints, mode: {
        "mode": mode,
        "names": [f"{side}_{joint}" for joint in joints],
        "command": list(joints.values()),
    },
    st.sampled_from(["left", "right"]),
    st.dictionaries(st.sampled_from(JOINTS), NUMBERS),
    JOINT_MODES,
)
COMMANDS = st.sampled_from(
    ["go", "calibrate", "configure", "stop", "reset", "reboot", "clear_calibration", "grip", "?"]
)
VALUES: dict[str, st.SearchStrategy[dict[str, Any]]] = {
    "std_msgs/Empty": st.just({}),
    "std_msgs/Bool": st.fixed_dictionaries({"data": st.sampled_from([True, True, True, False])}),
    "std_msgs/Float64": st.fixed_dictionaries({"data": NUMBERS}),
    "std_msgs/String": st.fixed_dictionaries({"data": st.one_of(WORDS, PRESSES)}),
    "trajectory_msgs/JointTrajectoryPoint": st.just({}),
    "baxter_core_msgs/HeadPanCommand": st.fixed_dictionaries({"target": NUMBERS}),
    "baxter_core_msgs/DigitalOutputCommand": st.fixed_dictionaries({"name": WORDS}),
    "baxter_core_msgs/AnalogOutputCommand": st.fixed_dictionaries({"name": WORDS}),
    "baxter_core_msgs/EndEffectorProperties": st.just({}),
    "baxter_core_msgs/EndEffectorState": st.just({}),
    "baxter_core_msgs/EndEffectorCommand": st.fixed_dictionaries(
        {"command": COMMANDS, "args": ARGS, "sequence": st.integers(0, 3)}
    ),
    "baxter_core_msgs/JointCommand": SANE_ORDERS
    | st.fixed_dictionaries(
        {
            "mode": JOINT_MODES,
            "names": st.lists(st.sampled_from([*NAMES, "x"]), max_size=8),
            "command": st.lists(NUMBERS, max_size=8),
        }
    ),
}
"""What may be sent, by type; what is left out is zero or empty."""


class Ears:
    """Stands for a node: remembers who listens to what."""

    def __init__(self) -> None:
        self.topics: list[tuple[str, str, Callable[[Received], None]]] = []

    def subscribe(self, topic: str, kind: str, callback: Callable[[Received], None]) -> None:
        self.topics.append((topic, kind, callback))


class Bench:
    def __init__(self, robot: Baxter) -> None:
        self.baxter, self.ears = SimulatedBaxter(World(robot)), Ears()
        self.said: list[str] = []
        self.diagnostics = Diagnostics(self.said.append)
        node: Any = self.ears
        self.subscribers = Subscribers(self.baxter, node, self.diagnostics)

    def send(self, topic: str, time_s: float = 0.0, **values: Any) -> None:
        for name, kind, callback in self.ears.topics:
            if name == topic:
                callback(Received(message_type(kind).make(**values), "/somebody", topic, time_s))


@settings(max_examples=25)
@given(st.data())
def test_no_messages_break_it(robot: Baxter, data: st.DataObject) -> None:
    bench = Bench(robot)
    bench.send("/robot/set_super_enable", data=True)
    topics = st.sampled_from([(topic, kind) for topic, kind, _ in bench.ears.topics])
    for topic, kind in data.draw(st.lists(topics, max_size=25)):
        bench.send(topic, **data.draw(VALUES[kind]))
        bench.subscribers.process()
        before = {side: arm.q.copy() for side, arm in bench.baxter.arms.items()}
        bench.baxter.tick(2)
        for side, arm in bench.baxter.arms.items():
            limits = robot.arm(side).limits
            assert (arm.q >= limits.q_min).all()
            assert (arm.q <= limits.q_max).all()
            assert (np.abs(arm.q - before[side]) <= 0.02 * SPEEDS + ROUNDING).all()
        assert all(
            0.0 <= gripper.fingers.percent <= 100.0 for gripper in bench.baxter.grippers.values()
        )


@pytest.mark.parametrize("side", ["left", "right"])
def test_messages_of_one_tick_are_obeyed_in_their_order(robot: Baxter, side: str) -> None:
    bench, topic = Bench(robot), f"/robot/limb/{side}/joint_command"
    bench.send("/robot/set_super_enable", data=True)
    bench.send(topic, mode=1, names=[f"{side}_s0", f"{side}_w2"], command=[0.5, 0.5])
    bench.send(topic, mode=1, names=[f"{side}_s0"], command=[0.1])
    bench.subscribers.process()
    assert bench.baxter.arms[side].target[[0, 6]].tolist() == [0.1, 0.5]


def test_a_late_tick_executes_each_order_when_a_punctual_one_does(robot: Baxter) -> None:
    punctual, late = Bench(robot), Bench(robot)
    topic, ticks = "/robot/limb/left/joint_command", 8
    turns = np.random.default_rng(5).uniform(-1.0, 1.0, ticks)
    for bench in (punctual, late):
        bench.send("/robot/set_super_enable", data=True)
        for number, turn in enumerate(turns.tolist()):
            bench.send(topic, number + 0.5, mode=1, names=["left_s0"], command=[turn])
    for number in range(1, ticks + 1):
        punctual.subscribers.process(number)
        punctual.baxter.tick()
    late.baxter.tick(ticks, lambda left: late.subscribers.process(ticks - left))
    assert late.baxter.arms["left"].q.tolist() == punctual.baxter.arms["left"].q.tolist()
    assert late.baxter.time_s == punctual.baxter.time_s


def test_what_is_done_between_ticks_has_its_result_or_its_error(robot: Baxter, block: Body) -> None:
    bench = Bench(robot)
    first = bench.subscribers.between_ticks(lambda: bench.baxter.spawn(block))
    second = bench.subscribers.between_ticks(lambda: bench.baxter.spawn(block))
    assert not first.done()
    bench.subscribers.process()
    assert first.result(0.0) is None
    with pytest.raises(SceneError, match="already"):
        second.result(0.0)


def test_what_nobody_waits_for_any_more_is_not_done(robot: Baxter, block: Body) -> None:
    bench = Bench(robot)
    done = bench.subscribers.between_ticks(lambda: bench.baxter.spawn(block))
    done.cancel()
    bench.subscribers.process()
    assert not bench.baxter.world.scene.bodies


TIMES = st.lists(st.floats(0.0, 100.0), min_size=1).map(sorted)


@given(TIMES)
def test_invalid_messages_are_all_counted_and_reported_once_a_second(times: list[float]) -> None:
    reports: list[str] = []
    diagnostics = Diagnostics(reports.append)
    reported_s: list[float] = []
    for time_s in times:
        before = len(reports)
        diagnostics.add("/topic", "/sender", "left_s0 = nan", time_s)
        reported_s += [time_s] * (len(reports) - before)
    assert diagnostics.counts["/topic"] == len(times)
    assert reports[0] == "/topic from /sender: left_s0 = nan"
    assert reported_s[0] == times[0]
    assert all(later - earlier >= 1.0 for earlier, later in pairwise(reported_s))


def test_another_sender_is_reported_at_once_and_what_was_left_out_is_counted() -> None:
    reports: list[str] = []
    diagnostics = Diagnostics(reports.append)
    for sender, time_s in (("/a", 0.0), ("/a", 0.1), ("/a", 0.2), ("/b", 0.3), ("/a", 1.5)):
        diagnostics.add("/topic", sender, "bad", time_s)
    assert reports == [
        "/topic from /a: bad",
        "/topic from /b: bad",
        "/topic from /a: bad (2 more since the last time)",
    ]


def test_any_number_of_senders_takes_no_more_memory() -> None:
    diagnostics = Diagnostics(lambda _: None)
    for number in range(3 * MAX_KNOWN):
        diagnostics.add("/topic", f"/sender_{number}", "bad", 0.0)
    assert len(diagnostics._reported_s) <= MAX_KNOWN
    assert diagnostics.counts.total() == 3 * MAX_KNOWN
