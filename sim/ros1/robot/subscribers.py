"""Subscribers: messages to the simulated Baxter, processed between two ticks in their order.

An invalid message is ignored whole, counted, and reported at most once a second for a topic and its
sender.
"""

from __future__ import annotations

import math
import time
from collections import Counter, deque
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial

from baxter_kin.kinematics.arm import LIMBS
from sim.ros1.node import Node, Received
from sim.ros1.robot.arm_motion import BadOrderError
from sim.ros1.robot.baxter import SimulatedBaxter
from sim.ros1.robot.gripper import GripperOrder
from sim.ros1_messages import Message

CORE = "baxter_core_msgs"
PRESS_TOPIC = "/robot/sim/press"
"""Our own, `std_msgs/String`: "left ok", "right cuff", "left estop", "left release"."""

MAX_WAITING = 10_000
"""Messages that may wait for a tick; beyond that the oldest are dropped."""

MIN_PERIOD_S = 1.0
"""Between two reports on one topic and sender."""

MAX_KNOWN = 1000
"""Number of topics and senders that are remembered, as senders may have any names."""

Act = Callable[[Message], object]
"""Executes a message; returns a phrase for each value that was clipped, if any."""


class Diagnostics:
    """Invalid messages so far.

    Attributes:
        counts: how many, by topic.
    """

    def __init__(self, report: Callable[[str], object]) -> None:
        """Begin without any; `report` is called with each line of text."""
        self.counts: Counter[str] = Counter()
        self._report = report
        self._reported_s: dict[tuple[str, str], float] = {}
        self._unreported: Counter[tuple[str, str]] = Counter()

    def add(self, topic: str, sender: str, text: str, time_s: float) -> None:
        """Count an invalid message, and report it unless the last report was just before.

        Args:
            topic: the topic of the message.
            sender: the node that sent it.
            text: what is wrong.
            time_s: now.
        """
        self.counts[topic] += 1
        key = topic, sender
        if time_s - self._reported_s.get(key, -math.inf) < MIN_PERIOD_S:
            self._unreported[key] += 1
            return
        if len(self._reported_s) >= MAX_KNOWN:
            self._reported_s.clear()
            self._unreported.clear()
        self._reported_s[key] = time_s
        more = self._unreported.pop(key, 0)
        since = f" ({more} more since the last time)" if more else ""
        self._report(f"{topic} from {sender or 'nobody'}: {text}{since}")


class Subscribers:
    """All topics that the robot subscribes to."""

    def __init__(self, baxter: SimulatedBaxter, node: Node, diagnostics: Diagnostics) -> None:
        """Subscribe by a node."""
        self._baxter, self._node, self._diagnostics = baxter, node, diagnostics
        self._waiting: deque[tuple[float, Callable[[], None]]] = deque(maxlen=MAX_WAITING)
        self._subscribe_to_robot()
        for side in LIMBS:
            self._subscribe_to_limb(side)
            self._subscribe_to_hand(side)

    def between_ticks(self, act: Callable[[], None]) -> Future[None]:
        """Call a function between two ticks, in the thread that ticks."""
        done: Future[None] = Future()

        def do() -> None:
            if not done.set_running_or_notify_cancel():
                return
            try:
                act()
            except Exception as cause:  # raised to the one that waits for the result
                done.set_exception(cause)
            else:
                done.set_result(None)

        self._waiting.append((time.monotonic(), do))
        return done

    def process(self, until_s: float = math.inf) -> None:
        """Process what has arrived since the last time, up to a time on the monotonic clock."""
        for _ in range(len(self._waiting)):
            if self._waiting[0][0] > until_s:
                return
            _, act = self._waiting.popleft()
            act()

    def _on(self, topic: str, type_name: str, act: Act) -> None:
        def wait(received: Received) -> None:
            self._waiting.append(
                (received.time_s, partial(self._process_one, topic, act, received))
            )

        self._node.subscribe(topic, type_name, wait)

    def _process_one(self, topic: str, act: Act, received: Received) -> None:
        try:
            clipped = act(received.message)
        except BadOrderError as cause:
            self._report(topic, received.sender, str(cause))
        else:
            if isinstance(clipped, tuple) and clipped:
                self._report(topic, received.sender, "; ".join(clipped))

    def _report(self, topic: str, sender: str, text: str) -> None:
        self._diagnostics.add(topic, sender, text, self._baxter.time_s)

    def _subscribe_to_robot(self) -> None:
        baxter, panel, head = self._baxter, self._baxter.panel, "/robot/head/command_head"
        self._on("/robot/set_super_enable", "std_msgs/Bool", self._enable)
        self._on("/robot/set_super_reset", "std_msgs/Empty", lambda _: baxter.reset())
        self._on("/robot/set_super_stop", "std_msgs/Empty", lambda _: baxter.stop())
        self._on(f"{head}_pan", f"{CORE}/HeadPanCommand", lambda m: baxter.order_head(m.target))
        self._on(f"{head}_nod", "std_msgs/Bool", lambda m: baxter.nod() if m.data else None)
        self._on(
            "/robot/digital_io/command",
            f"{CORE}/DigitalOutputCommand",
            lambda m: panel.set_output(m.name, m.value),
        )
        self._on(
            "/robot/analog_io/command",
            f"{CORE}/AnalogOutputCommand",
            lambda m: panel.set_analog(m.name, m.value),
        )
        self._on(PRESS_TOPIC, "std_msgs/String", self._press)

    def _enable(self, message: Message) -> None:
        if message.data:
            self._baxter.enable()
        else:
            self._baxter.disable()

    def _press(self, message: Message) -> None:
        side, _, button = message.data.partition(" ")
        self._baxter.press(side, button)

    def _subscribe_to_limb(self, side: str) -> None:
        baxter, arm, limb = self._baxter, self._baxter.arms[side], f"/robot/limb/{side}"
        self._on(
            f"{limb}/joint_command",
            f"{CORE}/JointCommand",
            lambda m: baxter.order_joints(side, m.mode, m.names, m.command.tolist()),
        )
        number = "std_msgs/Float64"
        self._on(f"{limb}/set_speed_ratio", number, lambda m: arm.set_speed_ratio(m.data))
        self._on(f"{limb}/joint_command_timeout", number, lambda m: arm.set_timeout(m.data))
        self._on(
            f"{limb}/suppress_collision_avoidance",
            "std_msgs/Empty",
            lambda _: baxter.assembly.suppress_collision_avoidance(baxter.time_s),
        )
        feed_forward = "trajectory_msgs/JointTrajectoryPoint"  # of torques; nothing has a mass
        self._on(f"{limb}/inverse_dynamics_command", feed_forward, lambda _: None)

    def _subscribe_to_hand(self, side: str) -> None:
        hand = f"/robot/end_effector/{side}_gripper"

        def order(m: Message) -> None:
            self._baxter.order_gripper(side, GripperOrder(m.command, m.args, m.sender, m.sequence))

        self._on(f"{hand}/command", f"{CORE}/EndEffectorCommand", order)
        for what, kind in (("properties", "EndEffectorProperties"), ("state", "EndEffectorState")):
            self._on(f"{hand}/rsdk/set_{what}", f"{CORE}/{kind}", _refuse_custom)


def _refuse_custom(_: Message) -> None:
    raise BadOrderError("custom end effectors are not simulated; the hand stays as it is")
