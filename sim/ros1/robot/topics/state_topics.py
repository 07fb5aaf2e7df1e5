"""State topics: the robot as a whole, its grippers, head, lights and buttons."""

from __future__ import annotations

import json
from functools import partial

import numpy as np

from baxter_kin.kinematics.arm import LIMBS
from sim.ros1.robot.baxter import SimulatedBaxter
from sim.ros1.robot.parts.electric_gripper import ElectricGripper
from sim.ros1.robot.parts.panel import (
    ANALOG_INPUTS,
    ANALOG_OUTPUTS,
    BUTTONS,
    INPUTS,
    LIGHTS,
    NAVIGATORS,
    OUTPUTS,
    Panel,
)
from sim.ros1.robot.topics.outlet import Outlets
from sim.ros1_messages import Message

CORE = "baxter_core_msgs"

STATE_ID = 131073
"""What the state of a hand's end effector has as its number, electric or not; clients send their
commands to it."""

GRIPPER_ID = 65538
ELECTRIC, PASSIVE = 2, 3

ELECTRIC_GRIPPER = {
    "id": GRIPPER_ID,
    "ui_type": ELECTRIC,
    "manufacturer": "Rethink Research Robot",
    "product": "Electric Parallel Gripper",
    "hardware_rev": "2",
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
"""A firmware that clients of the RSDK 1.2 take as it is."""

NO_GRIPPER = {
    "id": STATE_ID,
    "ui_type": PASSIVE,
    "manufacturer": "Rethink Research Robot",
    "product": "SDK End Effector",
}
"""What a Baxter says of a hand that has nothing it knows."""

UNKNOWN = 2
"""Of what is true (1) or false (0) elsewhere."""


class StateTopics:
    """Tells what the robot says of itself."""

    def __init__(self, baxter: SimulatedBaxter, outlets: Outlets) -> None:
        """Tell of a robot.

        Args:
            baxter: the robot.
            outlets: where.
        """
        self._baxter = baxter
        outlets.add("/robot/state", f"{CORE}/AssemblyState", self._fill_assembly)
        for side in LIMBS:
            self._add_gripper(side, outlets)
        outlets.add("/robot/head/head_state", f"{CORE}/HeadState", self._fill_head)
        for name in (*INPUTS, *OUTPUTS):
            outlets.add(
                f"/robot/digital_io/{name}/state",
                f"{CORE}/DigitalIOState",
                partial(_fill_digital, baxter.panel, name),
                isInputOnly=name in INPUTS,
            )
        for name in (*ANALOG_INPUTS, *ANALOG_OUTPUTS):
            outlets.add(
                f"/robot/analog_io/{name}/state",
                f"{CORE}/AnalogIOState",
                partial(_fill_analog, baxter.panel, name),
                isInputOnly=name in ANALOG_INPUTS,
            )
        for name in NAVIGATORS:
            outlets.add(
                f"/robot/navigators/{name}_navigator/state",
                f"{CORE}/NavigatorState",
                partial(_fill_navigator, baxter.panel, name),
                button_names=list(BUTTONS),
                light_names=list(LIGHTS),
            )

    def _add_gripper(self, side: str, outlets: Outlets) -> None:
        gripper = self._baxter.grippers.get(side)
        topic = f"/robot/end_effector/{side}_gripper"
        outlets.add(
            f"{topic}/properties",
            f"{CORE}/EndEffectorProperties",
            lambda _: None,
            **(NO_GRIPPER if gripper is None else ELECTRIC_GRIPPER),
        )
        unknown = ("calibrated", "ready", "moving", "gripping", "missed", "error", "reverse")
        outlets.add(
            f"{topic}/state",
            f"{CORE}/EndEffectorState",
            (lambda _: None) if gripper is None else partial(_fill_gripper, gripper),
            id=STATE_ID,
            enabled=1,
            **dict.fromkeys(unknown, UNKNOWN if gripper is None else 0),
        )

    def _fill_assembly(self, message: Message) -> None:
        state = self._baxter.assembly.state
        message.ready = message.enabled = state.is_enabled
        message.stopped = state.is_stopped
        message.estop_button, message.estop_source = int(state.button), int(state.source)

    def _fill_head(self, message: Message) -> None:
        head = self._baxter.head
        message.pan, message.isPanEnabled = head.pan_rad, head.is_pan_enabled
        message.isTurning, message.isNodding = head.is_turning, head.is_nodding


def _fill_gripper(gripper: ElectricGripper, message: Message) -> None:
    message.calibrated, message.ready = int(gripper.is_calibrated), int(gripper.is_ready)
    message.moving, message.gripping = int(gripper.is_moving), int(gripper.is_gripping)
    message.missed = int(gripper.has_missed)
    message.position, message.force = gripper.percent, gripper.force
    last = gripper.last
    message.command, message.command_sender = last.command, last.sender
    message.command_sequence = last.sequence
    message.state = json.dumps(gripper.parameters)


def _fill_digital(panel: Panel, name: str, message: Message) -> None:
    message.state = int(panel.is_on(name))


def _fill_analog(panel: Panel, name: str, message: Message) -> None:
    message.value = panel.analog(name)


def _fill_navigator(panel: Panel, name: str, message: Message) -> None:
    message.buttons = np.array(panel.buttons(name))
    message.lights = np.array(panel.lights(name))
    message.wheel = panel.wheel(name)
