"""Drive the simulated Baxter for an hour as the original demo does; print its memory and rates.

Starts `python -m sim.ros1.robot` in a process of its own and does what the original demo does, in a
client of our own: joint commands at 100 Hz that creep towards what the IK service answered, gripper
commands, a second of rest after each. Prints a line a minute, and at the end by how much the
robot's memory grew and how far its rate of joint states drifted from 100 Hz. The exit status is 1
if the memory grew by more than `MAX_GROWTH_MB` or the arm made no move.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
from measure_ros1 import IK_TYPE, LOOPBACK, robot_process

from sim.ros1.definitions import service_type
from sim.ros1.node import Node, Received

SIDE = "left"
JOINTS = tuple(f"{SIDE}_{name}" for name in ("s0", "s1", "e0", "e1", "w0", "w1", "w2"))
START = (-0.0800, -1.0000, -1.1900, 1.9400, 0.6700, 1.0300, -0.5000)
DOWN = dict(zip("xyzw", (-0.02495896, 0.99964940, 0.00737918, 0.00486451), strict=True))
BLOCKS = ((0.70, 0.15, -0.129), (0.75, 0.00, -0.129))
HOVER_M, NEAR_RAD, TIMEOUT_S, DWELL_S, PERIOD_S = 0.15, 0.0087, 15.0, 1.0, 0.01
CREEP = 0.0125
"""Share of the way from the last command to the goal per command."""

MAX_GROWTH_MB = 15.0
"""From the fifth minute on; it was 1.3 MB in an hour."""


class Watch:
    """The joint states that the robot publishes."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self.q: dict[str, float] = {}

    def heard(self, received: Received) -> None:
        """Store one message."""
        self.times.append(received.time_s)
        self.q.update(zip(received.message.name, received.message.position, strict=True))

    def minute(self) -> tuple[float, float, float]:
        """Rate, standard deviation and longest of the periods since the last call: Hz, ms, ms."""
        times, self.times = self.times, self.times[-1:]
        periods = np.diff(times)
        return float(1.0 / periods.mean()), 1e3 * float(periods.std()), 1e3 * float(periods.max())


class Demo:
    """Repeats pick and place as the original demo does."""

    def __init__(self, node: Node, watch: Watch) -> None:
        self._watch, self._node, self._sequence = watch, node, itertools.count(1)
        limb, hand = f"/robot/limb/{SIDE}", f"/robot/end_effector/{SIDE}_gripper"
        self._joints = node.advertise(f"{limb}/joint_command", "baxter_core_msgs/JointCommand")
        self._fingers = node.advertise(
            f"{hand}/command", "baxter_core_msgs/EndEffectorCommand", queue=100
        )
        self._enable = node.advertise("/robot/set_super_enable", "std_msgs/Bool")
        self._ik = f"/ExternalTools/{SIDE}/PositionKinematicsNode/IKService"
        node.wait_for_service(self._ik, 5.0)
        self.moves = self.timeouts = self.unsolved = 0

    def cycles(self, until_s: float) -> None:
        """Pick at one pose and place at the next until a time."""
        for _ in range(20):
            self._enable.publish(self._enable.type.make(data=True))
            time.sleep(0.05)
        self._go(START)
        self._grip(100.0)
        for number in itertools.count():
            for pose, percent in zip((number, number + 1), (0.0, 100.0), strict=True):
                if time.monotonic() > until_s:
                    return
                self._visit(BLOCKS[pose % len(BLOCKS)], percent)

    def _visit(self, position: tuple[float, float, float], percent: float) -> None:
        x, y, z = position
        self._reach(x, y, z + HOVER_M)
        self._reach(x, y, z)
        self._grip(percent)
        self._reach(x, y, z + HOVER_M)

    def _reach(self, x: float, y: float, z: float) -> None:
        pose = {"position": {"x": x, "y": y, "z": z}, "orientation": DOWN}
        stamped = {"header": {"frame_id": "base"}, "pose": pose}
        request = service_type(IK_TYPE).request.make(pose_stamp=[stamped])
        answer = self._node.call(self._ik, IK_TYPE, request)
        if not answer.isValid[0]:
            self.unsolved += 1
            return
        solution = dict(zip(answer.joints[0].name, answer.joints[0].position, strict=True))
        self._go([solution[name] for name in JOINTS])

    def _go(self, goal: Any) -> None:
        self.moves += 1
        wanted, command = np.array(goal), self._measured()
        begun = due = time.monotonic()
        while np.abs(self._measured() - wanted).max() > NEAR_RAD:
            if time.monotonic() > begun + TIMEOUT_S:
                self.timeouts += 1
                return
            command = CREEP * wanted + (1.0 - CREEP) * command
            make = self._joints.type.make
            self._joints.publish(make(mode=1, names=list(JOINTS), command=command))
            due += PERIOD_S
            time.sleep(max(0.0, due - time.monotonic()))

    def _measured(self) -> Any:
        return np.array([self._watch.q[name] for name in JOINTS])

    def _grip(self, percent: float) -> None:
        fields = {"id": 131073, "command": "go", "args": f'{{"position": {percent}}}'}
        number = next(self._sequence)
        make = self._fingers.type.make
        self._fingers.publish(make(sender=self._node.name, sequence=number, **fields))
        time.sleep(DWELL_S)


def memory_mb(process: int) -> float:
    """Resident memory of a process."""
    status = Path(f"/proc/{process}/status").read_text("utf-8")
    line = next(line for line in status.splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1024.0


def watched(demo: Demo, watch: Watch, robot: int, minutes: int) -> bool:
    """Run the demo and print a line a minute; returns whether memory and moves are as expected."""
    until_s = time.monotonic() + 60.0 * minutes
    traffic = Thread(target=demo.cycles, args=(until_s,), daemon=True)
    traffic.start()
    memories, rates = [], []
    print("minute  rate Hz   sd ms  max ms  memory MB  moves  time-outs  unsolved")
    for minute in range(1, minutes + 1):
        time.sleep(60.0)
        rate, sd, longest = watch.minute()
        rates.append(rate)
        memories.append(memory_mb(robot))
        numbers = f"{minute:6}  {rate:7.3f}  {sd:6.2f}  {longest:6.1f}  {memories[-1]:9.1f}"
        print(f"{numbers}  {demo.moves:5}  {demo.timeouts:9}  {demo.unsolved:8}", flush=True)
    traffic.join()
    settled = min(5, len(memories))
    first, last = memories[settled - 1], memories[-1]
    print(f"memory: {first:.1f} MB after {settled} minutes, {last:.1f} at the end")
    print(f"rate: {min(rates):.3f} .. {max(rates):.3f} Hz, at the end {rates[-1]:.3f}")
    return last - first <= MAX_GROWTH_MB and demo.moves > 0


def main() -> int:
    """Start a simulated Baxter and the traffic."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--minutes", type=int, default=60)
    minutes = parser.parse_args().minutes
    with robot_process() as (uri, robot), Node("/soak", master_uri=uri, host=LOOPBACK) as node:
        watch = Watch()
        node.subscribe("/robot/joint_states", "sensor_msgs/JointState", watch.heard)
        demo = Demo(node, watch)
        time.sleep(2.0)
        return 0 if watched(demo, watch, robot, minutes) else 1


if __name__ == "__main__":
    sys.exit(main())
