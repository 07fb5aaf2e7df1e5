"""A small Baxter written from the description of its interface alone, which misbehaves on demand.

It shares nothing with the simulated Baxter of `sim.ros1.robot`: the executor's other side in tests.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from sim.ros1.definitions import message_type
from tests.sim.ros1.execution.clock import TICK_S

SIDES = "left", "right"
NAMES = tuple(f"{side}_{j}" for side in SIDES for j in ["s0", "s1", "e0", "e1", "w0", "w1", "w2"])
CAPS = dict.fromkeys(["s0", "s1", "e0", "e1"], 2.0) | dict.fromkeys(["w0", "w1", "w2"], 4.0)
FINGER_PERCENT_S = 200.0


@dataclass
class Faults:
    """What goes wrong, from the moment it is set.

    Attributes:
        silent_joints: no joint states come any more.
        stuck: the arm does not follow.
        push: joint -> rad that are added each second, whatever is commanded.
        block_percent: where closing fingers meet something; None for nothing between them.
        missing: the hand between whose fingers there is nothing.
        finger_percent_s: how fast fingers are.
        deaf_gripper: commands to the grippers are ignored.
    """

    silent_joints: bool = False
    stuck: bool = False
    push: dict[str, float] = field(default_factory=dict)
    block_percent: float | None = 89.0
    missing: str = ""
    finger_percent_s: float = FINGER_PERCENT_S
    deaf_gripper: bool = False


@dataclass
class FakeHand:
    """An electric gripper, and the last command that it accepted, with its sender."""

    percent: float = 100.0
    goal: float = 100.0
    gripping: bool = False
    moving: bool = False
    echo: tuple[str, int] = ("", 0)


class FakeRobot:
    """Both arms of a Baxter, with a gripper each.

    Attributes:
        q: where the joints are, by name, rad.
        commands: (time of arrival, set-point by name) of all that came.
        ratios: the speed ratios that came.
        told_s: when a state was first published that says what `tell` was told.
        every: joint states come at every such tick.
        gripper_commands: those that came to either gripper.
        gripper_fields: what the grippers say beside their positions.
        sag: joint -> by how much it is measured below its set-point.
    """

    def __init__(
        self, node: Any, q: Mapping[str, float], *, lag_s: float = 0.0, urdf: str = ""
    ) -> None:
        self.clock = node.bus.clock
        self.node, self.q, self.lag_s = node, dict.fromkeys(NAMES, 0.0) | dict(q), lag_s
        self.goal = dict(self.q)
        self.v = dict.fromkeys(NAMES, 0.0)
        self.faults = Faults()
        self.state: dict[str, Any] = {"ready": True, "enabled": False}
        self.hands = {side: FakeHand() for side in SIDES}
        self.commands: list[tuple[float, dict[str, float]]] = []
        self.gripper_commands: list[Any] = []
        self.ratios: list[float] = []
        self.enables = 0
        self.told_s = math.inf
        self.sag: dict[str, float] = {}
        self.every, self._ticks = 1, 0
        self.gripper_fields: dict[str, Any] = {"id": 131073, "calibrated": 1, "ready": 1}
        node.set_parameter("/rethink/software_version", "1.2.0")
        node.set_parameter("/robot_description", urdf)
        self._ends = self._advertised()
        self._listen()
        self.clock.on_tick.append(self.tick)

    def __enter__(self) -> FakeRobot:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        if self.tick in self.clock.on_tick:
            self.clock.on_tick.remove(self.tick)
        self.node.close()

    def tell(self, **state: Any) -> None:
        """Publish a state at once, with some fields changed."""
        self.state |= state
        self.told_s = self.clock.now_s
        self._say("/robot/state", **self.state)

    def _advertised(self) -> dict[str, tuple[Any, Any]]:
        topics = {
            "/robot/joint_states": "sensor_msgs/JointState",
            "/robot/state": "baxter_core_msgs/AssemblyState",
        }
        for side in SIDES:
            hand = f"/robot/end_effector/{side}_gripper"
            topics[f"{hand}/state"] = "baxter_core_msgs/EndEffectorState"
            topics[f"{hand}/properties"] = "baxter_core_msgs/EndEffectorProperties"
        return {
            topic: (self.node.advertise(topic, kind), message_type(kind))
            for topic, kind in topics.items()
        }

    def _listen(self) -> None:
        for side in SIDES:
            limb = f"/robot/limb/{side}"
            self.node.subscribe(
                f"{limb}/joint_command", "baxter_core_msgs/JointCommand", self._hear_command
            )
            self.node.subscribe(
                f"{limb}/set_speed_ratio",
                "std_msgs/Float64",
                lambda heard: self.ratios.append(heard.message.data),
            )
            self.node.subscribe(
                f"/robot/end_effector/{side}_gripper/command",
                "baxter_core_msgs/EndEffectorCommand",
                partial(self._hear_gripper, self.hands[side]),
            )
        self.node.subscribe("/robot/set_super_enable", "std_msgs/Bool", self._hear_enable)

    def _hear_enable(self, heard: Any) -> None:
        self.enables += 1
        if not self.state.get("stopped"):
            self.state["enabled"] = bool(heard.message.data)

    def _hear_command(self, heard: Any) -> None:
        asked = dict(zip(heard.message.names, map(float, heard.message.command), strict=True))
        self.commands.append((self.clock.now_s, asked))
        if self.state["enabled"]:
            self.goal |= asked

    def _hear_gripper(self, hand: FakeHand, heard: Any) -> None:
        told = heard.message
        self.gripper_commands.append(told)
        if not self.faults.deaf_gripper:
            hand.echo = (told.sender, told.sequence)
            hand.goal, hand.moving = json.loads(told.args)["position"], True
            hand.gripping = False

    def tick(self) -> None:
        """Move on for `TICK_S`, and report."""
        self._move_arms(TICK_S)
        for side, hand in self.hands.items():
            block = None if side == self.faults.missing else self.faults.block_percent
            self._move_fingers(hand, block, TICK_S)
        self._publish()

    def _move_arms(self, passed_s: float) -> None:
        ratio = self.ratios[-1] if self.ratios else 0.3
        for name in NAMES:
            before = self.q[name]
            step = self.goal[name] - before
            if self.lag_s:
                step *= 1.0 - math.exp(-passed_s / self.lag_s)
            most = CAPS[name.split("_")[1]] * ratio * passed_s
            step = 0.0 if self.faults.stuck else max(-most, min(most, step))
            self.q[name] = before + step + passed_s * self.faults.push.get(name, 0.0)
            self.v[name] = (self.q[name] - before) / max(passed_s, 1e-6)

    def _move_fingers(self, hand: FakeHand, block: float | None, passed_s: float) -> None:
        if not hand.moving:
            return
        step, goal = self.faults.finger_percent_s * passed_s, hand.goal
        if block is not None and goal < block <= hand.percent:
            goal = block
        off = goal - hand.percent
        hand.percent += max(-step, min(step, off))
        if hand.percent == goal:
            hand.moving, hand.gripping = False, goal == block and goal != hand.goal

    def _publish(self) -> None:
        self._ticks += 1
        if not self.faults.silent_joints and self._ticks % self.every == 0:
            names = list(NAMES)
            self._say(
                "/robot/joint_states",
                name=names,
                position=[self.q[name] - self.sag.get(name, 0.0) for name in names],
                velocity=[self.v[name] for name in names],
                effort=[0.0] * len(names),
            )
        self._say("/robot/state", **self.state)
        for side, hand in self.hands.items():
            topic = f"/robot/end_effector/{side}_gripper"
            self._say(
                f"{topic}/state",
                **self.gripper_fields,
                moving=int(hand.moving),
                gripping=int(hand.gripping),
                position=hand.percent,
                command_sender=hand.echo[0],
                command_sequence=hand.echo[1],
            )
            self._say(f"{topic}/properties", ui_type=2)

    def _say(self, topic: str, **values: Any) -> None:
        publisher, kind = self._ends[topic]
        publisher.publish(kind.make(**values))
