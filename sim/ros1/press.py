"""`python -m sim.ros1.press left ok`: press a button of the simulated Baxter.

It publishes once on `/robot/sim/press`, our own topic, which a real Baxter does not have. `ok`,
`cancel` and `show` of the navigator, and `cuff`, `circle` and `dash` of the cuff are pressed for
half a second, the emergency stop `estop` until `release`; the robot stays stopped until `reset`,
which is no button but what `enable_robot.py -r` of the RSDK does. `wheel` turns that of the
navigator by one notch.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NoReturn

from baxter_kin.command_line import command, option, parse, run_process
from baxter_kin.kinematics.arm import LIMBS
from sim.ros1.node import Node
from sim.ros1.robot.panel import PRESSABLE
from sim.ros1.robot.subscribers import PRESS_TOPIC
from sim.ros1.terminal import EXIT_FAILED, EXIT_STATUS, SIMULATED, Terminal

TERMINAL = Terminal("baxter-press")
CONNECTED_S = 2.0
"""How long the robot may take to connect."""

SENT_S = 0.2
"""How long a message may take to be read before the node is gone."""

POLL_S = 0.01


@command(
    TERMINAL.name,
    "Press a button of the simulated Baxter on the master of ROS_MASTER_URI.",
    examples=(
        "python -m sim.ros1.press left ok",
        "python -m sim.ros1.press left estop",
        "python -m sim.ros1.press left release",
        "python -m sim.ros1.press left reset",
    ),
    end=EXIT_STATUS.format(done="0 pressed; 1 no robot received it"),
)
@dataclass(frozen=True, slots=True, kw_only=True)
class PressOptions:
    """Which button to press."""

    side: str = option(choices=LIMBS, help="of which arm; the emergency stop has no side")
    button: str = option(choices=(*PRESSABLE, "estop", "release", "reset"), help="which button")


def main(argv: Sequence[str] | None = None) -> int:
    """Press it; returns the exit status."""
    options = parse(PressOptions, argv)
    return TERMINAL.ended(lambda _: _pressed(f"{options.side} {options.button}"))


def _pressed(text: str) -> int:
    with Node(f"/press_{os.getpid()}") as node:
        if _press(node, text):
            return 0
    return TERMINAL.complain(
        f"no simulated Baxter listens to {PRESS_TOPIC}; start one: {SIMULATED}"
    )


def _press(node: Node, text: str) -> bool:
    """Whether a simulated Baxter has received it."""
    publisher = node.advertise(PRESS_TOPIC, "std_msgs/String")
    end_s = time.monotonic() + CONNECTED_S
    while not publisher.readers:
        if time.monotonic() > end_s:
            return False
        time.sleep(POLL_S)
    publisher.publish(publisher.type.make(data=text))
    time.sleep(SENT_S)
    return True


def run() -> NoReturn:
    """Run it as a program of its own."""
    run_process(main, TERMINAL.name, failed=EXIT_FAILED)


if __name__ == "__main__":
    run()
