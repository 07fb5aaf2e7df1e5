"""Publishers: the topics that the simulated Baxter publishes at every tick.

Each topic has one message, which is filled anew while a client is connected; stamps are shared.
Nothing is computed for a topic without readers. Efforts and wrenches are zero, as nothing here has
a mass.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from baxter_kin import quaternion_xyzw
from baxter_kin.kinematics.arm import LIMBS
from baxter_kin.validation import FloatArray
from sim.ros1.definitions import message_type
from sim.ros1.node import Node, Publisher
from sim.ros1.robot.baxter import SimulatedBaxter
from sim.ros1.robot.gripper import ElectricGripper
from sim.ros1.robot.panel import (
    ANALOG_INPUTS,
    ANALOG_OUTPUTS,
    BUTTONS,
    INPUTS,
    LIGHTS,
    NAVIGATORS,
    OUTPUTS,
)
from sim.ros1_messages import Message

CORE = "baxter_core_msgs"
NS = 1_000_000_000

STATE_ID = 131073
"""The id in the state of a hand's end effector, electric or not, to which clients send commands."""

GRIPPER_ID = 65538
ELECTRIC, PASSIVE = 2, 3

ELECTRIC_GRIPPER = {
    "id": GRIPPER_ID,
    "ui_type": ELECTRIC,
    "product": "Electric Parallel Gripper",
    "firmware_rev": "3.0.0 5.5",
    "firmware_date": "2014/7/24 18:30:00",
    "has_calibration": True,
    "controls_grip": True,
    "senses_grip": True,
    "controls_force": True,
    "senses_force": True,
    "controls_position": True,
    "senses_position": True,
}
"""Its firmware is one that the clients of the RSDK 1.2 accept; they check revision and date."""

NO_GRIPPER = {"id": STATE_ID, "ui_type": PASSIVE, "product": "SDK End Effector"}
"""Properties of a hand without a gripper that a Baxter knows."""

UNKNOWN = 2
"""Of states that are else true (1) or false (0)."""

Fill = Callable[[Message], object]
"""Writes the present state into a topic's message."""


class _Topic(NamedTuple):
    publisher: Publisher
    message: Message
    fill: Fill


class Publishers:
    """All topics that are published at every tick."""

    def __init__(self, baxter: SimulatedBaxter, node: Node) -> None:
        """Advertise all topics of a robot by a node."""
        self._baxter, self._node = baxter, node
        self._topics: list[_Topic] = []
        self._stamp = message_type("std_msgs/Header").make(stamp=0.0).stamp
        robot = baxter.world.robot
        self._arms = {s: np.array(robot.indices(robot.arm(s).joint_names)) for s in LIMBS}
        self._q = self._positions()
        self._time_s = baxter.time_s
        self._v = np.zeros_like(self._q)  # of head and fingers; the arms know theirs
        self._add_joints()
        for side in LIMBS:
            self._add_limb(side)
        self._add("/robot/state", f"{CORE}/AssemblyState", self._fill_assembly)
        for side in LIMBS:
            self._add_gripper(side)
        self._add("/robot/head/head_state", f"{CORE}/HeadState", self._fill_head, isPanEnabled=True)
        self._add_panel()

    @property
    def publishers(self) -> tuple[Publisher, ...]:
        """The publisher of each topic."""
        return tuple(topic.publisher for topic in self._topics)

    def publish(self) -> None:
        """Publish the present state on all topics that have readers."""
        self._stamp.sec, self._stamp.nanosec = divmod(time.time_ns(), NS)
        q = self._positions()
        passed_s = self._baxter.time_s - self._time_s  # several ticks where one was late
        if passed_s > 0.0:
            self._v = (q - self._q) / passed_s
            self._q, self._time_s = q, self._baxter.time_s
        for publisher, message, fill in self._topics:
            if publisher.readers:
                fill(message)
                publisher.publish(message)

    def _add(self, topic: str, type_name: str, fill: Fill, **fixed: Any) -> None:
        """Add a topic; `fixed` are the fields that never change."""
        message = message_type(type_name).make(**fixed)
        if hasattr(message, "header"):
            message.header.stamp = self._stamp
        if hasattr(message, "timestamp"):
            message.timestamp = self._stamp
        self._topics.append(_Topic(self._node.advertise(topic, type_name), message, fill))

    def _add_joints(self) -> None:
        robot, kind = self._baxter.world.robot, "sensor_msgs/JointState"
        arm_names = [name for side in LIMBS for name in robot.arm(side).joint_names]
        for topic, fill, names in (
            ("joint_states", self._fill_joints, list(robot.joint_names)),
            ("ref_joint_states", self._fill_targets, arm_names),
        ):
            effort = np.zeros(len(names))
            self._add(f"/robot/{topic}", kind, fill, name=names, effort=effort)

    def _add_limb(self, side: str) -> None:
        limb = f"/robot/limb/{side}"
        fill = partial(self._fill_endpoint, side)
        base = {"frame_id": "base"}
        self._add(f"{limb}/endpoint_state", f"{CORE}/EndpointState", fill, header=base)
        avoidance = f"{CORE}/CollisionAvoidanceState"  # nothing here pushes arms away
        self._add(f"{limb}/collision_avoidance_state", avoidance, lambda _: None)
        fill = partial(self._fill_detection, side)
        self._add(f"{limb}/collision_detection_state", f"{CORE}/CollisionDetectionState", fill)

    def _add_gripper(self, side: str) -> None:
        gripper, topic = self._baxter.grippers.get(side), f"/robot/end_effector/{side}_gripper"
        properties = NO_GRIPPER if gripper is None else ELECTRIC_GRIPPER
        kind = f"{CORE}/EndEffectorProperties"
        self._add(f"{topic}/properties", kind, lambda _: None, **properties)
        flags = ("calibrated", "ready", "moving", "gripping", "missed", "error", "reverse")
        self._add(
            f"{topic}/state",
            f"{CORE}/EndEffectorState",
            (lambda _: None) if gripper is None else partial(_fill_gripper, gripper),
            id=STATE_ID,
            enabled=1,
            **dict.fromkeys(flags, UNKNOWN if gripper is None else 0),
        )

    def _add_panel(self) -> None:
        for name in (*INPUTS, *OUTPUTS):
            topic, kind = f"/robot/digital_io/{name}/state", f"{CORE}/DigitalIOState"
            self._add(topic, kind, partial(self._fill_digital, name), isInputOnly=name in INPUTS)
        for name in (*ANALOG_INPUTS, *ANALOG_OUTPUTS):
            topic, kind = f"/robot/analog_io/{name}/state", f"{CORE}/AnalogIOState"
            is_input = name in ANALOG_INPUTS
            self._add(topic, kind, partial(self._fill_analog, name), isInputOnly=is_input)
        for name in NAVIGATORS:
            self._add(
                f"/robot/navigators/{name}_navigator/state",
                f"{CORE}/NavigatorState",
                partial(self._fill_navigator, name),
                button_names=list(BUTTONS),
                light_names=list(LIGHTS),
            )

    def _positions(self) -> FloatArray:
        """A full configuration, shape (n,), rad and m, with the arms where they report to be."""
        q = self._baxter.world.q
        for side, indices in self._arms.items():
            q[indices] = self._baxter.arms[side].q
        return q

    def _fill_joints(self, message: Message) -> None:
        v = self._v.copy()
        for side, indices in self._arms.items():
            v[indices] = self._baxter.arms[side].v
        message.position = self._q
        message.velocity = v

    def _fill_targets(self, message: Message) -> None:
        arms = [self._baxter.arms[side] for side in LIMBS]
        message.position = np.concatenate([arm.target for arm in arms])
        message.velocity = np.concatenate([arm.target_v for arm in arms])

    def _fill_endpoint(self, side: str, message: Message) -> None:
        motion, arm = self._baxter.arms[side], self._baxter.world.robot.arm(side)
        T_base_tip, pose = arm.T_base_tip(motion.q), message.pose
        p, o = pose.position, pose.orientation
        p.x, p.y, p.z = T_base_tip.translation.tolist()
        o.x, o.y, o.z, o.w = quaternion_xyzw(T_base_tip).tolist()
        linear, angular = message.twist.linear, message.twist.angular
        twist = (arm.jacobian(motion.q) @ motion.v).tolist()
        linear.x, linear.y, linear.z, angular.x, angular.y, angular.z = twist

    def _fill_detection(self, side: str, message: Message) -> None:
        message.collision_state = self._baxter.is_stopped_by_contact(side)

    def _fill_assembly(self, message: Message) -> None:
        state = self._baxter.assembly.state
        message.ready = message.enabled = state.is_enabled
        message.stopped = state.is_stopped
        message.estop_button, message.estop_source = int(state.button), int(state.source)

    def _fill_head(self, message: Message) -> None:
        head = self._baxter.head
        message.pan = head.pan_rad
        message.isTurning, message.isNodding = head.is_turning, head.is_nodding

    def _fill_digital(self, name: str, message: Message) -> None:
        message.state = int(self._baxter.panel.is_on(name))

    def _fill_analog(self, name: str, message: Message) -> None:
        message.value = self._baxter.panel.analog(name)

    def _fill_navigator(self, name: str, message: Message) -> None:
        panel = self._baxter.panel
        message.buttons = np.array(panel.buttons(name))
        message.lights = np.array(panel.lights(name))
        message.wheel = panel.wheel(name)


def _fill_gripper(gripper: ElectricGripper, message: Message) -> None:
    message.calibrated, message.ready = int(gripper.is_calibrated), int(gripper.is_ready)
    fingers, last = gripper.fingers, gripper.last
    message.moving, message.gripping = int(fingers.is_moving), int(fingers.is_gripping)
    message.missed = int(fingers.has_missed)
    message.position, message.force = fingers.percent, gripper.force
    message.command, message.command_sender = last.command, last.sender
    message.command_sequence = last.sequence
    message.state = json.dumps(gripper.parameters)
