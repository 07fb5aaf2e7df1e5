"""Figures of the node alone: it publishes what a Baxter publishes, and rospy reads."""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from baxter_kin import Baxter
from ros1_figures.figure import Figure, Reader
from sim.ros1.definitions import MESSAGES, SERVICES
from sim.ros1.master import Master
from sim.ros1.node import Node, Publisher
from tests.sim.ros1.debian import generate_classes

RATE_HZ = 100.0
STATES = {
    "/robot/joint_states": "sensor_msgs/JointState",
    "/robot/ref_joint_states": "sensor_msgs/JointState",
    "/robot/limb/left/endpoint_state": "baxter_core_msgs/EndpointState",
    "/robot/limb/right/endpoint_state": "baxter_core_msgs/EndpointState",
    "/robot/state": "baxter_core_msgs/AssemblyState",
    "/robot/head/head_state": "baxter_core_msgs/HeadState",
    "/robot/end_effector/left_gripper/state": "baxter_core_msgs/EndEffectorState",
    "/robot/end_effector/right_gripper/state": "baxter_core_msgs/EndEffectorState",
    "/robot/end_effector/left_gripper/properties": "baxter_core_msgs/EndEffectorProperties",
    "/robot/end_effector/right_gripper/properties": "baxter_core_msgs/EndEffectorProperties",
    **{f"/robot/digital_io/{n}/state": "baxter_core_msgs/DigitalIOState" for n in range(12)},
    **{f"/robot/navigators/{n}/state": "baxter_core_msgs/NavigatorState" for n in range(4)},
}
"""26 topics, as a Baxter has them."""

MOST_USED = dict(list(STATES.items())[:5])


def figures(duration_s: float) -> Iterator[Figure]:
    """Measure one after the other, each for so long."""
    with tempfile.TemporaryDirectory() as folder, Master(port=0) as master:
        classes = Path(folder)
        generate_classes(classes, MESSAGES, SERVICES)
        with Node("/publisher", master_uri=master.uri) as node:
            robot = _Robot(node)
            yield from _timing(robot, master.uri, classes, duration_s)
            yield from _work(robot, master.uri, classes, duration_s)
        yield _connecting(master.uri)


class _Robot:
    """Publishes all states at a fixed rate while it runs; it computes nothing."""

    def __init__(self, node: Node) -> None:
        self._publishers = {topic: node.advertise(topic, name) for topic, name in STATES.items()}
        self._names = Baxter.load().joint_names
        self._q = np.zeros(len(self._names))
        self._ended = threading.Event()

    def run(self, duration_s: float) -> float:
        """Publish for so long; gives the share of a core that this process used."""
        began_s, used_s = time.monotonic(), time.process_time()
        ticks = int(duration_s * RATE_HZ)
        for tick in range(ticks):
            self._ended.wait(max(0.0, began_s + tick / RATE_HZ - time.monotonic()))
            for topic, publisher in self._publishers.items():
                self._publish(topic, publisher)
        return (time.process_time() - used_s) / (time.monotonic() - began_s)

    def _publish(self, topic: str, publisher: Publisher) -> None:
        if topic.endswith("joint_states"):
            publisher.send(
                header={"stamp": time.time()},
                name=self._names,
                position=self._q,
                velocity=self._q,
                effort=self._q,
            )
        elif topic.endswith("endpoint_state"):
            publisher.send(header={"stamp": time.time()}, pose={"position": {"x": 0.5}})
        else:
            publisher.send()


def _timing(robot: _Robot, uri: str, classes: Path, duration_s: float) -> Iterator[Figure]:
    topic = "/robot/joint_states"
    with Reader(uri, MOST_USED, classes) as reader:
        robot.run(duration_s)
        times = np.array(reader.end()[topic])
    rate = (len(times) - 1) / (times[-1, 1] - times[0, 1])
    spread = 1e3 * np.diff(times[:, 1]).std()
    p50, p99 = 1e3 * np.percentile(times[:, 1] - times[:, 0], [50, 99])
    yield Figure(
        "joint_states rate, sd of period",
        "100 +- 0.5 Hz, <= 3 ms",
        f"{rate:.2f} Hz, {spread:.2f} ms",
        bool(abs(rate - RATE_HZ) <= 0.5 and spread <= 3.0),
    )
    yield Figure(
        "latency to a rospy client p50 / p99",
        "<= 2 / 15 ms",
        f"{p50:.2f} / {p99:.2f} ms",
        bool(p50 <= 2.0 and p99 <= 15.0),
    )


def _work(robot: _Robot, uri: str, classes: Path, duration_s: float) -> Iterator[Figure]:
    what = f"CPU of the node alone, {len(STATES)} topics at 100 Hz"
    yield Figure(f"{what}, no reader", "", _percent(robot.run(duration_s)))
    with Reader(uri, MOST_USED, classes) as reader:
        yield Figure(f"{what}, a client reads 5", "", _percent(robot.run(duration_s)))
        reader.end()
    with Reader(uri, STATES, classes) as reader:
        share = robot.run(duration_s)
        reader.end()
    found = _percent(share)
    yield Figure(f"{what}, a client reads all", "far below 20 %", found, share < 0.15)


def _connecting(uri: str) -> Figure:
    topic, name = "/new", "std_msgs/String"
    times_s = []
    with Node("/listener", master_uri=uri) as listener:
        subscriber = listener.subscribe(topic, name, lambda _: None)
        for _ in range(20):
            began_s = time.perf_counter()
            with Node("/new_publisher", master_uri=uri) as node:
                publisher = node.advertise(topic, name)
                while not (publisher.readers and subscriber.writers):
                    time.sleep(0.0005)
                times_s.append(time.perf_counter() - began_s)
            while subscriber.writers:
                time.sleep(0.001)
    median, worst = np.median(times_s), max(times_s)
    return Figure(
        "new publisher connected, its start included: median / max",
        "<= 0.25 s",
        f"{median:.3f} / {worst:.3f} s",
        bool(worst <= 0.25),
    )


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} % of a core"
