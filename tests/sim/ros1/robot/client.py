"""A client of a simulated Baxter: our node, and what it has heard."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

import pinocchio as pin

from baxter_kin.frames import quaternion_xyzw
from sim.ros1.definitions import message_type, service_type
from sim.ros1.node import Node
from tests.sim.ros1.processes import until

CORE = "baxter_core_msgs"
IK = f"{CORE}/SolvePositionIK"


class Client:
    """Says and hears by name of topic."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.heard: dict[str, list[Any]] = defaultdict(list)
        self._heard_of: set[str] = set()
        self._publishers: dict[str, Any] = {}

    def listen(self, topic: str, kind: str) -> list[Any]:
        """All that comes on a topic from now on, of who publishes it by now."""
        if topic not in self._heard_of:
            self._heard_of.add(topic)
            heard = self.heard[topic]
            found = self.node.subscribe(topic, kind, lambda got: heard.append(got.message))
            until(lambda: {*self.node.publishers_of(topic)} <= {*found.writers})
        return self.heard[topic]

    def now(self, topic: str, kind: str) -> Any:
        """What a topic says after now; the one after the next, which may be on its way."""
        heard = self.listen(topic, kind)
        count = len(heard)
        until(lambda: len(heard) >= count + 2)
        return heard[-1]

    def until(self, topic: str, kind: str, is_so: Callable[[Any], Any]) -> Any:
        """The first message after now of which something is so."""
        return until(lambda: is_so(now := self.now(topic, kind)) and now)

    def say(self, topic: str, kind: str, **values: Any) -> None:
        """Publish once the robot listens."""
        if topic not in self._publishers:
            self._publishers[topic] = self.node.advertise(topic, kind, queue=100)
        publisher = self._publishers[topic]
        until(lambda: publisher.readers)
        publisher.publish(message_type(kind).make(**values))

    def call(self, service: str, kind: str, **values: Any) -> Any:
        return self.node.call(service, kind, service_type(kind).request.make(**values))

    @property
    def state(self) -> Any:
        return self.now("/robot/state", f"{CORE}/AssemblyState")

    def enable(self) -> None:
        """As the original does: until the state agrees."""

        def is_enabled() -> bool:
            self.say("/robot/set_super_enable", "std_msgs/Bool", data=True)
            return bool(self.state.enabled)

        until(is_enabled)

    def joints(self, side: str = "left") -> dict[str, float]:
        message = self.now("/robot/joint_states", "sensor_msgs/JointState")
        pairs = zip(message.name, message.position.tolist(), strict=True)
        return {name: value for name, value in pairs if name.startswith(f"{side}_")}

    def gripper(self, side: str = "left") -> Any:
        return self.now(f"/robot/end_effector/{side}_gripper/state", f"{CORE}/EndEffectorState")

    def command_gripper(self, command: str, args: str = "", sequence: int = 1) -> None:
        self.say(
            "/robot/end_effector/left_gripper/command",
            f"{CORE}/EndEffectorCommand",
            id=131073,
            command=command,
            args=args,
            sender="/client",
            sequence=sequence,
        )

    def send(self, joints: dict[str, float], mode: int = 1) -> None:
        """One joint command to the left arm."""
        self.say(
            "/robot/limb/left/joint_command",
            f"{CORE}/JointCommand",
            mode=mode,
            names=list(joints),
            command=list(joints.values()),
        )

    def move(self, goal: dict[str, float], tolerance: float = 1e-3) -> None:
        """Send a goal at 100 Hz until the joints are there."""

        def has_arrived() -> bool:
            self.send(goal)
            now = self.joints()
            return all(abs(now[name] - goal[name]) < tolerance for name in goal)

        until(has_arrived)

    def solve(self, T_base_tip: pin.SE3, side: str = "left") -> dict[str, float]:
        x, y, z = T_base_tip.translation.tolist()
        qx, qy, qz, qw = quaternion_xyzw(T_base_tip).tolist()
        orientation = {"x": qx, "y": qy, "z": qz, "w": qw}
        pose = {"position": {"x": x, "y": y, "z": z}, "orientation": orientation}
        service = f"/ExternalTools/{side}/PositionKinematicsNode/IKService"
        stamped = {"header": {"frame_id": "base", "stamp": time.time()}, "pose": pose}
        answer = self.call(service, IK, pose_stamp=[stamped])
        assert answer.isValid.tolist() == [True]
        return dict(zip(answer.joints[0].name, answer.joints[0].position.tolist(), strict=True))
