"""Figures of the simulated Baxter: a process of its own, read by rospy, driven by our node."""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from baxter_kin import Baxter
from ros1_figures.figure import Figure, Reader
from ros1_figures.robot_process import robot_process
from sim.ros1.definitions import MESSAGES, SERVICES, service_type
from sim.ros1.node import Node
from tests.sim.ros1.debian import generate_classes

TOPICS = 26
JOINT_STATES = "/robot/joint_states"
COMMAND = "/robot/limb/left/joint_command"
IK = "/ExternalTools/left/PositionKinematicsNode/IKService"
IK_TYPE = "baxter_core_msgs/SolvePositionIK"
POSES = 300
STARTED_S = 5.0
TICK_S = 0.01
MIDDLE_RAD = np.array([0.0, -0.6, 0.0, 0.75, 0.0, 1.2, 0.0])
SWING_RAD = np.array([0.2, 0.1, 0.2, 0.2, 0.2, 0.1, 0.3])
DOWN = {"y": 1.0, "w": 0.0}


def figures(duration_s: float) -> Iterator[Figure]:
    """Measure one after the other, each for so long."""
    begun_s = time.monotonic()
    with robot_process() as (uri, process), Node("/driver", master_uri=uri) as node:
        ready_s = time.monotonic() - begun_s
        yield Figure("start to ready", "<= 5 s", f"{ready_s:.1f} s", ready_s <= STARTED_S)
        with tempfile.TemporaryDirectory() as folder:
            generate_classes(Path(folder), MESSAGES, SERVICES)
            yield from _driven(node, process, Path(folder), duration_s)
        yield _asked(node)


def _driven(node: Node, process: int, classes: Path, duration_s: float) -> Iterator[Figure]:
    kinds = node.topics()
    states = sorted(name for name in kinds if name.startswith("/robot/") and name.endswith("state"))
    others = [name for name in states if node.publishers_of(name)]
    read = {name: kinds[name] for name in (JOINT_STATES, *others[: TOPICS - 1])}
    with _moving(node), Reader(node.master_uri, read, classes) as reader:
        before, begun_s = _cpu_s(process), time.monotonic()
        time.sleep(duration_s)
        share = (_cpu_s(process) - before) / (time.monotonic() - begun_s)
        times = np.array(reader.end()[JOINT_STATES])
    rate = (len(times) - 1) / (times[-1, 1] - times[0, 1])
    spread = 1e3 * float(np.diff(times[:, 0]).std())
    p50, p99 = 1e3 * np.percentile(times[:, 1] - times[:, 0], [50, 99])
    yield Figure(
        "joint_states of the simulated Baxter: rate, sd of period",
        "100 +- 0.5 Hz, <= 3 ms",
        f"{rate:.2f} Hz, {spread:.2f} ms",
        bool(abs(rate - 100.0) <= 0.5 and spread <= 3.0),
    )
    yield Figure(
        "its latency to a rospy client p50 / p99",
        "<= 2 / 15 ms",
        f"{p50:.2f} / {p99:.2f} ms",
        bool(p50 <= 2.0 and p99 <= 15.0),
    )
    yield Figure(
        f"its CPU, {len(read)} topics read, one arm driven",
        "<= 20 % of a core",
        f"{100.0 * share:.1f} %",
        share <= 0.2,
    )


@contextmanager
def _moving(node: Node) -> Iterator[None]:
    """Its left arm swings in free space meanwhile."""
    enable = node.advertise("/robot/set_super_enable", "std_msgs/Bool")
    command = node.advertise(COMMAND, "baxter_core_msgs/JointCommand")
    names, ended = list(Baxter.load().arm("left").joint_names), threading.Event()

    def drive() -> None:
        due_s, number = time.monotonic(), 0
        while not ended.is_set():
            enable.send(data=True)
            q = MIDDLE_RAD + SWING_RAD * np.sin(TICK_S * number)
            command.send(mode=1, names=names, command=q)
            due_s, number = due_s + TICK_S, number + 1
            time.sleep(max(0.0, due_s - time.monotonic()))

    thread = threading.Thread(target=drive)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        command.close()
        enable.close()


def _asked(node: Node) -> Figure:
    """Poses before the robot, of which some are out of reach."""
    rng, make, times_s, solved = np.random.default_rng(1), service_type(IK_TYPE).request.make, [], 0
    for x, y, z in rng.uniform((0.4, -0.2, -0.2), (0.9, 0.6, 0.4), (POSES, 3)).tolist():
        pose = {"position": {"x": x, "y": y, "z": z}, "orientation": DOWN}
        request = make(pose_stamp=[{"header": {"frame_id": "base"}, "pose": pose}])
        begun_s = time.perf_counter()
        solved += bool(node.call(IK, IK_TYPE, request).isValid[0])
        times_s.append(time.perf_counter() - begun_s)
    median, most = 1e3 * np.median(times_s), 1e3 * max(times_s)
    return Figure(
        f"IK service, {POSES} poses, {solved} of them solved: median / max",
        "<= 3 / 50 ms",
        f"{median:.1f} / {most:.1f} ms",
        bool(median <= 3.0 and most <= 50.0),
    )


def _cpu_s(process: int) -> float:
    """What a process has computed so far, its threads included."""
    fields = Path(f"/proc/{process}/stat").read_text("utf-8").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / 100.0
