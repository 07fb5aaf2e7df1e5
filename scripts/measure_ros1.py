"""Measures the ROS 1 side: prints each row of its interface and its figures, with its verdict.

`python scripts/measure_ros1.py [--duration-s T] [--only PART ...]`

The parts `interface` and `md5` need no ROS; `node`, `baxter` and `executor` are read by
Debian's rospy, as `make test` installs it. All runs on this computer, at masters of its own; a
computer that does other things meanwhile gives worse figures. Exit status 1 when a row fails.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the tests' generator of classes

from baxter_kin import Baxter
from baxter_kin.fields import evolve
from planner import Manipulator, PickAndPlace, Plan, plan_pick_and_place
from planner.scene.objects import URDF_FOLDER
from sim import Simulation, World, read_recording
from sim.demo.scene import BLOCK, demo_bodies, overhead
from sim.errors import SimulationError
from sim.ros1 import BaxterLink, ExecutionOptions, Master, Node, Pace, RosExecutor, StopCause
from sim.ros1.definitions import MESSAGES, SERVICES, message_type, service_type
from sim.ros1.execution.execution import MeasuredOutcome
from sim.ros1.execution.link import STATE, command_topic
from sim.simulation import Dwell
from tests.sim.ros1.debian import PYTHON, environment, generate_classes

LIMBS = ("left", "right")
CORE = "baxter_core_msgs"
LOOPBACK = "127.0.0.1"
TICK_S = 0.01
WITHIN_S = 60.0
URI = re.compile(r"ROS_MASTER_URI=(http://\S+)")


class Row(NamedTuple):
    """One row of a table.

    Attributes:
        what: the name of a topic, or of a figure.
        required: in words.
        measured: in words.
        is_met: whether it is as required; None where nothing is.
        kind: type of the topic, service or parameter.
        direction: "R->C" from the robot to its clients, "C->R" back, "srv" or "param".
    """

    what: str
    required: str
    measured: str
    is_met: bool | None = None
    kind: str = ""
    direction: str = ""

    def __str__(self) -> str:
        verdict = {None: "", True: "pass", False: "FAIL"}[self.is_met]
        interface = (self.kind, self.direction) if self.kind else ()
        return f"| {' | '.join((self.what, *interface, self.required, self.measured, verdict))} |"


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, and print a row as soon as it is known."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--duration-s", type=float, default=10.0, help="default: %(default)s")
    parser.add_argument("--only", choices=PARTS, action="append", help="one part; repeatable")
    options = parser.parse_args(argv)
    os.environ["ROS_IP"] = LOOPBACK
    rows: list[Row] = []
    for name in options.only or PARTS:
        print(f"\n## {name}\n")
        titles = ("name", "type", "direction") if name in ("interface", "md5") else ("figure",)
        titles += ("required", "measured", "verdict")
        print(f"| {' | '.join(titles)} |\n|{' --- |' * len(titles)}", flush=True)
        for row in PARTS[name](options.duration_s):
            rows.append(row)
            print(row, flush=True)
    failed = [row for row in rows if row.is_met is False]
    print(f"\n{len(rows)} rows, {len(failed)} failed")
    return int(bool(failed))


@contextmanager
def robot_process(*options: str) -> Iterator[tuple[str, int]]:
    """A simulated Baxter with table and block: the URI of its own master, and its process."""
    command = [sys.executable, "-m", "sim.ros1.robot", "--own-master", "--port", "0"]
    process = subprocess.Popen(
        [*command, "--table", "--block", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert process.stdout is not None
        lines = iter(process.stdout.readline, "")  # others announce what takes seconds
        found = next((each for line in lines if (each := URI.search(line))), None)
        if found is None:
            raise SystemExit("the simulated Baxter did not start")
        yield found[1], process.pid
    finally:
        process.terminate()
        process.wait(WITHIN_S)


# Interface


class Client:
    """A client of the robot."""

    def __init__(self, node: Node) -> None:
        """Receive nothing yet."""
        self.node, self.kinds = node, node.topics()
        self._last: dict[str, Any] = {}
        self._publishers: dict[str, Any] = {}

    def rates_hz(self, topics: Sequence[str], duration_s: float) -> list[float]:
        """Rates of some topics, received for so long."""
        times: dict[str, list[float]] = {topic: [] for topic in topics}
        subscribers = [
            self.node.subscribe(topic, self.kinds[topic], lambda r: times[r.topic].append(r.time_s))
            for topic in topics
        ]
        time.sleep(duration_s)
        for subscriber in subscribers:
            subscriber.close()
        return [
            (len(each) - 1) / (each[-1] - each[0]) if each[1:] else 0.0 for each in times.values()
        ]

    def last(self, topic: str) -> Any:
        """The last message of a topic, which the robot publishes."""
        if topic not in self._last:
            self._last[topic] = None
            self.node.subscribe(topic, self.kinds[topic], self._keep)
            self.until(lambda: self._last[topic], 2.0)
        return self._last[topic]

    def _keep(self, received: Any) -> None:
        self._last[received.topic] = received.message

    def joint(self, name: str) -> float:
        """Position of a joint, rad."""
        message = self.last("/robot/joint_states")
        return float(message.position[message.name.index(name)])

    def send(self, topic: str, kind: str, **values: Any) -> None:
        """Publish a message once the robot is connected."""
        if topic not in self._publishers:
            self._publishers[topic] = self.node.advertise(topic, kind, queue=100)
            self.until(lambda: self._publishers[topic].readers, 2.0)
        self._publishers[topic].send(**values)

    def until(
        self, is_so: Callable[[], object], timeout_s: float, meanwhile: Callable[[], object] = int
    ) -> float:
        """Wait for a condition, at 100 Hz; returns how long that took, infinity when it was not."""
        begin_s = time.monotonic()
        while not is_so():
            if time.monotonic() - begin_s > timeout_s:
                return float("inf")
            meanwhile()
            time.sleep(TICK_S)
        return time.monotonic() - begin_s


def interface(duration_s: float) -> Iterator[Row]:
    """Each row of the interface: by its own master, so without ROS."""
    with robot_process() as (uri, _), Node("/client", master_uri=uri, host=LOOPBACK) as node:
        client = Client(node)
        yield from _parameters(node)
        yield from _gazebo(node)
        yield from _published(client, max(2.0, 0.5 * duration_s))
        yield from _subscribed(client)
        yield from _enabled(client)
        yield from _arm(client)
        yield from _gripper(client)
        yield from _kinematics(node)
        yield from _panel(client)
        yield from _stop(client)


def _parameters(node: Node) -> Iterator[Row]:
    version = node.parameter("/rethink/software_version")
    name = "rethink/software_version"
    yield Row(name, "1.2.0", str(version), version == "1.2.0", "string", "param")
    text = str(node.parameter("/robot_description"))
    measured, is_met = f"{len(text)} characters", Baxter.load(text).digest == Baxter.load().digest
    yield Row("robot_description", "the robot's URDF", measured, is_met, "string", "param")


def _gazebo(node: Node) -> Iterator[Row]:
    block = (URDF_FOLDER / "block.urdf").read_text("utf-8")
    box = "<collision name='c'><geometry><box><size>.1 .1 .1</size></box></geometry></collision>"
    sdf = f"<sdf version='1.6'><model name='m'><link name='l'>{box}</link></model></sdf>"
    pose = {"position": {"x": 2.0, "z": 1.0}}  # its quaternion is 0 0 0 0
    for form, xml in (("sdf", sdf), ("urdf", block)):
        name, kind = f"/gazebo/spawn_{form}_model", "gazebo_msgs/SpawnModel"
        request = service_type(kind).request.make(
            model_name=form, model_xml=xml, initial_pose=pose, reference_frame="world"
        )
        answer = node.call(name, kind, request)
        yield Row(name, "success", answer.status_message, bool(answer.success), kind, "srv")
    name, kind = "/gazebo/delete_model", "gazebo_msgs/DeleteModel"
    made = [service_type(kind).request.make(model_name=form) for form in ("sdf", "urdf", "none")]
    answers = [bool(node.call(name, kind, request).success) for request in made]
    required, is_met = "success; False for unknown names", answers == [True, True, False]
    yield Row(name, required, str(answers), is_met, kind, "srv")
    topic, kind, came = "/robot/sim/started", "std_msgs/Empty", list[float]()
    begin_s = time.monotonic()
    with Node("/late", master_uri=node.master_uri, host=LOOPBACK) as late:
        late.subscribe(topic, kind, lambda r: came.append(r.time_s))
        while not came and time.monotonic() < begin_s + 2.0:
            time.sleep(TICK_S)
    measured = f"after {1e3 * (came[0] - begin_s):.0f} ms" if came else "never"
    yield Row(topic, "latched", measured, len(came) == 1, kind, "R->C")


FILLED_IN = {
    "limb": LIMBS,
    "io": tuple(
        f"{limb}_{name}"
        for name in ("lower_cuff", "lower_button", "upper_button", "inner_light", "outer_light")
        for limb in LIMBS
    ),
    "navigator": tuple(f"{place}{limb}" for place in ("", "torso_") for limb in LIMBS),
}


def topics_of(pattern: str) -> list[str]:
    """The topics that a name with a placeholder stands for."""
    place = pattern.partition("{")[2].partition("}")[0]
    return [f"/robot/{pattern.format(**{place: each})}" for each in FILLED_IN.get(place, ("",))]


Published = tuple[str, str, Callable[[Any], object]]
PUBLISHED: dict[str, Published] = {
    "joint_states": (
        "sensor_msgs/JointState",
        "arrays as long as name",
        lambda m: len(m.name) == len(m.position) == len(m.velocity) == len(m.effort) >= 14,
    ),
    "ref_joint_states": (
        "sensor_msgs/JointState",
        "14 set-points",
        lambda m: len(m.name) == len(m.position) == 14,
    ),
    "limb/{limb}/endpoint_state": (
        f"{CORE}/EndpointState",
        "pose, twist, wrench; in base",
        lambda m: m.header.frame_id == "base" and m.pose.position.x != 0.0,
    ),
    "state": (
        f"{CORE}/AssemblyState",
        "disabled at first",
        lambda m: not (m.enabled or m.stopped or m.error or m.estop_button or m.estop_source),
    ),
    "end_effector/{limb}_gripper/state": (
        f"{CORE}/EndEffectorState",
        "id 131073, calibrated, ready",
        lambda m: (m.id, m.calibrated, m.ready, m.error) == (131073, 1, 1, 0),
    ),
    "end_effector/{limb}_gripper/properties": (
        f"{CORE}/EndEffectorProperties",
        "ui_type 2, id 65538, firmware after 2014/5/20",
        lambda m: (
            (m.ui_type, m.id, m.firmware_date) == (2, 65538, "2014/7/24 18:30:00")
            and m.firmware_rev
            and m.product
        ),
    ),
    "digital_io/{io}/state": (
        f"{CORE}/DigitalIOState",
        "off; inputs marked",
        lambda m: m.state == 0,
    ),
    "navigators/{navigator}_navigator/state": (
        f"{CORE}/NavigatorState",
        "3 buttons, lights named",
        lambda m: len(m.buttons) == len(m.button_names) == 3 and len(m.light_names) == 2,
    ),
    "head/head_state": (f"{CORE}/HeadState", "at rest", lambda m: not m.isTurning),
}


def _published(client: Client, duration_s: float) -> Iterator[Row]:
    for pattern, (kind, fields, is_valid) in PUBLISHED.items():
        topics = topics_of(pattern)
        rates = client.rates_hz(topics, duration_s)
        is_met = all(99.5 <= rate <= 100.5 for rate in rates)
        is_met &= all(client.kinds.get(topic) == kind for topic in topics)
        is_met &= all(bool(is_valid(client.last(topic))) for topic in topics)
        count = f", {len(topics)} topics" if len(topics) > 1 else ""
        measured = f"{min(rates):.2f} .. {max(rates):.2f} Hz{count}"
        yield Row(topics[0], f"100 +- 0.5 Hz; {fields}", measured, is_met, kind, "R->C")


SUBSCRIBED = {
    "limb/{limb}/joint_command": f"{CORE}/JointCommand",
    "limb/{limb}/set_speed_ratio": "std_msgs/Float64",
    "limb/{limb}/joint_command_timeout": "std_msgs/Float64",
    "limb/{limb}/inverse_dynamics_command": "trajectory_msgs/JointTrajectoryPoint",
    "limb/{limb}/suppress_collision_avoidance": "std_msgs/Empty",
    "set_super_enable": "std_msgs/Bool",
    "set_super_reset": "std_msgs/Empty",
    "set_super_stop": "std_msgs/Empty",
    "end_effector/{limb}_gripper/command": f"{CORE}/EndEffectorCommand",
    "end_effector/{limb}_gripper/rsdk/set_properties": f"{CORE}/EndEffectorProperties",
    "end_effector/{limb}_gripper/rsdk/set_state": f"{CORE}/EndEffectorState",
    "digital_io/command": f"{CORE}/DigitalOutputCommand",
    "head/command_head_pan": f"{CORE}/HeadPanCommand",
    "head/command_head_nod": "std_msgs/Bool",
}
NOT_OFFERED = {
    "joint_state_publish_rate": ("std_msgs/UInt16", "C->R"),
    "limb/left/follow_joint_trajectory/status": ("actionlib_msgs/GoalStatusArray", "action"),
}


def _subscribed(client: Client) -> Iterator[Row]:
    for name, kind in SUBSCRIBED.items():
        topics = topics_of(name)
        found = [client.node.subscribers_of(topic) for topic in topics]
        is_met = all(found) and all(client.kinds.get(topic) == kind for topic in topics)
        readers = ", ".join(sorted({node for nodes in found for node in nodes})) or "nobody"
        yield Row(topics[0], "subscribed", f"by {readers}", is_met, kind, "C->R")
    for name, (kind, direction) in NOT_OFFERED.items():
        topic = f"/robot/{name}"
        found = [*client.node.subscribers_of(topic), *client.node.publishers_of(topic)]
        measured = ", ".join(found) or "not offered"
        yield Row(topic, "not offered by the robot", measured, not found, kind, direction)


def _timed(topic: str, kind: str, required: str, taken_s: float, limit_s: float) -> Row:
    return Row(topic, required, f"after {taken_s:.2f} s", taken_s <= limit_s, kind, "C->R")


def _state(client: Client, name: str, field: str, value: bool, limit_s: float, **sent: bool) -> Row:
    """Repeat a message at 100 Hz until the robot's state has a value, as the original does."""
    topic = f"/robot/set_super_{name}"
    kind = client.kinds[topic]
    taken_s = client.until(
        lambda: bool(getattr(client.last(STATE), field)) is value,
        limit_s,
        lambda: client.send(topic, kind, **sent),
    )
    return _timed(topic, kind, f"{field}: {value} within {limit_s:g} s", taken_s, limit_s)


def _enabled(client: Client) -> Iterator[Row]:
    for is_on, limit_s in ((True, 2.0), (False, 5.0), (True, 2.0)):
        yield _state(client, "enable", "enabled", is_on, limit_s, data=is_on)


def _arm(client: Client) -> Iterator[Row]:
    limb, kind, name = "/robot/limb/left", f"{CORE}/JointCommand", "left_w2"
    topic, number = f"{limb}/joint_command", "std_msgs/Float64"

    def send(mode: int, value: float) -> None:
        client.send(topic, kind, mode=mode, names=[name], command=[value])

    def move(by_rad: float) -> tuple[float, float]:
        """Send a goal at 100 Hz until the joint is there: the goal, and how long that took."""
        goal = client.joint(name) + by_rad
        is_there = lambda: abs(client.joint(name) - goal) < 1e-6  # noqa: E731
        return goal, client.until(is_there, 3.0, lambda: send(1, goal))

    goal, taken_s = move(0.1)
    yield _timed(topic, kind, "mode 1, 100 Hz: at the set-point", taken_s, 1.0)
    time.sleep(0.5)
    off = abs(client.joint(name) - goal)
    yield Row(topic, "held without commands", f"{off:.1e} rad off", off < 1e-6, kind, "C->R")
    send(3, 1.0)
    time.sleep(0.2)
    off = abs(client.joint(name) - goal)
    yield Row(topic, "mode 3 refused", f"{off:.1e} rad moved", off < 1e-6, kind, "C->R")
    client.send(f"{limb}/joint_command_timeout", number, data=0.2)
    time.sleep(0.1)
    send(2, -0.5)
    time.sleep(0.6)
    moved, required = goal - client.joint(name), "0.2 s: mode 2, 0.5 rad/s moves by 0.1 rad"
    is_met, measured = abs(moved - 0.1) <= 0.011, f"{moved:.3f} rad"
    yield Row(f"{limb}/joint_command_timeout", required, measured, is_met, number, "C->R")
    for ratio in (0.1, 1.0):
        client.send(f"{limb}/set_speed_ratio", number, data=ratio)
        time.sleep(0.1)
        speed, cap = 0.4 / move(0.4)[1], 4.0 * ratio
        required, is_met = f"{ratio:g}: {cap:g} rad/s", 0.7 <= speed / cap <= 1.05
        measured = f"{speed:.2f} rad/s"
        yield Row(f"{limb}/set_speed_ratio", required, measured, is_met, number, "C->R")


def _gripper(client: Client) -> Iterator[Row]:
    hand, kind = "/robot/end_effector/left_gripper", f"{CORE}/EndEffectorCommand"
    topic, state = f"{hand}/command", f"{hand}/state"

    def go(percent: float, sequence: int) -> tuple[float, float]:
        """How long until a command is acknowledged, and until it is done."""
        args = json.dumps({"position": percent})
        command = {"id": 131073, "command": "go", "args": args, "sender": "/client"}
        client.send(topic, kind, **command, sequence=sequence)
        known_s = client.until(lambda: client.last(state).command_sequence == sequence, 1.0)
        return known_s, client.until(lambda: abs(client.last(state).position - percent) < 0.1, 2.0)

    for sequence, percent in enumerate((30.0, 100.0), 1):
        known_s, there_s = go(percent, sequence)
        yield _timed(topic, kind, f"go {percent:g} acknowledged", known_s, 0.2)
        yield _timed(topic, kind, f"at {percent:g} %", there_s, 1.0)


def _kinematics(node: Node) -> Iterator[Row]:
    kind, make = IK_TYPE, service_type(IK_TYPE).request.make
    for limb, y in zip(LIMBS, (0.2, -0.2), strict=True):
        name = f"/ExternalTools/{limb}/PositionKinematicsNode/IKService"
        request = make(pose_stamp=[_stamped(0.7, y, 0.0), _stamped(3.0, 0.0, 0.0)])
        answer = node.call(name, kind, request)
        found = answer.isValid.tolist(), answer.result_type.tolist(), len(answer.joints[0].name)
        is_met = found[0] == [True, False] and found[1][0] > 0 == found[1][1] and found[2] == 7
        required = "a pose and one out of reach"
        yield Row(name, required, f"valid {found[0]}, result {found[1]}", is_met, kind, "srv")


def _panel(client: Client) -> Iterator[Row]:
    topic, kind = "/robot/head/command_head_pan", f"{CORE}/HeadPanCommand"
    client.send(topic, kind, target=0.5)
    head = "/robot/head/head_state"
    taken_s = client.until(lambda: abs(client.last(head).pan - 0.5) < 0.01, 5.0)
    yield _timed(topic, kind, "0.5 rad within 5 s", taken_s, 5.0)
    client.send("/robot/head/command_head_nod", "std_msgs/Bool", data=True)
    taken_s = client.until(lambda: client.last(head).isNodding, 1.0)
    yield _timed("/robot/head/command_head_nod", "std_msgs/Bool", "nods", taken_s, 0.5)
    topic, kind = "/robot/digital_io/command", f"{CORE}/DigitalOutputCommand"
    client.send(topic, kind, name="left_inner_light", value=True)
    lit = "/robot/digital_io/left_inner_light/state"
    yield _timed(topic, kind, "echoed", client.until(lambda: client.last(lit).state == 1, 1.0), 0.5)


def _stop(client: Client) -> Iterator[Row]:
    yield _state(client, "stop", "stopped", True, 3.0)
    yield _state(client, "reset", "stopped", False, 3.0)


# Sums of definitions


SUMS = """
JointCommand 19bfec8434dd568ab3c633d187c36f2e EndpointState 44bea01d596ff699fa1447bec34167ac
AssemblyState 356d9dd237ce73b2667da9235f541933 EndEffectorState ade777f069d738595bc19e246b8ec7a0
EndEffectorProperties 21b83773ab9a35216d11e427573c76cc
EndEffectorCommand c003234e90416f2ca02ac7837c42cbb7 HeadState 71c43b264307205358e7e49be5601348
HeadPanCommand 23b8a3f4b7ee9de7099d029e57660a8c DigitalIOState 29d0be3859dae81a66b28f167ecec98c
DigitalOutputCommand 23f05028c1a699fb83e22401228c3a9e
NavigatorState 680d121a1f16a32647298b292492fffd AnalogIOState 39af371963dc9e4447e91f430c720b33
AnalogOutputCommand a7b945129a083ca4095d48aa94841d85
CollisionAvoidanceState 30f5cb8ae019f1ffe8b599e6d2e589c7
CollisionDetectionState 7bde38c182b4d08fdc0635b116f65d04
SEAJointState d36406dcbb6d860b1b39c4e28f81352b SolvePositionIK 18cc92fd96853eb10b34de0b5c7d3cba
gazebo_msgs/SpawnModel 9ed9c82c96abe1a00c3e8cdaeee24413
gazebo_msgs/DeleteModel 9ce56b4e9e54616de25d796dc972a262
control_msgs/FollowJointTrajectoryAction bc4f9b743838566551c0390c65f1a248
"""


def sums(_: float) -> Iterator[Row]:
    """The md5 sum of each definition that we have."""
    words = SUMS.split()
    for plain, required in zip(words[::2], words[1::2], strict=True):
        name = plain if "/" in plain else f"{CORE}/{plain}"
        kind = "srv" if name in SERVICES else "msg"
        if name not in MESSAGES and name not in SERVICES:
            yield Row(name, required, "not used by the robot", None, kind, "-")
            continue
        measured = (service_type if kind == "srv" else message_type)(name).md5
        yield Row(name, required, measured, measured == required, kind, "-")


# Figures of the node alone


class Reader:
    """A rospy client that reads topics, in a process of its own, inside a `with`."""

    SCRIPT = """
import json, sys, time
import roslib.message, rospy
answers, sys.stdout = sys.stdout, sys.stderr
rospy.init_node("reader", anonymous=True, disable_signals=True)
wanted = dict(item.split("=") for item in sys.argv[1:])
received = {topic: [] for topic in wanted}
def keep(message, topic):
    arrived_s, header = time.time(), getattr(message, "header", None)
    received[topic].append((header.stamp.to_sec() if header else 0.0, arrived_s))
subscribers = [
    rospy.Subscriber(topic, roslib.message.get_message_class(kind), keep, topic, tcp_nodelay=True)
    for topic, kind in wanted.items()
]
while not all(each.get_num_connections() for each in subscribers):
    time.sleep(0.01)
print("ready", file=answers, flush=True)
sys.stdin.read()
print(json.dumps(received), file=answers, flush=True)
rospy.signal_shutdown("done")
"""
    """Prints "ready" once connected; when its input ends, stamps and times of arrival by topic."""

    def __init__(self, master_uri: str, topics: Mapping[str, str], classes: Path) -> None:
        """Start it and wait until it is connected to all topics, given with their types."""
        self._process = subprocess.Popen(
            [PYTHON, "-c", self.SCRIPT, *(f"{topic}={name}" for topic, name in topics.items())],
            env=environment(master_uri, classes),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    def __enter__(self) -> Reader:
        assert self._process.stdout is not None
        if self._process.stdout.readline() != "ready\n":
            raise SystemExit("rospy did not start; the packages it needs are in set_up.py")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, _: BaseException | None, __: TracebackType | None
    ) -> None:
        if kind is not None:
            self._process.kill()
        self._process.communicate()

    def end(self) -> dict[str, np.ndarray]:
        """Stop it: by topic, stamps and times of arrival, shape (n, 2), s."""
        written, _ = self._process.communicate("", WITHIN_S)
        return {topic: np.array(rows) for topic, rows in json.loads(written).items()}


@contextmanager
def _classes() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as folder:
        generate_classes(Path(folder), MESSAGES, SERVICES)
        yield Path(folder)


JOINT_STATES = "/robot/joint_states"
STATES = {
    JOINT_STATES: "sensor_msgs/JointState",
    "/robot/ref_joint_states": "sensor_msgs/JointState",
    **{f"/robot/limb/{limb}/endpoint_state": f"{CORE}/EndpointState" for limb in LIMBS},
    "/robot/state": f"{CORE}/AssemblyState",
    "/robot/head/head_state": f"{CORE}/HeadState",
    **{f"/robot/end_effector/{n}_gripper/state": f"{CORE}/EndEffectorState" for n in LIMBS},
    **{
        f"/robot/end_effector/{n}_gripper/properties": f"{CORE}/EndEffectorProperties"
        for n in LIMBS
    },
    **{f"/robot/digital_io/{n}/state": f"{CORE}/DigitalIOState" for n in range(12)},
    **{f"/robot/navigators/{n}/state": f"{CORE}/NavigatorState" for n in range(4)},
}
"""26 topics, as a Baxter has them."""

MOST_USED = dict(list(STATES.items())[:5])


def node_alone(duration_s: float) -> Iterator[Row]:
    """The node publishes what a Baxter publishes, computes nothing, and rospy reads."""
    with _classes() as classes, Master(port=0) as master:
        with Node("/publisher", master_uri=master.uri) as node:
            send = _sender(node)
            with Reader(master.uri, MOST_USED, classes) as reader:
                _publish(send, duration_s)
                yield from _timing("the node's joint_states", reader.end()[JOINT_STATES])
            what = f"CPU of the node alone, {len(STATES)} topics at 100 Hz"
            yield Row(f"{what}, no reader", "", _percent(_publish(send, duration_s)))
            for topics, which, limit in ((MOST_USED, "5", None), (STATES, "all", 0.15)):
                with Reader(master.uri, topics, classes) as reader:
                    share = _publish(send, duration_s)
                    reader.end()
                is_met = None if limit is None else share < limit
                required = "" if limit is None else "far below 20 %"
                yield Row(f"{what}, a client reads {which}", required, _percent(share), is_met)
        yield _connecting(master.uri)


def _sender(node: Node) -> Callable[[], None]:
    """Publishes all states once."""
    publishers = {topic: node.advertise(topic, kind) for topic, kind in STATES.items()}
    names = Baxter.load().joint_names
    q = np.zeros(len(names))
    joints = {"name": names, "position": q, "velocity": q, "effort": q}

    def send() -> None:
        for topic, publisher in publishers.items():
            header = {"header": {"stamp": time.time()}}
            if topic.endswith("joint_states"):
                publisher.send(**header, **joints)
            elif topic.endswith("endpoint_state"):
                publisher.send(**header, pose={"position": {"x": 0.5}})
            else:
                publisher.send()

    return send


def _publish(send: Callable[[], None], duration_s: float) -> float:
    """Publish at 100 Hz; returns the share of a core that this process used."""
    began_s, used_s = time.monotonic(), time.process_time()
    for tick in range(int(duration_s / TICK_S)):
        time.sleep(max(0.0, began_s + tick * TICK_S - time.monotonic()))
        send()
    return (time.process_time() - used_s) / (time.monotonic() - began_s)


def _timing(what: str, times: np.ndarray) -> Iterator[Row]:
    """Rate, spread and latency of a topic, by its stamps and times of arrival, shape (n, 2), s."""
    rate = (len(times) - 1) / (times[-1, 1] - times[0, 1])
    spread = 1e3 * float(np.diff(times[:, 0]).std())
    p50, p99 = 1e3 * np.percentile(times[:, 1] - times[:, 0], [50, 99])
    yield Row(
        f"{what}: rate, sd of period",
        "100 +- 0.5 Hz, <= 3 ms",
        f"{rate:.2f} Hz, {spread:.2f} ms",
        bool(abs(rate - 100.0) <= 0.5 and spread <= 3.0),
    )
    yield Row(
        f"{what}: latency to a rospy client p50 / p99",
        "<= 2 / 15 ms",
        f"{p50:.2f} / {p99:.2f} ms",
        bool(p50 <= 2.0 and p99 <= 15.0),
    )


def _connecting(uri: str) -> Row:
    topic, name, times_s = "/new", "std_msgs/String", []
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
    what = "new publisher connected, its start included: median / max"
    return Row(what, "<= 0.25 s", f"{median:.3f} / {worst:.3f} s", worst <= 0.25)


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} % of a core"


# Figures of the simulated Baxter


IK_TYPE = f"{CORE}/SolvePositionIK"
POSES = 300
MIDDLE_RAD = np.array([0.0, -0.6, 0.0, 0.75, 0.0, 1.2, 0.0])
SWING_RAD = np.array([0.2, 0.1, 0.2, 0.2, 0.2, 0.1, 0.3])


def _stamped(x: float, y: float, z: float) -> dict[str, object]:
    """A pose in base, the hand pointing down."""
    pose = {"position": {"x": x, "y": y, "z": z}, "orientation": {"y": 1.0, "w": 0.0}}
    return {"header": {"frame_id": "base"}, "pose": pose}


def simulated_baxter(duration_s: float) -> Iterator[Row]:
    """A process of its own, read by rospy, driven by our node."""
    begun_s = time.monotonic()
    with robot_process() as (uri, process), Node("/driver", master_uri=uri) as node:
        ready_s = time.monotonic() - begun_s
        yield Row("start to ready", "<= 5 s", f"{ready_s:.1f} s", ready_s <= 5.0)
        kinds = node.topics()
        states = sorted(n for n in kinds if n.startswith("/robot/") and n.endswith("state"))
        others = [name for name in states if node.publishers_of(name)][: len(STATES) - 1]
        read = {name: kinds[name] for name in (JOINT_STATES, *others)}
        with _classes() as classes, _moving(node), Reader(uri, read, classes) as reader:
            before, begun_s = _cpu_s(process), time.monotonic()
            time.sleep(duration_s)
            share = (_cpu_s(process) - before) / (time.monotonic() - begun_s)
            yield from _timing("joint_states", reader.end()[JOINT_STATES])
        what = f"CPU of the simulated Baxter, {len(read)} topics read, one arm driven"
        yield Row(what, "<= 20 % of a core", _percent(share), share <= 0.2)
        yield _asked(node)


@contextmanager
def _moving(node: Node) -> Iterator[None]:
    """Its left arm swings in free space inside the block."""
    enable = node.advertise("/robot/set_super_enable", "std_msgs/Bool")
    command = node.advertise(command_topic("left"), f"{CORE}/JointCommand")
    names, ended = list(Baxter.load().arm("left").joint_names), threading.Event()

    def drive() -> None:
        begin_s, tick = time.monotonic(), 0
        while not ended.wait(max(0.0, begin_s + tick * TICK_S - time.monotonic())):
            enable.send(data=True)
            q = MIDDLE_RAD + SWING_RAD * np.sin(TICK_S * tick)
            command.send(mode=1, names=names, command=q)
            tick += 1

    thread = threading.Thread(target=drive)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        command.close()
        enable.close()


def _asked(node: Node) -> Row:
    """Poses in front of the robot, some of which are out of reach."""
    rng, make, times_s, solved = np.random.default_rng(1), service_type(IK_TYPE).request.make, [], 0
    service = "/ExternalTools/left/PositionKinematicsNode/IKService"
    for x, y, z in rng.uniform((0.4, -0.2, -0.2), (0.9, 0.6, 0.4), (POSES, 3)).tolist():
        request = make(pose_stamp=[_stamped(x, y, z)])
        begun_s = time.perf_counter()
        solved += bool(node.call(service, IK_TYPE, request).isValid[0])
        times_s.append(time.perf_counter() - begun_s)
    median, most = 1e3 * np.median(times_s), 1e3 * max(times_s)
    return Row(
        f"IK service, {POSES} poses, {solved} of them solved: median / max",
        "<= 3 / 50 ms",
        f"{median:.1f} / {most:.1f} ms",
        bool(median <= 3.0 and most <= 50.0),
    )


def _cpu_s(process: int) -> float:
    """CPU time of a process, its threads included."""
    fields = Path(f"/proc/{process}/stat").read_text("utf-8").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / 100.0


# Figures of the executor


RUNS, STOPS = 20, 10
LAG_S = 0.4
SAME_PLACE_MM = 1.0
PAUSE_S = 0.13
LAGGING = ("--follow", "lag", "--lag-s", str(LAG_S))
LAG_ROWS = (
    (Pace(1.0), "0.22 rad, 37 mm"),
    (Pace(0.3), "0.093 rad, 8.2 mm"),
    (Pace(0.1), "0.035 rad, 1.2 mm"),
    (Pace(1.0, LAG_S), "0.021 rad, 1.4 mm"),
    (Pace(0.5, LAG_S), "0.004 rad, 0.2 mm"),
)
"""Paces, and how far the prototype was off: joint and tip."""


def executor(duration_s: float) -> Iterator[Row]:
    """The executor drives a simulated Baxter; fewer runs where less than ten seconds are given."""
    runs, stops = (RUNS, STOPS) if duration_s >= 10.0 else (2, 2)
    stage = _Stage()
    yield from _exact(stage, runs)
    yield from _lagging(stage)
    yield _stopped(stage, stops)
    yield _paused(stage)


class _Stage:
    """The demo's plan, and where it puts the block in a simulation."""

    def __init__(self) -> None:
        robot = Baxter.load()
        world, arm = World(robot), robot.arm("left")
        simulation = Simulation(world)
        for body in demo_bodies("left"):
            simulation.spawn(body)
        world.move_arm("left", arm.start)
        manipulator = Manipulator.of(robot, "left", q_others=world.q)
        task = PickAndPlace(BLOCK, overhead((0.7, 0.15, -0.129)), overhead((0.75, 0.0, -0.129)))
        self.plan: Plan = plan_pick_and_place(task, manipulator, world.scene, arm.start)
        simulation.execute(self.plan, unverified=True)
        self.block_m = world.body(BLOCK).T_base_body.translation

    def run(
        self, pace: Pace, *robot_options: str, during: Callable[[], None] = lambda: None
    ) -> tuple[MeasuredOutcome, float, int]:
        """One execution: outcome, distance of the block from its place, mm, and number of hits."""
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / "robot.mcap"
            with (
                robot_process("--record", str(log), *robot_options) as (uri, _),
                linked(uri) as link,
            ):
                thread = threading.Thread(target=during)
                run = RosExecutor(link, options=ExecutionOptions(pace, Dwell(0.5, 0.5)))
                try:
                    # from where a new robot stands, so that the plan alone is measured
                    RosExecutor(link).execute(evolve(self.plan, steps=()))
                    ready = run.prepare(self.plan).ready or self.plan
                    thread.start()
                    outcome = run.execute(ready)
                    thread.join()
                except SimulationError as cause:  # as on a busy computer
                    outcome = MeasuredOutcome(str(cause), 0.0)
                time.sleep(0.3)
            recording = read_recording(log).recording
        hits = sum(event.kind.name == "HIT" for event in recording.events)
        off_m = np.abs(recording.body_poses[BLOCK][-1][:3] - self.block_m).max()
        return outcome, 1e3 * float(off_m), hits


@contextmanager
def linked(uri: str) -> Iterator[BaxterLink]:
    """A link to the robot of a master, by a node of its own."""
    with Node("/baxter_kin", master_uri=uri, host=LOOPBACK) as node, BaxterLink(node) as link:
        yield link


def _exact(stage: _Stage, runs: int) -> Iterator[Row]:
    found = [stage.run(Pace(1.0 if index % 2 else 0.3)) for index in range(runs)]
    outcomes = [outcome for outcome, _, _ in found]
    worst = max(off if outcome.is_success else np.inf for outcome, off, _ in found)
    yield Row(
        f"block within {SAME_PLACE_MM:g} mm of the simulation's, speeds 0.3 and 1",
        f"{runs} of {runs}",
        f"{worst:.3f} mm at most",
        worst <= SAME_PLACE_MM,
    )
    median = 1e3 * float(np.median([outcome.lateness_s[0] for outcome in outcomes]))
    late = 1e3 * max(outcome.lateness_s[1] for outcome in outcomes)
    yield Row(
        "joint_command lateness p50 / p99",
        "<= 1 / 20 ms",
        f"{median:.2f} / {late:.1f} ms, the worst of {runs} runs",
        median <= 1.0 and late <= 20.0,
    )
    for which, chosen in (("0.3", outcomes[::2]), ("1", outcomes[1::2])):
        joints = [outcome.joint_deviation_rad for outcome in chosen]
        tips_mm = [1e3 * outcome.tip_deviation_m for outcome in chosen]
        joint, tip_mm = float(np.median(joints)), float(np.median(tips_mm))
        yield Row(
            f"deviation at speed {which}, exact: joint / tip off path",
            "<= 0.03 rad / 0.2 mm" if which == "0.3" else "",
            f"{joint:.4f} rad / {tip_mm:.2f} mm, median of {len(chosen)} runs; the worst "
            f"{max(joints):.4f} rad / {max(tips_mm):.2f} mm",
            (joint <= 0.03 and tip_mm <= 0.2) if which == "0.3" else None,
        )


def _lagging(stage: _Stage) -> Iterator[Row]:
    """At full speed without a lead the guard has to stop the arm, before it hits anything."""
    for pace, known in LAG_ROWS:
        outcome, off_mm, hits = stage.run(pace, *LAGGING)
        is_stop_due = pace == Pace(1.0)
        how = outcome.failure or f"block {off_mm:.2f} mm off"
        is_met = not outcome.is_success and not hits if is_stop_due else outcome.is_success
        yield Row(
            f"lag {LAG_S} s, speed {pace.speed:g}, lead {pace.lead_s:g} s: joint / tip off path",
            f"{'guard stops, no hit' if is_stop_due else 'guard silent'}; prototype {known}",
            f"{outcome.joint_deviation_rad:.3f} rad / {1e3 * outcome.tip_deviation_m:.1f} mm, "
            f"{how}",
            is_met,
        )


def _stopped(stage: _Stage, runs: int) -> Row:
    delays_s = []
    for _ in range(runs):
        with (
            robot_process() as (uri, _),
            linked(uri) as link,
            Node("/other", master_uri=uri, host=LOOPBACK) as other,
        ):
            delays_s.append(_stop_delay_s(stage, link, other))
    worst_ms = 1e3 * max(delays_s)
    measured = f"{worst_ms:.1f} ms, the worst of {runs}"
    return Row("stop message to last command", "<= 30 ms", measured, worst_ms <= 30.0)


def _stop_delay_s(stage: _Stage, link: BaxterLink, other: Node) -> float:
    """From the first state that says stopped to the last set-point; infinite if that failed."""
    sent, stopped = list[float](), list[float]()
    other.subscribe(command_topic("left"), f"{CORE}/JointCommand", lambda r: sent.append(r.time_s))
    other.subscribe(
        STATE,
        f"{CORE}/AssemblyState",
        lambda r: stopped.append(r.time_s) if r.message.stopped else None,
    )

    def stop() -> None:
        while len(sent) < 100:
            time.sleep(TICK_S)
        publisher = other.advertise("/robot/set_super_stop", "std_msgs/Empty")
        while not stopped:
            publisher.send()
            time.sleep(TICK_S)

    threading.Thread(target=stop, daemon=True).start()
    options = ExecutionOptions(Pace(0.5), Dwell(0.0, 0.0))
    try:
        outcome = RosExecutor(link, options=options).execute(stage.plan)
    except SimulationError:
        return np.inf
    time.sleep(0.2)
    is_stopped = outcome.stop is not None and outcome.stop.cause is StopCause.STOPPED
    return max(0.0, sent[-1] - stopped[0]) if is_stopped else np.inf


def _paused(stage: _Stage) -> Row:
    """The whole process stands still for a while, as on a busy computer."""

    def pause() -> None:
        time.sleep(3.0)
        stop, go = (f"kill -{name} {os.getpid()}" for name in (signal.SIGSTOP.name[3:], "CONT"))
        subprocess.run(["sh", "-c", f"{stop}; sleep {PAUSE_S}; {go}"], check=True)

    outcome, off_mm, _ = stage.run(Pace(0.5), during=pause)
    late_ms = 1e3 * outcome.lateness_s[2]
    measured = outcome.failure or f"{late_ms:.0f} ms late at most, block {off_mm:.3f} mm off"
    is_met = outcome.is_success and late_ms > 1e3 * PAUSE_S * 0.8
    return Row(f"a pause of {1e3 * PAUSE_S:.0f} ms", "survived", measured, is_met)


PARTS: dict[str, Callable[[float], Iterator[Row]]] = {
    "interface": interface,
    "md5": sums,
    "node": node_alone,
    "baxter": simulated_baxter,
    "executor": executor,
}
"""What is measured, by name; each is given for how long."""

if __name__ == "__main__":
    sys.exit(main())
